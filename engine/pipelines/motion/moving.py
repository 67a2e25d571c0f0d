"""A motion of an arm between two named ends: what a person names becomes configurations, and a planner joins them."""

from dataclasses import dataclass, replace

import numpy as np

from engine.model.geometry import Floats
from engine.model.motion import Answer, Moved, Query, Strategy
from engine.pipelines.motion.ends import carried, end_of, tool_of
from engine.pipelines.motion.legs import APPROACH, FREE, RETRACT, Departures, Leg, departures, leg_of
from engine.pipelines.motion.timing import Timed, timed
from engine.pipelines.motion.zones import zones_of
from engine.pipelines.planning import initial_facts
from engine.plugins import geometry_backend
from engine.stages.geometry.collision.ground import Ground
from engine.stages.geometry.pictures.view import cell_of
from engine.stages.geometry.reach.hand import ArmHand
from engine.stages.geometry.reach.reach import Reachability
from engine.stages.geometry.world.following import following
from engine.stages.geometry.world.model import World
from engine.stages.motion.planner import plan
from engine.stages.motion.trajectory import Limits

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


def move(target: str, start: str, goals: tuple[str, ...], wish: Wish = Wish()) -> Motion:
    """The motion in the cell of a target from one end to one of several, each named as `end_of` says.

    The tool of a place is in the hand all the way. Raises `InvalidInput` for what cannot be read, and for places out of reach.
    """
    cell = cell_of(target)
    world = following(World.of(cell), initial_facts(target))
    reach, tool = Reachability(world, geometry_backend()), tool_of(wish.tool, cell)
    begin = end_of(start, "--from", reach, world, tool)
    arrive = [end_of(goal, "--to", reach, world, tool) for goal in goals]
    if wish.direct:
        begin, *arrive = (
            replace(end, place=end.place and replace(end.place, approach_m=0.0)) for end in (begin, *arrive)
        )
    place = carried(begin, arrive, tool)
    ground = Ground(reach.checker(place))
    hand = ArmHand(world, ground.scene, place.arm, reach.flange_to_end(place))
    here = reach.whole(place, nearest_first(begin.configurations, world.configurations[place.arm]))
    out = departures(begin, here, reach, hand, "--from")
    ins = [
        departures(
            end, reach.whole(place, nearest_first(end.configurations, here[0][hand.own])), reach, hand, "--to"
        )
        for end in arrive
    ]
    query = Query(
        out.configurations[0],
        np.concatenate([each.configurations for each in ins]),
        margin_m=wish.margin_m,
        seed=wish.seed,
        bridges=wish.bridges,
        moving=tuple(range(hand.own.start, hand.own.stop)),
        strategy=wish.strategy,
    )
    answer = plan(ground, query, hand)
    names = tuple(joint.name for joint in world.models[place.arm].arm.joints)
    legs, n = _legs(answer, out, ins, reach, Leg(FREE, query.start[None], False, ground, wish.margin_m))
    times = timed(legs, limits_of(world, place.arm), hand.own, zones_of(world, ground), wish.smooth)
    return Motion(
        world, place.arm, answer, hand.own, names, legs, arrive[n].name, times, query.start, ground, hand
    )


def _legs(
    answer: Answer, out: Departures, ins: list[Departures], reach: Reachability, blank: Leg
) -> tuple[tuple[Leg, ...], int]:
    """The legs of an answer, and the number of the end that is reached."""
    if not isinstance(answer, Moved):
        return (), 0
    n, goal = 0, answer.goal
    while goal >= len(ins[n].lines):
        goal -= len(ins[n].lines)
        n += 1
    legs = [replace(blank, path=answer.path, proved=answer.proved)]
    first, last = out.lines[0], ins[n].lines[goal]
    if first is not None and out.place is not None:
        legs.insert(0, leg_of(RETRACT, first, out.place, reach))
    place = ins[n].place
    if last is not None and place is not None:
        legs.append(leg_of(APPROACH, last, place, reach))
    return tuple(legs), n


def nearest_first(configurations: Floats, now: Floats) -> Floats:
    """The configurations (n, k), those first that are nearest to where the arm is."""
    found: Floats = configurations[np.argsort(np.abs(configurations - now).max(axis=1), kind="stable")]
    return found
