"""Canonical keys and numbers of automorphisms against all permutations."""

from itertools import permutations

from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.stages.states.clusters import canonical_form

Graph = tuple[tuple[int, ...], tuple[tuple[int, int, int], ...]]


@st.composite
def graphs(draw: st.DrawFn) -> Graph:
    """A connected graph of at most five nodes: colours, and edges (first, second, label)."""
    count = draw(st.integers(1, 5))
    colours = tuple(draw(st.lists(st.integers(0, 1), min_size=count, max_size=count)))
    tree = [(draw(st.integers(0, n - 1)), n, draw(st.integers(0, 1))) for n in range(1, count)]
    pairs = st.tuples(st.integers(0, count - 1), st.integers(0, count - 1), st.integers(0, 1))
    more = [each for each in draw(st.lists(pairs, max_size=2)) if each[0] != each[1]]
    return colours, tuple(sorted(tree + more))


def near(graph: Graph) -> list[list[tuple[tuple[int, int], int]]]:
    found: list[list[tuple[tuple[int, int], int]]] = [[] for _ in graph[0]]
    for first, second, label in graph[1]:
        found[first].append(((0, label), second))
        found[second].append(((1, label), first))
    return found


def permuted(graph: Graph, order: tuple[int, ...]) -> Graph:
    colours = [0] * len(order)
    for node, at in enumerate(order):
        colours[at] = graph[0][node]
    return tuple(colours), tuple(sorted((order[a], order[b], label) for a, b, label in graph[1]))


@settings(deadline=None)
@given(graph=graphs(), seed=st.randoms())
def test_the_key_does_not_depend_on_the_numbers_of_nodes(graph: Graph, seed: object) -> None:
    order = list(range(len(graph[0])))
    seed.shuffle(order)  # type: ignore[attr-defined]
    other = permuted(graph, tuple(order))
    first, second = (canonical_form([(c,) for c in each[0]], near(each)) for each in (graph, other))
    assert (first.key, first.automorphisms) == (second.key, second.automorphisms)


@settings(deadline=None)
@given(graph=graphs())
def test_automorphisms_are_the_permutations_that_change_nothing(graph: Graph) -> None:
    same = sum(permuted(graph, order) == graph for order in permutations(range(len(graph[0]))))
    assert canonical_form([(c,) for c in graph[0]], near(graph)).automorphisms == same


@settings(deadline=None)
@given(first=graphs(), second=graphs())
def test_graphs_with_the_same_key_are_the_same(first: Graph, second: Graph) -> None:
    keys = [canonical_form([(c,) for c in each[0]], near(each)).key for each in (first, second)]
    alike = len(first[0]) == len(second[0]) and any(
        permuted(first, order) == second for order in permutations(range(len(first[0])))
    )
    assert (keys[0] == keys[1]) == alike
