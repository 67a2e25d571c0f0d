"""Monitoring of an arm that an operator moves: warns when the goal becomes hard or impossible.

The operator's acts are joint targets, with jaws that close or open. What else changes the world is
told as a body that was shifted. After each act it is asked whether the part can still be brought to
its goal: with the grasp that holds it, with regrasps, or not at all.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from enum import IntEnum, StrEnum
from functools import cached_property
from typing import TypeAlias

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Truths
from cellwright.engine.kernels.rigid import difference, inverse
from cellwright.engine.model.manipulation_values import Regrasps, RelationContradiction
from cellwright.engine.model.vision import NotLocated
from cellwright.engine.pipelines.manipulation.clearance import no_room
from cellwright.engine.pipelines.manipulation.part_grasps import PartHolds
from cellwright.engine.pipelines.manipulation.place_answers import NotPlaced
from cellwright.engine.pipelines.manipulation.place_operation import (
    contradiction_answer,
    goal_of,
    likeliest_pose,
    not_seen_answer,
)
from cellwright.engine.pipelines.manipulation.regrasp_paths import (
    fewest_regrasps,
    possible_holds,
    serving_holds,
    table_rests,
)
from cellwright.engine.pipelines.manipulation.scene_camera import look_for_parts
from cellwright.engine.pipelines.manipulation.workspace import AssemblySite, PlaceTask
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.model.part_scene import Scene

NEAR_M, NEAR_RAD = 0.02, np.radians(10)  # how near to a grasp the hand holds the part
THERE_M, THERE_RAD = 0.003, np.radians(1)


class JawsAct(StrEnum):
    """What the jaws do when the arm has arrived."""

    CLOSE = "close"
    OPEN = "open"
    STAY = "stay"


@dataclass(frozen=True, slots=True, eq=False)
class OperatorAct:
    """The arm goes to its joint values (k,), and then the jaws do something."""

    q: Floats
    jaws: JawsAct = JawsAct.STAY


@dataclass(frozen=True, slots=True, eq=False)
class BodyShifted:
    """A body, or the part, is somewhere else: T_world_body."""

    body: str
    T_world_body: Floats


Event: TypeAlias = OperatorAct | BodyShifted


class GoalOutlook(IntEnum):
    """Whether the goal can be reached, from best to worst."""

    DONE = 0
    OPEN = 1
    HARD = 2
    IMPOSSIBLE = 3


@dataclass(frozen=True, slots=True)
class GoalForecast:
    """An outlook, and why it is not better."""

    outlook: GoalOutlook
    reason: str = ""


@dataclass(frozen=True, eq=False)
class WatchedWorld:
    """The world as far as it was followed: where the part is, or how it is held (T_part_hand),
    and what was shifted.
    """

    site: AssemblySite
    part: str
    T_goal: Floats
    T_world_part: Floats
    T_part_hand: Floats | None = None
    shifted: Mapping[str, Floats] = field(default_factory=dict)

    def after(self, event: Event) -> "WatchedWorld":
        """The world after an event."""
        if isinstance(event, BodyShifted):
            if event.body == self.part:
                return replace(self, T_world_part=event.T_world_body, T_part_hand=None)
            return replace(self, shifted={**self.shifted, event.body: event.T_world_body})
        hand = self._hand(event.q)
        T_hand = self.T_part_hand
        at = self.T_world_part if T_hand is None else hand @ inverse(T_hand)
        if event.jaws is JawsAct.OPEN:
            T_hand = None
        elif event.jaws is JawsAct.CLOSE and T_hand is None and self._grasped(at, hand) is not None:
            T_hand = inverse(at) @ hand
        return replace(self, T_world_part=at, T_part_hand=T_hand)

    def _hand(self, q: Floats) -> Floats:
        arm = self.site.scene.hand.arm
        return self.site.world.moved(arm, q).pose("world", f"{arm}.tool")

    def _grasped(self, T_world_part: Floats, T_world_hand: Floats) -> int | None:
        """The number of the hold that the hand is next to; None if it holds nothing."""
        poses = self.site.holds(self.part).poses
        if not len(poses):
            return None
        apart = [difference(pose, inverse(T_world_part) @ T_world_hand) for pose in poses]
        metres, radians = (np.array([float(gap[n]) for gap in apart]) for n in (0, 1))
        best = int(np.argmin(metres + 0.1 * radians))
        return best if metres[best] < NEAR_M and radians[best] < NEAR_RAD else None

    @cached_property
    def forecast(self) -> GoalForecast:
        """Whether the part can still be brought to its goal."""
        if self.T_part_hand is None and _same_pose(self.T_world_part, self.T_goal):
            return GoalForecast(GoalOutlook.DONE)
        task = self.site.task(self.part, (self.T_world_part, self.T_goal), self.shifted)
        if (crowded := no_room(task, self.T_goal)) is not None:
            return GoalForecast(GoalOutlook.IMPOSSIBLE, crowded.reason)
        goal = possible_holds(task, self.T_goal)
        if not goal.any():
            return GoalForecast(
                GoalOutlook.IMPOSSIBLE,
                f"no grasp of {self.part} can be let go at its goal any more: it is closed",
            )
        return (
            self._free(task, goal)
            if self.T_part_hand is None
            else self._held(task, self.T_part_hand)
        )

    def _free(self, task: PlaceTask, goal: Truths) -> GoalForecast:
        """The outlook with the part lying somewhere."""
        start = possible_holds(task, self.T_world_part)
        if not start.any():
            return GoalForecast(
                GoalOutlook.IMPOSSIBLE, f"no grasp of {self.part} is possible where it lies now"
            )
        if (start & goal).any():
            return GoalForecast(GoalOutlook.OPEN)
        return _regrasp_forecast(
            task, (start, goal), "no grasp serves both where it lies now and at its goal"
        )

    def _held(self, task: PlaceTask, T_part_hand: Floats) -> GoalForecast:
        """The outlook with the part in the hand: the hold that it has becomes the first of its
        holds.
        """
        nearest = self._grasped(self.T_world_part, self.T_world_part @ T_part_hand)
        like = task.holds.grasps[task.holds.grasp_of[nearest or 0]]
        mine = replace(like, T_part_hand=T_part_hand[None], free=np.ones(1, dtype=bool))
        own = replace(
            task, holds=PartHolds(task.holds.solid, task.holds.jaws, (mine, *task.holds.grasps))
        )
        goal = possible_holds(own, self.T_goal)
        if goal[0]:
            return GoalForecast(GoalOutlook.OPEN)
        start = np.zeros(len(goal), dtype=bool)
        start[0] = True
        return _regrasp_forecast(own, (start, goal), "this grasp cannot place it")


def _same_pose(T: Floats, T_other: Floats) -> bool:
    metres, radians = difference(T, T_other)
    return bool(metres < THERE_M and radians < THERE_RAD)


def _regrasp_forecast(task: PlaceTask, ends: tuple[Truths, Truths], why: str) -> GoalForecast:
    poses = [T for _, T in table_rests(task)]
    regrasp_answer = fewest_regrasps(task, ends, poses, serving_holds(task, poses))
    if isinstance(regrasp_answer, Regrasps):
        count = len(regrasp_answer.then)
        return GoalForecast(
            GoalOutlook.HARD, f"{why}; {count} regrasp{'s' if count > 1 else ''} would be needed"
        )
    return GoalForecast(GoalOutlook.IMPOSSIBLE, f"{why}, and no sequence of regrasps does")


def begin_watching(
    scene: Scene, part: str, base: str, seed: int = 0, image: Floats | None = None
) -> WatchedWorld | NotPlaced:
    """The world before the first event: the part is found, and its goal known.

    Raises `InvalidInput` for unknown names.
    """
    world = GeometricWorld.of(scene.cell)
    goal = goal_of(scene, world, (part,), base)
    if isinstance(goal, RelationContradiction):
        return contradiction_answer(goal)
    looked = look_for_parts(scene, world, (part,), seed, image)
    sighting = looked.sightings[part]
    if isinstance(sighting, NotLocated):
        return not_seen_answer(part, sighting)
    T_goal = world.pose("world", base) @ goal.poses[part]
    T_start = likeliest_pose(sighting, looked.T_world_camera, T_goal)
    return WatchedWorld(
        AssemblySite.of(scene, world, looked, {part: T_start}), part, T_goal, T_start
    )


def watch_events(
    state: WatchedWorld, events: Iterable[Event]
) -> Iterator[tuple[WatchedWorld, GoalForecast | None]]:
    """The world after each event, and a warning where the outlook has become worse than it was,
    and is not open.
    """
    before = state.forecast.outlook
    for event in events:
        state = state.after(event)
        now = state.forecast
        worse = now.outlook > before and now.outlook >= GoalOutlook.HARD
        yield state, now if worse else None
        before = now.outlook
