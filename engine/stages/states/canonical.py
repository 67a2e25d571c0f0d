"""When two clusters are the same up to exchanges: canonical keys and numbers of automorphisms of small labelled graphs.

Colours are refined until they are stable (Weisfeiler & Leman 1968), which decides forests exactly. In graphs with cycles,
and where no node is unlike all others, one node after another is told apart, and the smallest key counts.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from math import factorial, prod
from typing import Any

Label = tuple[Any, ...]
Adjacency = Sequence[Sequence[tuple[Label, int]]]
Key = tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class Canonical:
    """The key of a graph, the number of its automorphisms, and a number for each node: alike nodes have the same one."""

    key: Key
    automorphisms: int
    orbits: tuple[int, ...]


def canonical(colours: Sequence[Label], near: Adjacency) -> Canonical:
    """The canonical form of a connected graph. `near` lists the labelled neighbours of each node; edges may be parallel.

    In graphs with cycles, every node has a number of its own in `orbits`.
    """
    ranks = _refined(_ranked(list(colours)), near)
    pairs = {(i, j) for i, others in enumerate(near) for _, j in others if i < j}
    forest = len(pairs) == len(colours) - 1
    key, automorphisms = _of(colours, ranks, near, forest)
    return Canonical(key, automorphisms, tuple(ranks) if forest else tuple(range(len(colours))))


def _ranked(signatures: list[Any]) -> list[int]:
    order = {each: rank for rank, each in enumerate(sorted(set(signatures)))}
    return [order[each] for each in signatures]


def _refined(ranks: list[int], near: Adjacency) -> list[int]:
    while True:
        finer = _ranked([(ranks[i], _around(ranks, near[i])) for i in range(len(ranks))])
        if len(set(finer)) == len(set(ranks)):
            return finer
        ranks = finer


def _around(ranks: Sequence[int], neighbours: Sequence[tuple[Label, int]]) -> Key:
    return tuple(sorted((label, ranks[j]) for label, j in neighbours))


def _of(colours: Sequence[Label], ranks: list[int], near: Adjacency, forest: bool) -> tuple[Key, int]:
    """The least key, and the number of automorphisms, of a graph whose colours are stable."""
    sizes = Counter(ranks)
    if len(sizes) == len(ranks):
        return _key(colours, ranks, near), 1
    alone = next((i for i in range(len(ranks)) if sizes[ranks[i]] == 1), None)
    if forest and alone is not None:
        return _key(colours, ranks, near), _rooted(alone, ranks, near)
    cell = min((rank for rank in sizes if sizes[rank] > 1), key=lambda rank: (sizes[rank], rank))
    found = []
    for i in (i for i in range(len(ranks)) if ranks[i] == cell):
        told = _ranked([(rank, j != i) for j, rank in enumerate(ranks)])
        found.append(_of(colours, _refined(told, near), near, forest))
    least, automorphisms = min(found)
    return least, automorphisms * sum(key == least for key, _ in found)


def _key(colours: Sequence[Label], ranks: Sequence[int], near: Adjacency) -> Key:
    nodes = ((ranks[i], colours[i], _around(ranks, near[i])) for i in range(len(ranks)))
    return tuple(sorted(nodes))


def _rooted(root: int, ranks: Sequence[int], near: Adjacency) -> int:
    """The automorphisms of a tree that keep its root: alike children can be exchanged."""
    found, stack = 1, [(root, -1)]
    while stack:
        node, parent = stack.pop()
        children: dict[int, list[Label]] = {}
        for label, j in near[node]:
            if j != parent:
                children.setdefault(j, []).append(label)
        alike = Counter((ranks[j], tuple(sorted(labels))) for j, labels in children.items())
        found *= prod(map(factorial, alike.values()))
        stack += [(j, node) for j in children]
    return found
