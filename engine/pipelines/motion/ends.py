"""The ends of a motion: what a person names becomes configurations of an arm."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.kernels.linear import matmul
from cellwright.engine.model.geometry import Floats
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.reach.reach import Reachability, Unreached
from cellwright.engine.stages.geometry.world.model import World
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from cellwright.kb.loader.configuration import read_configuration
from cellwright.kb.model.cell import Cell, Place, Placement
from cellwright.kb.model.shapes import Pose

HOME, POINT, POSE, TURNS = "home", "point", "pose", "turns"
FORMS = {POINT: (3, "point 0.4, -0.2, 0.8"), POSE: (6, "pose 0.4, -0.2, 0.8, 180, 0, 90")}


@dataclass(frozen=True, slots=True, eq=False)
class End:
    """One end of a motion: its name, configurations (n, k) of an arm, and the place that they belong to, if there is one."""

    name: str
    arm: str
    configurations: Floats
    place: Place | None = None


def end_of(text: str, option: str, reach: Reachability, world: World, tool: str = "") -> End:
    """What a person names: `home`, a place of the cell, a point or pose in the world, or joint values.

    At `point X, Y, Z` the tool is turned as it is now; at `pose X, Y, Z, ROLL, PITCH, YAW` (m, degrees) as it is said. With
    `turns` behind either, it may turn about its own z. Raises `InvalidInput`.
    """
    cell, said = world.cell, text.strip()
    head, _, rest = said.partition(" ")
    if said == HOME or said.removesuffix(f".{HOME}") in cell.arms:
        arm = arm_named(said.removesuffix(HOME).removesuffix("."), cell, option)
        return End(said, arm, world.configurations[arm][None])
    if said in cell.places:
        return _reached(cell.places[said], said, option, reach)
    if head in FORMS:
        return _reached(_place_at(head, rest, world, option, tool), said, option, reach)
    if not any(each.isdigit() for each in said) or "(" in said:
        known = [HOME, *cell.places]
        raise InvalidInput([unknown_name("place", said, known, Source(option))])
    arm, values = read_configuration(said, cell, option)
    return End(said, arm, np.array(values)[None])


def arm_named(name: str, cell: Cell, option: str) -> str:
    """The arm of a name, or the first one of the cell. Raises `InvalidInput` for a cell without arms."""
    if not cell.arms:
        raise InvalidInput([Diagnostic(Source(option), "K405", "the cell has no arms", "give it one")])
    return name or next(iter(cell.arms))


def _reached(place: Place, name: str, option: str, reach: Reachability) -> End:
    answer = reach.at(place)
    if isinstance(answer, Unreached):
        message = f"no configuration reaches {name}: {answer.reason}"
        raise InvalidInput([Diagnostic(Source(option), "K705", message, answer.hint)])
    # Libraries for matrices round differently on each processor. The last digits, where that shows, are cut off.
    return End(name, place.arm, np.round(answer.q, 12), place)


def _place_at(head: str, text: str, world: World, option: str, tool: str) -> Place:
    """A place for the tool of the first arm, at a point or pose in the world."""
    turns = text.rstrip().endswith(TURNS)
    count, example = FORMS[head]
    try:
        values = [float(part) for part in text.rstrip().removesuffix(TURNS).split(",")]
    except ValueError:
        values = []
    if len(values) != count or not np.isfinite(values).all():
        message, hint = f"'{text}' is no {head}", f"write it as: {example}, or with 'turns' behind it"
        raise InvalidInput([Diagnostic(Source(option), "K406", message, hint)])
    arm = arm_named("", world.cell, option)
    rpy = np.radians(values[3:]) if head == POSE else _turned_now(world, arm, tool)
    x, y, z, roll, pitch, yaw = map(float, (*values[:3], *rpy))
    return Place(head, Placement("world", Pose((x, y, z), (roll, pitch, yaw))), arm, tool, turns=turns)


def _turned_now(world: World, arm: str, tool: str) -> tuple[float, float, float]:
    """Roll, pitch and yaw of the tool as it is now, or of the tip of what will be in hand."""
    T = world.pose("world", f"{arm}.tool")
    if tool:
        tip = transforms.of_pose(world.cell.bodies[tool].features["tip"])
        T = matmul(T, transforms.inverse(world.grip(tool)), tip)
    return transforms.to_pose(T).rpy_rad


def carried(start: End, goals: Sequence[End], tool: str = "") -> Place:
    """A place whose tool is in hand on the way, and with the contacts that ends without an approach allow.

    Raises `InvalidInput` for ends of several arms or tools.
    """
    places = [end.place for end in (start, *goals) if end.place is not None]
    tools = sorted({place.tool for place in places if place.tool} | ({tool} if tool else set()))
    if len(tools) > 1:
        message = f"the ends need two tools: {tools[0]} and {tools[1]}"
        raise InvalidInput([Diagnostic(Source("--to"), "K409", message, "plan a motion for each tool")])
    for goal in goals:
        if goal.arm != start.arm:
            message = f"{start.arm} starts, but {goal.arm} arrives"
            raise InvalidInput([Diagnostic(Source("--to"), "K409", message, "name ends of one arm")])
    near = [place for place in places if place.approach_m == 0.0]
    allowed = tuple(dict.fromkeys(name for place in near for name in place.touches))
    blank = Place("", Placement(), start.arm)
    depth_m = min((place.depth_m for place in near if place.touches), default=blank.depth_m)
    return replace(blank, tool=tools[0] if tools else "", touches=allowed, depth_m=depth_m)


def tool_of(text: str, cell: Cell) -> str:
    """The tool of an option. Raises `InvalidInput` for a body without a tip."""
    tools = {name for name, body in cell.bodies.items() if "tip" in body.features}
    if text and text not in tools:
        raise InvalidInput([unknown_name("tool with a `tip`", text, tools, Source("--tool"))])
    return text
