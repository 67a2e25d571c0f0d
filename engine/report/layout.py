"""Places for the steps of a plan, layer below layer (Sugiyama, Tagawa & Toda 1981): few crossings, no overlaps."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

SWEEPS = 12


@dataclass(frozen=True, slots=True)
class Layout:
    """The layer of each node (0 on top) and the horizontal centre of each, in the unit of the widths given."""

    layer: Mapping[int, int]
    centre: Mapping[int, float]
    width: float


def layout(widths: Mapping[int, float], edges: Sequence[tuple[int, int]], gap: float) -> Layout:
    """Layers and centres of the nodes of an acyclic graph; `widths` lists the nodes in a topological order."""
    layer = _layers(list(widths), edges)
    pieces = dict(widths)
    parts: list[tuple[int, int]] = []
    rows: list[list[int]] = [[] for _ in range(max(layer.values(), default=0) + 1)]
    for node in widths:
        rows[layer[node]].append(node)
    for (
        upper,
        lower,
    ) in edges:  # long edges become chains of narrow pieces, so that they find their way round boxes
        before = upper
        for level in range(layer[upper] + 1, layer[lower]):
            piece = -(len(pieces) + 2)
            pieces[piece] = gap
            rows[level].append(piece)
            parts.append((before, piece))
            before = piece
        parts.append((before, lower))
    above, below = _neighbours(parts, 1), _neighbours(parts, 0)
    for sweep in range(SWEEPS):
        _reorder(rows, above if sweep % 2 == 0 else below, sweep % 2 == 0)
    centre = _centres(rows, pieces, above, below, gap)
    left = min((centre[node] - pieces[node] / 2 for node in pieces), default=0.0)
    right = max((centre[node] + pieces[node] / 2 for node in pieces), default=0.0)
    return Layout(layer, {node: centre[node] - left for node in widths}, right - left)


def _layers(nodes: list[int], edges: Sequence[tuple[int, int]]) -> dict[int, int]:
    """The length of the longest way to each node."""
    into = _neighbours(edges, 1)
    layer: dict[int, int] = {}
    for node in nodes:
        layer[node] = 1 + max((layer[before] for before in into.get(node, ())), default=-1)
    return layer


def _neighbours(edges: Sequence[tuple[int, int]], end: int) -> dict[int, list[int]]:
    found: dict[int, list[int]] = {}
    for edge in edges:
        found.setdefault(edge[end], []).append(edge[1 - end])
    return found


def _reorder(rows: list[list[int]], towards: Mapping[int, list[int]], down: bool) -> None:
    """Sort each row by the mean place of its neighbours in the row before."""
    place = {node: index for row in rows for index, node in enumerate(row)}
    for row in rows if down else reversed(rows):
        means = {node: _mean([place[n] for n in towards.get(node, ())], place[node]) for node in row}
        row.sort(key=lambda node: means[node])
        place.update((node, index) for index, node in enumerate(row))


def _mean(values: Sequence[float], otherwise: float) -> float:
    return sum(values) / len(values) if values else otherwise


def _centres(
    rows: list[list[int]],
    widths: Mapping[int, float],
    above: Mapping[int, list[int]],
    below: Mapping[int, list[int]],
    gap: float,
) -> dict[int, float]:
    """Each node as near to the mean of its neighbours as its row allows."""
    centre: dict[int, float] = {}
    for row in rows:
        total = sum(widths[node] + gap for node in row) - gap
        at = -total / 2
        for node in row:
            centre[node] = at + widths[node] / 2
            at += widths[node] + gap
    for sweep in range(SWEEPS):
        towards = above if sweep % 2 == 0 else below
        for row in rows if sweep % 2 == 0 else rows[::-1]:
            wanted = [_mean([centre[n] for n in towards.get(node, ())], centre[node]) for node in row]
            centre.update(zip(row, _spread(wanted, [widths[node] for node in row], gap), strict=True))
    return centre


def _spread(wanted: Sequence[float], widths: Sequence[float], gap: float) -> list[float]:
    """Centres near the wanted ones, in the same order, that keep their distance: pushed right, pushed left, averaged."""
    right, left = list(wanted), list(wanted)
    for index in range(1, len(right)):
        right[index] = max(right[index], right[index - 1] + (widths[index - 1] + widths[index]) / 2 + gap)
    for index in range(len(left) - 2, -1, -1):
        left[index] = min(left[index], left[index + 1] - (widths[index] + widths[index + 1]) / 2 - gap)
    return [(one + other) / 2 for one, other in zip(right, left, strict=True)]
