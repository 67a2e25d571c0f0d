"""Schedules the blocks of a plan, also shared out among arms, as a plan that passes the gate."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from cellwright.engine.kernels.bits import Bits, bitset
from cellwright.engine.model.ground_task import GroundOperator, GroundTask, progress_state
from cellwright.engine.model.outcome import Infeasible
from cellwright.engine.model.plan_times import plan_makespan
from cellwright.engine.model.shop_scheduling import Shop, Timetable, ValidSchedule
from cellwright.engine.model.workflow_replay import (
    STAGE_FLUENT,
    join_stages,
    operators_by_instance,
    reached_goals,
    replay_instances,
)
from cellwright.engine.pipelines.planning.dwell_limits import wishes_for
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.pipelines.planning.timetable.step_order import TimedSteps
from cellwright.engine.stages.planning.effect_variants import plain_steps
from cellwright.engine.stages.planning.improvement.plan_reordering import deorder_steps
from cellwright.engine.stages.scheduling import ScheduleLimits, schedule_shop
from cellwright.engine.stages.scheduling.arm_assignment import ASSIGNMENT_RULES, shared_out
from cellwright.engine.stages.scheduling.plan_blocks import Unstructured, arm_resources
from cellwright.engine.stages.scheduling.shop_translation import (
    CellWork,
    Mislaid,
    TimedStep,
    cell_work,
    places_of_visits,
    timed_steps,
)
from cellwright.kb.model.plan_model import Plan, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Term

SCOPE_BLOCKS = "of all schedules of the blocks of this plan"
NO_ERRANDS_IN_TIME = "in no order of whole errands is everything taken away in time (longest_stay)"


def subjects_of(problem: Problem) -> tuple[Term, ...]:
    """The objects of the workflow."""
    return tuple(dict.fromkeys(c.subject for c in problem.chains if c.subject is not None))


def by_blocks(gate: PlanGate, steps: TimedSteps, limits: ScheduleLimits) -> Timetable | str:
    """The schedule of the blocks of a plan, or why there is none; none is longer than the plan
    in its own order.
    """
    problem, wishes = steps.problem, steps.wishes
    if problem.domain.quantities:
        return "steps change quantities, so that their order counts"
    try:
        work = cell_work(
            steps.task, steps.operators, steps.goals, subjects_of(problem), wishes, steps.lags
        )
        scheduled = schedule_shop(work.shop, limits)
        if isinstance(scheduled, ValidSchedule):
            timetable = _as_plan(gate, steps, work, scheduled)
            longer = not wishes.any and timetable.schedule.makespan > plan_makespan(steps.plan)
            return "whole errands of the arms take longer" if longer else timetable
        tight = isinstance(scheduled, Infeasible) and _has_dwells(work.shop)
        return NO_ERRANDS_IN_TIME if tight else scheduled.reason
    except (Unstructured, Mislaid) as error:
        return str(error)


def _has_dwells(shop: Shop) -> bool:
    return any(window.most is not None for window in shop.windows)


def _as_plan(
    gate: PlanGate, steps: TimedSteps, work: CellWork, scheduled: ValidSchedule
) -> Timetable:
    """The schedule as a plan that the checker accepts. Raises `Mislaid`."""
    timed = timed_steps(steps.task, work, scheduled.schedule)
    state = steps.task.initial
    for timed_step in timed:
        state = progress_state(state, timed_step.operator)
    if steps.goals & ~state:
        raise Mislaid("a step that serves no object is left out")
    plan = deorder_steps(
        steps.task, [s.operator for s in timed], steps.goals, [s.start for s in timed]
    )
    starts = {step.id: timed_step.start for step, timed_step in zip(plan.steps, timed, strict=True)}
    if wrong := gate.findings(steps.problem, plan):
        raise Mislaid(wrong[0].message)
    _require_order(plan, starts, timed)
    settled = replace(scheduled.schedule, units=places_of_visits(work, scheduled.schedule))
    return Timetable(
        plan, starts, work.shop, settled, SCOPE_BLOCKS, statistics=scheduled.statistics
    )


def _require_order(plan: Plan, starts: Mapping[StepId, int], steps: Sequence[TimedStep]) -> None:
    """Check that every step starts only after all steps that it waits for have ended.

    Raises `Mislaid`.
    """
    ends = {step_made.id: step.end for step_made, step in zip(plan.steps, steps, strict=True)}
    for step in plan.steps:
        if any(ends[before] > starts[step.id] for before in step.after):
            raise Mislaid(f"{step.operator} starts before a step that it waits for has ended")


def operators_of(task: GroundTask, plan: Plan) -> tuple[list[GroundOperator], Bits]:
    """The ground operators of a plan's steps in its order, without conditional effects, and the
    goal that they reach.

    Every stage is reached as early as possible.
    """
    operators = replay_instances(
        task, operators_by_instance(task), task.initial, [step.operator for step in plan.steps]
    )
    if operators is None:
        raise Unstructured("a step cannot be followed")
    state = task.initial
    for operator in operators:
        state = task.after(state, operator)
    met = next((goal for goal in task.goals if _visible_goal(task, goal) & ~state == 0), None)
    if met is None:
        raise Unstructured("the goals are reached in a way that cannot be followed")
    needed = reached_goals(task, state) if task.axioms else met
    steps, goals = join_stages(
        task, plain_steps(task, operators), _visible_goal(task, met if needed is None else needed)
    )
    return steps, _visible_goal(task, goals)


def _visible_goal(task: GroundTask, goal: Bits) -> Bits:
    """A goal without the internal atoms that grounding has added, except those of stages."""
    hidden = [
        n
        for n, atom in enumerate(task.atoms)
        if atom.name.startswith("_") and atom.name != STAGE_FLUENT
    ]
    return goal & ~bitset(hidden)


def arms_in(problem: Problem, plan: Plan) -> tuple[Term, ...]:
    """The arms that do the steps of a plan; none if no step holds a resource."""
    steps = [GroundOperator(s.operator, 0, 0, 0, (), s.resources) for s in plan.steps]
    try:
        return arm_resources(steps, subjects_of(problem))
    except Unstructured:
        return ()


def by_other_hands(
    problem: Problem, task: GroundTask, plan: Plan, limits: ScheduleLimits
) -> Iterator[Timetable]:
    """The timetables of the blocks of a plan, shared out among all arms."""
    gate = PlanGate()
    wishes = wishes_for(gate.semantics(problem), plan)
    if wishes.windows or problem.domain.quantities:
        return
    share = replace(limits, work=limits.work / len(ASSIGNMENT_RULES))
    try:
        operators, goals = operators_of(task, plan)
        for steps in shared_out(task, operators, subjects_of(problem)):
            timetable = by_blocks(
                gate, TimedSteps(problem, task, plan, steps, goals, wishes), share
            )
            if isinstance(timetable, Timetable):
                yield timetable
    except Unstructured:
        return
