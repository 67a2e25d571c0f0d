"""The ends of a motion as configurations, and its legs: straight out, free way, straight in."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.geometry.proof import proved
from cellwright.engine.kernels.linear import matmul
from cellwright.engine.model.motion_values import FINEST_M, Answer, Moved, PathQuery
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.collision.planning_scene import PlanningScene
from cellwright.engine.stages.geometry.reach.arm_hand import ArmHand, BrokenLine, straight_line
from cellwright.engine.stages.geometry.reach.place_reachability import (
    PlaceReachability,
    UnreachedPlace,
)
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.engine.stages.motion.path_planner import try_path
from cellwright.engine.stages.motion.path_proofs import BodyTouch, touches_on_path
from cellwright.engine.stages.motion.timed_paths import MotionTube
from cellwright.engine.stages.motion.upright_planner import UprightLevel
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from cellwright.kb.loader.joint_values import read_configuration
from cellwright.kb.model.body_shapes import Pose
from cellwright.kb.model.cell_model import Cell, Place, Placement

HOME, POINT, POSE, TURNS = "home", "point", "pose", "turns"
END_FORMS = {POINT: (3, "point 0.4, -0.2, 0.8"), POSE: (6, "pose 0.4, -0.2, 0.8, 180, 0, 90")}


@dataclass(frozen=True, slots=True, eq=False)
class MotionEnd:
    """One end of a motion: its name, configurations (n, k) of an arm, and the place that they
    belong to, if there is one.
    """

    name: str
    arm: str
    configurations: Floats
    place: Place | None = None


def end_of(
    text: str, option: str, reach: PlaceReachability, world: GeometricWorld, tool: str = ""
) -> MotionEnd:
    """What a person names: `home`, a place of the cell, a point or pose in the world, or joint
    values.

    At `point X, Y, Z` the tool is turned as it is now; at `pose X, Y, Z, ROLL, PITCH, YAW` (m,
    degrees) as it is said. With `turns` behind either, it may turn about its own z. Raises
    `InvalidInput`.
    """
    cell, spelled = world.cell, text.strip()
    head, _, rest = spelled.partition(" ")
    if spelled == HOME or spelled.removesuffix(f".{HOME}") in cell.arms:
        arm = arm_named(spelled.removesuffix(HOME).removesuffix("."), cell, option)
        return MotionEnd(spelled, arm, world.configurations[arm][None])
    if spelled in cell.places:
        return _reached_end(cell.places[spelled], spelled, option, reach)
    if head in END_FORMS:
        return _reached_end(_place_at(head, rest, world, option, tool), spelled, option, reach)
    if not any(character.isdigit() for character in spelled) or "(" in spelled:
        known_ends = [HOME, *cell.places]
        raise InvalidInput([unknown_name("place", spelled, known_ends, Source(option))])
    arm, values = read_configuration(spelled, cell, option)
    return MotionEnd(spelled, arm, np.array(values)[None])


def arm_named(name: str, cell: Cell, option: str) -> str:
    """The arm of a name, or the first one of the cell.

    Raises `InvalidInput` for a cell without arms.
    """
    if not cell.arms:
        raise InvalidInput(
            [Diagnostic(Source(option), "K405", "the cell has no arms", "give it one")]
        )
    return name or next(iter(cell.arms))


def _reached_end(place: Place, name: str, option: str, reach: PlaceReachability) -> MotionEnd:
    answer = reach.at(place)
    if isinstance(answer, UnreachedPlace):
        message = f"no configuration reaches {name}: {answer.reason}"
        raise InvalidInput([Diagnostic(Source(option), "K705", message, answer.hint)])
    # Libraries for matrices round differently on each processor. The last digits, where that shows,
    # are cut off.
    return MotionEnd(name, place.arm, np.round(answer.q, 12), place)


def _place_at(head: str, text: str, world: GeometricWorld, option: str, tool: str) -> Place:
    """A place for the tool of the first arm, at a point or pose in the world."""
    turns = text.rstrip().endswith(TURNS)
    count, example = END_FORMS[head]
    try:
        values = [float(part) for part in text.rstrip().removesuffix(TURNS).split(",")]
    except ValueError:
        values = []
    if len(values) != count or not np.isfinite(values).all():
        message, hint = (
            f"'{text}' is no {head}",
            f"write it as: {example}, or with 'turns' behind it",
        )
        raise InvalidInput([Diagnostic(Source(option), "K406", message, hint)])
    arm = arm_named("", world.cell, option)
    rpy = np.radians(values[3:]) if head == POSE else _turned_now(world, arm, tool)
    x, y, z, roll, pitch, yaw = map(float, (*values[:3], *rpy))
    return Place(
        head, Placement("world", Pose((x, y, z), (roll, pitch, yaw))), arm, tool, turns=turns
    )


def _turned_now(world: GeometricWorld, arm: str, tool: str) -> tuple[float, float, float]:
    """Roll, pitch and yaw of the tool as it is now, or of the tip of what will be in hand."""
    T = world.pose("world", f"{arm}.tool")
    if tool:
        tip = transforms.of_pose(world.cell.bodies[tool].features["tip"])
        T = matmul(T, transforms.inverse(world.grip(tool)), tip)
    return transforms.to_pose(T).rpy_rad


def carried_place(start: MotionEnd, goals: Sequence[MotionEnd], tool: str = "") -> Place:
    """A place whose tool is in hand on the way, and with the contacts that ends without an approach
    allow.

    Raises `InvalidInput` for ends of several arms or tools.
    """
    places = [end.place for end in (start, *goals) if end.place is not None]
    tools = sorted({place.tool for place in places if place.tool} | ({tool} if tool else set()))
    if len(tools) > 1:
        message = f"the ends need two tools: {tools[0]} and {tools[1]}"
        raise InvalidInput(
            [Diagnostic(Source("--to"), "K409", message, "plan a motion for each tool")]
        )
    for goal in goals:
        if goal.arm != start.arm:
            message = f"{start.arm} starts, but {goal.arm} arrives"
            raise InvalidInput(
                [Diagnostic(Source("--to"), "K409", message, "name ends of one arm")]
            )
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


MAX_TRIED_LINES = 32  # configurations of a place from which a line is tried
LINE_LOOKS = 8  # configurations of a line that are looked at between two
FURTHER_SEARCH_SHARE = 10  # a search after the first one has this part of the budget
RETRACT, FREE, APPROACH = "retract", "free", "approach"


@dataclass(frozen=True, slots=True, eq=False)
class MotionLeg:
    """A part of a motion: its configurations (m, k), whether it is proved, on what ground, and what
    touches on it.

    The pairs of `meeting` may overlap by `depth_m`.
    """

    kind: str
    path: Floats
    proved: bool
    ground: PlanningScene
    margin_m: float = 0.0
    touches: tuple[BodyTouch, ...] = ()
    meeting: PlanningScene | None = None
    depth_m: float = 0.0

    def tube(self, level: UprightLevel | None) -> MotionTube:
        """What a motion near this path must keep, to be as safe as the path."""
        return MotionTube(self.ground, self.margin_m, FINEST_M, self.meeting, self.depth_m, level)


@dataclass(frozen=True, slots=True, eq=False)
class LegDepartures:
    """Where the free part of a motion may begin or end: configurations (n, k) and, for each, the
    line to it from its place.

    A line is None for an end that has no approach.
    """

    configurations: Floats
    lines: tuple[Floats | None, ...]
    place: Place | None


def lines_out(
    end: MotionEnd, whole: Floats, reach: PlaceReachability, hand: ArmHand, option: str
) -> LegDepartures:
    """The straight lines out of a place, from its configurations (n, k), until `LINES` are tried.

    Lines on which something that may touch was seen deeper than the place's `depth` are left out,
    unless there are no others. Raises `InvalidInput` if every line breaks, with the reason for the
    first.
    """
    if end.place is None or end.place.approach_m == 0.0:
        return LegDepartures(whole, (None,) * len(whole), end.place)
    place, ground = end.place, PlanningScene(reach.checker(end.place))
    lines, why = [], ""
    for q in whole[:MAX_TRIED_LINES]:
        line = _line_out(end.name, place, ground, hand, q)
        if isinstance(line, str):
            why = why or line
        else:
            lines.append(line)
    if not lines:
        hint = "give another `approach` or `rpy`, or let the tool turn with `turns: true`"
        raise InvalidInput([Diagnostic(Source(option), "K705", why, hint)])
    meant = reach.shallow(place)
    free_lines = [line for line in lines if not meant.collides(_line_samples(line)).any()] or lines
    return LegDepartures(np.array([line[-1] for line in free_lines]), tuple(free_lines), place)


def _line_out(
    name: str, place: Place, ground: PlanningScene, hand: ArmHand, q: Floats
) -> Floats | str:
    """The straight line (m, k) out of a place from a configuration (k,), or why there is none."""
    T_back = matmul(hand.poses(q[None])[0], transforms.translation(0.0, 0.0, -place.approach_m))
    line = straight_line(hand, q, T_back)
    if isinstance(line, BrokenLine):
        away = f"{line.share * place.approach_m * 1000:.0f} mm from it"
        return f"the straight line out of {name} breaks {away}: {line.why}"
    if proved(ground.proof(0.0, FINEST_M), line) < len(line) - 1:
        return _what_blocks(ground, line, name)
    return line


def _line_samples(line: Floats) -> Floats:
    """The configurations of a line (m, k), and some between them."""
    shares = np.linspace(0.0, 1.0, LINE_LOOKS)[:, None]
    return np.concatenate([a + shares * (b - a) for a, b in pairwise(line)])


def _touch_ground(place: Place, reach: PlaceReachability) -> PlanningScene | None:
    """The pairs that may touch at a place; None if there are none."""
    return PlanningScene(reach.meeting(place)) if place.touches else None


def _path_touches(path: Floats, place: Place, reach: PlaceReachability) -> tuple[BodyTouch, ...]:
    """What touches on a path (m, k) as a place allows, pair by pair."""
    meant = _touch_ground(place, reach)
    return () if meant is None else touches_on_path(meant, path, place.depth_m)


def shallower_answer(
    answer: Answer, query: PathQuery, place: Place, reach: PlaceReachability, hand: ArmHand
) -> Answer:
    """The answer, or one whose path keeps what may touch within the place's `depth`, if the first
    does not and there is one.

    The first search does not know of depths, because that makes it many times as fast.
    """
    if not isinstance(answer, Moved) or all(
        touch.proved for touch in _path_touches(answer.path, place, reach)
    ):
        return answer
    ground = PlanningScene(reach.shallow(place))
    for finer in (1, 4, 16):
        budget, step = max(1, query.budget // FURTHER_SEARCH_SHARE), query.step / finer
        again = try_path(ground, replace(query, budget=budget, step=step), hand)
        if not isinstance(again, Moved):
            break
        if again.proved and all(touch.proved for touch in _path_touches(again.path, place, reach)):
            return again
    return answer


def _what_blocks(ground: PlanningScene, line: Floats, name: str) -> str:
    proof = ground.proof(0.0, FINEST_M)
    n = proved(proof, line)
    at = line[n] + proof.where * (line[n + 1] - line[n])
    contacts = ground.contacts(at, 0.001)
    message = (
        f"{contacts[0].first} comes too near to {contacts[0].second}"
        if contacts
        else "something is too near"
    )
    return f"on the straight line out of {name}, {message}"


def leg_of(kind: str, line: Floats, place: Place, reach: PlaceReachability) -> MotionLeg:
    """The leg of a line out of a place (m, k), or into it, with what touches on it by intention."""
    path = line if kind == RETRACT else line[::-1].copy()
    pairs = _path_touches(path, place, reach)
    proved_all = all(pair.proved for pair in pairs)
    leg = MotionLeg(kind, path, proved_all, PlanningScene(reach.checker(place)), touches=pairs)
    return replace(leg, meeting=_touch_ground(place, reach), depth_m=place.depth_m)


def free_leg(blank: MotionLeg, answer: Moved, place: Place, reach: PlaceReachability) -> MotionLeg:
    """The leg of a free path, with what touches on it because an end without a straight line
    allows it.
    """
    pairs = _path_touches(answer.path, place, reach)
    sure = answer.proved and all(pair.proved for pair in pairs)
    meant = _touch_ground(place, reach)
    return replace(
        blank, path=answer.path, proved=sure, touches=pairs, meeting=meant, depth_m=place.depth_m
    )
