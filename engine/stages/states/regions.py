"""Reachability in the whole: regions of contact states that one-way contacts part, and dead ends."""

from collections import Counter
from collections.abc import Iterator

import networkx as nx

from cellwright.engine.model.task_space import Region, Space
from cellwright.engine.stages.states.counting import Graph, Marking, exchanged
from cellwright.kb.model.contacts import OneWay


def regions(space: Space, graph: Graph) -> tuple[Region, ...]:
    """The strongly connected parts of the graph of global states, in the order in which they are reached."""
    states: nx.DiGraph[Marking] = nx.DiGraph()
    states.add_nodes_from(graph)
    states.add_edges_from((each, following) for each, steps in graph.items() for _, following in steps)
    whole = nx.condensation(states)
    at = {marking: n for n, marking in enumerate(graph)}
    order = sorted(whole.nodes, key=lambda part: min(at[each] for each in whole.nodes[part]["members"]))
    return tuple(_region(space, whole, part, graph) for part in order)


def _region(space: Space, whole: "nx.DiGraph[int]", part: int, graph: Graph) -> Region:
    members: set[Marking] = whole.nodes[part]["members"]
    first = min(members)
    count = sum(exchanged(space, each) for each in members)
    exits = whole.out_degree(part)
    return Region(count, tuple(sorted(_one_way(space, first))), exits, not graph[first])


def _one_way(space: Space, marking: Marking) -> Iterator[str]:
    """The one-way contacts that hold for good, and those of the start that are broken once and for all."""
    now, start = (Counter(_named(space, each)) for each in (marking, space.initial))
    for name, kind in now.elements():
        if space.model.contact_classes[kind].one_way is OneWay.MAKING:
            yield f"{name} ({kind})"
    for name, kind in (start - now).elements():
        if space.model.contact_classes[kind].one_way is OneWay.BREAKING:
            yield f"{name} ({kind}) broken"


def _named(space: Space, marking: Marking) -> Iterator[tuple[str, str]]:
    """The contacts of a global state by class."""
    for form in marking:
        cluster = space.forms[form].cluster
        for edge in cluster.edges:
            ends = ((edge.key, edge.key_slot), (edge.lock, edge.lock_slot))
            names = (space.types[cluster.nodes[node]].slot_name(slot) for node, slot in ends)
            yield " - ".join(names), edge.kind
