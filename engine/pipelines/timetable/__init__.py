"""From a problem to a timetable: plan, schedule, make a plan of the schedule, and check it.

A schedule is always also a valid plan: the steps are put in the order of their starts, orders that they do not need are
removed, and the result passes the gate. Some plans have no structure that can be scheduled. Such a plan keeps its own
order, and passes the gate as it was given.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from cellwright.engine.model.outcome import Found, GaveUp, Infeasible, Statistics
from cellwright.engine.model.schedule import Timetable
from cellwright.engine.model.task import Task
from cellwright.engine.pipelines.gate import PlanGate
from cellwright.engine.pipelines.planning import plan_in, planned, problem_of, task_for
from cellwright.engine.pipelines.timetable.blocked import BLOCKS, by_blocks
from cellwright.engine.pipelines.timetable.blocked import operators_of as operators_of
from cellwright.engine.pipelines.timetable.hands import arms_in, by_other_hands
from cellwright.engine.pipelines.timetable.kept import LONG, kept
from cellwright.engine.pipelines.timetable.orders import Steps, in_its_order
from cellwright.engine.pipelines.timetable.spares import with_one_of_each
from cellwright.engine.pipelines.timetable.wishes import wishes_for
from cellwright.engine.pipelines.timetable.wishes import wishes_of as wishes_of
from cellwright.engine.stages.planning import Limits
from cellwright.engine.stages.scheduling import ScheduleLimits
from cellwright.engine.stages.scheduling.blocks import Unstructured
from cellwright.engine.stages.scheduling.work import Wishes
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.plan import Plan
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Term

NOTHING: Mapping[Term, int] = {}
WINDOWS = "measurements with windows keep their order"


def subject_of(target: str, goals: str = "", command: str = "") -> tuple[Problem, Plan | None]:
    """The problem that a target names, and the plan if the target is the file of a plan. Raises `InvalidInput`."""
    from cellwright.kb.loader.plan import is_plan  # not needed for tasks in PDDL, and slow to load

    if is_plan(Path(target)):
        return plan_in(Path(target))
    return problem_of(target, goals, command), None


def timetable(
    problem: Problem,
    plan: Plan | None = None,
    planning: Limits = Limits(),
    limits: ScheduleLimits = ScheduleLimits(),
) -> Timetable | Infeasible | GaveUp:
    """The timetable of `plan`, or of a new plan for the problem if none is given. Raises `InvalidInput`."""
    started = time.perf_counter()
    if plan is not None and len(plan.steps) > LONG:
        long = keeping(problem, _sound(PlanGate(), problem, plan))
        return replace(long, statistics=Statistics({}, {"in all": time.perf_counter() - started}))
    outcome, task = (Found(plan), task_for(problem, plan)) if plan is not None else planned(problem, planning)
    if not isinstance(outcome, Found):
        return outcome
    before = time.perf_counter()
    made = timed(problem, task, outcome.plan, limits)
    if isinstance(made, Infeasible):
        made = replace(own_order(problem, task, _sound(PlanGate(), problem, outcome.plan)), note=made.reason)
    if not isinstance(made, Timetable):
        return made
    if plan is None:
        made = _without_spares(problem, task, outcome, made, planning, limits)
    seconds = {
        "planning": before - started,
        **made.statistics.seconds,
        "in all": time.perf_counter() - started,
    }
    return replace(made, statistics=Statistics(made.statistics.counts, seconds))


def _without_spares(
    problem: Problem, task: Task, outcome: Found, made: Timetable, planning: Limits, limits: ScheduleLimits
) -> Timetable:
    """The best timetable of the plan, of one that does without spare means, and of both with their blocks shared out anew."""
    others = without_spares(problem, task, outcome, made, planning, limits)
    return min([made, *others], key=value_of)


def without_spares(
    problem: Problem, task: Task, outcome: Found, made: Timetable, planning: Limits, limits: ScheduleLimits
) -> list[Timetable]:
    """The timetables of a plan that does without spare means, and of plans in which other arms do what it does.

    None if the plan that was found cannot be done sooner so.
    """
    fewer = None
    if not made.schedule.proved if made.scope != BLOCKS else len(arms_in(problem, outcome.plan)) > 1:
        fewer = with_one_of_each(problem, task, outcome, planning)
    timed_ = [] if fewer is None else [timed(problem, task, fewer, limits)]
    shared = (by_other_hands(problem, task, each, limits) for each in (outcome.plan, fewer) if each)
    return [*(each for each in timed_ if isinstance(each, Timetable)), *(t for each in shared for t in each)]


def value_of(made: Timetable) -> tuple[int, ...]:
    """What timetables are compared by; one that keeps to all that is wished comes first, the best proved one last."""
    schedule = made.schedule
    late = sum(each.lasts - each.most for each in made.overstays)
    best = late, schedule.tardiness, schedule.makespan
    return *best, made.plan.cost, len(made.plan.steps), -schedule.lower_bound


def timed(
    problem: Problem,
    task: Task,
    plan: Plan,
    limits: ScheduleLimits = ScheduleLimits(),
    busy: Mapping[Term, int] = NOTHING,
    begin: int = 0,
) -> Timetable | Infeasible | GaveUp:
    """The timetable of a plan: of its blocks where it can be cut into such, else of its steps one by one.

    What is `busy` at the start is free after so many units of time. The plan begins at `begin` of the clock that release and
    due times are of. Where longest stays are asked for, a plan's own order is no answer: then there may be none. Raises `InvalidInput` if the
    plan's own order remains and the checker refuses the plan.
    """
    gate = PlanGate()
    wishes = from_then_on(wishes_for(gate.semantics(problem), plan), begin, busy)
    if wishes.windows:
        return kept(problem, _sound(gate, problem, plan), wishes, WINDOWS)
    try:
        operators, goals = operators_of(task, plan)
    except Unstructured as error:
        return _as_given(problem, _sound(gate, problem, plan), str(error), wishes)
    steps = Steps(problem, task, plan, operators, goals, wishes)
    made = by_blocks(gate, steps, limits)
    if not isinstance(made, str):
        return made
    plan = _sound(gate, problem, plan)
    best = replace(steps, plan=plan).in_best_order(gate, limits, made)
    return best if best is not None else _as_given(problem, plan, made, wishes, steps.bound)


def from_then_on(
    wishes: Wishes, begin: int, busy: Mapping[Term, int] = NOTHING, tour: int | None = None
) -> Wishes:
    """The wishes for a plan that begins at a time: what should have ended before is late from the start.

    What is `busy` then is free after so many units of time. A tour that is under way by then has begun at `tour`.
    """
    release = {each: max(0, time_ - begin) for each, time_ in wishes.release.items()}
    due = {each: due - begin for each, due in wishes.due.items()}
    found = replace(wishes, release=_later(release, busy), due=due)
    if tour is None:
        return found
    windows = {
        name: (first + tour - begin, last + tour - begin) for name, (first, last) in wishes.windows.items()
    }
    return replace(found, windows=windows, under_way=True)


def _later(release: Mapping[Term, int], busy: Mapping[Term, int]) -> Mapping[Term, int]:
    return {**release, **{term: max(until, release.get(term, 0)) for term, until in busy.items()}}


def keeping(problem: Problem, plan: Plan) -> Timetable:
    """A checked plan in its own order, with the travel between its steps; nothing is grounded or searched."""
    long = f"more than {LONG} steps keep their order" if len(plan.steps) > LONG else ""
    return kept(problem, plan, wishes_for(PlanGate().semantics(problem), plan), long)


def own_order(problem: Problem, task: Task, plan: Plan) -> Timetable:
    """A checked plan with every step as early as its own order allows."""
    if len(plan.steps) > LONG:
        return keeping(problem, plan)
    wishes = wishes_for(PlanGate().semantics(problem), plan)
    if wishes.any:
        return kept(problem, plan, wishes)
    try:
        operators, goals = operators_of(task, plan)
    except Unstructured:
        return in_its_order(problem, plan)
    bound = Steps(problem, task, plan, operators, goals, wishes).bound
    return in_its_order(problem, plan, bound=bound)


def by_other_means(
    problem: Problem, task: Task, plans: Sequence[Plan], limits: ScheduleLimits, bound: int
) -> Timetable | None:
    """The best plan that chooses among the steps of some plans and the same by other means, as arms and machines.

    None if there are no other means. No plan of the task is shorter than `bound`.
    """
    gate = PlanGate()
    wishes = wishes_for(gate.semantics(problem), *plans)
    if wishes.windows:
        return None
    try:
        (operators, goals), *others = [operators_of(task, plan) for plan in plans]
    except Unstructured:
        return None
    more = [step for steps, _ in others for step in steps if step not in operators]
    steps = Steps(problem, task, plans[0], operators, goals, wishes)
    return steps.in_best_choice(gate, more, limits, bound)


def _as_given(problem: Problem, plan: Plan, note: str, wishes: Wishes, bound: int = 0) -> Timetable:
    """The plan in its own order, with everything that is wished; some things may stay too long in a place then."""
    return kept(problem, plan, wishes, note) if wishes.any else in_its_order(problem, plan, note, bound)


def _sound(gate: PlanGate, problem: Problem, plan: Plan) -> Plan:
    """A plan as it may be given out. Raises `InvalidInput` if the checker refuses it."""
    settled, wrong = gate.settled(problem, plan)
    if wrong:
        raise InvalidInput(wrong)
    return settled
