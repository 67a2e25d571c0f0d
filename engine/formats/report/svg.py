"""A plan as SVG: steps are boxes from top to bottom, orders are arrows, causal links are dashed ways with their condition.

Coloured bars in a box are the resources that the step holds. Colours are attributes, so that every converter shows them; a
style sheet changes them for dark pages.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import ceil, floor
from types import MappingProxyType
from xml.sax.saxutils import escape, quoteattr

from cellwright.engine.formats.report.channels import GRID, Boxes, Net, width_for
from cellwright.engine.formats.report.columns import Column, columns
from cellwright.engine.formats.report.dot import orders
from cellwright.engine.formats.report.layout import Edge, Layout, layout
from cellwright.engine.formats.report.palette import colours
from cellwright.engine.formats.report.routing import Point, Routing, route
from cellwright.engine.model.purposes import wording
from cellwright.kb.model.plan import START, Plan, Step, StepId
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Atom

CHARACTER, HEIGHT, GAP, MARGIN, BAR, ROUND = 7.3, 30, 44, 20, 6, 5
WIDE_START = 24  # ports
LONGEST = 44  # characters of a label; the whole condition is in the tooltip
MONOSPACED = "DejaVu Sans Mono, Menlo, Consolas, monospace"  # widths of labels are counted in its letters
INK, PAPER, BOX, LINK, GIVEN = "#1b1b1b", "#ffffff", "#f3f5f8", "#1f6fb5", "#8a8f98"
STANDING = {"running": ("#ffe08a", "▶ "), "done": ("#bfe5c7", "✓ "), "failed": ("#f5b5ac", "✗ ")}
STYLE = """
  .link:hover { stroke-width: 3; }
  @media (prefers-color-scheme: dark) {
    .paper { fill: #16181c; } .box { fill: #262a31; stroke: #e8e8e8; } .order { stroke: #e8e8e8; }
    .link { stroke: #7db4ea; } .given { stroke: #9aa0aa; } .head { fill: #e8e8e8; } .link-head { fill: #7db4ea; }
    .given-head { fill: #9aa0aa; } .text { fill: #e8e8e8; } .label { fill: #7db4ea; }
    .given-label { fill: #9aa0aa; }
  }
"""


@dataclass(frozen=True, slots=True)
class _Picture:
    """All drawn parts and their places. `index` finds the net of a condition of a producer."""

    column: Column
    nets: Sequence[Net]
    index: Mapping[tuple[StepId, str], int]
    orders: Sequence[Edge]
    placed: Layout
    boxes: Boxes
    routing: Routing
    say: Callable[[Atom], str]


def plan(
    made: Plan, problem: Problem | None = None, standing: Mapping[int, str] = MappingProxyType({})
) -> str:
    """The partial order with its causal links. The same plan gives the same bytes.

    Stages have the names of the problem. A long plan stands in columns. While a plan is carried out, `standing` says which
    steps are `planned`, `running`, `done` or `failed`: their boxes have a colour and a sign for it.
    """
    say = wording(problem)
    pictures = [_picture(column, say) for column in columns(made, say)]
    fill_of = colours(str(held) for step in made.steps for held in step.resources)
    return "\n".join([*_lines(pictures, fill_of, standing), "</svg>"]) + "\n"


def _picture(column: Column, say: Callable[[Atom], str]) -> _Picture:
    nets = _nets(column.part, say)
    routed = [
        Net(step, _shortened(said), tuple(users), step == START) for (step, said), users in nets.items()
    ]
    widths = _widths(column, routed)
    drawn: list[Edge] = list(orders(column.part))
    links = [(net.producer, consumer) for net in routed for consumer in net.consumers]
    placed = layout(widths, drawn, GAP, GRID, links)
    boxes = Boxes(placed.layer, placed.centre, widths, HEIGHT)
    passing = [
        (placed.layer[edge[0]] + n, x) for edge, bend in placed.bends.items() for n, x in enumerate(bend, 1)
    ]
    index = {key: place for place, key in enumerate(nets)}
    return _Picture(column, routed, index, drawn, placed, boxes, route(routed, boxes, passing), say)


def _widths(column: Column, nets: Sequence[Net]) -> dict[int, float]:
    """The widths of the boxes: room for the ports, and for the text with the bars on the left and equal space on the right."""
    bars = {step.id: len(step.resources) for step in column.part.steps}
    outward, inward = Counter(net.producer for net in nets), Counter(c for net in nets for c in net.consumers)
    outward[START] = max(
        outward[START], min(2 * outward[START], WIDE_START)
    )  # all on the left, if they are few
    return {
        step: max(
            len(text) * CHARACTER + 2 * (BAR * bars.get(step, 0) + 12),
            width_for(max(outward[step], inward[step])),
        )
        for step, text in column.texts.items()
    }


def _nets(made: Plan, say: Callable[[Atom], str]) -> dict[tuple[StepId, str], dict[StepId, None]]:
    """The consumers of each condition of each producer."""
    nets: dict[tuple[StepId, str], dict[StepId, None]] = {}
    for link in made.links:
        nets.setdefault((link.producer, say(link.condition)), {})[link.consumer] = None
    return nets


def _shortened(text: str) -> str:
    return text if len(text) <= LONGEST else text[: LONGEST - 1] + "…"


def _lines(
    pictures: Sequence[_Picture], fill_of: Mapping[str, str], standing: Mapping[int, str]
) -> Iterator[str]:
    """The file line by line: paper, the columns beside each other, legend."""
    extents = [_extent(picture) for picture in pictures]
    width = sum(right - left for left, right, _ in extents) + 2 * GAP * (len(pictures) - 1)
    width = 2 * MARGIN + max(width, sum(len(name) * CHARACTER + 34 for name in fill_of))
    height = max(low for _, _, low in extents) + 2 * MARGIN + (30 if fill_of else 0)
    yield (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" width="{width:g}"'
        f' height="{height:g}" font-family="{MONOSPACED}">'
    )
    yield f"<style>{STYLE}</style>"
    yield "<defs>"
    yield from map(_head, ("head", "link-head", "given-head"), (INK, LINK, GIVEN))
    yield "</defs>"
    yield f'<rect class="paper" x="0" y="0" width="{width:g}" height="{height:g}" fill="{PAPER}"/>'
    at = float(MARGIN)
    for picture, (left, right, _) in zip(pictures, extents, strict=True):
        yield f'<g class="column" transform="translate({at - left:g} {MARGIN})">'
        yield from (
            *_orders(picture),
            *_links(picture),
            *_labels(picture),
            *_boxes(picture, fill_of, standing),
        )
        yield "</g>"
        at += right - left + 2 * GAP
    yield from _legend(fill_of, MARGIN, height - MARGIN)


def _extent(picture: _Picture) -> tuple[float, float, float]:
    """Left, right and lower end of the drawing, as whole numbers."""
    boxes, routing = picture.boxes, picture.routing
    spans = [boxes.span(box) for box in boxes.layer]
    spans += [(label.left, label.right) for label in routing.labels]
    spans += [(x, x) for way in routing.ways.values() for x, _ in way]
    spans += [(x, x) for bend in picture.placed.bends.values() for x in bend]
    left, right = min(span[0] for span in spans), max(span[1] for span in spans)
    return floor(left), ceil(right), ceil(routing.tops[-1] + HEIGHT)


def _head(name: str, fill: str) -> str:
    return (
        f'<marker id="{name}" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8" markerHeight="7"'
        f' markerUnits="userSpaceOnUse" orient="auto"><path class="{name}" d="M0 0L8 4L0 8z" fill="{fill}"/></marker>'
    )


def _orders(picture: _Picture) -> Iterator[str]:
    """The orders: lines from the middle of one box to the middle of another, through their bends."""
    for edge in picture.orders:
        layer = picture.placed.layer[edge[0]]
        xs = [picture.placed.centre[edge[0]], *picture.placed.bends[edge], picture.placed.centre[edge[1]]]
        d = f"M{xs[0]:g} {picture.routing.tops[layer] + HEIGHT:g}"
        for n, (x, to_x) in enumerate(pairwise(xs), layer):
            y, to_y = picture.routing.tops[n] + HEIGHT, picture.routing.tops[n + 1]
            turn = min(40.0, (to_y - y) / 2)
            d += f"L{x:g} {y:g}" + (
                f"L{to_x:g} {to_y:g}"
                if x == to_x
                else f"C{x:g} {y + turn:g} {to_x:g} {to_y - turn:g} {to_x:g} {to_y:g}"
            )
        yield (
            f'<path class="order" d="{d}" fill="none" stroke="{INK}" stroke-width="1.5" marker-end="url(#head)"/>'
        )


def _links(picture: _Picture) -> Iterator[str]:
    """One dashed way for each causal link. Links from the start are paler."""
    for link in picture.column.part.links:
        said = picture.say(link.condition)
        way = picture.routing.ways[picture.index[link.producer, said], link.consumer]
        name, stroke = ("given", GIVEN) if link.producer == START else ("link", LINK)
        title = picture.column.titles[link.producer, link.condition, link.consumer]
        yield (
            f'<path class="link{" given" if name == "given" else ""}" d="{_rounded(way)}" fill="none" stroke="{stroke}"'
            f' stroke-width="1.1" stroke-dasharray="5 3" marker-end="url(#{name}-head)"><title>{escape(title)}</title></path>'
        )


def _rounded(way: Sequence[Point]) -> str:
    """A path with round corners."""
    d = f"M{way[0][0]:g} {way[0][1]:g}"
    for before, corner, after in zip(way, way[1:], way[2:], strict=False):
        near, far = _towards(corner, before), _towards(corner, after)
        d += f"L{near[0]:g} {near[1]:g}Q{corner[0]:g} {corner[1]:g} {far[0]:g} {far[1]:g}"
    return d + f"L{way[-1][0]:g} {way[-1][1]:g}"


def _towards(corner: Point, other: Point) -> Point:
    """A point near a corner on a vertical or horizontal line, never beyond the middle of the line."""
    dx, dy = other[0] - corner[0], other[1] - corner[1]
    length = abs(dx) + abs(dy)
    part = min(ROUND, length / 2) / length if length else 0
    return corner[0] + dx * part, corner[1] + dy * part


def _labels(picture: _Picture) -> Iterator[str]:
    """The label of each net, on a patch of paper colour."""
    for net, label in zip(picture.nets, picture.routing.labels, strict=True):
        x, anchor = (label.right, "end") if label.at_end else (label.left, "start")
        name, fill = ("given-label", GIVEN) if net.producer == START else ("label", LINK)
        yield (
            f'<rect class="paper" x="{label.left:g}" y="{label.y - 9:g}" width="{label.right - label.left:g}"'
            f' height="11.5" fill="{PAPER}"/>'
        )
        yield (
            f'<text class="{name}" x="{x:g}" y="{label.y:g}" text-anchor="{anchor}" font-size="10" fill="{fill}">'
            f"{escape(net.label)}</text>"
        )


def _boxes(picture: _Picture, fill_of: Mapping[str, str], standing: Mapping[int, str]) -> Iterator[str]:
    """The start, the steps and the goal."""
    steps: Mapping[StepId, Step] = {step.id: step for step in picture.column.part.steps}
    for step, text in picture.column.texts.items():
        (left, right), y = picture.boxes.span(step), picture.routing.tops[picture.boxes.layer[step]]
        chosen = (
            f' class="step {standing.get(int(step), "planned")}" tabindex="0" role="button"'
            f" data-step={quoteattr(str(steps[step].operator))}"
            if standing and step in steps
            else ""
        )
        yield f"<g{chosen}><title>{escape(_tooltip(steps[step]) if step in steps else text)}</title>"
        fill, sign = STANDING.get(standing.get(int(step), ""), (BOX, ""))
        yield (
            f'<rect class="box" x="{left:g}" y="{y:g}" width="{right - left:g}" height="{HEIGHT}"'
            f' rx="{6 if step in steps else HEIGHT // 2}" fill="{fill}" stroke="{INK}"/>'
        )
        for index, held in enumerate(steps[step].resources if step in steps else ()):
            at, fill = left + 5 + index * BAR, fill_of[str(held)]
            yield f'<rect class="bar" x="{at:g}" y="{y + 5:g}" width="4" height="{HEIGHT - 10}" fill="{fill}"/>'
        yield (
            f'<text class="text" x="{picture.boxes.centre[step]:g}" y="{y + HEIGHT / 2 + 4:g}" text-anchor="middle"'
            f' font-size="12" fill="{INK}">{sign}{escape(text)}</text></g>'
        )


def _legend(fill_of: Mapping[str, str], x: float, y: float) -> Iterator[str]:
    """The legend of colours and resources."""
    for name, fill in fill_of.items():
        yield f'<rect x="{x:g}" y="{y - 10:g}" width="12" height="12" fill="{fill}"/>'
        yield f'<text class="text" x="{x + 17:g}" y="{y:g}" font-size="12" fill="{INK}">{escape(name)}</text>'
        x += len(name) * CHARACTER + 34


def _tooltip(step: Step) -> str:
    held = f", holds {', '.join(map(str, step.resources))}" if step.resources else ""
    return f"{step.id} {step.operator}, lasts {step.duration}, costs {step.cost}{held}"
