"""Clusters of tokens: joined by a contact, parted by breaking one, brought into canonical form, and named."""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from math import factorial, prod

from cellwright.engine.model.task_space import Cluster, Edge, Form, TokenType
from cellwright.engine.stages.states.canonical import Key, canonical
from cellwright.kb.model.octuples import Octuple, Quadruple

Types = tuple[TokenType, ...]


def joined(first: Cluster, second: Cluster) -> Cluster:
    """Two clusters side by side; the nodes of the second are counted on."""
    shift = len(first.nodes)
    edges = (*first.edges, *(edge.shifted(shift) for edge in second.edges))
    return Cluster(first.nodes + second.nodes, edges)


def components(cluster: Cluster) -> list[list[int]]:
    """The nodes of each connected part, in order of their first nodes."""
    near = neighbours(cluster)
    found: list[list[int]] = []
    seen: set[int] = set()
    for start in range(len(cluster.nodes)):
        if start in seen:
            continue
        part, open_ = {start}, [start]
        while open_:
            for _, other in near[open_.pop()]:
                if other not in part:
                    part.add(other)
                    open_.append(other)
        seen |= part
        found.append(sorted(part))
    return found


def neighbours(cluster: Cluster) -> list[list[tuple[Edge, int]]]:
    """For each node, its contacts and the nodes at their other ends."""
    near: list[list[tuple[Edge, int]]] = [[] for _ in cluster.nodes]
    for edge in cluster.edges:
        near[edge.key].append((edge, edge.lock))
        near[edge.lock].append((edge, edge.key))
    return near


def part(cluster: Cluster, nodes: Sequence[int]) -> Cluster:
    """The part of a cluster with these nodes."""
    at = {node: n for n, node in enumerate(nodes)}
    edges = (
        Edge(at[e.key], e.key_slot, at[e.lock], e.lock_slot, e.kind) for e in cluster.edges if e.key in at
    )
    return Cluster(tuple(cluster.nodes[node] for node in nodes), tuple(sorted(edges)))


def free(cluster: Cluster, types: Types) -> list[dict[int, int]]:
    """For each node, its slots with free anchor points and their number."""
    left = [{n: len(slot.anchors) for n, slot in enumerate(types[kind].slots)} for kind in cluster.nodes]
    for edge in cluster.edges:
        left[edge.key][edge.key_slot] -= 1
        left[edge.lock][edge.lock_slot] -= 1
    return [{slot: count for slot, count in each.items() if count} for each in left]


def form_of(cluster: Cluster, types: Types) -> tuple[Key, Form]:
    """The key of a connected cluster, and its form."""
    near: list[list[tuple[tuple[object, ...], int]]] = [[] for _ in cluster.nodes]
    for e in cluster.edges:
        near[e.key].append(((0, e.key_slot, e.lock_slot, e.kind), e.lock))
        near[e.lock].append(((1, e.lock_slot, e.key_slot, e.kind), e.key))
    found = canonical([(kind,) for kind in cluster.nodes], near)
    unused = prod(factorial(count) for node in free(cluster, types) for count in node.values())
    alike: dict[Edge, int] = {}
    for edge in cluster.edges:
        alike[edge] = alike.get(edge, 0) + 1
    parallel = prod(map(factorial, alike.values()))
    return found.key, Form(cluster, found.automorphisms * unused * parallel, found.orbits)


def exchanges(types: Types) -> int:
    """The number of exchanges of alike tokens and of alike anchor points."""
    return prod(
        factorial(len(each.members))
        * prod(factorial(len(s.anchors)) for s in each.slots) ** len(each.members)
        for each in types
    )


class Named:
    """A cluster with names: the first tokens of each type, and the first anchor points of each slot."""

    def __init__(self, cluster: Cluster, types: Types) -> None:
        self.cluster, self.types = cluster, types
        used: dict[int, int] = {}
        self.members: list[tuple[str, ...]] = []
        for kind in cluster.nodes:
            self.members.append(types[kind].members[used.get(kind, 0)])
            used[kind] = used.get(kind, 0) + 1
        self._taken: dict[tuple[int, int], int] = {}
        self.contacts = {n: self._contact(edge) for n, edge in enumerate(cluster.edges)}

    def _contact(self, edge: Edge) -> Octuple:
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
