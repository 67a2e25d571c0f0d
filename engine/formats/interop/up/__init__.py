"""The engine for unified-planning, with our stages behind it.

get_environment().factory.add_engine("cellwright", "cellwright.engine.formats.interop.up",
"CellwrightEngine")
"""

from collections.abc import Callable
from typing import Any

from cellwright.engine.formats.interop.up.state_space_proofs import check_every_order, prove_optimum
from cellwright.engine.formats.interop.up.up_engine import StageFunctions, UpEngine
from cellwright.engine.kernels.cancellation import Interrupted
from cellwright.engine.model.outcome import Infeasible, Outcome
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.pipelines.recovery.plan_revision import PlanUnderWay, revise_plan
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.model.plan_model import Plan
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function


def _plan_problem(
    problem: Problem,
    interrupted: Interrupted,
    improved: Callable[[Plan], None],
    options: dict[str, Any],
) -> Outcome:
    gate = PlanGate()
    limits = SearchLimits(
        interrupted=interrupted,
        improved=lambda plan: improved(gate.accepted(problem, plan)),
        **options,
    )
    return checked_plan.plan_problem(problem, limits)


def _revise_plan(
    former: Problem,
    plan: Plan,
    problem: Problem,
    interrupted: Interrupted,
    compare: bool,
    options: dict[str, Any],
) -> Outcome:
    limits = SearchLimits(interrupted=interrupted, **options)
    revision = revise_plan(PlanUnderWay.of(former, plan), (), problem.initial, limits, compare)
    if revision.given_up:  # a plan for some of the goals is no answer here
        return Infeasible(f"{revision.given_up[0].goal} cannot be reached")
    return revision.outcome


def _ground_instances(problem: Problem) -> tuple[Function, ...]:
    return tuple(dict.fromkeys(operator.instance for operator in ground(problem).operators))


class CellwrightEngine(UpEngine):
    """One-shot and anytime planner, validator of sequential and partial-order plans, grounder
    and replanner.
    """

    stages = StageFunctions(
        _plan_problem, _revise_plan, prove_optimum, check_every_order, _ground_instances
    )
