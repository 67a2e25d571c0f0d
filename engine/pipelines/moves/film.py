"""Films of a plan or a run: where everything is from moment to moment while the arms take their steps. Waiting is left out."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.moves import Leg, LegKind, MovedStep
from cellwright.engine.pipelines.moves.states import states_of
from cellwright.engine.pipelines.moves.steps import guide_value
from cellwright.engine.pipelines.moves.walking import Walk, operation_of
from cellwright.engine.stages.geometry.world.following import following
from cellwright.engine.stages.geometry.world.model import World
from cellwright.engine.stages.validation.semantics import Semantics
from cellwright.kb.model.cell import Cell, Operation
from cellwright.kb.model.plan import Plan, Step, StepId
from cellwright.kb.terms import Atom, Function

SHORT_S = 0.5  # how long a change without a motion is shown


@dataclass(frozen=True, slots=True, eq=False)
class Take:
    """A step to be shown: its motion, if it has one, and the cell before and after it."""

    before: World
    after: World
    moved: MovedStep | None = None
    operation: Operation | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """The cell at a moment of the film."""

    at_s: float
    world: World


def takes_of_plan(semantics: Semantics, cell: Cell, plan: Plan, steps: Sequence[MovedStep]) -> Iterator[Take]:
    """The takes of a plan that moves."""
    moved = {each.step: each for each in steps}
    for step, before, after in states_of(semantics, plan):
        worlds = following(World.of(cell), before), following(World.of(cell), after)
        if step.id in moved:
            yield Take(*worlds, moved[step.id], operation_of(cell, step.operator))
        else:
            yield Take(*worlds)


def takes_of_run(
    walk: Walk, start: Iterable[Atom], told: Iterable[tuple[Function | None, Iterable[Atom], Iterable[Atom]]]
) -> Iterator[Take]:
    """The takes of a run. `told` says, record by record, which step was done, what it added, and what it ended.

    Where no step is named, the world model was corrected. A step that has no motion now is shown without one.
    """
    state = frozenset(start)
    for number, (action, adds, ends) in enumerate(told, 1):
        after = (state - frozenset(ends)) | frozenset(adds)
        worlds = walk.room(state).world, walk.room(after).world
        operation = None if action is None else operation_of(walk.cell, action)
        moved = None
        if action is not None and operation is not None:
            found = walk.step(Step(StepId(number), action), operation, state, after)
            moved = found if isinstance(found, MovedStep) else None
        yield Take(*worlds, moved, operation if moved else None)
        state = after


def filmed(takes: Iterable[Take], every_s: float) -> Iterator[Shot]:
    """The shots of a film, so often, and wherever something ends."""
    now, arms = 0.0, dict[str, Floats]()
    for take in takes:
        if not arms:
            arms = dict(take.before.configurations)
            yield Shot(0.0, take.before)
        if take.moved is None or take.operation is None:
            if not _same(take.before, take.after):
                now += SHORT_S
                yield Shot(now, _with(take.after, arms))
            continue
        for shot in _of_step(take, take.moved, take.operation, arms, every_s):
            yield Shot(now + shot.at_s, shot.world)
        now += take.moved.seconds


def thinned(shots: Sequence[Shot], every_s: float) -> list[Shot]:
    """The first shot after each so many seconds, and the last one."""
    found, due = list[Shot](), 0.0
    for shot in shots:
        if shot.at_s >= due - 1e-9:
            found.append(shot)
            due = (int(shot.at_s / every_s + 1e-9) + 1) * every_s
    return found if not shots or found[-1] is shots[-1] else [*found, shots[-1]]


def _of_step(
    take: Take, moved: MovedStep, operation: Operation, arms: dict[str, Floats], every_s: float
) -> Iterator[Shot]:
    """The shots of one step, from its start. `arms` is where the arms are, and follows them."""
    t = 0.0
    for leg in moved.legs:
        lasts = moved.takes_s if leg.kind is LegKind.DRIVE else leg.seconds
        for at in _moments(lasts, every_s):
            for each in (leg, *leg.beside):
                arms[each.arm] = each.at(at)
            yield Shot(t + at, _with(_during(take, leg, operation, at / lasts if lasts else 1.0), arms))
        t += lasts
        if leg.kind is LegKind.IN and moved.takes_s:
            t += moved.takes_s
            dragged = operation.drags and any(each.kind is LegKind.DRAG for each in moved.legs)
            yield Shot(t, _with(take.before if dragged else take.after, arms))


def _during(take: Take, leg: Leg, operation: Operation, share: float) -> World:
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
            held = take.before.moved(leg.arm, leg.path[0])
            return held.affix(str(operation.carries), f"{leg.arm}.tool")


def _moments(lasts: float, every_s: float) -> list[float]:
    count = max(1, int(np.ceil(lasts / every_s)))
    return [lasts * n / count for n in range(1, count + 1)]


def _with(world: World, arms: dict[str, Floats]) -> World:
    for arm, q in arms.items():
        world = world.moved(arm, q)
    return world


def _same(one: World, other: World) -> bool:
    return all(
        fixed.parent == other.placed[name].parent
        and np.array_equal(fixed.T_parent_frame, other.placed[name].T_parent_frame)
        for name, fixed in one.placed.items()
    )
