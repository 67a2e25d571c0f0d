"""Ports where causal links leave and enter boxes, their rows in the channels between layers, and their tracks.

Channel routing by the left edge algorithm (Hashimoto & Stevens 1971). A net is one condition with its producer and all
its consumers. It leaves the producer at one port and has a row with its label in the channel below. It runs down a track
beside the layers that it passes, and has a row above each layer with a consumer. Ports down, ports in and tracks lie on
three grids without common lines, so that two nets never overlap. No track crosses a box or a label.
"""

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from typing import TypeVar

GRID = 16  # ports down are at multiples, ports in half way between them, tracks at odd quarters
CHARACTER = 6.1  # of a label

Span = tuple[float, float]
End = tuple[int, int]  # net, consumer
Key = TypeVar("Key", bound=Hashable)


@dataclass(frozen=True, slots=True)
class Net:
    """One condition of a producer for its consumers, all in lower layers. If `left`, it goes round on the left."""

    producer: int
    label: str
    consumers: tuple[int, ...]
    left: bool = False


@dataclass(frozen=True, slots=True)
class Boxes:
    """Layer, centre (a multiple of `GRID`) and width of each box, and the common height."""

    layer: Mapping[int, int]
    centre: Mapping[int, float]
    width: Mapping[int, float]
    height: float

    def span(self, box: int) -> Span:
        """Left and right end of a box."""
        return self.centre[box] - self.width[box] / 2, self.centre[box] + self.width[box] / 2

    def next_to(self, net: Net, consumer: int) -> bool:
        """Whether a consumer is in the layer just below the producer."""
        return self.layer[consumer] == self.layer[net.producer] + 1


@dataclass(frozen=True, slots=True)
class Ports:
    """The x where each net leaves its producer, and where it enters each consumer."""

    down: Mapping[int, float]
    into: Mapping[End, float]


@dataclass(frozen=True, slots=True)
class NetRows:
    """The row of each net below its producer, counted from the top, and above each layer that its track reaches, from below."""

    upper: Mapping[int, int]
    lower: Mapping[tuple[int, int], int]


