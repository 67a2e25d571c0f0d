"""Small directed graphs as mappings: strongly connected components and reachability.

These few functions are enough here. Importing a graph library would take longer than planning a
small problem.
"""

from collections.abc import Hashable, Iterable, Iterator, Mapping
from typing import TypeVar

Vertex = TypeVar("Vertex", bound=Hashable)


def strong_components(graph: Mapping[Vertex, Iterable[Vertex]]) -> Iterator[list[Vertex]]:
    """The strongly connected components; each comes after all components that it points at (Tarjan
    1972, without recursion).
    """
    numbers: dict[Vertex, int] = {}
    lowest: dict[Vertex, int] = {}
    open_: dict[Vertex, None] = {}
    for root in graph:
        if root in numbers:
            continue
        path = [(root, iter(graph[root]))]
        numbers[root] = lowest[root] = len(numbers)
        open_[root] = None
        while path:
            vertex, targets = path[-1]
            new = next(
                (
                    target
                    for target in targets
                    if _is_new_target(target, vertex, numbers, lowest, open_)
                ),
                None,
            )
            if new is not None:
                numbers[new] = lowest[new] = len(numbers)
                open_[new] = None
                path.append((new, iter(graph.get(new, ()))))
                continue
            path.pop()
            if path:
                lowest[path[-1][0]] = min(lowest[path[-1][0]], lowest[vertex])
            if lowest[vertex] == numbers[vertex]:
                yield _close_component(vertex, open_)


def _is_new_target(
    target: Vertex,
    vertex: Vertex,
    numbers: dict[Vertex, int],
    lowest: dict[Vertex, int],
    open_: dict[Vertex, None],
) -> bool:
    """Whether a target is new. The number of an open target lowers `lowest` of its predecessor."""
    if target not in numbers:
        return True
    if target in open_:
        lowest[vertex] = min(lowest[vertex], numbers[target])
    return False


def _close_component(vertex: Vertex, open_: dict[Vertex, None]) -> list[Vertex]:
    """The component whose first vertex is `vertex`. Its vertices are removed from the open ones."""
    component = []
    while True:
        last, _ = open_.popitem()
        component.append(last)
        if last == vertex:
            return component[::-1]


def reachable_vertices(graph: Mapping[Vertex, Iterable[Vertex]], start: Vertex) -> set[Vertex]:
    """The vertices that a path from `start` leads to, with `start` itself."""
    visited, waiting = {start}, [start]
    while waiting:
        for target in graph.get(waiting.pop(), ()):
            if target not in visited:
                visited.add(target)
                waiting.append(target)
    return visited
