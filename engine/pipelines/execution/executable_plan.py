"""Executable plans: planned, timed and compiled from where a run stands."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from cellwright.engine.model.outcome import Found, Outcome
from cellwright.engine.model.plan_times import earliest_starts
from cellwright.engine.model.shop_scheduling import Timetable
from cellwright.engine.model.start_rules import NO_RULES, StartRules
from cellwright.engine.model.time_limits import missed_windows_text, tour_begin_so_far
from cellwright.engine.pipelines.execution.compiled_program import (
    CompiledProgram,
    compile_plan,
    initial_situation,
    unit_ms,
)
from cellwright.engine.pipelines.execution.planner_choice import choose_and_plan
from cellwright.engine.pipelines.planning.checked_plan import task_for
from cellwright.engine.pipelines.planning.dwell_limits import stays_of, wishes_for
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.pipelines.planning.timetable import from_then_on, time_plan
from cellwright.engine.pipelines.planning.timetable.kept_order import order_keeping_timetable
from cellwright.engine.stages.lifted.cell_domain import Situation
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.scheduling import ScheduleLimits
from cellwright.kb.model.plan_model import Plan, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Term

RESCHEDULE_WORK_S = 1.0  # of the scheduler for a recovery, about seconds of one core
# steps of a recovery that are scheduled anew; longer ones keep their order
MAX_RESCHEDULED_STEPS = 120

Since = Mapping[
    Atom, int
]  # when facts became true, and measurements began, in milliseconds of the run's clock
NO_TIMES: Since = {}
NOTHING_BUSY: Mapping[Term, int] = {}


@dataclass(frozen=True)
class ReadyPlan:
    """A plan that can be executed: when each step is forecast to start, and its program."""

    problem: Problem
    plan: Plan
    starts: Mapping[StepId, int]
    compiled: CompiledProgram
    makespan: int = 0
    outcome: Outcome | None = None
    notes: tuple[str, ...] = field(default=())


def first_plan(
    problem: Problem,
    limits: SearchLimits = SearchLimits(),
    outcome: Outcome | None = None,
    store: str = "",
) -> ReadyPlan | Outcome:
    """The first program of a run, or why there is none. `outcome` is a plan that is known already.
    Raises `InvalidInput`.

    What is learned of plans is kept in `store`, if one is given.
    """
    planned = choose_and_plan(problem, limits, store, outcome)
    if not isinstance(planned.outcome, Found):
        return planned.outcome
    return replace(
        compile_ready_plan(problem, planned.outcome.plan, planned.starts, 0), notes=planned.notes
    )


def schedule_again(
    problem: Problem,
    plan: Plan,
    begin_ms: int,
    limits: SearchLimits = SearchLimits(),
    since: Since = NO_TIMES,
    busy: Mapping[Term, int] = NOTHING_BUSY,
) -> ReadyPlan:
    """The program of a plan that was made while the run goes on. `since` says when facts became
    true.

    What is `busy` with steps under way is free after so many of the domain's units of time.
    """
    if not any(step.duration for step in plan.steps):
        return compile_ready_plan(problem, plan, None, begin_ms, since=since)
    if (waiting := in_windows(problem, plan, begin_ms, since, busy)) is not None:
        return waiting
    starts: Mapping[StepId, int] | None = None
    if len(plan.steps) <= MAX_RESCHEDULED_STEPS:
        work = ScheduleLimits(RESCHEDULE_WORK_S, limits.seed, interrupted=limits.interrupted)
        timetable = time_plan(
            problem,
            task_for(problem, plan),
            plan,
            work,
            busy,
            int(begin_ms // unit_ms(problem.domain)),
        )
        if isinstance(timetable, Timetable):
            plan, starts = timetable.plan, timetable.starts
    return compile_ready_plan(problem, plan, starts, begin_ms, since=since)


def in_windows(
    problem: Problem,
    plan: Plan,
    begin_ms: int,
    since: Since,
    busy: Mapping[Term, int] = NOTHING_BUSY,
) -> ReadyPlan | None:
    """The program of a plan whose measurements wait for their windows; None if they have none.

    Windows count from the start of the tour, which may be under way. Those that are missed are told
    in a note.
    """
    wishes, unit = wishes_for(PlanGate().semantics(problem), plan), unit_ms(problem.domain)
    if not wishes.windows:
        return None
    began = tour_begin_so_far(
        problem, wishes.windows, {atom: int(at_ms // unit) for atom, at_ms in since.items()}
    )
    begin = int(begin_ms // unit)
    timetable = order_keeping_timetable(problem, plan, from_then_on(wishes, begin, busy, began))
    shift = 0 if began is None else begin - began
    late = {name: at + shift for name, at in timetable.missed.items()}
    notes = (missed_windows_text(late, problem.domain.time_unit),) if late else ()
    return replace(
        compile_ready_plan(problem, plan, timetable.starts, begin_ms, since=since), notes=notes
    )


def compile_ready_plan(
    problem: Problem,
    plan: Plan,
    starts: Mapping[StepId, int] | None,
    begin_ms: int,
    here: Situation | None = None,
    since: Since = NO_TIMES,
    rules: StartRules = NO_RULES,
) -> ReadyPlan:
    """The program of a plan with its forecast; without `starts`, every step is as early as the
    plan's order allows. With the `rules` of a policy, steps begin by these.
    """
    times = dict(starts) if starts is not None else earliest_starts(plan)
    begin = here or initial_situation(problem)
    wishes = wishes_for(PlanGate().semantics(problem), plan)
    stays = tuple(stays_of(plan, wishes.longest_stay, begin, since))
    waits = bool(wishes.travel or wishes.longest_stay or wishes.release or wishes.windows)
    program = compile_plan(problem, plan, times, begin_ms, stays, waits, begin, rules)
    last = max((times[step.id] + step.duration for step in plan.steps), default=0)
    return ReadyPlan(problem, plan, times, program, last)
