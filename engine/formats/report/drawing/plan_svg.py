"""A plan as SVG: steps are boxes, orders arrows, causal links dashed; long plans in columns."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil, floor
from types import MappingProxyType
from xml.sax.saxutils import escape, quoteattr

from cellwright.engine.formats.report.drawing.colour_palette import assign_colours
from cellwright.engine.formats.report.drawing.dot_graphs import direct_orders
from cellwright.engine.formats.report.drawing.graph_layout import Edge, GraphLayout, layout_graph
from cellwright.engine.formats.report.drawing.link_routing import (
    PORT_GRID,
    LayeredBoxes,
    LinkNet,
    LinkRouting,
    Point,
    route_links,
    width_for,
)
from cellwright.engine.model.answer_wording import condition_wording
from cellwright.engine.model.task_costs import cost_text
from cellwright.kb.model.plan_model import GOAL_STEP, INITIAL_STEP, CausalLink, Plan, Step, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom

MAX_COLUMN_STEPS = 24  # steps of a column

Way = tuple[StepId, Atom, StepId]


@dataclass(frozen=True, slots=True)
class PlanColumn:
    """Some steps that stand below each other. `texts` are the texts of its boxes, those of `START`
    and `GOAL` included.

    `titles` says for each of its links what it stands for: all links of the whole plan that leave
    or enter the column there.
    """

    part: Plan
    texts: Mapping[StepId, str]
    titles: Mapping[Way, str]


def split_columns(plan: Plan, say: Callable[[Atom], str]) -> list[PlanColumn]:
    """The plan in as few columns of about equal height as `HIGHEST` allows; at least one."""
    count = max(1, ceil(len(plan.steps) / MAX_COLUMN_STEPS))
    height = ceil(len(plan.steps) / count)
    texts = {
        INITIAL_STEP: "start",
        **{step.id: f"{step.id} {step.operator}" for step in plan.steps},
        GOAL_STEP: "goal",
    }
    return [
        _make_column(plan, plan.steps[n * height : (n + 1) * height], texts, say)
        for n in range(count)
        if n == 0 or n * height < len(plan.steps)
    ]


def _make_column(
    plan: Plan, steps: tuple[Step, ...], texts: Mapping[StepId, str], say: Callable[[Atom], str]
) -> PlanColumn:
    own = {step.id for step in steps}
    links: dict[Way, list[CausalLink]] = {}
    for link in plan.links:
        if link_ends := _link_in_column(link, own, not steps or steps[0] == plan.steps[0]):
            links.setdefault(link_ends, []).append(link)
    column_steps = tuple(
        replace(step, after=tuple(earlier_id for earlier_id in step.after if earlier_id in own))
        for step in steps
    )
    shown = {
        step_id: text
        for step_id, text in texts.items()
        if step_id in own or step_id in (INITIAL_STEP, GOAL_STEP)
    }
    shown |= dict(_column_ends(plan, steps))
    titles = {link_ends: _link_title(parts, texts, say) for link_ends, parts in links.items()}
    return PlanColumn(
        Plan(column_steps, tuple(CausalLink(*link_ends) for link_ends in links)), shown, titles
    )


def _link_in_column(link: CausalLink, own: set[StepId], first: bool) -> Way | None:
    """Where a link of the plan runs in a column; None if it passes by. What the start gives the
    goal is in the first.
    """
    inside = link.producer in own, link.consumer in own
    if not any(inside) and not (
        first and (link.producer, link.consumer) == (INITIAL_STEP, GOAL_STEP)
    ):
        return None
    return (
        link.producer if inside[0] else INITIAL_STEP,
        link.condition,
        link.consumer if inside[1] else GOAL_STEP,
    )


def _column_ends(plan: Plan, steps: tuple[Step, ...]) -> Iterator[tuple[StepId, str]]:
    """What stands above and below a column that is not the first or not the last."""
    if steps and steps[0] != plan.steps[0]:
        yield INITIAL_STEP, f"start and steps up to {steps[0].id - 1}"
    if steps and steps[-1] != plan.steps[-1]:
        yield GOAL_STEP, f"goal and steps from {steps[-1].id + 1} on"


def _link_title(
    links: list[CausalLink], texts: Mapping[StepId, str], say: Callable[[Atom], str]
) -> str:
    users: dict[StepId, list[str]] = {}
    for link in links:
        users.setdefault(link.producer, []).append(texts[link.consumer])
    condition_text = say(links[0].condition)
    return "; ".join(
        f"{texts[producer_id]} achieves {condition_text} for {', '.join(names)}"
        for producer_id, names in users.items()
    )


CHARACTER, HEIGHT, GAP, MARGIN, BAR, ROUND = 7.3, 30, 44, 20, 6, 5
WIDE_START = 24  # ports
MAX_LABEL_CHARACTERS = 44  # characters of a label; the whole condition is in the tooltip
# widths of labels are counted in its letters
LABEL_FONTS = "DejaVu Sans Mono, Menlo, Consolas, monospace"
INK, PAPER, BOX, LINK, GIVEN = "#1b1b1b", "#ffffff", "#f3f5f8", "#1f6fb5", "#8a8f98"
STANDING_MARKS = {
    "running": ("#ffe08a", "▶ "),
    "done": ("#bfe5c7", "✓ "),
    "failed": ("#f5b5ac", "✗ "),
}
PLAN_STYLE = """
  .link:hover { stroke-width: 3; }
  @media (prefers-color-scheme: dark) {
    .paper { fill: #16181c; } .box { fill: #262a31; stroke: #e8e8e8; } .order { stroke: #e8e8e8; }
    .link { stroke: #7db4ea; } .given { stroke: #9aa0aa; } .head { fill: #e8e8e8; } \
.link-head { fill: #7db4ea; }
    .given-head { fill: #9aa0aa; } .text { fill: #e8e8e8; } .label { fill: #7db4ea; }
    .given-label { fill: #9aa0aa; }
  }
"""


@dataclass(frozen=True, slots=True)
class _ColumnPicture:
    """All drawn parts and their places. `index` finds the net of a condition of a producer."""

    column: PlanColumn
    nets: Sequence[LinkNet]
    index: Mapping[tuple[StepId, str], int]
    orders: Sequence[Edge]
    placed: GraphLayout
    boxes: LayeredBoxes
    routing: LinkRouting
    say: Callable[[Atom], str]


def draw_plan(
    drawn_plan: Plan,
    problem: Problem | None = None,
    standing: Mapping[int, str] = MappingProxyType({}),
) -> str:
    """The partial order with its causal links. The same plan gives the same bytes.

    Stages have the names of the problem. A long plan stands in columns. While a plan is carried
    out, `standing` says which steps are `planned`, `running`, `done` or `failed`: their boxes have
    a colour and a sign for it.
    """
    say = condition_wording(problem)
    pictures = [_column_picture(column, say) for column in split_columns(drawn_plan, say)]
    fill_of = assign_colours(
        str(resource) for step in drawn_plan.steps for resource in step.resources
    )
    tips = {each.id: _step_tooltip(each, problem) for each in drawn_plan.steps}
    return "\n".join([*_picture_lines(pictures, fill_of, standing, tips), "</svg>"]) + "\n"


def _column_picture(column: PlanColumn, say: Callable[[Atom], str]) -> _ColumnPicture:
    nets = _condition_nets(column.part, say)
    routed = [
        LinkNet(step, _shorten_label(condition_text), tuple(users), step == INITIAL_STEP)
        for (step, condition_text), users in nets.items()
    ]
    widths = _box_widths(column, routed)
    drawn: list[Edge] = list(direct_orders(column.part))
    links = [(net.producer, consumer) for net in routed for consumer in net.consumers]
    placed = layout_graph(widths, drawn, GAP, PORT_GRID, links)
    boxes = LayeredBoxes(placed.layer, placed.centre, widths, HEIGHT)
    passing = [
        (placed.layer[edge[0]] + n, x)
        for edge, bend in placed.bends.items()
        for n, x in enumerate(bend, 1)
    ]
    index = {key: place for place, key in enumerate(nets)}
    return _ColumnPicture(
        column, routed, index, drawn, placed, boxes, route_links(routed, boxes, passing), say
    )


def _box_widths(column: PlanColumn, nets: Sequence[LinkNet]) -> dict[int, float]:
    """The widths of the boxes: room for the ports, and for the text with the bars on the left
    and equal space on the right.
    """
    bars = {step.id: len(step.resources) for step in column.part.steps}
    outward, inward = (
        Counter(net.producer for net in nets),
        Counter(c for net in nets for c in net.consumers),
    )
    outward[INITIAL_STEP] = max(
        outward[INITIAL_STEP], min(2 * outward[INITIAL_STEP], WIDE_START)
    )  # all on the left, if they are few
    return {
        step: max(
            len(text) * CHARACTER + 2 * (BAR * bars.get(step, 0) + 12),
            width_for(max(outward[step], inward[step])),
        )
        for step, text in column.texts.items()
    }


def _condition_nets(
    drawn_plan: Plan, say: Callable[[Atom], str]
) -> dict[tuple[StepId, str], dict[StepId, None]]:
    """The consumers of each condition of each producer."""
    nets: dict[tuple[StepId, str], dict[StepId, None]] = {}
    for link in drawn_plan.links:
        nets.setdefault((link.producer, say(link.condition)), {})[link.consumer] = None
    return nets


def _shorten_label(text: str) -> str:
    return text if len(text) <= MAX_LABEL_CHARACTERS else text[: MAX_LABEL_CHARACTERS - 1] + "…"


def _picture_lines(
    pictures: Sequence[_ColumnPicture],
    fill_of: Mapping[str, str],
    standing: Mapping[int, str],
    tips: Mapping[StepId, str],
) -> Iterator[str]:
    """The file line by line: paper, the columns beside each other, legend."""
    extents = [_picture_extent(picture) for picture in pictures]
    width = sum(right - left for left, right, _ in extents) + 2 * GAP * (len(pictures) - 1)
    width = 2 * MARGIN + max(width, sum(len(name) * CHARACTER + 34 for name in fill_of))
    height = max(low for _, _, low in extents) + 2 * MARGIN + (30 if fill_of else 0)
    yield (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" '
        f'width="{width:g}"'
        f' height="{height:g}" font-family="{LABEL_FONTS}">'
    )
    yield f"<style>{PLAN_STYLE}</style>"
    yield "<defs>"
    yield from map(_arrow_head, ("head", "link-head", "given-head"), (INK, LINK, GIVEN))
    yield "</defs>"
    yield f'<rect class="paper" x="0" y="0" width="{width:g}" height="{height:g}" fill="{PAPER}"/>'
    at = float(MARGIN)
    for picture, (left, right, _) in zip(pictures, extents, strict=True):
        yield f'<g class="column" transform="translate({at - left:g} {MARGIN})">'
        yield from (
            *_order_lines(picture),
            *_link_lines(picture),
            *_net_labels(picture),
            *_step_boxes(picture, fill_of, standing, tips),
        )
        yield "</g>"
        at += right - left + 2 * GAP
    yield from _resource_legend(fill_of, MARGIN, height - MARGIN)


def _picture_extent(picture: _ColumnPicture) -> tuple[float, float, float]:
    """Left, right and lower end of the drawing, as whole numbers."""
    boxes, routing = picture.boxes, picture.routing
    spans = [boxes.span(box) for box in boxes.layer]
    spans += [(label.left, label.right) for label in routing.labels]
    spans += [(x, x) for corners in routing.ways.values() for x, _ in corners]
    spans += [(x, x) for bend in picture.placed.bends.values() for x in bend]
    left, right = min(span[0] for span in spans), max(span[1] for span in spans)
    return floor(left), ceil(right), ceil(routing.tops[-1] + HEIGHT)


def _arrow_head(name: str, fill: str) -> str:
    return (
        f'<marker id="{name}" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8" markerHeight="7"'
        f' markerUnits="userSpaceOnUse" orient="auto"><path class="{name}" d="M0 0L8 4L0 8z" '
        f'fill="{fill}"/></marker>'
    )


def _order_lines(picture: _ColumnPicture) -> Iterator[str]:
    """The orders: lines from the middle of one box to the middle of another, through their
    bends.
    """
    for edge in picture.orders:
        layer = picture.placed.layer[edge[0]]
        xs = [
            picture.placed.centre[edge[0]],
            *picture.placed.bends[edge],
            picture.placed.centre[edge[1]],
        ]
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
            f'<path class="order" d="{d}" fill="none" stroke="{INK}" stroke-width="1.5" '
            'marker-end="url(#head)"/>'
        )


def _link_lines(picture: _ColumnPicture) -> Iterator[str]:
    """One dashed way for each causal link. Links from the start are paler."""
    for link in picture.column.part.links:
        condition_text = picture.say(link.condition)
        corners = picture.routing.ways[picture.index[link.producer, condition_text], link.consumer]
        name, stroke = ("given", GIVEN) if link.producer == INITIAL_STEP else ("link", LINK)
        title = picture.column.titles[link.producer, link.condition, link.consumer]
        yield (
            f'<path class="link{" given" if name == "given" else ""}" '
            f'd="{_rounded_path(corners)}" fill="none" stroke="{stroke}"'
            ' stroke-width="1.1" stroke-dasharray="5 3" '
            f'marker-end="url(#{name}-head)"><title>{escape(title)}</title></path>'
        )


def _rounded_path(corners: Sequence[Point]) -> str:
    """A path with round corners."""
    d = f"M{corners[0][0]:g} {corners[0][1]:g}"
    for before, corner, after in zip(corners, corners[1:], corners[2:], strict=False):
        near, far = _point_towards(corner, before), _point_towards(corner, after)
        d += f"L{near[0]:g} {near[1]:g}Q{corner[0]:g} {corner[1]:g} {far[0]:g} {far[1]:g}"
    return d + f"L{corners[-1][0]:g} {corners[-1][1]:g}"


def _point_towards(corner: Point, neighbour: Point) -> Point:
    """A point near a corner on a vertical or horizontal line, never beyond the middle of the
    line.
    """
    dx, dy = neighbour[0] - corner[0], neighbour[1] - corner[1]
    length = abs(dx) + abs(dy)
    part = min(ROUND, length / 2) / length if length else 0
    return corner[0] + dx * part, corner[1] + dy * part


def _net_labels(picture: _ColumnPicture) -> Iterator[str]:
    """The label of each net, on a patch of paper colour."""
    for net, label in zip(picture.nets, picture.routing.labels, strict=True):
        x, anchor = (label.right, "end") if label.at_end else (label.left, "start")
        name, fill = ("given-label", GIVEN) if net.producer == INITIAL_STEP else ("label", LINK)
        yield (
            f'<rect class="paper" x="{label.left:g}" y="{label.y - 9:g}" '
            f'width="{label.right - label.left:g}"'
            f' height="11.5" fill="{PAPER}"/>'
        )
        yield (
            f'<text class="{name}" x="{x:g}" y="{label.y:g}" text-anchor="{anchor}" '
            f'font-size="10" fill="{fill}">'
            f"{escape(net.label)}</text>"
        )


def _step_boxes(
    picture: _ColumnPicture,
    fill_of: Mapping[str, str],
    standing: Mapping[int, str],
    tips: Mapping[StepId, str],
) -> Iterator[str]:
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
        yield f"<g{chosen}><title>{escape(tips.get(step, text))}</title>"
        fill, sign = STANDING_MARKS.get(standing.get(int(step), ""), (BOX, ""))
        yield (
            f'<rect class="box" x="{left:g}" y="{y:g}" width="{right - left:g}" height="{HEIGHT}"'
            f' rx="{6 if step in steps else HEIGHT // 2}" fill="{fill}" stroke="{INK}"/>'
        )
        for index, resource in enumerate(steps[step].resources if step in steps else ()):
            at, fill = left + 5 + index * BAR, fill_of[str(resource)]
            yield (
                f'<rect class="bar" x="{at:g}" y="{y + 5:g}" width="4" height="{HEIGHT - 10}" '
                f'fill="{fill}"/>'
            )
        yield (
            f'<text class="text" x="{picture.boxes.centre[step]:g}" y="{y + HEIGHT / 2 + 4:g}" '
            'text-anchor="middle"'
            f' font-size="12" fill="{INK}">{sign}{escape(text)}</text></g>'
        )


def _resource_legend(fill_of: Mapping[str, str], x: float, y: float) -> Iterator[str]:
    """The legend of colours and resources."""
    for name, fill in fill_of.items():
        yield f'<rect x="{x:g}" y="{y - 10:g}" width="12" height="12" fill="{fill}"/>'
        yield (
            f'<text class="text" x="{x + 17:g}" y="{y:g}" font-size="12" '
            f'fill="{INK}">{escape(name)}</text>'
        )
        x += len(name) * CHARACTER + 34


def _step_tooltip(step: Step, problem: Problem | None) -> str:
    holds_text = f", holds {', '.join(map(str, step.resources))}" if step.resources else ""
    cost = cost_text(step.cost, problem.domain) if problem else str(step.cost)
    return f"{step.id} {step.operator}, lasts {step.duration}, costs {cost}{holds_text}"
