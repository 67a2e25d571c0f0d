"""A net of contact states as SVG: operators in the middle, places with a robot on the right.

An operator and the one that undoes it are one box with two heads on its lines. One-way operators
have their own colour.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from xml.sax.saxutils import escape

from cellwright.engine.formats.report.drawing.plan_svg import LABEL_FONTS
from cellwright.engine.model.task_space import ContactNet, NetPlace, Transition

CHARACTER, ROW, BOX, PLACE, MARGIN, CHANNEL, SWEEPS = 6.6, 30, 20, 26, 24, 150, 24
INK, PAPER, DEVICE, ROBOT, OPERATOR, ONE_WAY = (
    "#1b1b1b",
    "#ffffff",
    "#f3f5f8",
    "#dbe9f8",
    "#fff7e0",
    "#b5341f",
)
NET_STYLE = """
  .line:hover { stroke-width: 3; }
  @media (prefers-color-scheme: dark) {
    .paper { fill: #16181c; } .device { fill: #262a31; stroke: #e8e8e8; } \
.robot { fill: #1f3a57; stroke: #e8e8e8; }
    .operator { fill: #3a3320; stroke: #e8e8e8; } .line { stroke: #c8c8c8; } \
.head { fill: #c8c8c8; } .text { fill: #e8e8e8; }
  }
"""


@dataclass(frozen=True, slots=True)
class _OperatorBox:
    """An operator with its undoing: the name, the places before and after, and what stands in
    the tooltip.
    """

    name: str
    before: tuple[str, ...]
    after: tuple[str, ...]
    both: bool
    title: str


@dataclass(frozen=True, slots=True)
class _DrawnSpot:
    """Where something is drawn: its left end, its width and its middle height."""

    x: float
    width: float
    y: float


Marking = Mapping[str, Sequence[Sequence[str]]]  # for each place, the objects of each cluster in it


def draw_net(contact_net: ContactNet, marking: Marking | None = None) -> str:
    """The drawing. The same net gives the same bytes.

    With a marking, the places that have objects now are full (●), others empty.
    """
    boxes = list(_operator_boxes(contact_net.transitions))
    left = [place for place in contact_net.places if not place.robot]
    right = [place for place in contact_net.places if place.robot]
    rows, heights = _arrange_heights(boxes, left, right)
    width = [
        max([CHARACTER * len(_place_label(place, marking)) + 20 for place in column], default=60.0)
        for column in (left, right)
    ]
    middle = max([CHARACTER * len(box.name) + 20 for box in boxes], default=60.0)
    xs = MARGIN, MARGIN + width[0] + CHANNEL, MARGIN + width[0] + middle + 2 * CHANNEL
    spots = {place.name: _DrawnSpot(xs[0], width[0], heights[place.name]) for place in left}
    spots |= {place.name: _DrawnSpot(xs[2], width[1], heights[place.name]) for place in right}
    operators = {n: _DrawnSpot(xs[1], middle, row) for n, row in rows.items()}
    lowest = max([*heights.values(), *rows.values()], default=0.0)
    size = xs[2] + width[1] + MARGIN, lowest + ROW + MARGIN
    return (
        "\n".join(
            [
                *_net_head(contact_net, *size),
                *_arc_lines(boxes, operators, spots),
                *_draw_net_parts(contact_net, boxes, operators, spots, marking),
                "</svg>",
            ]
        )
        + "\n"
    )


def _place_label(place: NetPlace, marking: Marking | None = None) -> str:
    sign = "" if marking is None else "● " if place.name in marking else "○ "
    return f"{sign}{place.name} {place.say}"


def _operator_boxes(transitions: Sequence[Transition]) -> Iterator[_OperatorBox]:
    done: set[str] = set()
    for transition in transitions:
        if transition.name in done:
            continue
        back = next(
            (
                undoing
                for undoing in transitions
                if undoing.name not in done
                and undoing is not transition
                and (undoing.inputs, undoing.outputs, undoing.contact)
                == (transition.outputs, transition.inputs, transition.contact)
            ),
            None,
        )
        first, second = (
            (transition, back) if transition.makes or back is None else (back, transition)
        )
        done |= {transition.name, *([back.name] if back else [])}
        name = (
            first.name
            if second is None
            else f"{first.operator}, {second.operator} "
            f"{first.name.removeprefix(first.operator + '_')}"
        )
        title = "\n".join(
            _transition_title(direction) for direction in (first, second) if direction is not None
        )
        yield _OperatorBox(name, first.inputs, first.outputs, second is not None, title)


def _transition_title(transition: Transition) -> str:
    moved = ", ".join(
        f"{row.type} {row.most if row.least == row.most else f'{row.least}..{row.most}'} from "
        f"{row.source} to {row.target}"
        for row in transition.transfers
    )
    only = "".join(f"; only if {restriction}" for restriction in transition.restrictions)
    return f"{transition.name}: {moved}{only}"


def _arrange_heights(
    boxes: Sequence[_OperatorBox], left: Sequence[NetPlace], right: Sequence[NetPlace]
) -> tuple[dict[int, float], dict[str, float]]:
    """The heights of operators and places: each near the mean of what it is joined to
    (barycentres, Sugiyama 1981).
    """
    order = list(range(len(boxes)))
    height = float(max(len(boxes), len(left), len(right), 1))
    places: dict[str, float] = {}
    for column in (left, right):
        places |= {place.name: (n + 0.5) * height / len(column) for n, place in enumerate(column)}
    rows = {n: at + 0.5 for at, n in enumerate(order)}
    for _ in range(SWEEPS):
        order.sort(
            key=lambda n: (
                _mean_height([places[p] for p in (*boxes[n].before, *boxes[n].after)]),
                n,
            )
        )
        rows = {n: (at + 0.5) * height / len(order) for at, n in enumerate(order)}
        for column in (left, right):
            joined = {
                place.name: [
                    rows[n]
                    for n, box in enumerate(boxes)
                    if place.name in (*box.before, *box.after)
                ]
                for place in column
            }
            ranked = sorted(
                column, key=lambda place: (_mean_height(joined[place.name]), place.name)
            )
            places |= {
                place.name: (at + 0.5) * height / len(column) for at, place in enumerate(ranked)
            }
    top = MARGIN + ROW
    return {n: top + y * ROW for n, y in rows.items()}, {
        name: top + y * ROW for name, y in places.items()
    }


def _mean_height(values: Sequence[float]) -> float:
    return sum(values) / len(values) if values else 0.0


def _net_head(contact_net: ContactNet, width: float, height: float) -> Iterator[str]:
    yield (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" '
        f'width="{width:g}"'
        f' height="{height:g}" font-family="{LABEL_FONTS}">'
    )
    yield f"<style>{NET_STYLE}</style>"
    yield "<defs>"
    for name, fill in (("head", INK), ("one-way", ONE_WAY)):
        yield (
            f'<marker id="{name}" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8" '
            'markerHeight="7"'
            f' markerUnits="userSpaceOnUse" orient="auto-start-reverse"><path class="{name}" '
            f'd="M0 0L8 4L0 8z" fill="{fill}"/></marker>'
        )
    yield "</defs>"
    yield f'<rect class="paper" x="0" y="0" width="{width:g}" height="{height:g}" fill="{PAPER}"/>'
    yield (
        f'<text class="text" x="{MARGIN}" y="{MARGIN}" font-size="12" '
        f'fill="{INK}">{escape(contact_net.name)}: '
        f"{len(contact_net.places)} places, {len(contact_net.transitions)} transitions; with a "
        "robot on the right, apart dashed, together solid</text>"
    )


def _arc_lines(
    boxes: Sequence[_OperatorBox],
    operators: Mapping[int, _DrawnSpot],
    spots: Mapping[str, _DrawnSpot],
) -> Iterator[str]:
    """The arcs: from the places before to the operator, and from it to the places after."""
    for n, box in enumerate(boxes):
        for place in dict.fromkeys((*box.before, *box.after)):
            inward, outward = place in box.before, place in box.after
            yield _arc_line(operators[n], spots[place], box, inward, outward, -4 if inward else 4)


def _arc_line(
    operator: _DrawnSpot,
    place: _DrawnSpot,
    box: _OperatorBox,
    inward: bool,
    outward: bool,
    shift: float,
) -> str:
    on_left = place.x < operator.x
    x, y = (operator.x if on_left else operator.x + operator.width), operator.y + shift
    to_x = place.x + place.width if on_left else place.x
    bend = (to_x - x) / 2
    head = "head" if box.both else "one-way"
    start = f' marker-start="url(#{head})"' if inward or box.both else ""
    end = f' marker-end="url(#{head})"' if outward or box.both else ""
    stroke = INK if box.both else ONE_WAY
    dashes = ' stroke-dasharray="6 3"' if inward else ""
    return (
        f'<path class="line" d="M{x:g} {y:g}C{x + bend:g} {y:g} {to_x - bend:g} {place.y:g} '
        f'{to_x:g} {place.y:g}"'
        f' fill="none" stroke="{stroke}" stroke-width="1.1"{dashes}{start}{end}/>'
    )


def _draw_net_parts(
    contact_net: ContactNet,
    boxes: Sequence[_OperatorBox],
    operators: Mapping[int, _DrawnSpot],
    spots: Mapping[str, _DrawnSpot],
    marking: Marking | None,
) -> Iterator[str]:
    for place in contact_net.places:
        kind, fill = ("robot", ROBOT) if place.robot else ("device", DEVICE)
        capacity = ", ".join(f"{name} {n}" for name, n in place.capacity)
        inside = [", ".join(cluster) for cluster in (marking or {}).get(place.name, ())]
        title = "\n".join(
            [f"{_place_label(place)}; room for {capacity}", *inside, *map(str, place.contacts)]
        )
        full = place.name in marking if marking is not None else place.initial
        shape = _rounded_shape(
            kind,
            fill,
            spots[place.name],
            PLACE,
            13,
            _place_label(place, marking),
            title,
            2 if full else 1,
        )
        yield shape if marking is None else f'<g data-place="{escape(place.name)}">{shape}</g>'
    for n, box in enumerate(boxes):
        yield _rounded_shape("operator", OPERATOR, operators[n], BOX, 2, box.name, box.title, 1)


def _rounded_shape(
    kind: str,
    fill: str,
    at: _DrawnSpot,
    height: float,
    round_: float,
    text: str,
    title: str,
    rim: float,
) -> str:
    return (
        f'<g><title>{escape(title)}</title><rect class="{kind}" x="{at.x:g}" '
        f'y="{at.y - height / 2:g}" width="{at.width:g}"'
        f' height="{height:g}" rx="{round_:g}" fill="{fill}" stroke="{INK}" '
        f'stroke-width="{rim:g}"/>'
        f'<text class="text" x="{at.x + at.width / 2:g}" y="{at.y + 4:g}" text-anchor="middle" '
        'font-size="11"'
        f' fill="{INK}">{escape(text)}</text></g>'
    )
