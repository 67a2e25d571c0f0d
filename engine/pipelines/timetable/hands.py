"""Timetables of plans whose blocks are shared out among arms that can do the same."""

from collections.abc import Iterator
from dataclasses import replace

from cellwright.engine.model.schedule import Timetable
from cellwright.engine.model.task import GroundOperator, Task
from cellwright.engine.pipelines.gate import PlanGate
from cellwright.engine.pipelines.timetable.blocked import by_blocks, operators_of, subjects_of
from cellwright.engine.pipelines.timetable.orders import Steps
from cellwright.engine.pipelines.timetable.wishes import wishes_for
from cellwright.engine.stages.scheduling import ScheduleLimits
from cellwright.engine.stages.scheduling.blocks import Unstructured, arms_of
from cellwright.engine.stages.scheduling.hands import WAYS, shared_out
from cellwright.kb.model.plan import Plan
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Term


def arms_in(problem: Problem, plan: Plan) -> tuple[Term, ...]:
    """The arms that do the steps of a plan; none if no step holds a resource."""
    steps = [GroundOperator(s.operator, 0, 0, 0, (), s.resources) for s in plan.steps]
    try:
        return arms_of(steps, subjects_of(problem))
    except Unstructured:
        return ()


def by_other_hands(problem: Problem, task: Task, plan: Plan, limits: ScheduleLimits) -> Iterator[Timetable]:
    """The timetables of the blocks of a plan, shared out among all arms."""
    gate = PlanGate()
    wishes = wishes_for(gate.semantics(problem), plan)
    if wishes.windows or problem.domain.quantities:
        return
    share = replace(limits, work=limits.work / len(WAYS))
    try:
        operators, goals = operators_of(task, plan)
        for steps in shared_out(task, operators, subjects_of(problem)):
            made = by_blocks(gate, Steps(problem, task, plan, steps, goals, wishes), share)
            if isinstance(made, Timetable):
                yield made
    except Unstructured:
        return
