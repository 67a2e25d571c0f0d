"""Routes of causal links between boxes in layers: their ports, rows, tracks and labels.

Channel routing by the left edge algorithm (Hashimoto & Stevens 1971). A net is one condition with
its producer and all its consumers. It leaves the producer at one port and has a row with its label
in the channel below. It runs down a track beside the layers that it passes, and has a row above
each layer with a consumer. Ports down, ports in and tracks lie on three grids without common lines,
so that two nets never overlap. No track crosses a box or a label.
"""

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from typing import TypeVar

# ports down are at multiples, ports in half way between them, tracks at odd quarters
PORT_GRID = 16
CHARACTER = 6.1  # of a label

Span = tuple[float, float]
End = tuple[int, int]  # net, consumer
Key = TypeVar("Key", bound=Hashable)


@dataclass(frozen=True, slots=True)
class LinkNet:
    """One condition of a producer for its consumers, all in lower layers.

    If `left`, it goes round on the left.
    """

    producer: int
    label: str
    consumers: tuple[int, ...]
    left: bool = False


@dataclass(frozen=True, slots=True)
class LayeredBoxes:
    """Layer, centre (a multiple of `GRID`) and width of each box, and the common height."""

    layer: Mapping[int, int]
    centre: Mapping[int, float]
    width: Mapping[int, float]
    height: float

    def span(self, box: int) -> Span:
        """Left and right end of a box."""
        return self.centre[box] - self.width[box] / 2, self.centre[box] + self.width[box] / 2

    def next_to(self, net: LinkNet, consumer: int) -> bool:
        """Whether a consumer is in the layer just below the producer."""
        return self.layer[consumer] == self.layer[net.producer] + 1


@dataclass(frozen=True, slots=True)
class NetPorts:
    """The x where each net leaves its producer, and where it enters each consumer."""

    down: Mapping[int, float]
    into: Mapping[End, float]


@dataclass(frozen=True, slots=True)
class NetRows:
    """The row of each net below its producer, counted from the top, and above each layer that
    its track reaches, from below.
    """

    upper: Mapping[int, int]
    lower: Mapping[tuple[int, int], int]


