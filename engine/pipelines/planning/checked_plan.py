"""From a problem to the checked plan with the least cost: grounds, searches, and asks the gate.

The loaders of our own language are imported inside the functions that use them, because tasks in
PDDL do not need them.
"""

import time
from dataclasses import replace

from cellwright.engine.model.ground_task import GroundTask
from cellwright.engine.model.outcome import Found, GaveUp, Outcome, Statistics
from cellwright.engine.pipelines.planning.object_order import canonical_object_order
from cellwright.engine.pipelines.planning.plan_files import check_plan as check_plan
from cellwright.engine.pipelines.planning.plan_files import plan_in as plan_in
from cellwright.engine.pipelines.planning.plan_gate import PlanGate, refusal_error
from cellwright.engine.pipelines.planning.target_files import load_target as load_target
from cellwright.engine.pipelines.planning.target_files import problem_of as problem_of
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.grounding.instance_bounds import bound_instances
from cellwright.engine.stages.grounding.pruning import (
    Named,
    drop_irrelevant_objects,
    drop_irrelevant_operators,
    preserves_optimality,
)
from cellwright.engine.stages.planning import NO_MACROS, Macros, SearchLimits, plan_task
from cellwright.kb.asp.excerpt import excerpt_problem
from cellwright.kb.diagnostics import Diagnostic
from cellwright.kb.model.domain_model import Operator
from cellwright.kb.model.object_likeness import constant_names
from cellwright.kb.model.plan_model import Plan
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import term_variables

LITTLE_WORK = 10_000  # operators and generated nodes of a problem that is planned in no time
LARGE_INSTANCES = 200_000  # possible instances of operators


def plan_problem(problem: Problem, limits: SearchLimits = SearchLimits()) -> Outcome:
    """A checked plan for a problem, or that there is none, or why the search gave up.

    Raises `InvalidInput`.
    """
    return plan_and_ground(problem, limits)[0]


def plan_and_ground(
    problem: Problem,
    limits: SearchLimits = SearchLimits(),
    macros: Macros = NO_MACROS,
    ordered: bool = False,
    whole: bool = False,
    gate: PlanGate | None = None,
) -> tuple[Outcome, GroundTask]:
    """The outcome of `plan`, and the ground task. The searches may use `macros` as operators.
    Raises `InvalidInput`.

    If the plan shall be `ordered` and none of its steps takes time, it is made as by
    `in_the_order_named`. A `whole` problem is grounded as it is: nobody asks what may be left out.
    A `gate` may know the cell already.
    """
    few = problem if whole else excerpt_problem(problem)
    if whole:
        outcome, task = _search_task(ground(problem), limits, macros, time.perf_counter())
    else:
        outcome, task = search_plan(problem, limits, macros, few=few)
    started = time.perf_counter()
    if isinstance(outcome, Found):
        gate = gate or PlanGate()
        settled_plan, wrong = _settle_plan(
            gate, few if task.whole is False else problem, outcome.plan, ordered
        )
        if wrong and not task.whole:  # what was left out did play a part
            outcome, task = _search_task(ground(problem), limits, macros)
            settled_plan = (
                gate.accepted(problem, outcome.plan) if isinstance(outcome, Found) else settled_plan
            )
        elif wrong:
            raise refusal_error(wrong)
        outcome = replace(outcome, plan=settled_plan) if isinstance(outcome, Found) else outcome
    seconds = {**outcome.statistics.seconds, "check": time.perf_counter() - started}
    return replace(outcome, statistics=replace(outcome.statistics, seconds=seconds)), task


def planned_on(
    problem: Problem, task: GroundTask, limits: SearchLimits, macros: Macros, gate: PlanGate
) -> Found | GaveUp | None:
    """The checked plan of a problem whose ground task is known, or why the search gave up; None if
    there seems to be no plan, or the checker refuses it.
    """
    outcome, _ = _search_task(task, limits, macros)
    if not isinstance(outcome, Found):
        return outcome if isinstance(outcome, GaveUp) else None
    started = time.perf_counter()
    plan, wrong = gate.settled(problem, outcome.plan)
    seconds = {**outcome.statistics.seconds, "check": time.perf_counter() - started}
    statistics = replace(outcome.statistics, seconds=seconds)
    return None if wrong else replace(outcome, plan=plan, statistics=statistics)


