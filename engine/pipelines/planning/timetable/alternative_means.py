"""Steps of a plan by other arms or machines, and plans that do without the spare ones.

A search looks at costs, so it is content with one arm where two could share the work.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import reduce
from operator import or_

from cellwright.engine.kernels.bits import Bits, bitset
from cellwright.engine.model.ground_task import GroundOperator, GroundTask
from cellwright.engine.model.outcome import Found
from cellwright.engine.model.workflow_replay import STAGE_FLUENT
from cellwright.engine.pipelines.planning.plan_gate import accept_plan
from cellwright.engine.stages.planning import SearchLimits, plan_task
from cellwright.engine.stages.scheduling.plan_blocks import contains_term
from cellwright.kb.model.plan_model import Plan
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Number, Term

MAX_MEANS_PER_STEP = 4  # ways to support one instance


def alternative_operators(
    task: GroundTask, steps: Sequence[GroundOperator], goals: Bits
) -> Iterator[GroundOperator]:
    """Each step by every other means, as often as the plan has it.

    Means are resources that no goal names. Where a step has another argument, both are means, or
    both are numbers.
    """
    means = _spare_resources(task, goals)
    stages = bitset([number for number, atom in enumerate(task.atoms) if atom.name == STAGE_FLUENT])
    named: dict[str, list[GroundOperator]] = {}
    for operator in task.operators:
        if not operator.conditional:
            named.setdefault(operator.instance.name, []).append(operator)
    wanted_counts: Counter[GroundOperator] = Counter()
    own = Counter(steps)
    for step, number in own.items():
        variants: Counter[Atom] = Counter()
        for other_instance in named.get(step.instance.name, ()):
            same = other_instance.adds & stages == step.adds & stages and other_instance not in own
            if (
                same
                and _is_alike(step.instance, other_instance.instance, means)
                and variants[other_instance.instance] < MAX_MEANS_PER_STEP
            ):
                variants[other_instance.instance] += 1
                wanted_counts[other_instance] = max(number, wanted_counts[other_instance])
    return wanted_counts.elements()


def exchangeable_means(task: GroundTask, instances: Iterable[Atom]) -> Iterator[tuple[Term, Term]]:
    """Pairs of means of which the first does one of these instances, and the second can do the
    same in its place.
    """
    means = _spare_resources(task, reduce(or_, task.goals, 0))
    own: dict[tuple[object, ...], set[Atom]] = {}
    for instance in instances:
        own.setdefault(_instance_frame(instance, means), set()).add(instance)
    for operator in task.operators:
        for other_instance in own.get(_instance_frame(operator.instance, means), ()):
            if _is_alike(other_instance, operator.instance, means):
                pairs = zip(other_instance.arguments, operator.instance.arguments, strict=True)
                yield from ((a, b) for a, b in pairs if a != b and b in operator.resources)


def _instance_frame(instance: Atom, means: frozenset[Term]) -> tuple[object, ...]:
    """What two instances that are alike have in common."""
    numbers = (isinstance(argument, Number) for argument in instance.arguments)
    return instance.name, *(
        number or (None if argument in means else argument)
        for argument, number in zip(instance.arguments, numbers, strict=True)
    )


def _spare_resources(task: GroundTask, goals: Bits) -> frozenset[Term]:
    """The resources that no goal names."""
    resources_used = {resource for operator in task.operators for resource in operator.resources}
    goal_atoms = task.names(goals)
    return frozenset(
        resource
        for resource in resources_used
        if not any(contains_term(atom, resource) for atom in goal_atoms)
    )


def _is_alike(first: Atom, second: Atom, means: frozenset[Term]) -> bool:
    """Whether two instances of an operator differ, and only in means and numbers."""
    pairs = [(a, b) for a, b in zip(first.arguments, second.arguments, strict=True) if a != b]
    numbers = (isinstance(a, Number) and isinstance(b, Number) for a, b in pairs)
    exchanged = [({a, b} <= means, number) for (a, b), number in zip(pairs, numbers, strict=True)]
    return any(mean for mean, _ in exchanged) and all(mean or number for mean, number in exchanged)


# expansions that the search for the other plan may take, or as many as that for the plan itself
# took
MIN_SPARE_EXPANSIONS = 2_000


def with_one_of_each(
    problem: Problem, task: GroundTask, outcome: Found, limits: SearchLimits
) -> Plan | None:
    """A plan without the spare means of the plan that was found; None if it has none, or if
    none is soon found.
    """
    spare = spare_means(task, outcome.plan)
    if not spare or limits.interrupted():
        return None
    fewer = tuple(operator for operator in task.operators if spare.isdisjoint(operator.resources))
    most = max(MIN_SPARE_EXPANSIONS, outcome.statistics.counts.get("expanded", 0))
    soon = replace(limits, expansions=min(limits.expansions, most), thorough=False)
    other_outcome = plan_task(replace(task, operators=fewer), soon)
    return accept_plan(problem, other_outcome.plan) if isinstance(other_outcome, Found) else None


def spare_means(task: GroundTask, plan: Plan) -> frozenset[Term]:
    """The resources of a plan whose steps busier ones can do, which do at least as much in the
    plan.
    """
    load: Counter[Term] = Counter()
    for step in plan.steps:
        load.update(dict.fromkeys(step.resources, step.duration))
    rank = {means: (-busy, str(means)) for means, busy in load.items()}
    pairs = exchangeable_means(task, [step.operator for step in plan.steps])
    return frozenset(
        spare for spare, better in pairs if better in rank and rank[better] < rank[spare]
    )