def width_for(ports: int) -> float:
    """The width of a box that has room for these numbers of ports."""
    return 2 * PORT_GRID * (-(-ports // 2) + 1)


def ports_of(nets: Sequence[LinkNet], boxes: LayeredBoxes) -> NetPorts:
    """The ports of all nets: first the straight ways, with the shortest nets in the middle;
    then the longest at the sides.
    """
    down: dict[int, float] = {}
    into: dict[End, float] = {}
    used_down: dict[int, set[float]] = {box: set() for box in boxes.layer}
    used_into: dict[int, set[float]] = {box: set() for box in boxes.layer}
    order = sorted(range(len(nets)), key=lambda index: (_lowest_layer(nets[index], boxes), index))
    for index in order:
        net = nets[index]
        for consumer in net.consumers:
            x = _straight_x(net, consumer, boxes, used_down[net.producer] | used_into[consumer])
            if x is not None:
                down[index] = into[index, consumer] = x
                used_down[net.producer].add(x)
                used_into[consumer].add(x)
                break
    for index in reversed(order):
        net = nets[index]
        if index not in down:
            down[index] = _free_port(
                net.producer, _net_side(net, boxes), boxes, used_down[net.producer], 0
            )
            used_down[net.producer].add(down[index])
        for consumer in net.consumers:
            if (index, consumer) not in into:
                near = 1 if down[index] >= boxes.centre[consumer] else -1
                side = near if boxes.next_to(net, consumer) else _net_side(net, boxes)
                into[index, consumer] = _free_port(
                    consumer, side, boxes, used_into[consumer], PORT_GRID / 2
                )
                used_into[consumer].add(into[index, consumer])
    return NetPorts(down, into)


def _lowest_layer(net: LinkNet, boxes: LayeredBoxes) -> int:
    return max(boxes.layer[consumer] for consumer in net.consumers) - boxes.layer[net.producer]


def _net_side(net: LinkNet, boxes: LayeredBoxes) -> int:
    """-1 for a net that goes to the left, 1 to the right."""
    if _lowest_layer(net, boxes) > 1:
        return -1 if net.left else 1
    return -1 if boxes.centre[net.consumers[0]] < boxes.centre[net.producer] else 1


def _straight_x(net: LinkNet, consumer: int, boxes: LayeredBoxes, used: set[float]) -> float | None:
    """The x of a straight way down; None if there is none."""
    if not boxes.next_to(net, consumer):
        return None
    spans = boxes.span(net.producer), boxes.span(consumer)
    first = max(span[0] for span in spans) + PORT_GRID / 2
    last = min(span[1] for span in spans) - PORT_GRID / 2
    middles = boxes.centre[net.producer], boxes.centre[consumer]
    places = (
        float(PORT_GRID * k) for k in range(int(-(-first // PORT_GRID)), int(last // PORT_GRID) + 1)
    )
    free = [x for x in places if x not in used and x not in middles]
    side = -1 if net.left else 1
    return min(free, key=lambda x: (abs(x - middles[0]), -side * x), default=None)


def _free_port(box: int, side: int, boxes: LayeredBoxes, used: set[float], offset: float) -> float:
    """The outermost free port on one side of a box; if there is none, on the other side."""
    most = int((boxes.width[box] / 2 - PORT_GRID / 2 - offset) // PORT_GRID)
    steps = [k * PORT_GRID + offset for k in range(most, 0, -1)]
    places = [boxes.centre[box] + direction * step for direction in (side, -side) for step in steps]
    return next(x for x in places if x not in used)


def label_span(net: LinkNet, port: float, boxes: LayeredBoxes) -> Span:
    """Left and right end of a label, which starts at its port and extends outwards."""
    length = len(net.label) * CHARACTER
    return (
        (port - 4 - length, port - 4)
        if port < boxes.centre[net.producer]
        else (port + 4, port + 4 + length)
    )


def tracks_of(
    nets: Sequence[LinkNet],
    boxes: LayeredBoxes,
    labels: Sequence[Span],
    passing: Iterable[tuple[int, float]],
) -> dict[int, float]:
    """The x of the track of each net that passes layers: outside their boxes and labels, with the
    shortest nets innermost.

    Layers and the channels below them are counted together: 0, 1, 2, ...
    """
    least, most = [0.0] * (2 * layer_count(boxes)), [0.0] * (2 * layer_count(boxes))
    wide = [(2 * boxes.layer[box], boxes.span(box)) for box in boxes.layer]
    wide += [
        (2 * boxes.layer[net.producer] + 1, span) for net, span in zip(nets, labels, strict=True)
    ]
    wide += [
        (place, (x, x))
        for layer, x in passing
        for place in (2 * layer - 1, 2 * layer, 2 * layer + 1)
    ]
    for place, (left, right) in wide:
        least[place], most[place] = min(least[place], left), max(most[place], right)
    taken: dict[float, list[tuple[int, int]]] = {}
    tracks: dict[int, float] = {}
    for index in sorted(
        range(len(nets)), key=lambda index: (_lowest_layer(nets[index], boxes), index)
    ):
        net, top = nets[index], 2 * boxes.layer[nets[index].producer] + 1
        bottom = top + 2 * _lowest_layer(net, boxes) - 2
        if bottom > top:
            side = _net_side(net, boxes)
            edge = -min(least[top : bottom + 1]) if side < 0 else max(most[top : bottom + 1])
            tracks[index] = _free_column(side, edge, (top, bottom), taken)
    return tracks


def layer_count(boxes: LayeredBoxes) -> int:
    return max(boxes.layer.values()) + 1


def _free_column(
    side: int, edge: float, rows: tuple[int, int], taken: dict[float, list[tuple[int, int]]]
) -> float:
    """The innermost column beyond an edge that is free in these rows. It is marked as taken."""
    for place in count(int(edge // (PORT_GRID / 2)) + 2):
        x = side * (place * PORT_GRID / 2 + PORT_GRID / 4)
        if all(bottom < rows[0] or rows[1] < top for top, bottom in taken.get(x, ())):
            taken.setdefault(x, []).append(rows)
            return x
    raise AssertionError("columns never end")


def rows_of(
    nets: Sequence[LinkNet],
    boxes: LayeredBoxes,
    ports: NetPorts,
    labels: Sequence[Span],
    tracks: Mapping[int, float],
) -> NetRows:
    """The row of each net below its producer, and above each layer that its track reaches."""
    out: dict[int, list[tuple[float, int, Span]]] = {}
    back: dict[int, list[tuple[float, tuple[int, int], Span]]] = {}
    for index, net in enumerate(nets):
        near = [
            ports.into[index, consumer]
            for consumer in net.consumers
            if boxes.next_to(net, consumer)
        ]
        track = [tracks[index]] if index in tracks else []
        port, layer = ports.down[index], boxes.layer[net.producer]
        inner = -abs(port - boxes.centre[net.producer])
        out.setdefault(layer, []).append(
            (inner, index, _hull_span(port, *near, *track, *labels[index]))
        )
        for reached in sorted({boxes.layer[c] for c in net.consumers if not boxes.next_to(net, c)}):
            doors = [ports.into[index, c] for c in net.consumers if boxes.layer[c] == reached]
            span = _hull_span(*doors, tracks[index])
            back.setdefault(reached, []).append((span[1] - span[0], (index, reached), span))
    upper = {key: row for layer in out.values() for key, row in _left_edge(layer).items()}
    lower = {key: row for layer in back.values() for key, row in _left_edge(layer).items()}
    return NetRows(upper, lower)


def _hull_span(*xs: float) -> Span:
    return min(xs), max(xs)


def _left_edge(wanted_spans: Iterable[tuple[float, Key, Span]]) -> dict[Key, int]:
    """For each span the first row in which it meets no other span; spans of lower rank are
    placed first.
    """
    rows: list[list[Span]] = []
    row_of_key: dict[Key, int] = {}
    for _, key, (left, right) in sorted(wanted_spans, key=lambda wanted_span: wanted_span[0]):
        clear = (
            n
            for n, row in enumerate(rows)
            if all(end + PORT_GRID < left or right + PORT_GRID < start for start, end in row)
        )
        row_of_key[key] = next(clear, len(rows))
        rows += [[] for _ in range(row_of_key[key] + 1 - len(rows))]
        rows[row_of_key[key]].append((left, right))
    return row_of_key


# pitches of rows, margins and least height of a channel
UPPER, LOWER, ABOVE, BELOW, LEAST = 14, 8, 8, 18, 40

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class LinkLabel:
    """A line of text from `left` to `right` on the base line `y`.

    Its port is at one of its ends.
    """

    text: str
    left: float
    right: float
    y: float
    at_end: bool


@dataclass(frozen=True, slots=True)
class LinkRouting:
    """The top of each layer, the corners of each net's way to each consumer, and the label of
    each net.
    """

    tops: tuple[float, ...]
    ways: Mapping[End, tuple[Point, ...]]
    labels: tuple[LinkLabel, ...]


@dataclass(frozen=True, slots=True)
class _Channels:
    nets: Sequence[LinkNet]
    boxes: LayeredBoxes
    ports: NetPorts
    labels: Sequence[Span]
    tracks: Mapping[int, float]
    rows: NetRows
    tops: tuple[float, ...]

    def line(self, index: int) -> float:
        """The y of the row of a net below its producer."""
        top = self.tops[self.boxes.layer[self.nets[index].producer]]
        return top + self.boxes.height + ABOVE + UPPER * (self.rows.upper[index] + 1)


def route_links(
    nets: Sequence[LinkNet], boxes: LayeredBoxes, passing: Iterable[tuple[int, float]] = ()
) -> LinkRouting:
    """Ways for all nets. Tracks stay outside everything that passes a layer at the given x."""
    ports = ports_of(nets, boxes)
    labels = [label_span(net, ports.down[index], boxes) for index, net in enumerate(nets)]
    tracks = tracks_of(nets, boxes, labels, passing)
    rows = rows_of(nets, boxes, ports, labels, tracks)
    channels = _Channels(nets, boxes, ports, labels, tracks, rows, _layer_tops(nets, boxes, rows))
    ways = {
        (index, consumer): _net_way(channels, index, consumer)
        for index, net in enumerate(nets)
        for consumer in net.consumers
    }
    return LinkRouting(
        channels.tops, ways, tuple(_net_label(channels, index) for index in range(len(nets)))
    )


def _layer_tops(nets: Sequence[LinkNet], boxes: LayeredBoxes, rows: NetRows) -> tuple[float, ...]:
    """The top of each layer. Each channel is as high as its rows need."""
    upper, lower = [0] * layer_count(boxes), [0] * layer_count(boxes)
    for index, row in rows.upper.items():
        layer = boxes.layer[nets[index].producer]
        upper[layer] = max(upper[layer], row + 1)
    for (_, layer), row in rows.lower.items():
        lower[layer] = max(lower[layer], row + 1)
    tops = [0.0]
    for above, below in zip(upper, lower[1:], strict=False):
        channel = ABOVE + UPPER * above + LOWER * below + BELOW
        tops.append(tops[-1] + boxes.height + max(LEAST, channel))
    return tuple(tops)


def _net_way(channels: _Channels, index: int, consumer: int) -> tuple[Point, ...]:
    """The corners from the port down, along a row, a track and a row, to the port in."""
    net, boxes, tops = channels.nets[index], channels.boxes, channels.tops
    start, end = channels.ports.down[index], channels.ports.into[index, consumer]
    layer, line = boxes.layer[consumer], channels.line(index)
    head, foot = (start, tops[boxes.layer[net.producer]] + boxes.height), (end, tops[layer])
    if boxes.next_to(net, consumer):
        return (head, foot) if start == end else (head, (start, line), (end, line), foot)
    landing = tops[layer] - BELOW - LOWER * channels.rows.lower[index, layer]
    track = channels.tracks[index]
    return head, (start, line), (track, line), (track, landing), (end, landing), foot


def _net_label(channels: _Channels, index: int) -> LinkLabel:
    net, (left, right) = channels.nets[index], channels.labels[index]
    at_end = channels.ports.down[index] < channels.boxes.centre[net.producer]
    return LinkLabel(net.label, left, right, channels.line(index) - 4, at_end)
