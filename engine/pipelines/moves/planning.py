"""From a problem to a plan that moves: plan, walk through it with the arm, and plan again where a step has no motion.

A step without a motion becomes a condition of its operator (`bars`), and planning goes on: where measurements are made in an order,
only from the measurement of that step on, until all is as it was. When every step moves, its real
time replaces the declared one, the steps are scheduled again, and the plan passes the gate with these times.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from cellwright.engine.model.moves import MovedStep, Unmoved
from cellwright.engine.model.outcome import Found, GaveUp, Infeasible, Outcome
from cellwright.engine.model.passing import Sharing
from cellwright.engine.model.schedule import Schedule, Timetable
from cellwright.engine.pipelines.attainment import GivenUp
from cellwright.engine.pipelines.gate import PlanGate
from cellwright.engine.pipelines.moves.bars import told, without_blocked
from cellwright.engine.pipelines.moves.leaving_out import all_lost, within_reach
from cellwright.engine.pipelines.moves.meetings import Encounters
from cellwright.engine.pipelines.moves.passing import Shared, kept_apart
from cellwright.engine.pipelines.moves.states import in_order
from cellwright.engine.pipelines.moves.walking import Walk, Ways
from cellwright.engine.pipelines.objective import Run
from cellwright.engine.pipelines.parts.patching import patched
from cellwright.engine.pipelines.places import measured_at
from cellwright.engine.pipelines.planning import task_for
from cellwright.engine.pipelines.timetable import keeping, own_order, timed
from cellwright.engine.pipelines.timetable.kept import LONG
from cellwright.engine.pipelines.timetable.orders import by_step
from cellwright.engine.pipelines.timetable.wishes import wishes_for
from cellwright.engine.ports import GeometryBackend
from cellwright.engine.stages.planning import Limits
from cellwright.engine.stages.scheduling.blocks import mentions
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.cell import Cell
from cellwright.kb.model.plan import Plan, StepId
from cellwright.kb.model.problem import Problem
from cellwright.kb.syntax import SECONDS
from cellwright.kb.terms import Function

MOST_BARS = 60  # steps without motion, after which planning gives up
NONE_LOST: Mapping[str, str] = {}
NOTHING_LEFT = "no arm can take any of the measurements that are asked for"
PASSING = "of all ways in which the arms pass each other, each with its steps in this order"
ROUNDS = 4  # schedules, each of whose order is walked through again


@dataclass(frozen=True, slots=True, eq=False)
class Moving:
    """A run whose plan moves. `problem` has the real times of the steps, `steps` their motions, `refused` what had none.

    `given_up` are goals about measurements that no arm can take; `problem` is without them. `sharing` says how several arms keep
    apart. `walk` knows the motions of the steps, and the cell.
    """

    run: Run
    problem: Problem
    steps: tuple[MovedStep, ...] = ()
    refused: tuple[Unmoved, ...] = ()
    given_up: tuple[GivenUp, ...] = ()
    sharing: Sharing | None = None
    walk: Walk | None = None


def plan_moving(
    problem: Problem,
    cell: Cell,
    backend: GeometryBackend,
    planned: Callable[[Problem], Run],
    seed: int = 0,
    ways: Ways | None = None,
    lost: Mapping[str, str] = NONE_LOST,
) -> Moving:
    """A plan for the problem, by `planned`, in which every step moves.

    `ways` are straight ways into places that are known already. `lost` says why no arm can take some measurements. Goals about
    them are given up, and so are goals about measurements whose place is refused, if there is no plan with them.
    Raises `InvalidInput` for a cell without operations.
    """
    _require_operations(cell)
    refused: list[Unmoved] = []
    walk = Walk(PlanGate().semantics(problem), cell, backend, seed, ways=ways or {})
    last: Run | None = None
    while len(refused) <= MOST_BARS:
        left, given_up = within_reach(problem, lost)
        asked = without_blocked(left, refused)
        run = (_patched(asked, last, refused[-1].step, seed) if last else None) or planned(asked)
        if not isinstance(run.outcome, Found):
            if more := _lost(problem, refused, lost):
                lost = {**lost, **more}
                continue
            outcome = _without(run.outcome, refused)
            if left is problem and lost and isinstance(outcome, Infeasible):
                outcome = replace(outcome, reason=NOTHING_LEFT)
            return Moving(Run(outcome), problem, (), tuple(refused), given_up or all_lost(problem, lost))
        steps = list(walk.steps(run.outcome.plan))
        if steps and isinstance(steps[-1], Unmoved):
            refused, last = [*refused, steps[-1]], run
            continue
        moved = [each for each in steps if isinstance(each, MovedStep)]
        made = _in_real_time(_Asked(left, asked, walk), run, moved, refused)
        return replace(made, given_up=given_up, walk=walk)
    reason = f"{len(refused)} steps have no motion; the last: {told(refused[-1:])}"
    return Moving(Run(GaveUp(reason, "work")), problem, refused=tuple(refused))


def _patched(problem: Problem, last: Run, failed: StepId, seed: int) -> Run | None:
    """The last run with the part of a step replanned that has no motion, if it follows a sequence and the rest can stay."""
    if last.itinerary is None or not isinstance(last.outcome, Found):
        return None
    found = patched(problem, last.outcome.plan, last.itinerary, failed, Limits(seed=seed))
    if not isinstance(found, Found):
        return None if found is None else Run(found, None, last.itinerary)
    return Run(found, keeping(problem, found.plan), last.itinerary)


def _lost(problem: Problem, refused: Sequence[Unmoved], lost: Mapping[str, str]) -> dict[str, str]:
    """The measurements whose places have refused steps, with the reasons, but for those that are known to be lost."""
    words, found = problem.domain.conventions, dict[str, str]()
    for each in refused:
        name = measured_at(words, each.place)
        if name and name not in lost:
            found[name] = each.reason if each.sure else f"{each.reason} (not proved)"
    return found


def _require_operations(cell: Cell) -> None:
    if not cell.operations:
        hint = "say what the arm does in a step under `operations:`, such as pick(Item, Place): {at: Place}"
        raise InvalidInput([Diagnostic(Source(cell.path), "K405", "the cell declares no operations", hint)])


def _without(outcome: Outcome, refused: Sequence[Unmoved]) -> Outcome:
    """The outcome of planning without the steps that have no motion."""
    if not refused or not isinstance(outcome, Infeasible):
        return outcome
    reason = f"{outcome.reason}; {told(refused)}"
    if all(each.sure for each in refused):
        return replace(outcome, reason=reason)
    return GaveUp(f"{reason}. Whether there really is no way was not proved", "work", outcome.statistics)


@dataclass(frozen=True, slots=True, eq=False)
class _Asked:
    """The problem as it was given, and without the steps that have no motion; the arm that walks through its plans."""

    problem: Problem
    barred: Problem
    walk: Walk


def _in_real_time(asked: _Asked, run: Run, steps: list[MovedStep], refused: Sequence[Unmoved]) -> Moving:
    """The plan with the times of its motions, in the best order that is found; in its own order if no order settles."""
    assert isinstance(run.outcome, Found)
    plan = run.outcome.plan
    for _ in range(ROUNDS):
        barred, plan = with_times(asked.barred, plan, steps)
        table = _scheduled(barred, plan, run)
        if table is None:
            break
        again: Sequence[MovedStep | Unmoved] = steps
        if _tour(table.plan) != _tour(plan):
            again = list(asked.walk.steps(table.plan))
        if any(isinstance(each, Unmoved) for each in again):
            break
        moved = [each for each in again if isinstance(each, MovedStep)]
        settled = _times(moved, barred) == _times(steps, barred)
        plan, steps = table.plan, moved
        if settled:
            return _made(asked, run, table, steps, refused)
    barred, plan = with_times(asked.barred, plan, steps)
    table = own_order(barred, task_for(barred, plan), plan)
    return _made(asked, run, table, steps, refused)


def _tour(plan: Plan) -> list[tuple[StepId, Function]]:
    """What the arms do one after the other."""
    return [(step.id, step.operator) for step in in_order(plan)]


def _made(
    asked: _Asked, run: Run, table: Timetable, steps: Sequence[MovedStep], refused: Sequence[Unmoved]
) -> Moving:
    """The answer, which has passed the gate with the times of its motions in place of those of the domain."""
    assert isinstance(run.outcome, Found)
    sharing = None
    if len(asked.walk.cell.arms) > 1:
        shared = _kept_apart(asked, table)
        if isinstance(shared, str):
            reason = f"the arms get in each other's way: {shared}"
            return Moving(Run(GaveUp(reason, "work")), asked.problem, refused=tuple(refused))
        table, steps, sharing = _as_table(asked, table, shared), shared.steps, shared.sharing
    problem = replace(asked.problem, durations=_times(steps, asked.problem))
    plan = PlanGate().accepted(problem, table.plan)
    outcome = replace(run.outcome, plan=plan, optimal=False)
    made = replace(run, outcome=outcome, timetable=table)
    return Moving(made, problem, tuple(steps), tuple(refused), sharing=sharing)


def _kept_apart(asked: _Asked, table: Timetable) -> Shared | str:
    """The plan in which several arms keep apart."""
    wishes = wishes_for(asked.walk.semantics, table.plan)
    release = {
        step.id: max(time, 0)
        for step in table.plan.steps
        for subject, time in wishes.release.items()
        if mentions(step.operator, subject)
    }

    def lasting(plan: Plan, steps: Sequence[MovedStep]) -> Plan:
        return with_times(asked.barred, plan, steps)[1]

    return kept_apart(asked.walk, table.plan, lasting, Encounters(asked.walk.backend), release)


def _as_table(asked: _Asked, table: Timetable, shared: Shared) -> Timetable:
    """The timetable of the plan in which the arms keep apart."""
    bound = min(shared.sharing.lower_bound, shared.makespan)
    made = Schedule({}, (), shared.makespan, bound, proved=shared.sharing.proved)
    problem = replace(asked.barred, durations=_times(shared.steps, asked.barred))
    return by_step(problem, shared.plan, shared.starts, made, table.note, PASSING)


def _times(steps: Sequence[MovedStep], problem: Problem) -> Mapping[Function, int]:
    """How long each step lasts, in the domain's unit, rounded up; the longest time of those with the same name."""
    unit = float(SECONDS[problem.domain.time_unit])
    found = dict(problem.durations)
    longest: dict[Function, int] = {}
    for each in steps:
        lasts = math.ceil(each.seconds / unit - 1e-9)
        longest[each.operator] = max(lasts, longest.get(each.operator, 0))
    return found | longest


def with_times(problem: Problem, plan: Plan, steps: Sequence[MovedStep]) -> tuple[Problem, Plan]:
    """The problem and the plan with the times of motions."""
    times = _times(steps, problem)
    lasting = tuple(replace(step, duration=times.get(step.operator, step.duration)) for step in plan.steps)
    return replace(problem, durations=times), replace(plan, steps=lasting)


def _scheduled(problem: Problem, plan: Plan, run: Run) -> Timetable | None:
    """The plan in the best order that is found with these times; a sequence of measurements keeps its order."""
    if run.itinerary is not None or len(plan.steps) > LONG:
        return keeping(problem, plan)
    made = timed(problem, task_for(problem, plan), plan)
    return made if isinstance(made, Timetable) else None
