"""Finds the plan with the least makespan; moves steps that set a workflow stage to its turn.

A stage that is a fluent is reached in its turn if it holds then, whenever it was made true. So a
search may make it true as early as it likes. Who asks for it expects it done in its turn. Where
that costs nothing, the step that makes it true moves there.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from cellwright.engine.kernels.bits import Bits, bitset, indices
from cellwright.engine.model.ground_task import GroundOperator, GroundTask
from cellwright.engine.model.outcome import Found, GaveUp, Infeasible
from cellwright.engine.model.shop_scheduling import Timetable
from cellwright.engine.model.workflow_replay import (
    STAGE_FLUENT,
    STAGE_OPERATOR,
    Instances,
    operators_by_instance,
    reached_goals,
    replay_instances,
)
from cellwright.engine.pipelines import planning
from cellwright.engine.pipelines.planning.checked_plan import in_named_order
from cellwright.engine.pipelines.planning.plan_gate import PlanGate, accept_plan
from cellwright.engine.pipelines.planning.timetable import (
    by_other_means,
    keep_plan_order,
    own_order,
    time_plan,
    timetable_value,
    without_spares,
)
from cellwright.engine.pipelines.planning.timetable.block_schedule import operators_of
from cellwright.engine.pipelines.planning.timetable.kept_order import LONGEST, MAX_SCHEDULED_STEPS
from cellwright.engine.pipelines.planning.timetable.step_order import (
    SCOPE_ALL_PLANS,
    least_makespan,
)
from cellwright.engine.stages.planning import SearchLimits, plan_task
from cellwright.engine.stages.planning.improvement.plan_reordering import deorder_steps
from cellwright.engine.stages.scheduling import ScheduleLimits
from cellwright.engine.stages.scheduling.plan_blocks import Unstructured
from cellwright.kb.model.plan_model import Plan, Step
from cellwright.kb.model.planning_problem import Problem

MAX_DELAYED_STEPS = 400  # steps; the order of longer plans is as it was found


def delay_settings(problem: Problem, task: GroundTask, plan: Plan) -> Plan:
    """The plan with the same steps that makes settings of the workflow in their turn; the plan
    itself if the gate refuses that.
    """
    if task.axioms or len(plan.steps) > MAX_DELAYED_STEPS:
        return plan
    instances_known, order = operators_by_instance(task), plan.steps
    for _ in plan.steps:
        later = _delay_one_step(task, instances_known, order)
        if later is None:
            break
        order = later
    if order == plan.steps:
        return plan
    try:
        deordered = deorder_steps(task, *operators_of(task, Plan(order)))
    except Unstructured:
        return plan
    return plan if PlanGate().findings(problem, deordered) else deordered


def _delay_one_step(
    task: GroundTask, known: Instances, order: tuple[Step, ...]
) -> tuple[Step, ...] | None:
    """The order with one step moved back to its turn; None if every one is there, or cannot be."""
    steps = replay_instances(
        task, known, task.initial, [step_of_order.operator for step_of_order in order]
    )
    for maker, turn in _early_makers(task, steps or ()):
        later_order = (
            *order[:maker],
            *order[maker + 1 : turn + 1],
            order[maker],
            *order[turn + 1 :],
        )
        replay = replay_instances(
            task, known, task.initial, [step_of_order.operator for step_of_order in later_order]
        )
        if replay is not None and reached_goals(task, _end_state(task, replay)) is not None:
            return later_order
    return None


def _early_makers(task: GroundTask, steps: Sequence[GroundOperator]) -> Iterator[tuple[int, int]]:
    """The places of steps that make a stage true before its turn, and of those with which its
    turn comes.
    """
    stages = bitset([number for number, atom in enumerate(task.atoms) if atom.name == STAGE_FLUENT])
    makers: dict[int, int] = {}
    before, state, place = task.initial, task.initial, -1
    for step in steps:
        if step.instance.name == STAGE_OPERATOR:
            for atom in indices(step.preconditions & before & ~stages):
                if 0 <= makers.get(atom, -1) < place:
                    yield makers[atom], place
        else:
            place, before = place + 1, state
            makers |= dict.fromkeys(indices(step.adds & ~state), place)
        state = task.after(state, step)


def _end_state(task: GroundTask, steps: Sequence[GroundOperator]) -> Bits:
    state = task.initial
    for step in steps:
        state = task.after(state, step)
    return state


SOLVER_WORK_S = 3.0  # of the solver, about seconds of one core
OTHER_MEANS_WORK_S = 2.0  # at most of it, and a sixth, spent on other means
SOON_EXPANSIONS = 5_000  # expansions after which no second plan is looked for
# of the work for each object, if many are scheduled, and for all of them
PER_OBJECT, MOST_WORK = 0.25, 25.0
OTHER_PLAN_EXPANSIONS = 2_000  # expansions that a second plan may take


def search_least_makespan(
    problem: Problem,
    task: GroundTask,
    outcome: Found,
    limits: SearchLimits,
    work: ScheduleLimits | None = None,
) -> tuple[Timetable, Infeasible | GaveUp | None]:
    """The best timetable of the plan and of others found from there on; and why a plan has
    none, if one has none.
    """
    work = work or ScheduleLimits(SOLVER_WORK_S, limits.seed, interrupted=limits.interrupted)
    bound = least_makespan(task)
    if len(outcome.plan.steps) > (LONGEST if problem.chains else MAX_SCHEDULED_STEPS):
        return _with_bound(keep_plan_order(problem, outcome.plan), bound), None
    own = own_order(problem, task, outcome.plan)
    if own.schedule.makespan <= bound and own.keeps_all:
        named = _in_named_order(problem, task, own.plan)
        renamed_order = own if named == own.plan else own_order(problem, task, named)
        return _with_bound(
            renamed_order if timetable_value(renamed_order) <= timetable_value(own) else own, bound
        ), None
    # the solver alone takes longer to load than is left
    if limits.interrupted() and own.keeps_all:
        return _with_bound(own, bound), None
    plans = list(_candidate_plans(problem, task, outcome, limits))
    timetables = [time_plan(problem, task, candidate, work) for candidate in plans]
    if isinstance(timetables[0], Timetable):
        timetables += without_spares(problem, task, outcome, timetables[0], limits, work)
    choosing = replace(work, work=min(work.work / 6, OTHER_MEANS_WORK_S))
    timetables += [
        timetable
        for timetable in [by_other_means(problem, task, plans, choosing, bound)]
        if timetable is not None
    ]
    found_timetables = [
        own,
        *(timetable for timetable in timetables if isinstance(timetable, Timetable)),
    ]
    best = min(found_timetables, key=timetable_value)
    if (flowing := _flowing(problem, best, bound, work)) is not None:
        return flowing, None
    refused = next(
        (timetable for timetable in timetables if not isinstance(timetable, Timetable)), None
    )
    return _as_named(problem, task, _with_bound(best, bound), bound, choosing), refused


def effort(limits: SearchLimits, objects: int) -> ScheduleLimits:
    """The work of a schedule of many objects: more for more of them."""
    return ScheduleLimits(
        max(SOLVER_WORK_S, min(MOST_WORK, PER_OBJECT * objects)),
        limits.seed,
        interrupted=limits.interrupted,
    )


def _flowing(
    problem: Problem, best: Timetable, bound: int, work: ScheduleLimits
) -> Timetable | None:
    """The timetable of objects that choose their ways while they are scheduled, if it is better
    than the best of other plans.
    """
    if (best.schedule.makespan <= bound and best.keeps_all) or not problem.chains:
        return None
    if best.schedule.proved and len({chain.subject for chain in problem.chains}) == 1:
        return None  # one object has nothing to wait for, and other plans of it were tried
    made = planning.by_flow(problem, work)
    if not isinstance(made, Timetable) or timetable_value(made)[:3] >= timetable_value(best)[:3]:
        return None
    return made


def _as_named(
    problem: Problem, task: GroundTask, best: Timetable, bound: int, work: ScheduleLimits
) -> Timetable:
    """The best timetable, or one that is as good and does things in the order in which they are
    named.
    """
    ways: tuple[Callable[[Plan], Plan], ...] = (
        lambda plan: _in_named_order(problem, task, plan),
        lambda plan: in_named_order(problem, plan),
    )
    for named in ways:
        plan = named(best.plan)
        if plan == best.plan:
            return best
        for renamed_timetable in (
            time_plan(problem, task, plan, work),
            _renamed(own_order(problem, task, plan), best),
        ):
            if isinstance(renamed_timetable, Timetable):
                judged = _with_bound(renamed_timetable, bound)
                as_good = timetable_value(judged)[:-1] <= timetable_value(best)[:-1]
                proved = judged.schedule.proved >= best.schedule.proved
                if as_good and proved and named(judged.plan) == judged.plan:
                    return judged
    return best


def _renamed(own: Timetable, best: Timetable) -> Timetable:
    """The timetable of a plan that differs from the best one in the names of alike objects:
    what bounds that one bounds it, too.
    """
    if own.schedule.makespan != best.schedule.makespan:
        return own
    known = replace(
        own.schedule, lower_bound=best.schedule.lower_bound, proved=best.schedule.proved
    )
    return replace(own, schedule=known, scope=best.scope)


def _in_named_order(problem: Problem, task: GroundTask, plan: Plan) -> Plan:
    """The plan that does in its turn what has one, and serves alike objects in the order in
    which they are named.
    """
    return in_named_order(problem, delay_settings(problem, task, plan))


def _with_bound(timetable: Timetable, bound: int) -> Timetable:
    """The timetable, with the proof that no plan is shorter if it meets a bound of all plans."""
    late = timetable.schedule.tardiness or not timetable.keeps_all
    if timetable.schedule.makespan > bound or late:
        return timetable
    return replace(
        timetable,
        schedule=replace(timetable.schedule, lower_bound=bound, proved=True),
        scope=SCOPE_ALL_PLANS,
    )


def _candidate_plans(
    problem: Problem, task: GroundTask, outcome: Found, limits: SearchLimits
) -> Iterator[Plan]:
    """The plan, and others with other steps."""
    yield outcome.plan
    yield from _plans_by_duration(problem, task, outcome, limits)


def _plans_by_duration(
    problem: Problem, task: GroundTask, outcome: Found, limits: SearchLimits
) -> Iterator[Plan]:
    """The plan whose steps take least time, if it is soon found and has other steps."""
    different = len({operator.duration for operator in task.operators if operator.duration}) > 1
    if (
        not different
        or outcome.statistics.counts.get("expanded", 0) > SOON_EXPANSIONS
        or limits.interrupted()
    ):
        return
    operators = tuple(
        replace(operator, cost=operator.duration + min(1, operator.cost))
        for operator in task.operators
    )
    second = replace(
        limits,
        expansions=OTHER_PLAN_EXPANSIONS,
        thorough=False,
        strategy="auto",
        improved=lambda _: None,
    )
    answer = plan_task(replace(task, operators=operators), second)
    if isinstance(answer, Found) and _step_names(answer.plan) != _step_names(outcome.plan):
        costs = {operator.instance: operator.cost for operator in task.operators}
        steps = tuple(replace(step, cost=costs[step.operator]) for step in answer.plan.steps)
        yield accept_plan(problem, Plan(steps, answer.plan.links))


def _step_names(plan: Plan) -> list[str]:
    return sorted(str(step.operator) for step in plan.steps)
