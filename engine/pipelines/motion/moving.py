"""A motion of an arm between two named ends: what a person names becomes configurations, and a planner joins them."""

from dataclasses import dataclass, replace

import numpy as np

from engine.model.geometry import Floats
from engine.model.motion import Answer, Moved, Query, Strategy
from engine.pipelines.planning import initial_facts
from engine.plugins import geometry_backend
from engine.stages.geometry import transforms
from engine.stages.geometry.collision.ground import Ground
from engine.stages.geometry.pictures.view import cell_of
from engine.stages.geometry.reach.hand import ArmHand
from engine.stages.geometry.reach.reach import Reachability, Unreached
from engine.stages.geometry.world.following import following
from engine.stages.geometry.world.model import World
from engine.stages.motion.planner import plan
from engine.stages.motion.trajectory import Limits, Trajectory, fastest
from kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from kb.loader.configuration import read_configuration
from kb.model.cell import Cell, Place, Placement
from kb.model.shapes import Pose

HOME, POINT = "home", "point"
UNKNOWN_SPEED = 1.0  # rad/s or m/s
SWIFT = 4.0  # 1/s: of a joint whose acceleration is unknown: full speed after a quarter of a second
ABRUPT = 10.0  # 1/s: full acceleration after a tenth of a second


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """A planned motion of one arm; the answer's configurations are those of all joints of the world.

    `joints` names the arm's joints, `first` is the number of the first of them in the world.
    """

    world: World
    arm: str
    answer: Answer
    first: int
    joints: tuple[str, ...]

    def path(self) -> Floats:
        """The arm's own configurations on the path (m, k); none where there is no path."""
        if not isinstance(self.answer, Moved):
            return np.zeros((0, len(self.joints)))
        return self.answer.path[:, self.first : self.first + len(self.joints)]

    def trajectory(self) -> Trajectory:
        """The least times on the path, within what the arm's file says of its joints, and else what is assumed of them."""
        joints = self.world.models[self.arm].arm.joints
        speed = np.array([joint.speed or UNKNOWN_SPEED for joint in joints])
        rated = [joint.acceleration or SWIFT * full for joint, full in zip(joints, speed, strict=True)]
        return fastest(self.path(), Limits(speed, np.array(rated), np.array(rated) * ABRUPT))


@dataclass(frozen=True, slots=True, eq=False)
class _End:
    """One end of a motion: configurations (n, k) of an arm, and the place that they belong to, if there is one."""

    arm: str
    configurations: Floats
    place: Place | None = None


def move(
    target: str,
    start: str,
    goal: str,
    margin_m: float = 0.0,
    seed: int = 0,
    bridges: int = 60,
    strategy: Strategy = Strategy.CONNECT,
) -> Motion:
    """The motion in the cell of a target between two ends, each named as `end_of` says.

    The tool of a place is in the hand all the way. Raises `InvalidInput` for what cannot be read, and for places out of reach.
    """
    cell = cell_of(target)
    world = following(World.of(cell), initial_facts(target))
    reach = Reachability(world, geometry_backend())
    ends = [end_of(text, option, reach, world) for text, option in ((start, "--from"), (goal, "--to"))]
    if ends[0].arm != ends[1].arm:
        message = f"{ends[0].arm} starts, but {ends[1].arm} arrives"
        raise InvalidInput([Diagnostic(Source("--to"), "K409", message, "name ends of one arm")])
    place = _carried(ends[0], ends[1])
    ground = Ground(reach.checker(place))
    here = reach.whole(place, _nearest_first(ends[0].configurations, world.configurations[place.arm]))[0]
    first, count = world.first_carriers[place.arm], world.models[place.arm].joints.count
    query = Query(
        here,
        reach.whole(place, ends[1].configurations),
        margin_m=margin_m,
        seed=seed,
        bridges=bridges,
        moving=tuple(range(first, first + count)),
        strategy=strategy,
    )
    hand = ArmHand(world, ground.scene, place.arm, reach.flange_to_end(place))
    names = tuple(joint.name for joint in world.models[place.arm].arm.joints)
    return Motion(world, place.arm, plan(ground, query, hand), first, names)


def _nearest_first(configurations: Floats, now: Floats) -> Floats:
    """The configurations (n, k), those first that are nearest to where the arm is."""
    found: Floats = configurations[np.argsort(np.abs(configurations - now).max(axis=1), kind="stable")]
    return found


def end_of(text: str, option: str, reach: Reachability, world: World) -> _End:
    """What a person names: `home`, a place of the cell, `point X, Y, Z` in the world, or joint values.

    At a point the tool is turned as it is now. Raises `InvalidInput`.
    """
    cell, said = world.cell, text.strip()
    head, _, rest = said.partition(" ")
    if said == HOME or said.removesuffix(f".{HOME}") in cell.arms:
        arm = _arm(said.removesuffix(HOME).removesuffix("."), cell, option)
        return _End(arm, world.configurations[arm][None])
    if said in cell.places:
        return _reached(cell.places[said], said, option, reach)
    if head == POINT:
        return _reached(_place_at(rest, world, option), said, option, reach)
    if not any(each.isdigit() for each in said) or "(" in said:
        known = {*cell.places, HOME}
        raise InvalidInput([unknown_name("place", said, known, Source(option))])
    arm, values = read_configuration(said, cell, option)
    return _End(arm, np.array(values)[None])


def _arm(name: str, cell: Cell, option: str) -> str:
    if not cell.arms:
        raise InvalidInput([Diagnostic(Source(option), "K405", "the cell has no arms", "give it one")])
    return name or next(iter(cell.arms))


def _reached(place: Place, name: str, option: str, reach: Reachability) -> _End:
    answer = reach.at(place)
    if isinstance(answer, Unreached):
        message = f"no configuration reaches {name}: {answer.reason}"
        raise InvalidInput([Diagnostic(Source(option), "K705", message, answer.hint)])
    return _End(place.arm, answer.q, place)


def _place_at(text: str, world: World, option: str) -> Place:
    """A place for the tool of the first arm at `X, Y, Z`, in metres in the world."""
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        x = y = z = float("nan")
    if not np.isfinite([x, y, z]).all():
        hint = "write it as: point 0.4, -0.2, 0.8"
        raise InvalidInput([Diagnostic(Source(option), "K406", f"'{text}' is no point", hint)])
    arm = _arm("", world.cell, option)
    turned = transforms.to_pose(world.pose("world", f"{arm}.tool"))
    return Place(f"point {text}", Placement("world", Pose((x, y, z), turned.rpy_rad)), arm)


def _carried(start: _End, goal: _End) -> Place:
    """A place whose tool is in hand on the way, and with the contacts that both ends allow. Raises `InvalidInput`."""
    places = [end.place for end in (start, goal) if end.place is not None]
    tools = sorted({place.tool for place in places if place.tool})
    if len(tools) > 1:
        message = f"the ends need two tools: {tools[0]} and {tools[1]}"
        raise InvalidInput([Diagnostic(Source("--to"), "K409", message, "plan a motion for each tool")])
    touches = tuple(dict.fromkeys(name for place in places for name in place.touches))
    blank = Place("", Placement(), start.arm)
    return replace(blank, tool=tools[0] if tools else "", touches=touches)
