"""The program of a run: planned, timed and compiled, from where the run stands."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from cellwright.engine.model.outcome import Found, Outcome
from cellwright.engine.model.schedule import Timetable
from cellwright.engine.model.windows import begun, outside
from cellwright.engine.pipelines.execution.compiling import Compiled, compiled, situation_of, unit_ms
from cellwright.engine.pipelines.gate import PlanGate
from cellwright.engine.pipelines.planning import task_for
from cellwright.engine.pipelines.stays import stays_of
from cellwright.engine.pipelines.timetable import from_then_on, timed
from cellwright.engine.pipelines.timetable.kept import kept
from cellwright.engine.pipelines.timetable.wishes import wishes_for
from cellwright.engine.stages.macros.lifted.situation import Situation
from cellwright.engine.stages.planning import Limits
from cellwright.engine.stages.scheduling import ScheduleLimits
from cellwright.kb.model.plan import Plan, StepId
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Atom, Term

WORK = 1.0  # of the scheduler for a recovery, about seconds of one core
SHORT = 120  # steps of a recovery that are scheduled anew; longer ones keep their order

Since = Mapping[
    Atom, int
]  # when facts became true, and measurements began, in milliseconds of the run's clock
NOTHING: Since = {}
FREE: Mapping[Term, int] = {}


@dataclass(frozen=True)
class Ready:
    """A plan that can be executed: when each step is forecast to start, and its program."""

    problem: Problem
    plan: Plan
    starts: Mapping[StepId, int]
    compiled: Compiled
    makespan: int = 0
    outcome: Outcome | None = None
    notes: tuple[str, ...] = field(default=())


def first(
    problem: Problem, limits: Limits = Limits(), outcome: Outcome | None = None, store: str = ""
) -> Ready | Outcome:
    """The first program of a run, or why there is none. `outcome` is a plan that is known already. Raises `InvalidInput`.

    What is learned of plans is kept in `store`, if one is given.
    """
    from cellwright.engine.pipelines.execution.toplevel import made

    found = made(problem, limits, store, outcome)
    if not isinstance(found.outcome, Found):
        return found.outcome
    return replace(ready(problem, found.outcome.plan, found.starts, 0), notes=found.notes)


def again(
    problem: Problem,
    plan: Plan,
    begin_ms: int,
    limits: Limits = Limits(),
    since: Since = NOTHING,
    busy: Mapping[Term, int] = FREE,
) -> Ready:
    """The program of a plan that was made while the run goes on. `since` says when facts became true.

    What is `busy` with steps under way is free after so many of the domain's units of time.
    """
    if not any(step.duration for step in plan.steps):
        return ready(problem, plan, None, begin_ms, since=since)
    if (waiting := in_windows(problem, plan, begin_ms, since, busy)) is not None:
        return waiting
    starts: Mapping[StepId, int] | None = None
    if len(plan.steps) <= SHORT:
        work = ScheduleLimits(WORK, limits.seed, interrupted=limits.interrupted)
        made = timed(
            problem, task_for(problem, plan), plan, work, busy, int(begin_ms // unit_ms(problem.domain))
        )
        if isinstance(made, Timetable):
            plan, starts = made.plan, made.starts
    return ready(problem, plan, starts, begin_ms, since=since)


def in_windows(
    problem: Problem, plan: Plan, begin_ms: int, since: Since, busy: Mapping[Term, int] = FREE
) -> Ready | None:
    """The program of a plan whose measurements wait for their windows; None if they have none.

    Windows count from the start of the tour, which may be under way. Those that are missed are told in a note.
    """
    wishes, unit = wishes_for(PlanGate().semantics(problem), plan), unit_ms(problem.domain)
    if not wishes.windows:
        return None
    began = begun(problem, wishes.windows, {atom: int(at_ms // unit) for atom, at_ms in since.items()})
    begin = int(begin_ms // unit)
    made = kept(problem, plan, from_then_on(wishes, begin, busy, began))
    shift = 0 if began is None else begin - began
    late = {name: at + shift for name, at in made.missed.items()}
    notes = (outside(late, problem.domain.time_unit),) if late else ()
    return replace(ready(problem, plan, made.starts, begin_ms, since=since), notes=notes)


def ready(
    problem: Problem,
    plan: Plan,
    starts: Mapping[StepId, int] | None,
    begin_ms: int,
    here: Situation | None = None,
    since: Since = NOTHING,
) -> Ready:
    """The program of a plan with its forecast; without `starts`, every step is as early as the plan's order allows."""
    from cellwright.engine.model.forecast import earliest_starts

    times = dict(starts) if starts is not None else earliest_starts(plan)
    begin = here or situation_of(problem)
    wishes = wishes_for(PlanGate().semantics(problem), plan)
    stays = tuple(stays_of(plan, wishes.longest_stay, begin, since))
    waits = bool(wishes.travel or wishes.longest_stay or wishes.release or wishes.windows)
    made = compiled(problem, plan, times, begin_ms, stays, waits, begin)
    last = max((times[step.id] + step.duration for step in plan.steps), default=0)
    return Ready(problem, plan, times, made, last)
