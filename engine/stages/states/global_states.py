"""Global contact states of a cell: how many there are, and the regions between which steps lead one
way only.

A global state is a set of clusters in which every token stands once. Global states are searched up
to exchanges of alike tokens and alike anchor points, and each of them stands for all its exchanges:
their number is that of all exchanges divided by those that leave the state as it is. The start may
be exchanged, too.
"""

from collections import Counter
from collections.abc import Iterable, Iterator
from fractions import Fraction
from math import factorial, perm, prod

import networkx as nx

from cellwright.engine.model.task_space import (
    ClusterForm,
    ContactStep,
    FormSpace,
    StateGrowth,
    StateRegion,
)
from cellwright.engine.stages.states.clusters import count_exchanges, counts_of
from cellwright.kb.model.contact_model import OneWay

MAX_GLOBAL_STATES = 200_000
Marking = tuple[int, ...]  # the forms of all clusters, in ascending order
Graph = dict[Marking, tuple[tuple[ContactStep, Marking], ...]]


def reachable_states(space: FormSpace, most: int = MAX_GLOBAL_STATES) -> Graph | None:
    """Every global state up to exchanges with the steps from it, in the order of a breadth-first
    search.

    None if there are more than `most`.
    """
    graph: Graph = {}
    open_ = [space.initial]
    seen = {space.initial}
    for marking in open_:
        graph[marking] = tuple(successor_states(space, marking))
        for _, following in graph[marking]:
            if following not in seen:
                seen.add(following)
                open_.append(following)
        if len(seen) > most:
            return None
    return graph


def successor_states(space: FormSpace, marking: Marking) -> Iterator[tuple[ContactStep, Marking]]:
    """The steps that can be taken in a global state, and where they lead."""
    form_counts = sorted(Counter(marking).items())
    for n, (form, count) in enumerate(form_counts):
        asked = [
            (form,),
            *([(form, form)] if count > 1 else []),
            *((form, second) for second, _ in form_counts[n + 1 :]),
        ]
        for inputs in asked:
            for step in space.by_inputs.get(inputs, ()):
                remaining = list(marking)
                for number in inputs:
                    remaining.remove(number)
                yield step, tuple(sorted((*remaining, *step.outputs)))


def count_exchanged_states(space: FormSpace, marking: Marking) -> int:
    """The number of fully specified global states that one state up to exchanges stands for."""
    same: int = prod(
        space.forms[form].symmetries ** count * factorial(count)
        for form, count in Counter(marking).items()
    )
    return count_exchanges(space.types) // same


def count_individuals(space: FormSpace, form: ClusterForm) -> int:
    """The number of fully specified clusters of a form."""
    ways: int = 1
    for kind, count in counts_of(form.cluster.nodes).items():
        token_type = space.types[kind]
        anchors = prod(factorial(len(slot.anchors)) for slot in token_type.slots)
        ways *= perm(len(token_type.members), count) * anchors**count
    return ways // form.symmetries


def state_growth(space: FormSpace, graph: Graph | None) -> StateGrowth:
    """The count of global states: exact if all were reached, else an upper bound."""
    if graph is not None and space.complete:
        return StateGrowth(
            sum(count_exchanged_states(space, marking) for marking in graph), True, len(graph)
        )
    return StateGrowth(bound_states(space), False, None)


def bound_states(space: FormSpace) -> int:
    """An upper bound on the number of global states: all sets of known forms in which every token
    stands once.

    If not all forms are known: every way to fill the anchor points.
    """
    if not space.complete:
        return _count_key_placements(space)
    whole = tuple(len(token_type.members) for token_type in space.types)
    ways = {whole: Fraction(1)}
    for form in space.forms:
        used = counts_of(form.cluster.nodes)
        ways = _add_clusters(
            ways, [used.get(kind, 0) for kind in range(len(whole))], form.symmetries
        )
    total = ways.get(tuple(0 for _ in whole), Fraction(0)) * count_exchanges(space.types)
    return int(total)


def _add_clusters(
    ways: dict[Marking, Fraction], used: Iterable[int], symmetries: int
) -> dict[Marking, Fraction]:
    """The ways to use up tokens with any number of clusters of one more form."""
    tokens, extended = list(used), dict(ways)
    for unused, weight in ways.items():
        count, rest = 1, unused
        while all(have >= need for have, need in zip(rest, tokens, strict=True)):
            rest = tuple(have - need for have, need in zip(rest, tokens, strict=True))
            extended[rest] = extended.get(rest, Fraction(0)) + weight / (
                symmetries**count * factorial(count)
            )
            count += 1
    return extended


def _count_key_placements(space: FormSpace) -> int:
    """Every key is free, or in one of the locks of the cell."""
    keys = locks = 0
    for token_type in space.types:
        for slot in token_type.slots:
            count = len(token_type.members) * len(slot.anchors)
            keys, locks = (keys + count, locks) if slot.key else (keys, locks + count)
    return int((locks + 1) ** keys)


def state_regions(space: FormSpace, graph: Graph) -> tuple[StateRegion, ...]:
    """The strongly connected parts of the graph of global states, in the order in which they
    are reached.
    """
    states: nx.DiGraph[Marking] = nx.DiGraph()
    states.add_nodes_from(graph)
    states.add_edges_from(
        (state, following) for state, steps in graph.items() for _, following in steps
    )
    whole = nx.condensation(states)
    at = {marking: n for n, marking in enumerate(graph)}
    order = sorted(
        whole.nodes, key=lambda part: min(at[state] for state in whole.nodes[part]["members"])
    )
    return tuple(_region_of_part(space, whole, part, graph) for part in order)


def _region_of_part(
    space: FormSpace, whole: "nx.DiGraph[int]", part: int, graph: Graph
) -> StateRegion:
    members: set[Marking] = whole.nodes[part]["members"]
    first = min(members)
    count = sum(count_exchanged_states(space, state) for state in members)
    exits = whole.out_degree(part)
    return StateRegion(count, tuple(sorted(_one_way(space, first))), exits, not graph[first])


def _one_way(space: FormSpace, marking: Marking) -> Iterator[str]:
    """The one-way contacts that hold for good, and those of the start that are broken once and
    for all.
    """
    now, start = (Counter(_named_contacts(space, state)) for state in (marking, space.initial))
    for name, kind in now.elements():
        if space.model.contact_classes[kind].one_way is OneWay.MAKING:
            yield f"{name} ({kind})"
    for name, kind in (start - now).elements():
        if space.model.contact_classes[kind].one_way is OneWay.BREAKING:
            yield f"{name} ({kind}) broken"


def _named_contacts(space: FormSpace, marking: Marking) -> Iterator[tuple[str, str]]:
    """The contacts of a global state by class."""
    for form in marking:
        cluster = space.forms[form].cluster
        for edge in cluster.edges:
            ends = ((edge.key, edge.key_slot), (edge.lock, edge.lock_slot))
            names = (space.types[cluster.nodes[node]].slot_name(slot) for node, slot in ends)
            yield " - ".join(names), edge.kind
