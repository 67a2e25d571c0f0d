"""A cell that physics moves: what steps of the arm do in it, and whether that is what the facts say."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.moves import Leg, MovedStep
from cellwright.engine.pipelines.moves.arms import arms_of
from cellwright.engine.pipelines.moves.hands import Where
from cellwright.engine.pipelines.moves.meetings import Encounters
from cellwright.engine.pipelines.moves.tracks import Moment, Passage, Rider, tracks
from cellwright.engine.pipelines.moves.walking import Walk, operation_of
from cellwright.engine.pipelines.simulator.unknown import Unknown
from cellwright.engine.pipelines.witness.sensing import reading
from cellwright.engine.pipelines.witness.servos import NEAR_M, value_of
from cellwright.engine.pipelines.witness.stage import SETTLE_S, Stage
from cellwright.engine.pipelines.witness.stopping import retreat
from cellwright.engine.pipelines.witness.touches import Stopped
from cellwright.engine.pipelines.witness.tree import hand_of, is_free
from cellwright.engine.stages.geometry.world.following import following
from cellwright.engine.stages.geometry.world.model import World
from cellwright.kb.model.plan import Step, StepId
from cellwright.kb.terms import Atom, Function, match, substitute

FIRST = StepId(1)

Facts = Collection[Atom]


@dataclass(frozen=True, slots=True)
class Hindrance:
    """What makes a physical cell other than its model: a friction of all parts, joints that are blocked, parts that are stuck."""

    friction: float | None = None
    blocked: tuple[str, ...] = ()
    stuck: tuple[str, ...] = ()


class Body:
    """The physical cell of a run."""

    def __init__(
        self, walk: Walk, start: Facts, hindrance: Hindrance = Hindrance(), unknown: Unknown | None = None
    ) -> None:
        self.walk, self.cell, self.hindrance = walk, walk.cell, hindrance
        self.unknown = unknown or Unknown(walk.cell)
        whole = replace(walk.cell, bodies={**walk.cell.bodies, **self.unknown.bodies})
        self.stage = Stage(following(World.of(whole), self.unknown.real(start)))
        self._encounters = Encounters(walk.backend)
        self._told: Mapping[str, Any] = {}
        self._failed: Facts | None = None
        self._last: list[str] = []  # what the last step was to move
        self._way_in: Leg | None = None  # of a step that was stopped while the arm dragged something
        if hindrance.friction is not None:
            self.stage.make_slippery(hindrance.friction)
        for name in hindrance.blocked:
            self.stage.block(name, True)
        for name in hindrance.stuck:
            self.stage.stick(name, True)

    def carries_out(self, step: Function, before: Facts, after: Facts) -> bool:
        """Take a step; whether all bodies that it moves are then where the facts put them. A step without a motion is done."""
        self._open_after_failure()
        operation = operation_of(self.cell, step)
        if operation is None:
            return True
        believed, where = self.unknown.believed, self.walk.hands.where()
        self.walk.lying, self._told = self._lying(before), {}
        moved = self.walk.step(Step(FIRST, step), operation, believed(before), believed(after))
        if not isinstance(moved, MovedStep):
            return self._stopped_again()
        worlds, self._last = (self._world(before), self._world(after)), self._moved(before, after)
        self.stage.guard = frozenset()
        self._make_way(moved, step, believed(before), believed(after))
        self.stage.guard = self.unknown.names
        try:
            self._way_in = self.stage.take(moved, *worlds, stops=True)
        except Stopped as stopped:
            retreat(self.stage, moved.legs, stopped, *worlds)
            self._meets(stopped.body, where)
            return False
        if self._way_in is not None:
            self.walk.hands.arrive(self._way_in.arm, self._way_in.path[0], None)
        return all(self._is_where(name, after) for name in self._moved(before, after))

    def _make_way(
        self, moved: MovedStep, step: Function, before: frozenset[Atom], after: frozenset[Atom]
    ) -> None:
        """Arms that rest in the way of a step go home first."""
        arms = arms_of(self.cell, step, operation_of(self.cell, step))
        others = [arm for arm in self.cell.arms if arm not in arms]
        if not others:
            return
        one, other = (self.walk.room(facts).world for facts in (before, after))
        now = {arm: self.walk.hands.now(arm) for arm in self.cell.arms}
        starts = {**now, **{leg.arm: leg.path[0] for leg in reversed(moved.legs)}}
        own = tracks([Moment(moved.step, one, other, moved, arms)], starts)
        passages = [each for arm in arms for occupied in own[arm] for each in occupied.passages]
        for arm in others:
            rest = Passage(Rider(one, arm), now[arm][None])
            if any(self._encounters.meet(rest, each) for each in passages):
                way = self.walk.homeward(arm, before)
                if way is not None:
                    self.stage.go(way, self._world(before))

    def _stopped_again(self) -> bool:
        """A step has no motion: because of what was met, if something was."""
        if met := min(self.unknown.met, default=""):
            self._told = self.unknown.meets(met, self.stage.world)
        return False

    def _meets(self, body: str, where: Where) -> None:
        """The arm has met a body, and is back where it was; from now on motions are found around it."""
        self._told = self.unknown.meets(body, self.stage.world)
        walk = Walk(self.walk.semantics, self.unknown.known, self.walk.backend, self.walk.seed)
        walk.hands.put(where)
        self.walk = walk

    def met(self) -> Mapping[str, Any]:
        """What has stopped the arm in the last step, as the data of a reply; empty if nothing has."""
        return self._told

    def misfit(self, facts: Facts, before: Facts, after: Facts) -> int:
        """How many of the bodies that a step was to move are not as some facts say, `before` and `after` being those of the step.

        A body that no fact puts anywhere should be at neither place.
        """
        placed, wrong = self._placed(facts), 0
        for name in self._moved(before, after):
            if name in placed:
                wrong += not self._is_where(name, facts)
            else:
                wrong += self._is_where(name, before) or self._is_where(name, after)
        return wrong

    def failed(self, facts: Facts) -> None:
        """A step has failed. The hand will be as the facts say, and the arm away, when something is done next.

        Until then sensors read how it is: a hand that dragged something still holds it."""
        self._failed = facts

    def reading(self, sensor: str) -> str:
        """What a sensor of the cell reads now; empty for one that it has not."""
        known = self.cell.sensors.get(sensor)
        return reading(self.stage, self.stage.world, known) if known else ""

    def tells(self, sensor: str, shown: str) -> str:
        """The outcome of a test that a reading means; the reading itself, if the cell says nothing else."""
        return self.cell.sensors[sensor].tells.get(shown, shown)

    def _open_after_failure(self) -> None:
        if self._failed is None:
            return
        world = self._world(self._failed)
        for arm in self.cell.arms:
            self.stage.fingers(arm, world, closed=False)
        self.stage.wait(SETTLE_S)
        if self._way_in is not None:
            self.stage.back_out(self._way_in)
        self._failed = self._way_in = None

    def repaired(self, before: Facts, after: Facts) -> None:
        """A repair has helped: nothing is blocked or stuck any more, and what it has brought somewhere is there."""
        for name in self.hindrance.blocked:
            self.stage.block(name, False)
        for name in self.hindrance.stuck:
            self.stage.stick(name, False)
        world = self._world(after)
        for name in self._moved(before, after):
            if name in self._placed(after) and not self._is_where(name, after):
                self.stage.put(name, world)
        self.failed(after)
        self._open_after_failure()
        for name in self._halfway(world):
            if name in self._placed(after):
                self.stage.put(name, world)

    def _halfway(self, world: World) -> list[str]:
        """The joints that the last step was to move, which may have stopped halfway, and the parts that ride on them, crooked perhaps."""
        joints = [name for name in self._last if self.cell.bodies[name].guide is not None]
        parts = (name for name in self.cell.bodies if is_free(self.cell, name))
        return [*joints, *(name for name in parts if not set(joints).isdisjoint(world.supports(name)[1:]))]

    def _world(self, facts: Facts) -> World:
        return following(World.of(self.cell), facts)

    def _lying(self, facts: Facts) -> Mapping[str, Floats]:
        """Where the parts lie that no fact puts anywhere: poses in the world (4, 4)."""
        placed = self._placed(facts)
        free = (name for name in self.cell.bodies if is_free(self.cell, name))
        return {name: self.stage.pose(name) for name in free if name not in placed}

    def _placed(self, facts: Facts) -> set[str]:
        found = set()
        for fact in facts:
            for location in self.cell.locations:
                bindings = match(location.fact, fact, {})
                if bindings is not None:
                    found.add(str(substitute(location.body, bindings)))
        return found

    def _moved(self, before: Facts, after: Facts) -> list[str]:
        """Parts and joints that two sets of facts put elsewhere, except for the fingers."""
        one, other = self._world(before), self._world(after)
        hands = {each for arm in self.cell.arms for each in hand_of(one, arm)}
        return [
            name
            for name, body in self.cell.bodies.items()
            if name not in hands
            and (is_free(self.cell, name) or (body.guide is not None and not body.guide.follows))
            and self._differs(name, one, other)
        ]

    def _differs(self, name: str, one: World, other: World) -> bool:
        mine, theirs = one.placed[name], other.placed[name]
        same = np.abs(mine.T_parent_frame - theirs.T_parent_frame).max() < 1e-9
        return mine.parent != theirs.parent or not same

    def _is_where(self, name: str, facts: Facts) -> bool:
        """Whether a body is where some facts put it. What is in a hand is measured from the hand."""
        world, body = self._world(facts), self.cell.bodies[name]
        if body.guide is not None:
            return self.stage.is_near(name, value_of(world, name))
        there = self.stage.actual(world).pose("world", name)[:3, 3]
        return float(np.linalg.norm(self.stage.pose(name)[:3, 3] - there)) <= NEAR_M
