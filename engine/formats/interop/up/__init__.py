"""The engine for unified-planning, with our stages behind it.

get_environment().factory.add_engine("cellwright", "engine.formats.interop.up", "CellwrightEngine")
"""

from collections.abc import Callable
from typing import Any

from engine.formats.interop.up.engine import StageFunctions, UpEngine
from engine.kernels.cancellation import Interrupted
from engine.model.outcome import Infeasible, Outcome
from engine.pipelines import planning
from engine.pipelines.gate import PlanGate
from engine.pipelines.optimum import proved
from engine.pipelines.orders import every_order
from engine.pipelines.revision import Course, revise
from engine.stages.grounding import ground
from engine.stages.planning import Limits
from kb.model.plan import Plan
from kb.model.problem import Problem
from kb.terms import Function


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
