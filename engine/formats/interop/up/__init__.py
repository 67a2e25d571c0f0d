"""The engine for unified-planning, with our stages behind it.

get_environment().factory.add_engine("cellwright", "cellwright.engine.formats.interop.up", "CellwrightEngine")
"""

from collections.abc import Callable
from typing import Any

from cellwright.engine.formats.interop.up.engine import StageFunctions, UpEngine
from cellwright.engine.kernels.cancellation import Interrupted
from cellwright.engine.model.outcome import Infeasible, Outcome
from cellwright.engine.pipelines import planning
from cellwright.engine.pipelines.gate import PlanGate
from cellwright.engine.pipelines.optimum import proved
from cellwright.engine.pipelines.orders import every_order
from cellwright.engine.pipelines.revision import Course, revise
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.planning import Limits
from cellwright.kb.model.plan import Plan
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Function


def _plan(
    problem: Problem,
    interrupted: Interrupted,
    improved: Callable[[Plan], None],
    options: dict[str, Any],
) -> Outcome:
    gate = PlanGate()
    limits = Limits(
        interrupted=interrupted, improved=lambda plan: improved(gate.accepted(problem, plan)), **options
    )
    return planning.plan(problem, limits)


def _revise(
    former: Problem,
    plan: Plan,
    problem: Problem,
    interrupted: Interrupted,
    compare: bool,
    options: dict[str, Any],
) -> Outcome:
    limits = Limits(interrupted=interrupted, **options)
    found = revise(Course.of(former, plan), (), problem.initial, limits, compare)
    if found.given_up:  # a plan for some of the goals is no answer here
        return Infeasible(f"{found.given_up[0].goal} cannot be reached")
    return found.outcome


def _instances(problem: Problem) -> tuple[Function, ...]:
    return tuple(dict.fromkeys(operator.instance for operator in ground(problem).operators))


class CellwrightEngine(UpEngine):
    """One-shot and anytime planner, validator of sequential and partial-order plans, grounder and replanner."""

    stages = StageFunctions(_plan, _revise, proved, every_order, _instances)
