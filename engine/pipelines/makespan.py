"""The plan with the least makespan: several plans are scheduled, and the best timetable is the answer."""

from collections.abc import Iterator
from dataclasses import replace

from cellwright.engine.model.outcome import Found, GaveUp, Infeasible
from cellwright.engine.model.schedule import Timetable
from cellwright.engine.model.task import Task
from cellwright.engine.pipelines.gate import accepted
from cellwright.engine.pipelines.planning import in_the_order_named
from cellwright.engine.pipelines.timetable import (
    by_other_means,
    keeping,
    own_order,
    timed,
    value_of,
    without_spares,
)
from cellwright.engine.pipelines.timetable.kept import LONG
from cellwright.engine.pipelines.timetable.orders import least_makespan
from cellwright.engine.pipelines.turns import in_turn
from cellwright.engine.stages.planning import Limits
from cellwright.engine.stages.planning import plan as plan_task
from cellwright.engine.stages.scheduling import ScheduleLimits
from cellwright.kb.model.plan import Plan
from cellwright.kb.model.problem import Problem

WORK = 3.0  # of the solver, about seconds of one core
CHOOSING = 2.0  # at most of it, and a sixth, spent on other means
SOON = 5_000  # expansions after which no second plan is looked for
SECOND = 2_000  # expansions that a second plan may take
PLANS = "of all plans"


def fastest(
    problem: Problem, task: Task, outcome: Found, limits: Limits, work: ScheduleLimits | None = None
) -> tuple[Timetable, Infeasible | GaveUp | None]:
    """The best timetable of the plan and of others found from there on; and why a plan has none, if one has none."""
    work = work or ScheduleLimits(WORK, limits.seed, interrupted=limits.interrupted)
    bound = least_makespan(task)
    if len(outcome.plan.steps) > LONG:
        return _judged(keeping(problem, outcome.plan), bound), None
    own = own_order(problem, task, outcome.plan)
    if own.schedule.makespan <= bound and not own.overstays:
        named = _named(problem, task, own.plan)
        other = own if named == own.plan else own_order(problem, task, named)
        return _judged(other if value_of(other) <= value_of(own) else own, bound), None
    if limits.interrupted() and not own.overstays:  # the solver alone takes longer to load than is left
        return _judged(own, bound), None
    plans = list(_plans(problem, task, outcome, limits))
    made = [timed(problem, task, each, work) for each in plans]
    if isinstance(made[0], Timetable):
        made += without_spares(problem, task, outcome, made[0], limits, work)
    choosing = replace(work, work=min(work.work / 6, CHOOSING))
    made += [each for each in [by_other_means(problem, task, plans, choosing, bound)] if each is not None]
    found = [own, *(each for each in made if isinstance(each, Timetable))]
    refused = next((each for each in made if not isinstance(each, Timetable)), None)
    return _as_named(problem, task, _judged(min(found, key=value_of), bound), bound, choosing), refused


def _as_named(problem: Problem, task: Task, best: Timetable, bound: int, work: ScheduleLimits) -> Timetable:
    """The best timetable, or one that is as good and does things in the order in which they are named."""
    plan = _named(problem, task, best.plan)
    made = None if plan == best.plan else timed(problem, task, plan, work)
    if not isinstance(made, Timetable):
        return best
    made = _judged(made, bound)
    as_good = value_of(made)[:-1] <= value_of(best)[:-1] and made.schedule.proved >= best.schedule.proved
    return made if as_good and _named(problem, task, made.plan) == made.plan else best


def _named(problem: Problem, task: Task, plan: Plan) -> Plan:
    """The plan that does in its turn what has one, and serves alike objects in the order in which they are named."""
    return in_the_order_named(problem, in_turn(problem, task, plan))


def _judged(made: Timetable, bound: int) -> Timetable:
    """The timetable, with the proof that no plan is shorter if it meets a bound of all plans."""
    if made.schedule.makespan > bound or made.schedule.tardiness:
        return made
    return replace(made, schedule=replace(made.schedule, lower_bound=bound, proved=True), scope=PLANS)


def _plans(problem: Problem, task: Task, outcome: Found, limits: Limits) -> Iterator[Plan]:
    """The plan, and others with other steps."""
    yield outcome.plan
    yield from _others(problem, task, outcome, limits)


def _others(problem: Problem, task: Task, outcome: Found, limits: Limits) -> Iterator[Plan]:
    """The plan whose steps take least time, if it is soon found and has other steps."""
    different = len({operator.duration for operator in task.operators if operator.duration}) > 1
    if not different or outcome.statistics.counts.get("expanded", 0) > SOON or limits.interrupted():
        return
    operators = tuple(replace(each, cost=each.duration + min(1, each.cost)) for each in task.operators)
    second = replace(limits, expansions=SECOND, thorough=False, strategy="auto", improved=lambda _: None)
    found = plan_task(replace(task, operators=operators), second)
    if isinstance(found, Found) and _done(found.plan) != _done(outcome.plan):
        costs = {operator.instance: operator.cost for operator in task.operators}
        steps = tuple(replace(step, cost=costs[step.operator]) for step in found.plan.steps)
        yield accepted(problem, Plan(steps, found.plan.links))


def _done(plan: Plan) -> list[str]:
    return sorted(str(step.operator) for step in plan.steps)
