"""A plan that is to keep its windows whatever happens: judged, timed anew, and with its policy."""

from collections.abc import Mapping
from dataclasses import replace

from cellwright.engine.model.outcome import Found
from cellwright.engine.model.plan_times import plan_makespan
from cellwright.engine.model.robustness import RobustPlan
from cellwright.engine.model.shop_scheduling import Schedule, Timetable
from cellwright.engine.model.start_rules import StartRules
from cellwright.engine.pipelines.planning.checked_plan import task_for
from cellwright.engine.pipelines.planning.dwell_limits import find_overstays, wishes_for
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.pipelines.planning.plan_objective import Run
from cellwright.engine.pipelines.planning.robustness.robust_plan import judge_robustness
from cellwright.engine.pipelines.planning.timetable import time_plan
from cellwright.engine.pipelines.planning.timetable.step_order import by_step
from cellwright.engine.stages.uncertainty.window_chances import DrawnDuration, draw_runs
from cellwright.kb.model.operator_amounts import range_of_step
from cellwright.kb.model.plan_model import Plan, StepId
from cellwright.kb.model.planning_problem import Problem

LONGEST_ORDER = "the order is the one for the longest durations"


def make_robust(problem: Problem, run: Run) -> tuple[Run, RobustPlan | None]:
    """The run whose plan has a policy, if one is found, and what is known of its windows; None
    without a plan whose steps take time.

    The order of the steps is kept where it has a policy. Else they are scheduled as if each took
    as long as it can. Raises `InvalidInput`.
    """
    table = run.timetable
    if table is None or not isinstance(run.outcome, Found):
        return run, None
    timed = _is_timed(problem, table.plan)
    answer = judge_robustness(problem, table.plan, table.starts, timed)
    if not answer.is_robust and (longest := _longest_order(problem, table.plan)) is not None:
        plan, starts = longest
        second = judge_robustness(problem, plan, starts, timed)
        if second.is_robust:
            answer, table = replace(second, notes=(LONGEST_ORDER,)), replace(table, plan=plan)
    if answer.is_robust:
        table = _by_policy(problem, table, answer.rules)
    return replace(run, outcome=replace(run.outcome, plan=table.plan), timetable=table), answer


def _is_timed(problem: Problem, plan: Plan) -> bool:
    """Whether the executive lets no step begin before its forecast."""
    wishes = wishes_for(PlanGate().semantics(problem), plan)
    return bool(wishes.travel or wishes.longest_stay or wishes.release or wishes.windows)


def _longest_order(problem: Problem, plan: Plan) -> tuple[Plan, Mapping[StepId, int]] | None:
    """The plan in the order of a schedule in which each step takes as long as it can."""
    amounts = PlanGate().semantics(problem).amounts
    most = {step.id: range_of_step(amounts, step).most for step in plan.steps}
    usual = {step.operator: step.duration for step in plan.steps}
    slow = replace(
        problem,
        durations={
            **problem.durations,
            **{step.operator: most[step.id] for step in plan.steps if most[step.id]},
        },
    )
    long = Plan(tuple(replace(s, duration=most[s.id]) for s in plan.steps), plan.links)
    table = time_plan(slow, task_for(slow, long), long)
    if not isinstance(table, Timetable) or any(s.operator not in usual for s in table.plan.steps):
        return None
    steps = tuple(replace(s, duration=usual[s.operator]) for s in table.plan.steps)
    return Plan(steps, table.plan.links), table.starts


def _by_policy(problem: Problem, table: Timetable, rules: StartRules) -> Timetable:
    """The timetable that a policy leads to if every step takes its usual time."""
    plan = table.plan
    durations = {int(s.id): DrawnDuration(s.duration, s.duration) for s in plan.steps}
    runs = draw_runs(rules, durations, draws=1)
    starts = {step.id: round(float(runs.starts[int(step.id)][0])) for step in plan.steps}
    if starts == dict(table.starts):
        return table
    last = plan_makespan(plan, starts)
    bound = min(table.schedule.lower_bound, last)
    proved = table.schedule.proved and bound == last
    schedule = Schedule({}, (), last, bound, table.schedule.tardiness, proved)
    semantics = PlanGate().semantics(problem)
    longest = wishes_for(semantics, plan).longest_stay
    return replace(
        by_step(problem, plan, starts, schedule, table.note, table.scope),
        overstays=find_overstays(problem, plan, starts, longest, semantics),
        floor=table.floor,
        statistics=table.statistics,
    )
