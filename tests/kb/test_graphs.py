"""Laws of small graphs, against a plainly correct closure."""

from hypothesis import given
from hypothesis import strategies as st

from cellwright.kb.graphs import reachable_vertices, strong_components

GRAPHS = st.integers(0, 7).flatmap(
    lambda size: st.dictionaries(
        st.integers(0, size), st.lists(st.integers(0, size), max_size=4), max_size=size + 1
    )
)


@given(GRAPHS)
def test_components_are_the_classes_of_mutual_reachability_with_targets_first(
    graph: dict[int, list[int]],
) -> None:
    found = list(strong_components(graph))
    vertices = set(graph) | {target for targets in graph.values() for target in targets}
    assert sorted(vertex for part in found for vertex in part) == sorted(vertices)
    place = {vertex: number for number, part in enumerate(found) for vertex in part}
    for vertex in vertices:
        for other in reachable_vertices(graph, vertex):
            assert (place[vertex] == place[other]) == (vertex in reachable_vertices(graph, other))
            assert place[other] <= place[vertex]


@given(GRAPHS, st.integers(0, 7))
def test_reached_is_the_least_closed_set(graph: dict[int, list[int]], start: int) -> None:
    closed = {start}
    for _ in range(9):
        closed |= {target for vertex in closed for target in graph.get(vertex, [])}
    assert reachable_vertices(graph, start) == closed
