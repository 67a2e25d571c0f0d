"""The steps of a plan by other means: the same for the same objects, by another arm or on another machine.

A search looks at costs, so it is content with one arm where two could share the work.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from functools import reduce
from operator import or_

from cellwright.engine.model.stages import STAGE
from cellwright.engine.model.task import Bits, GroundOperator, Task, bitset
from cellwright.engine.stages.scheduling.blocks import mentions
from cellwright.kb.terms import Atom, Number, Term

VARIANTS = 4  # ways to support one instance


def alternatives(task: Task, steps: Sequence[GroundOperator], goals: Bits) -> Iterator[GroundOperator]:
    """Each step by every other means, as often as the plan has it.

    Means are resources that no goal names. Where a step has another argument, both are means, or both are numbers.
    """
    means = _means(task, goals)
    stages = bitset([number for number, atom in enumerate(task.atoms) if atom.name == STAGE])
    named: dict[str, list[GroundOperator]] = {}
    for operator in task.operators:
        if not operator.conditional:
            named.setdefault(operator.instance.name, []).append(operator)
    wanted: Counter[GroundOperator] = Counter()
    own = Counter(steps)
    for step, number in own.items():
        variants: Counter[Atom] = Counter()
        for other in named.get(step.instance.name, ()):
            same = other.adds & stages == step.adds & stages and other not in own
            if same and _alike(step.instance, other.instance, means) and variants[other.instance] < VARIANTS:
                variants[other.instance] += 1
                wanted[other] = max(number, wanted[other])
    return wanted.elements()


def exchangeable(task: Task, instances: Iterable[Atom]) -> Iterator[tuple[Term, Term]]:
    """Pairs of means of which the first does one of these instances, and the second can do the same in its place."""
    means = _means(task, reduce(or_, task.goals, 0))
    own: dict[tuple[object, ...], set[Atom]] = {}
    for each in instances:
        own.setdefault(_without(each, means), set()).add(each)
    for operator in task.operators:
        for each in own.get(_without(operator.instance, means), ()):
            if _alike(each, operator.instance, means):
                pairs = zip(each.arguments, operator.instance.arguments, strict=True)
                yield from ((a, b) for a, b in pairs if a != b and b in operator.resources)


def _without(instance: Atom, means: frozenset[Term]) -> tuple[object, ...]:
    """What two instances that are alike have in common."""
    numbers = (isinstance(each, Number) for each in instance.arguments)
    return instance.name, *(
        number or (None if each in means else each)
        for each, number in zip(instance.arguments, numbers, strict=True)
    )


def _means(task: Task, goals: Bits) -> frozenset[Term]:
    """The resources that no goal names."""
    held = {resource for operator in task.operators for resource in operator.resources}
    wanted = task.names(goals)
    return frozenset(each for each in held if not any(mentions(atom, each) for atom in wanted))


def _alike(one: Atom, other: Atom, means: frozenset[Term]) -> bool:
    """Whether two instances of an operator differ, and only in means and numbers."""
    pairs = [(a, b) for a, b in zip(one.arguments, other.arguments, strict=True) if a != b]
    numbers = (isinstance(a, Number) and isinstance(b, Number) for a, b in pairs)
    exchanged = [({a, b} <= means, number) for (a, b), number in zip(pairs, numbers, strict=True)]
    return any(mean for mean, _ in exchanged) and all(mean or number for mean, number in exchanged)
