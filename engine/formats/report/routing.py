"""Ways for causal links between boxes in layers: straight down, or round the boxes by rows and tracks."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from cellwright.engine.formats.report.channels import (
    Boxes,
    End,
    Net,
    NetRows,
    Ports,
    Span,
    depth,
    label_span,
    ports_of,
    rows_of,
    tracks_of,
)

UPPER, LOWER, ABOVE, BELOW, LEAST = 14, 8, 8, 18, 40  # pitches of rows, margins and least height of a channel

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Label:
    """A line of text from `left` to `right` on the base line `y`. Its port is at one of its ends."""

    text: str
    left: float
    right: float
    y: float
    at_end: bool


@dataclass(frozen=True, slots=True)
class Routing:
    """The top of each layer, the corners of each net's way to each consumer, and the label of each net."""

    tops: tuple[float, ...]
    ways: Mapping[End, tuple[Point, ...]]
    labels: tuple[Label, ...]


@dataclass(frozen=True, slots=True)
class _Channels:
    nets: Sequence[Net]
    boxes: Boxes
    ports: Ports
    labels: Sequence[Span]
    tracks: Mapping[int, float]
    rows: NetRows
    tops: tuple[float, ...]

    def line(self, index: int) -> float:
        """The y of the row of a net below its producer."""
        top = self.tops[self.boxes.layer[self.nets[index].producer]]
        return top + self.boxes.height + ABOVE + UPPER * (self.rows.upper[index] + 1)


def route(nets: Sequence[Net], boxes: Boxes, passing: Iterable[tuple[int, float]] = ()) -> Routing:
    """Ways for all nets. Tracks stay outside everything that passes a layer at the given x."""
    ports = ports_of(nets, boxes)
    labels = [label_span(net, ports.down[index], boxes) for index, net in enumerate(nets)]
    tracks = tracks_of(nets, boxes, labels, passing)
    rows = rows_of(nets, boxes, ports, labels, tracks)
    channels = _Channels(nets, boxes, ports, labels, tracks, rows, _tops(nets, boxes, rows))
    ways = {
        (index, consumer): _way(channels, index, consumer)
        for index, net in enumerate(nets)
        for consumer in net.consumers
    }
    return Routing(channels.tops, ways, tuple(_label(channels, index) for index in range(len(nets))))


def _tops(nets: Sequence[Net], boxes: Boxes, rows: NetRows) -> tuple[float, ...]:
    """The top of each layer. Each channel is as high as its rows need."""
    upper, lower = [0] * depth(boxes), [0] * depth(boxes)
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


def _way(channels: _Channels, index: int, consumer: int) -> tuple[Point, ...]:
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


def _label(channels: _Channels, index: int) -> Label:
    net, (left, right) = channels.nets[index], channels.labels[index]
    at_end = channels.ports.down[index] < channels.boxes.centre[net.producer]
    return Label(net.label, left, right, channels.line(index) - 4, at_end)
