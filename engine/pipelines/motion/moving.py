"""A motion of an arm between two named ends: what a person names becomes configurations, and a planner joins them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.motion import Answer, Blocked, Moved, Query, Strategy
from cellwright.engine.pipelines.files import initial_facts
from cellwright.engine.pipelines.motion.ends import End, carried, end_of, tool_of
from cellwright.engine.pipelines.motion.legs import (
    APPROACH,
    FREE,
    FURTHER,
    LINES,
    RETRACT,
    Departures,
    Leg,
    departures,
    free_leg,
    leg_of,
    shallower,
)
from cellwright.engine.pipelines.motion.timing import Timed, timed
from cellwright.engine.pipelines.motion.zones import zones_of
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.stages.geometry.collision.ground import Ground
from cellwright.engine.stages.geometry.reach.hand import ArmHand
from cellwright.engine.stages.geometry.reach.reach import Reachability
from cellwright.engine.stages.geometry.world.following import following
from cellwright.engine.stages.geometry.world.model import World
from cellwright.engine.stages.motion.planner import plan, tried
from cellwright.engine.stages.motion.refining import proved_and_refined
from cellwright.engine.stages.motion.trajectory import Limits
from cellwright.engine.stages.motion.upright import Level
from cellwright.kb.loader.cell import cell_of
from cellwright.kb.model.cell import Place

UNKNOWN_SPEED = 1.0  # rad/s or m/s
SWIFT = 4.0  # 1/s: of a joint whose acceleration is unknown: full speed after a quarter of a second
ABRUPT = 10.0  # 1/s: full acceleration after a tenth of a second


@dataclass(frozen=True, slots=True)
class Wish:
    """What is asked of a motion beside its ends.

    `bridges` are the short cuts tried. With `direct` there are no straight lines out of places and into them. `tool` is in
    hand where no place says what is.
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
class Motion:
    """A planned motion of one arm, in legs; configurations are those of all joints of the world.

    `joints` names the arm's joints, `own` are their numbers in the world. `goal` names the end reached,
    `start` (all joints,) is where the planner started, on `ground`, with `hand`.
    """

    world: World
    arm: str
    answer: Answer
    own: slice
    joints: tuple[str, ...]
    legs: tuple[Leg, ...]
    goal: str
    times: Timed
    start: Floats
    ground: Ground
    hand: ArmHand

    def whole(self) -> Floats:
        """The configurations (m, all joints) of the world on the path; none where there is no path."""
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


def limits_of(world: World, arm: str) -> Limits:
    """What the arm's file says that its joints can do, and else what is assumed of them."""
    joints = world.models[arm].arm.joints
    speed = np.array([joint.speed or UNKNOWN_SPEED for joint in joints])
    rated = [joint.acceleration or SWIFT * full for joint, full in zip(joints, speed, strict=True)]
    return Limits(speed, np.array(rated), np.array(rated) * ABRUPT)


@dataclass(frozen=True, slots=True, eq=False)
class Site:
    """A cell in which motions are planned; what is packed for one motion serves the next."""

    world: World
    reach: Reachability

    @classmethod
    def of(cls, target: str) -> "Site":
        """The cell of a target, with its bodies where the facts put them. Raises `InvalidInput`."""
        world = following(World.of(cell_of(target)), initial_facts(target))
        return cls(world, Reachability(world, geometry_backend()))


def move(site: Site, start: str, goals: Sequence[str], wish: Wish = Wish()) -> Motion:
    """The motion from one end to one of several, each named as `end_of` says.

    The tool of a place is in the hand all the way. Raises `InvalidInput` for what cannot be read, and for places out of reach.
    """
    begin, *arrive = _ends(site, start, goals, wish)
    place = carried(begin, arrive, wish.tool)
    ground = Ground(site.reach.checker(place))
    hand = ArmHand(site.world, ground.scene, place.arm, site.reach.flange_to_end(place))
    limits = limits_of(site.world, place.arm)
    now = site.world.configurations[place.arm]
    out, *_ = _departures(site, hand, "--from", [begin], now, limits)
    ins = _departures(site, hand, "--to", arrive, out.configurations[0][hand.own], limits)
    first, query, answer = _planned(ground, hand, out, ins, wish)
    if wish.refine and not wish.upright_rad and isinstance(answer, Moved):
        speeds = np.ones(site.world.joints.count)
        speeds[hand.own] = limits.speed
        answer = proved_and_refined(ground, query, answer, speeds, wish.refine).found
    answer = shallower(answer, query, place, site.reach, hand)
    names = tuple(joint.name for joint in site.world.models[place.arm].arm.joints)
    blank = Leg(FREE, query.start[None], False, ground, wish.margin_m)
    free = free_leg(blank, answer, place, site.reach) if isinstance(answer, Moved) else None
    legs, n = _legs(answer, free, (out.lines[first], out.place), ins, site.reach)
    level = Level.at(hand, query.start, wish.upright_rad) if wish.upright_rad else None
    times = timed(legs, limits, hand.own, zones_of(site.world, ground), wish.smooth, level)
    goal = arrive[n].name
    return Motion(
        site.world, place.arm, answer, hand.own, names, legs, goal, times, query.start, ground, hand
    )


