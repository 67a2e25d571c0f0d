"""A plan that does without spare means: with one of several arms or machines that can do the same.

A search looks at costs, and hands that share the work cost no more than one. But what passes from one hand to another cannot be cut into
blocks, and the order of single steps is hard to make better. So the plan of one hand may be done sooner, and it is tried, too.
"""

from collections import Counter
from dataclasses import replace

from cellwright.engine.model.outcome import Found
from cellwright.engine.model.task import Task
from cellwright.engine.pipelines.gate import accepted
from cellwright.engine.pipelines.timetable.alternatives import exchangeable
from cellwright.engine.stages.planning import Limits
from cellwright.engine.stages.planning import plan as plan_task
from cellwright.kb.model.plan import Plan
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Term

LEAST = 2_000  # expansions that the search for the other plan may take, or as many as that for the plan itself took


def with_one_of_each(problem: Problem, task: Task, outcome: Found, limits: Limits) -> Plan | None:
    """A plan without the spare means of the plan that was found; None if it has none, or if none is soon found."""
    spare = spare_means(task, outcome.plan)
    if not spare or limits.interrupted():
        return None
    fewer = tuple(each for each in task.operators if spare.isdisjoint(each.resources))
    most = max(LEAST, outcome.statistics.counts.get("expanded", 0))
    soon = replace(limits, expansions=min(limits.expansions, most), thorough=False)
    found = plan_task(replace(task, operators=fewer), soon)
    return accepted(problem, found.plan) if isinstance(found, Found) else None


def spare_means(task: Task, plan: Plan) -> frozenset[Term]:
    """The resources of a plan whose steps busier ones can do, which do at least as much in the plan."""
    load: Counter[Term] = Counter()
    for step in plan.steps:
        load.update(dict.fromkeys(step.resources, step.duration))
    rank = {each: (-busy, str(each)) for each, busy in load.items()}
    pairs = exchangeable(task, [step.operator for step in plan.steps])
    return frozenset(one for one, other in pairs if other in rank and rank[other] < rank[one])
