"""Plans the motion of one arm from a named start to one of several named goals."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.motion_values import Answer, Blocked, Moved, PathQuery, Strategy
from cellwright.engine.pipelines.motion.leg_timing import TimedLegs, time_legs, zones_of
from cellwright.engine.pipelines.motion.motion_legs import (
    APPROACH,
    FREE,
    FURTHER_SEARCH_SHARE,
    MAX_TRIED_LINES,
    RETRACT,
    LegDepartures,
    MotionEnd,
    MotionLeg,
    carried_place,
    end_of,
    free_leg,
    leg_of,
    lines_out,
    shallower_answer,
    tool_of,
)
from cellwright.engine.pipelines.planning.target_files import initial_facts
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.stages.geometry.collision.planning_scene import PlanningScene
from cellwright.engine.stages.geometry.reach.arm_hand import ArmHand
from cellwright.engine.stages.geometry.reach.place_reachability import PlaceReachability
from cellwright.engine.stages.geometry.world.geometric_world import (
    GeometricWorld,
    world_after_facts,
)
from cellwright.engine.stages.motion.path_planner import plan_path, try_path
from cellwright.engine.stages.motion.path_refinement import refine_and_prove
from cellwright.engine.stages.motion.timed_paths import JointLimits
from cellwright.engine.stages.motion.upright_planner import UprightLevel
from cellwright.kb.loader.cell import cell_of
from cellwright.kb.model.cell_model import Place

UNKNOWN_JOINT_SPEED = 1.0  # rad/s or m/s
# 1/s: of a joint whose acceleration is unknown: full speed after a quarter of a second
SWIFT_PER_S = 4.0
ABRUPT_PER_S = 10.0  # 1/s: full acceleration after a tenth of a second


@dataclass(frozen=True, slots=True)
class MotionWish:
    """What is asked of a motion beside its ends.

    `bridges` are the short cuts tried. With `direct` there are no straight lines out of places and
    into them. `tool` is in hand where no place says what is.
    """

    margin_m: float = 0.0
    seed: int = 0
    bridges: int = 60
    strategy: Strategy = Strategy.CONNECT
    direct: bool = False
    tool: str = ""
    smooth: bool = True
    refine: int = 0
    upright_rad: float = 0.0
    budget: int = 1_000_000


@dataclass(frozen=True, slots=True, eq=False)
class ArmMotion:
    """A planned motion of one arm, in legs; configurations are those of all joints of the world.

    `joints` names the arm's joints, `own` are their numbers in the world. `goal` names the end
    reached, `start` (all joints,) is where the planner started, on `ground`, with `hand`.
    """

    world: GeometricWorld
    arm: str
    answer: Answer
    own: slice
    joints: tuple[str, ...]
    legs: tuple[MotionLeg, ...]
    goal: str
    times: TimedLegs
    start: Floats
    ground: PlanningScene
    hand: ArmHand

    def whole(self) -> Floats:
        """The configurations (m, all joints) of the world on the path; none where there is no
        path.
        """
        if not self.legs:
            return np.zeros((0, self.world.joints.count))
        return np.concatenate([self.legs[0].path[:1], *(leg.path[1:] for leg in self.legs)])

    def path(self) -> Floats:
        """The arm's own configurations on the path (m, k); none where there is no path."""
        return self.whole()[:, self.own]

    @property
    def slides(self) -> tuple[bool, ...]:
        """Which of the arm's joints slide."""
        return tuple(map(bool, self.world.models[self.arm].joints.prismatic))

    @property
    def proved(self) -> bool:
        """Whether every leg is."""
        return all(leg.proved for leg in self.legs)


def limits_of(world: GeometricWorld, arm: str) -> JointLimits:
    """What the arm's file says that its joints can do, and else what is assumed of them."""
    joints = world.models[arm].arm.joints
    speed = np.array([joint.speed or UNKNOWN_JOINT_SPEED for joint in joints])
    rated = [
        joint.acceleration or SWIFT_PER_S * full for joint, full in zip(joints, speed, strict=True)
    ]
    return JointLimits(speed, np.array(rated), np.array(rated) * ABRUPT_PER_S)


@dataclass(frozen=True, slots=True, eq=False)
class MotionSite:
    """A cell in which motions are planned; what is packed for one motion serves the next."""

    world: GeometricWorld
    reach: PlaceReachability

    @classmethod
    def of(cls, target: str) -> "MotionSite":
        """The cell of a target, with its bodies where the facts put them. Raises `InvalidInput`."""
        world = world_after_facts(GeometricWorld.of(cell_of(target)), initial_facts(target))
        return cls(world, PlaceReachability(world, geometry_backend()))


