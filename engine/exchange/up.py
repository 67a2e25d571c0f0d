"""The engine for unified-planning, with our stages behind it.

get_environment().factory.add_engine("cellwright", "engine.exchange.up", "CellwrightEngine")
"""

from collections.abc import Callable
from typing import Any

from engine import pipeline
from engine.exchange.optimum import proved
from engine.exchange.orders import every_order
from engine.grounding import ground
from engine.interop.up.engine import Stages, UpEngine
from engine.model.outcome import Outcome
from engine.planning import Limits
from engine.revision import Course, revise
from kb.model.plan import Plan
from kb.model.problem import Problem
from kb.terms import Function


def _plan(
    problem: Problem,
    interrupted: Callable[[], bool],
    improved: Callable[[Plan], None],
    options: dict[str, Any],
) -> Outcome:
    limits = Limits(
        interrupted=interrupted, improved=lambda plan: improved(pipeline.accepted(problem, plan)), **options
    )
    return pipeline.plan(problem, limits)


def _revise(
    former: Problem,
    plan: Plan,
    problem: Problem,
    interrupted: Callable[[], bool],
    compare: bool,
    options: dict[str, Any],
) -> Outcome:
    limits = Limits(interrupted=interrupted, **options)
    return revise(Course.of(former, plan), (), problem.initial, limits, compare).outcome


def _instances(problem: Problem) -> tuple[Function, ...]:
    return tuple(dict.fromkeys(operator.instance for operator in ground(problem).operators))


class CellwrightEngine(UpEngine):
    """One-shot and anytime planner, validator of sequential and partial-order plans, grounder and replanner."""

    stages = Stages(_plan, _revise, proved, every_order, _instances)
