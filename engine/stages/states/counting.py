"""How many fully specified global contact states a cell has, without listing them.

A global state is a set of clusters in which every token stands once. Global states are searched up to exchanges of alike
tokens and alike anchor points, and each of them stands for all its exchanges: their number is that of all exchanges divided
by those that leave the state as it is. The start may be exchanged, too.
"""

from collections import Counter
from collections.abc import Iterable, Iterator
from fractions import Fraction
from math import factorial, perm, prod

from cellwright.engine.model.task_space import Form, Growth, Space, Step
from cellwright.engine.stages.states.clusters import counts_of, exchanges

MOST_STATES = 200_000
Marking = tuple[int, ...]  # the forms of all clusters, in ascending order
Graph = dict[Marking, tuple[tuple[Step, Marking], ...]]


def reachable(space: Space, most: int = MOST_STATES) -> Graph | None:
    """Every global state up to exchanges with the steps from it, in the order of a breadth-first search.

    None if there are more than `most`.
    """
    found: Graph = {}
    open_ = [space.initial]
    seen = {space.initial}
    for marking in open_:
        found[marking] = tuple(successors(space, marking))
        for _, following in found[marking]:
            if following not in seen:
                seen.add(following)
                open_.append(following)
        if len(seen) > most:
            return None
    return found


def successors(space: Space, marking: Marking) -> Iterator[tuple[Step, Marking]]:
    """The steps that can be taken in a global state, and where they lead."""
    there = sorted(Counter(marking).items())
    for n, (form, count) in enumerate(there):
        asked = [
            (form,),
            *([(form, form)] if count > 1 else []),
            *((form, other) for other, _ in there[n + 1 :]),
        ]
        for inputs in asked:
            for step in space.by_inputs.get(inputs, ()):
                left = list(marking)
                for each in inputs:
                    left.remove(each)
                yield step, tuple(sorted((*left, *step.outputs)))


def exchanged(space: Space, marking: Marking) -> int:
    """The number of fully specified global states that one state up to exchanges stands for."""
    same: int = prod(
        space.forms[form].symmetries ** count * factorial(count) for form, count in Counter(marking).items()
    )
    return exchanges(space.types) // same


def individuals(space: Space, form: Form) -> int:
    """The number of fully specified clusters of a form."""
    ways: int = 1
    for kind, count in counts_of(form.cluster.nodes).items():
        each = space.types[kind]
        anchors = prod(factorial(len(slot.anchors)) for slot in each.slots)
        ways *= perm(len(each.members), count) * anchors**count
    return ways // form.symmetries


def growth(space: Space, graph: Graph | None) -> Growth:
    """The count of global states: exact if all were reached, else an upper bound."""
    if graph is not None and space.complete:
        return Growth(sum(exchanged(space, marking) for marking in graph), True, len(graph))
    return Growth(bound(space), False, None)


def bound(space: Space) -> int:
    """An upper bound on the number of global states: all sets of known forms in which every token stands once.

    If not all forms are known: every way to fill the anchor points.
    """
    if not space.complete:
        return _filled(space)
    whole = tuple(len(each.members) for each in space.types)
    ways = {whole: Fraction(1)}
    for form in space.forms:
        used = counts_of(form.cluster.nodes)
        ways = _with(ways, [used.get(kind, 0) for kind in range(len(whole))], form.symmetries)
    total = ways.get(tuple(0 for _ in whole), Fraction(0)) * exchanges(space.types)
    return int(total)


def _with(ways: dict[Marking, Fraction], used: Iterable[int], symmetries: int) -> dict[Marking, Fraction]:
    """The ways to use up tokens with any number of clusters of one more form."""
    each, found = list(used), dict(ways)
    for left, weight in ways.items():
        count, rest = 1, left
        while all(have >= need for have, need in zip(rest, each, strict=True)):
            rest = tuple(have - need for have, need in zip(rest, each, strict=True))
            found[rest] = found.get(rest, Fraction(0)) + weight / (symmetries**count * factorial(count))
            count += 1
    return found


def _filled(space: Space) -> int:
    """Every key is free, or in one of the locks of the cell."""
    keys = locks = 0
    for each in space.types:
        for slot in each.slots:
            count = len(each.members) * len(slot.anchors)
            keys, locks = (keys + count, locks) if slot.key else (keys, locks + count)
    return int((locks + 1) ** keys)