def plan_named_motion(
    site: MotionSite, start: str, goals: Sequence[str], wish: MotionWish = MotionWish()
) -> ArmMotion:
    """The motion from one end to one of several, each named as `end_of` says.

    The tool of a place is in the hand all the way. Raises `InvalidInput` for what cannot be read,
    and for places out of reach.
    """
    begin, *arrive = _ends_of_motion(site, start, goals, wish)
    place = carried_place(begin, arrive, wish.tool)
    ground = PlanningScene(site.reach.checker(place))
    hand = ArmHand(site.world, ground.scene, place.arm, site.reach.flange_to_end(place))
    limits = limits_of(site.world, place.arm)
    now = site.world.configurations[place.arm]
    out, *_ = _ends_departures(site, hand, "--from", [begin], now, limits)
    ins = _ends_departures(site, hand, "--to", arrive, out.configurations[0][hand.own], limits)
    first, query, answer = _search_starts(ground, hand, out, ins, wish)
    if wish.refine and not wish.upright_rad and isinstance(answer, Moved):
        speeds = np.ones(site.world.joints.count)
        speeds[hand.own] = limits.speed
        answer = refine_and_prove(ground, query, answer, speeds, wish.refine).found
    answer = shallower_answer(answer, query, place, site.reach, hand)
    names = tuple(joint.name for joint in site.world.models[place.arm].arm.joints)
    blank = MotionLeg(FREE, query.start[None], False, ground, wish.margin_m)
    free = free_leg(blank, answer, place, site.reach) if isinstance(answer, Moved) else None
    legs, n = _answer_legs(answer, free, (out.lines[first], out.place), ins, site.reach)
    level = UprightLevel.at(hand, query.start, wish.upright_rad) if wish.upright_rad else None
    times = time_legs(legs, limits, hand.own, zones_of(site.world, ground), wish.smooth, level)
    goal = arrive[n].name
    return ArmMotion(
        site.world, place.arm, answer, hand.own, names, legs, goal, times, query.start, ground, hand
    )


def _ends_of_motion(
    site: MotionSite, start: str, goals: Sequence[str], wish: MotionWish
) -> list[MotionEnd]:
    """The start, and then the goals; without approaches if the motion is to be direct."""
    tool = tool_of(wish.tool, site.world.cell)
    ends = [end_of(start, "--from", site.reach, site.world, tool)]
    ends += [end_of(goal, "--to", site.reach, site.world, tool) for goal in goals]
    if not wish.direct:
        return ends
    return [replace(end, place=end.place and replace(end.place, approach_m=0.0)) for end in ends]


def _ends_departures(
    site: MotionSite,
    hand: ArmHand,
    option: str,
    ends: Sequence[MotionEnd],
    now: Floats,
    limits: JointLimits,
) -> list[LegDepartures]:
    """Where the free part of a motion may begin or end, for each end; what is soonest from
    `now` (own joints,) comes first.
    """
    departures_found = []
    for end in ends:
        own = soonest_first(end.configurations, now, limits.speed)
        whole = np.repeat(site.world.configuration[None], len(own), axis=0)
        whole[:, hand.own] = own
        departures_found.append(lines_out(end, whole, site.reach, hand, option))
    return departures_found


def _search_starts(
    ground: PlanningScene,
    hand: ArmHand,
    out: LegDepartures,
    ins: Sequence[LegDepartures],
    wish: MotionWish,
) -> tuple[int, PathQuery, Answer]:
    """The number of a start, what was asked from there, and the answer: the first that is proved,
    else the best one.

    The first start has the whole budget, each further one a tenth of it. That no path exists counts
    if it holds for all.
    """
    answers: list[tuple[int, PathQuery, Answer]] = []
    for n, start in enumerate(out.configurations[:MAX_TRIED_LINES]):
        budget = max(1, wish.budget // FURTHER_SEARCH_SHARE) if n else wish.budget
        query = _motion_query(hand, start, ins, replace(wish, budget=budget))
        look = try_path if answers and _is_open(answers[0][2]) else plan_path
        answer = look(ground, query, hand)
        if isinstance(answer, Moved) and answer.proved:
            return n, query, answer
        answers.append((n, query, answer))
    return min(
        answers,
        key=lambda candidate: (not isinstance(candidate[2], Moved), not _is_open(candidate[2])),
    )


def _is_open(answer: Answer) -> bool:
    """Whether an answer leaves open if there is a path."""
    return isinstance(answer, Blocked) and answer.severed is None


def _motion_query(
    hand: ArmHand, start: Floats, ins: Sequence[LegDepartures], wish: MotionWish
) -> PathQuery:
    return PathQuery(
        start,
        np.concatenate([departure.configurations for departure in ins]),
        margin_m=wish.margin_m,
        seed=wish.seed,
        bridges=wish.bridges,
        moving=tuple(range(hand.own.start, hand.own.stop)),
        strategy=wish.strategy,
        upright_rad=wish.upright_rad,
        budget=wish.budget,
    )


def _answer_legs(
    answer: Answer,
    free: MotionLeg | None,
    out: tuple[Floats | None, Place | None],
    ins: list[LegDepartures],
    reach: PlaceReachability,
) -> tuple[tuple[MotionLeg, ...], int]:
    """The legs of an answer, from the line out of the start on, and the number of the end that
    is reached.
    """
    if not isinstance(answer, Moved) or free is None:
        return (), 0
    n, goal = 0, answer.goal
    while goal >= len(ins[n].lines):
        goal -= len(ins[n].lines)
        n += 1
    legs, (first, line_left) = [free], out
    last, place = ins[n].lines[goal], ins[n].place
    if first is not None and line_left is not None:
        legs.insert(0, leg_of(RETRACT, first, line_left, reach))
    if last is not None and place is not None:
        legs.append(leg_of(APPROACH, last, place, reach))
    return tuple(legs), n


def soonest_first(configurations: Floats, now: Floats, speed: Floats) -> Floats:
    """The configurations (n, k), those first that the arm is at soonest, from where it is and at
    the speeds (k,) of its joints.

    Times that differ by rounding alone count as the same, so that the order does not depend on the
    processor.
    """
    times = (np.abs(configurations - now) / speed).max(axis=1)
    ordered: Floats = configurations[np.argsort(np.round(times, 9), kind="stable")]
    return ordered
