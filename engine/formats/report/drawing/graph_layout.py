"""Layout of an acyclic graph in layers with few crossings (Sugiyama, Tagawa & Toda 1981)."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

LAYOUT_SWEEPS = 12
Edge = tuple[int, int]
Neighbours = Mapping[int, list[int]]


@dataclass(frozen=True, slots=True)
class GraphLayout:
    """The layer of each node (0 is the top), its horizontal centre, and the places where long edges
    pass each layer.

    Centres and bends are multiples of `grid`. `bends` holds one x for each layer between the ends
    of an edge, from the top.
    """

    layer: Mapping[int, int]
    centre: Mapping[int, float]
    bends: Mapping[Edge, tuple[float, ...]]


@dataclass(frozen=True, slots=True)
class _Rows:
    """Nodes and pieces of long edges in layers, their widths, and the edges between
    neighbouring layers.
    """

    rows: list[list[int]]
    widths: dict[int, float]
    above: Neighbours
    below: Neighbours
    pieces: Mapping[Edge, list[int]]


def layout_graph(
    widths: Mapping[int, float],
    edges: Sequence[Edge],
    gap: float,
    grid: float = 1.0,
    extra: Iterable[Edge] = (),
) -> GraphLayout:
    """Layers, centres and bends of a graph. `widths` lists the nodes in a topological order of all
    edges.

    `extra` edges also point downwards, but they do not pull nodes together. Boxes of one layer are
    at least `gap - grid` apart.
    """
    layer = _node_layers(list(widths), [*edges, *extra])
    rows = _node_rows(widths, layer, edges, gap)
    for sweep in range(LAYOUT_SWEEPS):
        _reorder_rows(rows.rows, rows.below if sweep % 2 else rows.above, down=not sweep % 2)
    placed = {node: round(x / grid) * grid for node, x in _node_centres(rows, gap).items()}
    bends = {edge: tuple(placed[piece] for piece in pieces) for edge, pieces in rows.pieces.items()}
    return GraphLayout(layer, {node: placed[node] for node in widths}, bends)


def _node_layers(nodes: Sequence[int], edges: Iterable[Edge]) -> dict[int, int]:
    """The length of the longest path to each node."""
    into = _neighbours_of(edges, 1)
    layer: dict[int, int] = {}
    for node in nodes:
        layer[node] = 1 + max((layer.get(before, -1) for before in into.get(node, ())), default=-1)
    return layer


def _node_rows(
    widths: Mapping[int, float], layer: Mapping[int, int], edges: Sequence[Edge], gap: float
) -> _Rows:
    """The rows of nodes. Long edges are cut into chains of narrow pieces, so that they can go
    round the boxes.
    """
    rows: list[list[int]] = [[] for _ in range(max(layer.values(), default=0) + 1)]
    for node in widths:
        rows[layer[node]].append(node)
    every, parts, pieces = dict(widths), list[Edge](), dict[Edge, list[int]]()
    fresh = min(widths, default=0) - 1
    for upper, lower in edges:
        chain = list(range(fresh, fresh - max(layer[lower] - layer[upper] - 1, 0), -1))
        fresh -= len(chain)
        for level, piece in enumerate(chain, layer[upper] + 1):
            rows[level].append(piece)
            every[piece] = gap
        parts += zip([upper, *chain], [*chain, lower], strict=True)
        pieces[upper, lower] = chain
    return _Rows(rows, every, _neighbours_of(parts, 1), _neighbours_of(parts, 0), pieces)


def _neighbours_of(edges: Iterable[Edge], end: int) -> dict[int, list[int]]:
    neighbours: dict[int, list[int]] = {}
    for edge in edges:
        neighbours.setdefault(edge[end], []).append(edge[1 - end])
    return neighbours


def _reorder_rows(rows: list[list[int]], towards: Neighbours, down: bool) -> None:
    """Sort each row by the mean position of the neighbours in the row before."""
    place = {node: index for row in rows for index, node in enumerate(row)}
    for row in rows if down else reversed(rows):
        means = {
            node: _mean_or([place[n] for n in towards.get(node, ())], place[node]) for node in row
        }
        row.sort(key=lambda node: means[node])
        place.update((node, index) for index, node in enumerate(row))


def _mean_or(values: Sequence[float], otherwise: float) -> float:
    return sum(values) / len(values) if values else otherwise


def _node_centres(rows: _Rows, gap: float) -> dict[int, float]:
    """The centres of all nodes: each as near to the mean of its neighbours as its row allows."""
    centre: dict[int, float] = {}
    for row in rows.rows:
        at = -(sum(rows.widths[node] + gap for node in row) - gap) / 2
        for node in row:
            centre[node] = at + rows.widths[node] / 2
            at += rows.widths[node] + gap
    for sweep in range(LAYOUT_SWEEPS):
        towards = rows.below if sweep % 2 else rows.above
        for row in reversed(rows.rows) if sweep % 2 else rows.rows:
            wanted_centres = [
                _mean_or([centre[n] for n in towards.get(node, ())], centre[node]) for node in row
            ]
            centre.update(
                zip(
                    row,
                    _spread_row(wanted_centres, [rows.widths[node] for node in row], gap),
                    strict=True,
                )
            )
    return centre


def _spread_row(
    wanted_centres: Sequence[float], widths: Sequence[float], gap: float
) -> list[float]:
    """Centres near the wanted ones, in the same order, with the needed distances: the mean of a
    push right and a push left.
    """
    right, left = list(wanted_centres), list(wanted_centres)
    for index in range(1, len(right)):
        right[index] = max(
            right[index], right[index - 1] + (widths[index - 1] + widths[index]) / 2 + gap
        )
    for index in range(len(left) - 2, -1, -1):
        left[index] = min(
            left[index], left[index + 1] - (widths[index] + widths[index + 1]) / 2 - gap
        )
    return [
        (pushed_right + pushed_left) / 2
        for pushed_right, pushed_left in zip(right, left, strict=True)
    ]
