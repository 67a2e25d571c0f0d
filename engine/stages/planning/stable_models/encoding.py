"""Planning in answer set programming.

A step may hold several operators that can run one after another in some order. Such plans are called
exists-step plans (Rintanen, Heljanko & Niemelä 2006; in ASP Dimopoulos et al. 2019, plasp 3). All
preconditions of a step hold before it, and its effects agree. An acyclic order ensures that no operator
deletes what a later one needs. Mutex groups are constraints. A heuristic makes the solver prefer that atoms
persist (Gebser et al. 2013).
"""

import graphlib
from collections.abc import Iterator, Sequence

from cellwright.engine.model.task import Bits, GroundOperator, indices

STEP = """
{ occurs(O,t) } :- first(O,L), L <= t.
:- occurs(O,t), needs(O,A), not holds(A,t-1).
added(A,t) :- occurs(O,t), adds(O,A).
deleted(A,t) :- occurs(O,t), deletes(O,A).
:- added(A,t), deleted(A,t).
holds(A,t) :- added(A,t).
holds(A,t) :- holds(A,t-1), not deleted(A,t).
:- group(G), 2 { holds(A,t) : member(G,A) }.
#heuristic holds(A,t-1) : holds(A,t). [1,true]
#heuristic holds(A,t-1) : not holds(A,t), fluent(A). [1,false]
#show occurs/2.
"""
PARALLEL = """
:- used_up(A), 2 { occurs(O,t) : needs(O,A), deletes(O,A) }.
#edge ((operator(O),t),(kept(A),t)) : occurs(O,t), needs(O,A), not deletes(O,A).
#edge ((kept(A),t),(operator(O),t)) : occurs(O,t), deletes(O,A).
#edge ((operator(O),t),(left(A),t)) : occurs(O,t), needs(O,A), deletes(O,A).
#edge ((left(A),t),(operator(O),t)) : occurs(O,t), deletes(O,A), not needs(O,A).
"""
SINGLE = """
:- 2 { occurs(O,t) }.
"""
OPTIONS = ("--heuristic=Domain", "--configuration=frumpy")


def facts(
    initial: Bits,
    operators: Sequence[GroundOperator],
    first: Sequence[int],
    groups: Sequence[Bits],
    size: int,
) -> Iterator[str]:
    """The facts of a task over atoms below `size`.

    `first` is the first step at which each operator can occur, -1 for never.
    """
    yield f"fluent(0..{max(size - 1, 0)})."
    yield "holds(A,0) :- initial(A)."
    yield from (f"initial({atom})." for atom in indices(initial))
    for number, group in enumerate(groups):
        yield f"group({number})."
        yield from (f"member({number},{atom})." for atom in indices(group))
    used = 0
    for number, operator in enumerate(operators):
        if first[number] < 0:
            continue
        deleted = operator.deletes & ~operator.adds
        yield f"first({number},{first[number]})."
        yield from (f"needs({number},{atom})." for atom in indices(operator.preconditions))
        yield from (f"adds({number},{atom})." for atom in indices(operator.adds))
        yield from (f"deletes({number},{atom})." for atom in indices(deleted))
        used |= operator.preconditions & deleted
    yield from (f"used_up({atom})." for atom in indices(used))


def sequence(
    operators: Sequence[GroundOperator], occurring: frozenset[tuple[int, ...]]
) -> list[GroundOperator]:
    """The operators of all pairs (number, step), ordered by step and within a step so that they can run."""
    steps: dict[int, list[GroundOperator]] = {}
    for number, step in sorted(occurring):
        steps.setdefault(step, []).append(operators[number])
    return [operator for step in sorted(steps) for operator in _ordered(steps[step])]


def _ordered(together: list[GroundOperator]) -> Iterator[GroundOperator]:
    sorter: graphlib.TopologicalSorter[int] = graphlib.TopologicalSorter(
        {number: () for number in range(len(together))}
    )
    for ending, one in enumerate(together):
        ended = one.deletes & ~one.adds
        for other, each in enumerate(together):
            if other != ending and each.preconditions & ended:
                sorter.add(ending, other)
    return (together[number] for number in sorter.static_order())