def width_for(ports: int) -> float:
    """The width of a box that has room for these numbers of ports."""
    return 2 * GRID * (-(-ports // 2) + 1)


def ports_of(nets: Sequence[Net], boxes: Boxes) -> Ports:
    """The ports of all nets: first the straight ways, with the shortest nets in the middle; then the longest at the sides."""
    down: dict[int, float] = {}
    into: dict[End, float] = {}
    used_down: dict[int, set[float]] = {box: set() for box in boxes.layer}
    used_into: dict[int, set[float]] = {box: set() for box in boxes.layer}
    order = sorted(range(len(nets)), key=lambda index: (_reach(nets[index], boxes), index))
    for index in order:
        net = nets[index]
        for consumer in net.consumers:
            x = _straight(net, consumer, boxes, used_down[net.producer] | used_into[consumer])
            if x is not None:
                down[index] = into[index, consumer] = x
                used_down[net.producer].add(x)
                used_into[consumer].add(x)
                break
    for index in reversed(order):
        net = nets[index]
        if index not in down:
            down[index] = _free(net.producer, _side(net, boxes), boxes, used_down[net.producer], 0)
            used_down[net.producer].add(down[index])
        for consumer in net.consumers:
            if (index, consumer) not in into:
                near = 1 if down[index] >= boxes.centre[consumer] else -1
                side = near if boxes.next_to(net, consumer) else _side(net, boxes)
                into[index, consumer] = _free(consumer, side, boxes, used_into[consumer], GRID / 2)
                used_into[consumer].add(into[index, consumer])
    return Ports(down, into)


def _reach(net: Net, boxes: Boxes) -> int:
    return max(boxes.layer[consumer] for consumer in net.consumers) - boxes.layer[net.producer]


def _side(net: Net, boxes: Boxes) -> int:
    """-1 for a net that goes to the left, 1 to the right."""
    if _reach(net, boxes) > 1:
        return -1 if net.left else 1
    return -1 if boxes.centre[net.consumers[0]] < boxes.centre[net.producer] else 1


def _straight(net: Net, consumer: int, boxes: Boxes, used: set[float]) -> float | None:
    """The x of a straight way down; None if there is none."""
    if not boxes.next_to(net, consumer):
        return None
    spans = boxes.span(net.producer), boxes.span(consumer)
    first = max(span[0] for span in spans) + GRID / 2
    last = min(span[1] for span in spans) - GRID / 2
    middles = boxes.centre[net.producer], boxes.centre[consumer]
    places = (float(GRID * k) for k in range(int(-(-first // GRID)), int(last // GRID) + 1))
    free = [x for x in places if x not in used and x not in middles]
    side = -1 if net.left else 1
    return min(free, key=lambda x: (abs(x - middles[0]), -side * x), default=None)


def _free(box: int, side: int, boxes: Boxes, used: set[float], offset: float) -> float:
    """The outermost free port on one side of a box; if there is none, on the other side."""
    most = int((boxes.width[box] / 2 - GRID / 2 - offset) // GRID)
    steps = [k * GRID + offset for k in range(most, 0, -1)]
    places = [boxes.centre[box] + way * step for way in (side, -side) for step in steps]
    return next(x for x in places if x not in used)


def label_span(net: Net, port: float, boxes: Boxes) -> Span:
    """Left and right end of a label, which starts at its port and extends outwards."""
    length = len(net.label) * CHARACTER
    return (
        (port - 4 - length, port - 4) if port < boxes.centre[net.producer] else (port + 4, port + 4 + length)
    )


def tracks_of(
    nets: Sequence[Net], boxes: Boxes, labels: Sequence[Span], passing: Iterable[tuple[int, float]]
) -> dict[int, float]:
    """The x of the track of each net that passes layers: outside their boxes and labels, with the shortest nets innermost.

    Layers and the channels below them are counted together: 0, 1, 2, ...
    """
    least, most = [0.0] * (2 * depth(boxes)), [0.0] * (2 * depth(boxes))
    wide = [(2 * boxes.layer[box], boxes.span(box)) for box in boxes.layer]
    wide += [(2 * boxes.layer[net.producer] + 1, span) for net, span in zip(nets, labels, strict=True)]
    wide += [(place, (x, x)) for layer, x in passing for place in (2 * layer - 1, 2 * layer, 2 * layer + 1)]
    for place, (left, right) in wide:
        least[place], most[place] = min(least[place], left), max(most[place], right)
    taken: dict[float, list[tuple[int, int]]] = {}
    tracks: dict[int, float] = {}
    for index in sorted(range(len(nets)), key=lambda index: (_reach(nets[index], boxes), index)):
        net, top = nets[index], 2 * boxes.layer[nets[index].producer] + 1
        bottom = top + 2 * _reach(net, boxes) - 2
        if bottom > top:
            side = _side(net, boxes)
            edge = -min(least[top : bottom + 1]) if side < 0 else max(most[top : bottom + 1])
            tracks[index] = _column(side, edge, (top, bottom), taken)
    return tracks


def depth(boxes: Boxes) -> int:
    return max(boxes.layer.values()) + 1


def _column(
    side: int, edge: float, rows: tuple[int, int], taken: dict[float, list[tuple[int, int]]]
) -> float:
    """The innermost column beyond an edge that is free in these rows. It is marked as taken."""
    for place in count(int(edge // (GRID / 2)) + 2):
        x = side * (place * GRID / 2 + GRID / 4)
        if all(bottom < rows[0] or rows[1] < top for top, bottom in taken.get(x, ())):
            taken.setdefault(x, []).append(rows)
            return x
    raise AssertionError("columns never end")


def rows_of(
    nets: Sequence[Net], boxes: Boxes, ports: Ports, labels: Sequence[Span], tracks: Mapping[int, float]
) -> NetRows:
    """The row of each net below its producer, and above each layer that its track reaches."""
    out: dict[int, list[tuple[float, int, Span]]] = {}
    back: dict[int, list[tuple[float, tuple[int, int], Span]]] = {}
    for index, net in enumerate(nets):
        near = [ports.into[index, each] for each in net.consumers if boxes.next_to(net, each)]
        track = [tracks[index]] if index in tracks else []
        port, layer = ports.down[index], boxes.layer[net.producer]
        inner = -abs(port - boxes.centre[net.producer])
        out.setdefault(layer, []).append((inner, index, _hull(port, *near, *track, *labels[index])))
        for reached in sorted({boxes.layer[c] for c in net.consumers if not boxes.next_to(net, c)}):
            doors = [ports.into[index, c] for c in net.consumers if boxes.layer[c] == reached]
            span = _hull(*doors, tracks[index])
            back.setdefault(reached, []).append((span[1] - span[0], (index, reached), span))
    upper = {key: row for layer in out.values() for key, row in _left_edge(layer).items()}
    lower = {key: row for layer in back.values() for key, row in _left_edge(layer).items()}
    return NetRows(upper, lower)


def _hull(*xs: float) -> Span:
    return min(xs), max(xs)


def _left_edge(wanted: Iterable[tuple[float, Key, Span]]) -> dict[Key, int]:
    """For each span the first row in which it meets no other span; spans of lower rank are placed first."""
    rows: list[list[Span]] = []
    found: dict[Key, int] = {}
    for _, key, (left, right) in sorted(wanted, key=lambda each: each[0]):
        clear = (
            n
            for n, row in enumerate(rows)
            if all(end + GRID < left or right + GRID < start for start, end in row)
        )
        found[key] = next(clear, len(rows))
        rows += [[] for _ in range(found[key] + 1 - len(rows))]
        rows[found[key]].append((left, right))
    return found