def _settle_plan(
    gate: PlanGate, problem: Problem, plan: Plan, ordered: bool
) -> tuple[Plan, list[Diagnostic]]:
    """What the gate tells of a plan.

    One that is to be `ordered` is so before, so that it is checked only once.
    """
    if not ordered or any(step.duration for step in plan.steps):
        return gate.settled(problem, plan)
    proposed: list[Plan] = []  # ever more objects at their turn

    def noted(proposal: Plan) -> bool:
        proposed.append(proposal)
        return True

    canonical_object_order(gate.semantics(problem), plan, noted)
    if proposed and not gate.findings(problem, proposed[-1]):
        return proposed[-1], []
    settled_plan, wrong = gate.settled(problem, plan)
    return (
        _order_objects(gate, problem, settled_plan)
        if len(proposed) > 1 and not wrong
        else settled_plan
    ), wrong


def in_named_order(problem: Problem, plan: Plan) -> Plan:
    """The plan that serves alike objects in the order in which they are named, if the gate lets
    it pass; else the plan itself.
    """
    return _order_objects(PlanGate(), problem, plan)


def _order_objects(gate: PlanGate, problem: Problem, plan: Plan) -> Plan:
    return canonical_object_order(
        gate.semantics(problem), plan, lambda proposal: not gate.findings(problem, proposal)
    )


def task_for(problem: Problem, plan: Plan) -> GroundTask:
    """The ground task in which a plan is looked at: without most objects that it does not name
    and of which many are alike.
    """
    return ground(
        excerpt_problem(
            problem, {name for step in plan.steps for name in constant_names(step.operator)}
        )
    )


def search_plan(
    problem: Problem,
    limits: SearchLimits = SearchLimits(),
    macros: Macros = NO_MACROS,
    statics: Named | None = None,
    proves: bool = True,
    few: Problem | None = None,
) -> tuple[Outcome, GroundTask]:
    """An outcome that the gate has not seen, and the task that was searched; `statics` are the
    problem's, and `few` is its excerpt, if known already.

    Only what the goals can need is grounded. The whole problem is, if something that was left out
    might shorten a plan. A problem too large for that is planned without it first; unless it
    `proves`, nobody asks then whether that plan is the shortest. Raises `InvalidInput`.
    """
    started = time.perf_counter()
    small = drop_irrelevant_objects(problem, statics, few)
    if not small.left_out:
        return _search_task(ground(problem), limits, macros, started)
    task = replace(drop_irrelevant_operators(ground(small.problem)), whole=False)
    if not proves and bound_instances(problem) > LARGE_INSTANCES:
        outcome, _ = _search_task(task, limits, macros, started)
        if isinstance(outcome, Found):
            return replace(outcome, optimal=False), task
    sure = preserves_optimality(task, small.spares)
    if sure or bound_instances(problem) > LARGE_INSTANCES:
        outcome, _ = _search_task(task, limits, macros, started)
        if isinstance(outcome, Found):
            alike = sure and not any(map(_is_priced, problem.domain.operators))
            return replace(outcome, optimal=outcome.optimal and alike), task
        if sure:
            return outcome, task
    return _search_task(ground(problem), limits, macros, started)


def _search_task(
    task: GroundTask, limits: SearchLimits, macros: Macros, started: float | None = None
) -> tuple[Outcome, GroundTask]:
    grounded = time.perf_counter()
    outcome = plan_task(task, limits, macros)
    counts = {
        "operators": len(task.operators),
        "atoms": len(task.atoms),
        "mutex groups": len(task.mutex_groups),
        **outcome.statistics.counts,
    }
    before = grounded if started is None else started
    seconds = {"grounding": grounded - before, "search": time.perf_counter() - grounded}
    return replace(outcome, statistics=Statistics(counts, seconds, outcome.statistics.offer)), task


def is_little_work(outcome: Outcome) -> bool:
    """Whether the planner had little to do. Work is counted, not timed, so that the same input
    gives the same answer.
    """
    counts = outcome.statistics.counts
    return counts.get("operators", 0) + counts.get("generated", 0) < LITTLE_WORK


def _is_priced(operator: Operator) -> bool:
    """Whether the cost of an operator depends on its arguments."""
    return operator.cost is not None and next(term_variables(operator.cost), None) is not None
