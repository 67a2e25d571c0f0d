"""Clusters of tokens as labelled graphs: joined, parted, in canonical form, and named.

Colours are refined until they are stable (Weisfeiler & Leman 1968), which decides forests exactly.
In graphs with cycles, and where no node is unlike all others, one node after another is told apart,
and the smallest key counts.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import factorial, prod
from typing import Any

from cellwright.engine.model.task_space import ClusterForm, ContactEdge, TokenCluster, TokenType
from cellwright.kb.model.contact_model import Octuple, Quadruple

Label = tuple[Any, ...]
Adjacency = Sequence[Sequence[tuple[Label, int]]]
Key = tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class CanonicalForm:
    """The key of a graph, the number of its automorphisms, and a number for each node: alike
    nodes have the same one.
    """

    key: Key
    automorphisms: int
    orbits: tuple[int, ...]


def canonical_form(colours: Sequence[Label], near: Adjacency) -> CanonicalForm:
    """The canonical form of a connected graph. `near` lists the labelled neighbours of each node;
    edges may be parallel.

    In graphs with cycles, every node has a number of its own in `orbits`.
    """
    ranks = _refine_ranks(_rank_signatures(list(colours)), near)
    pairs = {(i, j) for i, edges in enumerate(near) for _, j in edges if i < j}
    forest = len(pairs) == len(colours) - 1
    key, automorphisms = _least_key(colours, ranks, near, forest)
    return CanonicalForm(key, automorphisms, tuple(ranks) if forest else tuple(range(len(colours))))


def _rank_signatures(signatures: list[Any]) -> list[int]:
    order = {signature: rank for rank, signature in enumerate(sorted(set(signatures)))}
    return [order[signature] for signature in signatures]


def _refine_ranks(ranks: list[int], near: Adjacency) -> list[int]:
    while True:
        finer = _rank_signatures(
            [(ranks[i], _signature_around(ranks, near[i])) for i in range(len(ranks))]
        )
        if len(set(finer)) == len(set(ranks)):
            return finer
        ranks = finer


def _signature_around(ranks: Sequence[int], neighbours: Sequence[tuple[Label, int]]) -> Key:
    return tuple(sorted((label, ranks[j]) for label, j in neighbours))


def _least_key(
    colours: Sequence[Label], ranks: list[int], near: Adjacency, forest: bool
) -> tuple[Key, int]:
    """The least key, and the number of automorphisms, of a graph whose colours are stable."""
    sizes = Counter(ranks)
    if len(sizes) == len(ranks):
        return _graph_key(colours, ranks, near), 1
    alone = next((i for i in range(len(ranks)) if sizes[ranks[i]] == 1), None)
    if forest and alone is not None:
        return _graph_key(colours, ranks, near), _rooted_automorphisms(alone, ranks, near)
    cell = min((rank for rank in sizes if sizes[rank] > 1), key=lambda rank: (sizes[rank], rank))
    least_forms = []
    for i in (i for i in range(len(ranks)) if ranks[i] == cell):
        split_ranks = _rank_signatures([(rank, j != i) for j, rank in enumerate(ranks)])
        least_forms.append(_least_key(colours, _refine_ranks(split_ranks, near), near, forest))
    least, automorphisms = min(least_forms)
    return least, automorphisms * sum(key == least for key, _ in least_forms)


def _graph_key(colours: Sequence[Label], ranks: Sequence[int], near: Adjacency) -> Key:
    nodes = ((ranks[i], colours[i], _signature_around(ranks, near[i])) for i in range(len(ranks)))
    return tuple(sorted(nodes))


def _rooted_automorphisms(root: int, ranks: Sequence[int], near: Adjacency) -> int:
    """The automorphisms of a tree that keep its root: alike children can be exchanged."""
    automorphisms, stack = 1, [(root, -1)]
    while stack:
        node, parent = stack.pop()
        children: dict[int, list[Label]] = {}
        for label, j in near[node]:
            if j != parent:
                children.setdefault(j, []).append(label)
        alike = Counter((ranks[j], tuple(sorted(labels))) for j, labels in children.items())
        automorphisms *= prod(map(factorial, alike.values()))
        stack += [(j, node) for j in children]
    return automorphisms


Types = tuple[TokenType, ...]


def join_clusters(first: TokenCluster, second: TokenCluster) -> TokenCluster:
    """Two clusters side by side; the nodes of the second are counted on."""
    shift = len(first.nodes)
    edges = (*first.edges, *(edge.shifted(shift) for edge in second.edges))
    return TokenCluster(first.nodes + second.nodes, edges)


def cluster_components(cluster: TokenCluster) -> list[list[int]]:
    """The nodes of each connected part, in order of their first nodes."""
    near = cluster_neighbours(cluster)
    parts: list[list[int]] = []
    seen: set[int] = set()
    for start in range(len(cluster.nodes)):
        if start in seen:
            continue
        part, open_ = {start}, [start]
        while open_:
            for _, neighbour in near[open_.pop()]:
                if neighbour not in part:
                    part.add(neighbour)
                    open_.append(neighbour)
        seen |= part
        parts.append(sorted(part))
    return parts


def cluster_neighbours(cluster: TokenCluster) -> list[list[tuple[ContactEdge, int]]]:
    """For each node, its contacts and the nodes at their other ends."""
    near: list[list[tuple[ContactEdge, int]]] = [[] for _ in cluster.nodes]
    for edge in cluster.edges:
        near[edge.key].append((edge, edge.lock))
        near[edge.lock].append((edge, edge.key))
    return near


def part_of_cluster(cluster: TokenCluster, nodes: Sequence[int]) -> TokenCluster:
    """The part of a cluster with these nodes."""
    at = {node: n for n, node in enumerate(nodes)}
    edges = (
        ContactEdge(at[e.key], e.key_slot, at[e.lock], e.lock_slot, e.kind)
        for e in cluster.edges
        if e.key in at
    )
    return TokenCluster(tuple(cluster.nodes[node] for node in nodes), tuple(sorted(edges)))


def free_slots(cluster: TokenCluster, types: Types) -> list[dict[int, int]]:
    """For each node, its slots with free anchor points and their number."""
    free_counts = [
        {n: len(slot.anchors) for n, slot in enumerate(types[kind].slots)} for kind in cluster.nodes
    ]
    for edge in cluster.edges:
        free_counts[edge.key][edge.key_slot] -= 1
        free_counts[edge.lock][edge.lock_slot] -= 1
    return [{slot: count for slot, count in counts.items() if count} for counts in free_counts]


def form_of_cluster(cluster: TokenCluster, types: Types) -> tuple[Key, ClusterForm]:
    """The key of a connected cluster, and its form."""
    near: list[list[tuple[tuple[object, ...], int]]] = [[] for _ in cluster.nodes]
    for e in cluster.edges:
        near[e.key].append(((0, e.key_slot, e.lock_slot, e.kind), e.lock))
        near[e.lock].append(((1, e.lock_slot, e.key_slot, e.kind), e.key))
    form = canonical_form([(kind,) for kind in cluster.nodes], near)
    unused = prod(
        factorial(count) for node in free_slots(cluster, types) for count in node.values()
    )
    alike: dict[ContactEdge, int] = {}
    for edge in cluster.edges:
        alike[edge] = alike.get(edge, 0) + 1
    parallel = prod(map(factorial, alike.values()))
    return form.key, ClusterForm(cluster, form.automorphisms * unused * parallel, form.orbits)


def count_exchanges(types: Types) -> int:
    """The number of exchanges of alike tokens and of alike anchor points."""
    return prod(
        factorial(len(token_type.members))
        * prod(factorial(len(s.anchors)) for s in token_type.slots) ** len(token_type.members)
        for token_type in types
    )


class NamedCluster:
    """A cluster with names: the first tokens of each type, and the first anchor points of each
    slot.
    """

    def __init__(self, cluster: TokenCluster, types: Types) -> None:
        self.cluster, self.types = cluster, types
        used: dict[int, int] = {}
        self.members: list[tuple[str, ...]] = []
        for kind in cluster.nodes:
            self.members.append(types[kind].members[used.get(kind, 0)])
            used[kind] = used.get(kind, 0) + 1
        self._taken: dict[tuple[int, int], int] = {}
        self.contacts = {n: self._contact(edge) for n, edge in enumerate(cluster.edges)}

    def _contact(self, edge: ContactEdge) -> Octuple:
        return Octuple(self._next(edge.key, edge.key_slot), self._next(edge.lock, edge.lock_slot))

    def _next(self, node: int, slot: int) -> Quadruple:
        taken = self._taken.get((node, slot), 0)
        self._taken[node, slot] = taken + 1
        return self.point(node, slot, taken)

    def point(self, node: int, slot: int, number: int = 0) -> Quadruple:
        """An anchor point of a node, by its number in its slot."""
        kind = self.types[self.cluster.nodes[node]]
        at = kind.slots[slot]
        instance = self.members[node][at.position]
        return Quadruple(kind.classes[at.position], instance, at.anchor_class, at.anchors[number])

    @property
    def objects(self) -> tuple[str, ...]:
        """The objects in it."""
        return tuple(name for member in self.members for name in member)


@lru_cache(maxsize=256)
def counts_of(nodes: tuple[int, ...]) -> Mapping[int, int]:
    """How many nodes of each type there are."""
    return {kind: nodes.count(kind) for kind in set(nodes)}
