"""From a problem to a timetable: plans, schedules, makes a plan of the schedule, and checks it.

A schedule is always also a valid plan: the steps are put in the order of their starts, orders that
they do not need are removed, and the result passes the gate. Some plans have no structure that can
be scheduled. Such a plan keeps its own order, and passes the gate as it was given.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from cellwright.engine.model.ground_task import GroundTask
from cellwright.engine.model.outcome import Found, GaveUp, Infeasible, Statistics
from cellwright.engine.model.shop_scheduling import Timetable
from cellwright.engine.pipelines.planning.checked_plan import plan_and_ground, problem_of, task_for
from cellwright.engine.pipelines.planning.dwell_limits import wishes_for
from cellwright.engine.pipelines.planning.dwell_limits import wishes_of as wishes_of
from cellwright.engine.pipelines.planning.plan_files import plan_in
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.pipelines.planning.timetable.alternative_means import with_one_of_each
from cellwright.engine.pipelines.planning.timetable.block_schedule import (
    SCOPE_BLOCKS,
    arms_in,
    by_blocks,
    by_other_hands,
)
from cellwright.engine.pipelines.planning.timetable.block_schedule import (
    operators_of as operators_of,
)
from cellwright.engine.pipelines.planning.timetable.kept_order import (
    LONGEST,
    MAX_SCHEDULED_STEPS,
    order_keeping_timetable,
)
from cellwright.engine.pipelines.planning.timetable.step_order import TimedSteps, in_its_order
from cellwright.engine.pipelines.planning.window_keeping import (
    joins_the_same,
    judge_times,
    why_not_given,
)
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.scheduling import ScheduleLimits
from cellwright.engine.stages.scheduling.plan_blocks import Unstructured
from cellwright.engine.stages.scheduling.shop_translation import Wishes
from cellwright.kb import loader
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.plan_model import Plan
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Term

NOT_BUSY: Mapping[Term, int] = {}
NO_ERRANDS_IN_WINDOWS = "in no order of whole errands that was found are all windows kept"
WINDOWS_KEEP_ORDER = "measurements with windows keep their order"


def subject_of(target: str, goals: str = "", command: str = "") -> tuple[Problem, Plan | None]:
    """The problem that a target names, and the plan if the target is the file of a plan.

    Raises `InvalidInput`.
    """
    if loader.is_plan(Path(target)):
        return plan_in(Path(target))
    return problem_of(target, goals, command), None


def make_timetable(
    problem: Problem,
    plan: Plan | None = None,
    planning: SearchLimits = SearchLimits(),
    limits: ScheduleLimits = ScheduleLimits(),
) -> Timetable | Infeasible | GaveUp:
    """The timetable of `plan`, or of a new plan for the problem if none is given.

    Raises `InvalidInput`.
    """
    started = time.perf_counter()
    if plan is not None and len(plan.steps) > (LONGEST if problem.chains else MAX_SCHEDULED_STEPS):
        long = keep_plan_order(problem, _checked_plan(PlanGate(), problem, plan))
        if not long.keeps_hours:
            return why_not_given(problem, long)
        return replace(long, statistics=Statistics({}, {"in all": time.perf_counter() - started}))
    outcome, task = (
        (Found(plan), task_for(problem, plan))
        if plan is not None
        else plan_and_ground(problem, planning)
    )
    if not isinstance(outcome, Found):
        return outcome
    before = time.perf_counter()
    timetable_made = time_plan(problem, task, outcome.plan, limits)
    if isinstance(timetable_made, Infeasible):
        timetable_made = replace(
            own_order(problem, task, _checked_plan(PlanGate(), problem, outcome.plan)),
            note=timetable_made.reason,
        )
    if not isinstance(timetable_made, Timetable):
        return timetable_made
    if plan is None:
        timetable_made = _without_spares(problem, task, outcome, timetable_made, planning, limits)
    if not timetable_made.keeps_hours:
        return why_not_given(problem, timetable_made)
    seconds = {
        "planning": before - started,
        **timetable_made.statistics.seconds,
        "in all": time.perf_counter() - started,
    }
    return replace(timetable_made, statistics=Statistics(timetable_made.statistics.counts, seconds))


def _without_spares(
    problem: Problem,
    task: GroundTask,
    outcome: Found,
    timetable_made: Timetable,
    planning: SearchLimits,
    limits: ScheduleLimits,
) -> Timetable:
    """The best timetable of the plan, of one that does without spare means, and of both with
    their blocks shared out anew.
    """
    spared_timetables = without_spares(problem, task, outcome, timetable_made, planning, limits)
    return min([timetable_made, *spared_timetables], key=timetable_value)


def without_spares(
    problem: Problem,
    task: GroundTask,
    outcome: Found,
    timetable_made: Timetable,
    planning: SearchLimits,
    limits: ScheduleLimits,
) -> list[Timetable]:
    """The timetables of a plan that does without spare means, and of plans in which other arms do
    what it does.

    None if the plan that was found cannot be done sooner so.
    """
    fewer = None
    if (
        not timetable_made.schedule.proved
        if timetable_made.scope != SCOPE_BLOCKS
        else len(arms_in(problem, outcome.plan)) > 1
    ):
        fewer = with_one_of_each(problem, task, outcome, planning)
    timed_ = [] if fewer is None else [time_plan(problem, task, fewer, limits)]
    shared = (
        by_other_hands(problem, task, candidate, limits)
        for candidate in (outcome.plan, fewer)
        if candidate
    )
    return [
        *(candidate for candidate in timed_ if isinstance(candidate, Timetable)),
        *(
            _judge_timetable(problem, t, 0)
            for timetables_shared in shared
            for t in timetables_shared
        ),
    ]


def timetable_value(timetable_made: Timetable) -> tuple[int, ...]:
    """What timetables are compared by; one that keeps to all that is wished comes first, the
    best proved one last.
    """
    schedule = timetable_made.schedule
    late = sum(overstay.lasts - overstay.most for overstay in timetable_made.overstays)
    broken = sum(breach.amount for breach in timetable_made.breaches if breach.window.is_hard)
    price = sum(breach.cost for breach in timetable_made.breaches)
    wrong = late + broken + len(timetable_made.outside)
    best = wrong, schedule.tardiness + price, schedule.makespan
    return *best, timetable_made.plan.cost, len(timetable_made.plan.steps), -schedule.lower_bound


def time_plan(
    problem: Problem,
    task: GroundTask,
    plan: Plan,
    limits: ScheduleLimits = ScheduleLimits(),
    busy: Mapping[Term, int] = NOT_BUSY,
    begin: int = 0,
) -> Timetable | Infeasible | GaveUp:
    """The timetable of a plan: of its blocks where it can be cut into such, else of its steps one
    by one.

    What is `busy` at the start is free after so many units of time. The plan begins at `begin` of
    the clock that release and due times are of. Where longest stays are asked for, a plan's own
    order is no answer: then there may be none. Raises `InvalidInput` if the plan's own order
    remains and the checker refuses the plan.
    """
    gate = PlanGate()
    wishes = from_then_on(wishes_for(gate.semantics(problem), plan), begin, busy)
    if wishes.windows:
        return order_keeping_timetable(
            problem, _checked_plan(gate, problem, plan), wishes, WINDOWS_KEEP_ORDER
        )
    try:
        operators, goals = operators_of(task, plan)
    except Unstructured as error:
        return _as_given(problem, _checked_plan(gate, problem, plan), str(error), wishes)
    steps = TimedSteps(problem, task, plan, operators, goals, wishes)
    blocks = by_blocks(gate, steps, limits)
    if isinstance(blocks, Timetable):
        blocks = _judge_timetable(problem, blocks, steps.bound)
        if blocks.keeps_all:
            return blocks
    note = NO_ERRANDS_IN_WINDOWS if isinstance(blocks, Timetable) else blocks
    plan = _checked_plan(gate, problem, plan)
    best = replace(steps, plan=plan).in_best_order(gate, limits, note)
    if best is None:
        best = _as_given(problem, plan, note, wishes, steps.bound)
    if isinstance(best, Timetable):
        best = _judge_timetable(problem, best, steps.bound)
        return min([best, blocks], key=timetable_value) if isinstance(blocks, Timetable) else best
    return blocks if isinstance(blocks, Timetable) and blocks.keeps_hours else best


def _judge_timetable(problem: Problem, timetable: Timetable, bound: int) -> Timetable:
    """The timetable with the windows that it breaks. Where windows may join other steps in another
    order, nothing is proved but that no order ends before `bound`.
    """
    judged = judge_times(problem, timetable)
    if not problem.all_windows or joins_the_same(problem, judged.plan):
        return judged
    least = min(bound, judged.schedule.lower_bound)
    return replace(judged, schedule=replace(judged.schedule, proved=False, lower_bound=least))


def from_then_on(
    wishes: Wishes, begin: int, busy: Mapping[Term, int] = NOT_BUSY, tour: int | None = None
) -> Wishes:
    """The wishes for a plan that begins at a time: what should have ended before is late from the
    start.

    What is `busy` then is free after so many units of time. A tour that is under way by then has
    begun at `tour`.
    """
    release = {release_key: max(0, time_ - begin) for release_key, time_ in wishes.release.items()}
    due = {due_key: due - begin for due_key, due in wishes.due.items()}
    later_wishes = replace(wishes, release=_later_release(release, busy), due=due)
    if tour is None:
        return later_wishes
    windows = {
        name: (first + tour - begin, last + tour - begin)
        for name, (first, last) in wishes.windows.items()
    }
    return replace(later_wishes, windows=windows, under_way=True)


def _later_release(release: Mapping[Term, int], busy: Mapping[Term, int]) -> Mapping[Term, int]:
    return {**release, **{term: max(until, release.get(term, 0)) for term, until in busy.items()}}


def keep_plan_order(problem: Problem, plan: Plan) -> Timetable:
    """A checked plan in its own order, with the travel between its steps; nothing is grounded
    or searched.
    """
    most = LONGEST if problem.chains else MAX_SCHEDULED_STEPS
    long = f"more than {most} steps keep their order" if len(plan.steps) > most else ""
    return order_keeping_timetable(
        problem, plan, wishes_for(PlanGate().semantics(problem), plan), long
    )


def own_order(problem: Problem, task: GroundTask, plan: Plan) -> Timetable:
    """A checked plan with every step as early as its own order allows."""
    if len(plan.steps) > (LONGEST if problem.chains else MAX_SCHEDULED_STEPS):
        return keep_plan_order(problem, plan)
    wishes = wishes_for(PlanGate().semantics(problem), plan)
    if wishes.any:
        return order_keeping_timetable(problem, plan, wishes)
    try:
        operators, goals = operators_of(task, plan)
    except Unstructured:
        return in_its_order(problem, plan)
    bound = TimedSteps(problem, task, plan, operators, goals, wishes).bound
    return in_its_order(problem, plan, bound=bound)


def by_other_means(
    problem: Problem, task: GroundTask, plans: Sequence[Plan], limits: ScheduleLimits, bound: int
) -> Timetable | None:
    """The best plan that chooses among the steps of some plans and the same by other means, as arms
    and machines.

    None if there are no other means. No plan of the task is shorter than `bound`.
    """
    gate = PlanGate()
    wishes = wishes_for(gate.semantics(problem), *plans)
    if wishes.windows or wishes.between:
        return None
    try:
        (operators, goals), *other_plans = [operators_of(task, plan) for plan in plans]
    except Unstructured:
        return None
    more = [step for steps, _ in other_plans for step in steps if step not in operators]
    steps = TimedSteps(problem, task, plans[0], operators, goals, wishes)
    chosen = steps.in_best_choice(gate, more, limits, bound)
    return None if chosen is None else _judge_timetable(problem, chosen, bound)


def _as_given(problem: Problem, plan: Plan, note: str, wishes: Wishes, bound: int = 0) -> Timetable:
    """The plan in its own order, with everything that is wished; some things may stay too long
    in a place then.
    """
    return (
        order_keeping_timetable(problem, plan, wishes, note)
        if wishes.any
        else in_its_order(problem, plan, note, bound)
    )


def _checked_plan(gate: PlanGate, problem: Problem, plan: Plan) -> Plan:
    """A plan as it may be given out. Raises `InvalidInput` if the checker refuses it."""
    settled, wrong = gate.settled(problem, plan)
    if wrong:
        raise InvalidInput(wrong)
    return settled
