"""Films of a plan or a run: where everything is from moment to moment, without the waiting."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.motion_values import LegKind, MovedStep, StepLeg
from cellwright.engine.pipelines.motion.places_in_a_row import step_parts
from cellwright.engine.pipelines.motion.plan_walk import PlanWalk, operation_of, states_of
from cellwright.engine.pipelines.motion.step_motion import guide_value
from cellwright.engine.stages.geometry.world.geometric_world import (
    GeometricWorld,
    world_after_facts,
)
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.model.cell_model import Cell, Operation
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.terms import Atom, Function

SHORT_S = 0.5  # how long a change without a motion is shown


@dataclass(frozen=True, slots=True, eq=False)
class FilmTake:
    """A step to be shown: its motion, if it has one, and the cell before and after it."""

    before: GeometricWorld
    after: GeometricWorld
    moved: MovedStep | None = None
    operation: Operation | None = None


@dataclass(frozen=True, slots=True, eq=False)
class FilmShot:
    """The cell at a moment of the film."""

    at_s: float
    world: GeometricWorld


def takes_of_plan(
    semantics: Semantics, cell: Cell, plan: Plan, steps: Sequence[MovedStep]
) -> Iterator[FilmTake]:
    """The takes of a plan that moves."""
    moved = {step.step: step for step in steps}
    for step, before, after in states_of(semantics, plan):
        worlds = (
            world_after_facts(GeometricWorld.of(cell), before),
            world_after_facts(GeometricWorld.of(cell), after),
        )
        if step.id in moved:
            yield FilmTake(*worlds, moved[step.id], operation_of(cell, step.operator))
        else:
            yield FilmTake(*worlds)


def takes_of_run(
    walk: PlanWalk,
    start: Iterable[Atom],
    told_steps: Iterable[tuple[Function | None, Iterable[Atom], Iterable[Atom]]],
) -> Iterator[FilmTake]:
    """The takes of a run. `told` says, record by record, which step was done, what it added, and
    what it ended.

    Where no step is named, the world model was corrected. A step that has no motion now is shown
    without one.
    """
    state = frozenset(start)
    for number, (action, adds, ends) in enumerate(told_steps, 1):
        after = (state - frozenset(ends)) | frozenset(adds)
        worlds = walk.room(state).world, walk.room(after).world
        operation = None if action is None else operation_of(walk.cell, action)
        moved = None
        if action is not None and operation is not None:
            motion = walk.step(Step(StepId(number), action), operation, state, after)
            moved = motion if isinstance(motion, MovedStep) else None
        yield FilmTake(*worlds, moved, operation if moved else None)
        state = after


def shots_of_film(takes: Iterable[FilmTake], every_s: float) -> Iterator[FilmShot]:
    """The shots of a film, so often, and wherever something ends."""
    now, arms = 0.0, dict[str, Floats]()
    for take in takes:
        if not arms:
            arms = dict(take.before.configurations)
            yield FilmShot(0.0, take.before)
        if take.moved is None or take.operation is None:
            if not _is_same_world(take.before, take.after):
                now += SHORT_S
                yield FilmShot(now, _with_arms(take.after, arms))
            continue
        for part, before, after in step_parts(take.moved, take.before, take.after):
            of_part = replace(take, before=before, after=after, moved=part)
            for shot in _of_step(of_part, part, take.operation, arms, every_s):
                yield FilmShot(now + shot.at_s, shot.world)
            now += part.seconds


def thin_shots(shots: Sequence[FilmShot], every_s: float) -> list[FilmShot]:
    """The first shot after each so many seconds, and the last one."""
    shots_kept, due = list[FilmShot](), 0.0
    for shot in shots:
        if shot.at_s >= due - 1e-9:
            shots_kept.append(shot)
            due = (int(shot.at_s / every_s + 1e-9) + 1) * every_s
    return shots_kept if not shots or shots_kept[-1] is shots[-1] else [*shots_kept, shots[-1]]


def _of_step(
    take: FilmTake, moved: MovedStep, operation: Operation, arms: dict[str, Floats], every_s: float
) -> Iterator[FilmShot]:
    """The shots of one step, from its start. `arms` is where the arms are, and follows them."""
    t = 0.0
    for leg in moved.legs:
        lasts = moved.takes_s if leg.kind is LegKind.DRIVE else leg.seconds
        for at in _shot_times(lasts, every_s):
            for own_leg in (leg, *leg.beside):
                arms[own_leg.arm] = own_leg.at(at)
            yield FilmShot(
                t + at,
                _with_arms(_world_during(take, leg, operation, at / lasts if lasts else 1.0), arms),
            )
        t += lasts
        if leg.kind is LegKind.IN and moved.takes_s:
            t += moved.takes_s
            dragged = operation.drags and any(leg.kind is LegKind.DRAG for leg in moved.legs)
            yield FilmShot(t, _with_arms(take.before if dragged else take.after, arms))


def _world_during(
    take: FilmTake, leg: StepLeg, operation: Operation, share: float
) -> GeometricWorld:
    """The furniture and parts while a leg is under way."""
    match leg.kind:
        case LegKind.WAY | LegKind.IN:
            return take.before
        case LegKind.OUT:
            return take.after
        case LegKind.DRAG | LegKind.DRIVE:
            body = operation.drags or operation.drives
            first, last = guide_value(take.before, body), guide_value(take.after, body)
            return take.before.guided(body, first + share * (last - first))
        case LegKind.CARRY:
            world_held = take.before.moved(leg.arm, leg.path[0])
            return world_held.affix(str(operation.carries), f"{leg.arm}.tool")


def _shot_times(lasts: float, every_s: float) -> list[float]:
    count = max(1, int(np.ceil(lasts / every_s)))
    return [lasts * n / count for n in range(1, count + 1)]


def _with_arms(world: GeometricWorld, arms: dict[str, Floats]) -> GeometricWorld:
    for arm, q in arms.items():
        world = world.moved(arm, q)
    return world


def _is_same_world(first_world: GeometricWorld, second_world: GeometricWorld) -> bool:
    return all(
        fixed.parent == second_world.placed[name].parent
        and np.array_equal(fixed.T_parent_frame, second_world.placed[name].T_parent_frame)
        for name, fixed in first_world.placed.items()
    )