def _ends(site: Site, start: str, goals: Sequence[str], wish: Wish) -> list[End]:
    """The start, and then the goals; without approaches if the motion is to be direct."""
    tool = tool_of(wish.tool, site.world.cell)
    ends = [end_of(start, "--from", site.reach, site.world, tool)]
    ends += [end_of(goal, "--to", site.reach, site.world, tool) for goal in goals]
    if not wish.direct:
        return ends
    return [replace(end, place=end.place and replace(end.place, approach_m=0.0)) for end in ends]


def _departures(
    site: Site, hand: ArmHand, option: str, ends: Sequence[End], now: Floats, limits: Limits
) -> list[Departures]:
    """Where the free part of a motion may begin or end, for each end; what is soonest from `now` (own joints,) comes first."""
    found = []
    for end in ends:
        own = nearest_first(end.configurations, now, limits.speed)
        whole = np.repeat(site.world.configuration[None], len(own), axis=0)
        whole[:, hand.own] = own
        found.append(departures(end, whole, site.reach, hand, option))
    return found


def _planned(
    ground: Ground, hand: ArmHand, out: Departures, ins: Sequence[Departures], wish: Wish
) -> tuple[int, Query, Answer]:
    """The number of a start, what was asked from there, and the answer: the first that is proved, else the best one.

    The first start has the whole budget, each further one a tenth of it. That no path exists counts if it holds for all.
    """
    found: list[tuple[int, Query, Answer]] = []
    for n, start in enumerate(out.configurations[:LINES]):
        budget = max(1, wish.budget // FURTHER) if n else wish.budget
        query = _query(hand, start, ins, replace(wish, budget=budget))
        look = tried if found and _is_open(found[0][2]) else plan
        answer = look(ground, query, hand)
        if isinstance(answer, Moved) and answer.proved:
            return n, query, answer
        found.append((n, query, answer))
    return min(found, key=lambda each: (not isinstance(each[2], Moved), not _is_open(each[2])))


def _is_open(answer: Answer) -> bool:
    """Whether an answer leaves open if there is a path."""
    return isinstance(answer, Blocked) and answer.severed is None


def _query(hand: ArmHand, start: Floats, ins: Sequence[Departures], wish: Wish) -> Query:
    return Query(
        start,
        np.concatenate([each.configurations for each in ins]),
        margin_m=wish.margin_m,
        seed=wish.seed,
        bridges=wish.bridges,
        moving=tuple(range(hand.own.start, hand.own.stop)),
        strategy=wish.strategy,
        upright_rad=wish.upright_rad,
        budget=wish.budget,
    )


def _legs(
    answer: Answer,
    free: Leg | None,
    out: tuple[Floats | None, Place | None],
    ins: list[Departures],
    reach: Reachability,
) -> tuple[tuple[Leg, ...], int]:
    """The legs of an answer, from the line out of the start on, and the number of the end that is reached."""
    if not isinstance(answer, Moved) or free is None:
        return (), 0
    n, goal = 0, answer.goal
    while goal >= len(ins[n].lines):
        goal -= len(ins[n].lines)
        n += 1
    legs, (first, left) = [free], out
    last, place = ins[n].lines[goal], ins[n].place
    if first is not None and left is not None:
        legs.insert(0, leg_of(RETRACT, first, left, reach))
    if last is not None and place is not None:
        legs.append(leg_of(APPROACH, last, place, reach))
    return tuple(legs), n


def nearest_first(configurations: Floats, now: Floats, speed: Floats) -> Floats:
    """The configurations (n, k), those first that the arm is at soonest, from where it is and at the speeds (k,) of its joints.

    Times that differ by rounding alone count as the same, so that the order does not depend on the processor.
    """
    times = (np.abs(configurations - now) / speed).max(axis=1)
    found: Floats = configurations[np.argsort(np.round(times, 9), kind="stable")]
    return found
