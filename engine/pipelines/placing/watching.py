"""Monitoring: an operator moves the arm, the world is followed, and what makes the goal hard or impossible is told at once.

The operator's acts are joint targets, with jaws that close or open. What else changes the world is told as a body that was
shifted. After each act it is asked whether the part can still be brought to its goal: with the grasp that holds it, with
regrasps, or not at all.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from enum import IntEnum, StrEnum
from functools import cached_property
from typing import TypeAlias

import numpy as np

from cellwright.engine.kernels.rigid import difference, inverse
from cellwright.engine.model.assembly import Contradiction
from cellwright.engine.model.geometry import Floats, Truths
from cellwright.engine.model.grasping import Regrasps
from cellwright.engine.model.vision import NotLocated
from cellwright.engine.pipelines.placing.answers import NotPlaced
from cellwright.engine.pipelines.placing.goals import goal_of
from cellwright.engine.pipelines.placing.holding import Holds
from cellwright.engine.pipelines.placing.looking import look
from cellwright.engine.pipelines.placing.placing import contradicted, likeliest, unseen
from cellwright.engine.pipelines.placing.room import no_room
from cellwright.engine.pipelines.placing.site import Site
from cellwright.engine.pipelines.placing.task import Task
from cellwright.engine.pipelines.placing.ways import possible, rests, serving, shortest
from cellwright.engine.stages.geometry.world.model import World
from cellwright.kb.model.scene import Scene

NEAR_M, NEAR_RAD = 0.02, np.radians(10)  # how near to a grasp the hand holds the part
THERE_M, THERE_RAD = 0.003, np.radians(1)


class Jaws(StrEnum):
    """What the jaws do when the arm has arrived."""

    CLOSE = "close"
    OPEN = "open"
    STAY = "stay"


@dataclass(frozen=True, slots=True, eq=False)
class Act:
    """The arm goes to its joint values (k,), and then the jaws do something."""

    q: Floats
    jaws: Jaws = Jaws.STAY


@dataclass(frozen=True, slots=True, eq=False)
class Shifted:
    """A body, or the part, is somewhere else: T_world_body."""

    body: str
    T_world_body: Floats


Event: TypeAlias = Act | Shifted


class Outlook(IntEnum):
    """Whether the goal can be reached, from best to worst."""

    DONE = 0
    OPEN = 1
    HARD = 2
    IMPOSSIBLE = 3


@dataclass(frozen=True, slots=True)
class Forecast:
    """An outlook, and why it is not better."""

    outlook: Outlook
    reason: str = ""


@dataclass(frozen=True, eq=False)
class Watched:
    """The world as far as it was followed: where the part is, or how it is held (T_part_hand), and what was shifted."""

    site: Site
    part: str
    T_goal: Floats
    T_world_part: Floats
    T_part_hand: Floats | None = None
    shifted: Mapping[str, Floats] = field(default_factory=dict)

    def after(self, event: Event) -> "Watched":
        """The world after an event."""
        if isinstance(event, Shifted):
            if event.body == self.part:
                return replace(self, T_world_part=event.T_world_body, T_part_hand=None)
            return replace(self, shifted={**self.shifted, event.body: event.T_world_body})
        hand = self._hand(event.q)
        held = self.T_part_hand
        at = self.T_world_part if held is None else hand @ inverse(held)
        if event.jaws is Jaws.OPEN:
            held = None
        elif event.jaws is Jaws.CLOSE and held is None and self._grasped(at, hand) is not None:
            held = inverse(at) @ hand
        return replace(self, T_world_part=at, T_part_hand=held)

    def _hand(self, q: Floats) -> Floats:
        arm = self.site.scene.hand.arm
        return self.site.world.moved(arm, q).pose("world", f"{arm}.tool")

    def _grasped(self, T_world_part: Floats, T_world_hand: Floats) -> int | None:
        """The number of the hold that the hand is next to; None if it holds nothing."""
        poses = self.site.holds(self.part).poses
        if not len(poses):
            return None
        apart = [difference(each, inverse(T_world_part) @ T_world_hand) for each in poses]
        metres, radians = (np.array([float(each[n]) for each in apart]) for n in (0, 1))
        best = int(np.argmin(metres + 0.1 * radians))
        return best if metres[best] < NEAR_M and radians[best] < NEAR_RAD else None

    @cached_property
    def forecast(self) -> Forecast:
        """Whether the part can still be brought to its goal."""
        if self.T_part_hand is None and _there(self.T_world_part, self.T_goal):
            return Forecast(Outlook.DONE)
        task = self.site.task(self.part, (self.T_world_part, self.T_goal), self.shifted)
        if (crowded := no_room(task, self.T_goal)) is not None:
            return Forecast(Outlook.IMPOSSIBLE, crowded.reason)
        goal = possible(task, self.T_goal)
        if not goal.any():
            return Forecast(
                Outlook.IMPOSSIBLE,
                f"no grasp of {self.part} can be let go at its goal any more: it is closed",
            )
        return self._free(task, goal) if self.T_part_hand is None else self._held(task, self.T_part_hand)

    def _free(self, task: Task, goal: Truths) -> Forecast:
        """The outlook with the part lying somewhere."""
        start = possible(task, self.T_world_part)
        if not start.any():
            return Forecast(Outlook.IMPOSSIBLE, f"no grasp of {self.part} is possible where it lies now")
        if (start & goal).any():
            return Forecast(Outlook.OPEN)
        return _regrasps(task, (start, goal), "no grasp serves both where it lies now and at its goal")

    def _held(self, task: Task, T_part_hand: Floats) -> Forecast:
        """The outlook with the part in the hand: the hold that it has becomes the first of its holds."""
        nearest = self._grasped(self.T_world_part, self.T_world_part @ T_part_hand)
        like = task.holds.grasps[task.holds.grasp_of[nearest or 0]]
        mine = replace(like, T_part_hand=T_part_hand[None], free=np.ones(1, dtype=bool))
        own = replace(task, holds=Holds(task.holds.solid, task.holds.jaws, (mine, *task.holds.grasps)))
        goal = possible(own, self.T_goal)
        if goal[0]:
            return Forecast(Outlook.OPEN)
        start = np.zeros(len(goal), dtype=bool)
        start[0] = True
        return _regrasps(own, (start, goal), "this grasp cannot place it")


def _there(T: Floats, other: Floats) -> bool:
    metres, radians = difference(T, other)
    return bool(metres < THERE_M and radians < THERE_RAD)


def _regrasps(task: Task, ends: tuple[Truths, Truths], why: str) -> Forecast:
    poses = [T for _, T in rests(task)]
    found = shortest(task, ends, poses, serving(task, poses))
    if isinstance(found, Regrasps):
        count = len(found.then)
        return Forecast(Outlook.HARD, f"{why}; {count} regrasp{'s' if count > 1 else ''} would be needed")
    return Forecast(Outlook.IMPOSSIBLE, f"{why}, and no sequence of regrasps does")


def begin(
    scene: Scene, part: str, base: str, seed: int = 0, image: Floats | None = None
) -> Watched | NotPlaced:
    """The world before the first event: the part is found, and its goal known. Raises `InvalidInput` for unknown names."""
    world = World.of(scene.cell)
    goal = goal_of(scene, world, (part,), base)
    if isinstance(goal, Contradiction):
        return contradicted(goal)
    looked = look(scene, world, (part,), seed, image)
    sighting = looked.sightings[part]
    if isinstance(sighting, NotLocated):
        return unseen(part, sighting)
    T_goal = world.pose("world", base) @ goal.poses[part]
    T_start = likeliest(sighting, looked.T_world_camera, T_goal)
    return Watched(Site.of(scene, world, looked, {part: T_start}), part, T_goal, T_start)


def watched(state: Watched, events: Iterable[Event]) -> Iterator[tuple[Watched, Forecast | None]]:
    """The world after each event, and a warning where the outlook has become worse than it was, and is not open."""
    before = state.forecast.outlook
    for event in events:
        state = state.after(event)
        now = state.forecast
        worse = now.outlook > before and now.outlook >= Outlook.HARD
        yield state, now if worse else None
        before = now.outlook
