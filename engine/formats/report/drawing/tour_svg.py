"""A tour as SVG: visits and the ways between them in their plane, coloured by tool."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from xml.sax.saxutils import escape

import numpy as np

from cellwright.engine.formats.report.drawing.colour_palette import assign_colours
from cellwright.engine.formats.report.drawing.plan_svg import INK, PAPER
from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.tour_problem import Tour, TourProblem
from cellwright.engine.stages.geometry.pictures.picture_notes import (
    SIZE_PIXELS,
    PictureLabel,
    place_labels,
)

# pixels: the longer side, the margin, a line of the legend
LONGEST, MARGIN, LINE = 860.0, 30.0, 18.0
MAX_NAMED_VISITS = 60  # visits that are named; of longer tours, the first and the last
VISIT_RADIUS = 3.0  # radius of a visit
TOOL_CHANGE_COLOUR = "#9a9fa8"  # ways on which the tool is changed
# points lie in a plane if they spread across it less than this share of what they spread along
# it
MAX_FLAT_SHARE = 0.5
LETTER_WIDTH = 6.5  # pixels of a letter, on average
MAX_UPRIGHT_COSINE = 0.95  # the cosine of the steepest slope that is still seen from above


def draw_tour(tour: Tour, problem: TourProblem) -> str | None:
    """The SVG; None if some visit has no position."""
    visits = [problem.visits[visit_index] for visit_index in tour.order]
    places = [visit.position for visit in visits if visit.position is not None]
    if not places or len(places) < len(visits):
        return None
    flat, seen_from = _flat_positions(np.array(places, dtype=float))
    tools = assign_colours(sorted({visit.tool for visit in visits}))
    head = MARGIN + LINE * (len(tools) + 3)
    caption = _tour_caption(len(visits), seen_from, problem.closed)
    at, (width, height) = _fit_to_picture(flat, head)
    size = max(width, round(2 * MARGIN + LETTER_WIDTH * len(caption))), height
    ways = [
        *pairwise(range(len(at))),
        *([(len(at) - 1, 0)] if problem.closed and len(at) > 2 else []),
    ]
    used = [visit.tool for visit in visits]
    body = [
        *_tool_legend(tools, used, caption),
        *(
            _way_line(at[a], at[b], tools[used[a]] if used[a] == used[b] else TOOL_CHANGE_COLOUR)
            for a, b in ways
        ),
        *(
            _visit_circle(at[n], tools[visit.tool], n + 1, visit.name)
            for n, visit in enumerate(visits)
        ),
        *_visit_names(at, [visit.name for visit in visits], size),
    ]
    return "\n".join([*_tour_opening(size), *body, "</svg>"]) + "\n"


def _flat_positions(places: Floats) -> tuple[Floats, str]:
    """Positions (n, 2 or 3) as coordinates (n, 2) to the right and up, and from where they are
    seen.

    Points that lie near an upright or slanting plane are seen along its normal, from the side of
    the origin.
    """
    if places.shape[1] < 3:
        return places[:, :2], "x to the right, y upwards"
    middle = places.mean(axis=0)
    _, spread, axes = np.linalg.svd(places - middle, full_matrices=True)
    normal = axes[2] if axes[2] @ middle <= 0 else -axes[2]
    lies_flat = len(spread) > 2 and spread[1] > 0 and spread[2] < MAX_FLAT_SHARE * spread[1]
    if not lies_flat or abs(normal[2]) > MAX_UPRIGHT_COSINE:
        return places[:, :2], "seen from above: x to the right, y upwards"
    up = np.array([0.0, 0.0, 1.0]) - normal[2] * normal
    up /= np.linalg.norm(up)
    along = ", ".join(f"{coordinate + 0.0:.2f}" for coordinate in -normal.round(2))
    return places @ np.stack([np.cross(up, normal), up], axis=1), f"seen along ({along}), z upwards"


def _fit_to_picture(flat: Floats, head: float) -> tuple[list[tuple[float, float]], tuple[int, int]]:
    """Where points (n, 2) are in the picture below its head, and the size of the picture in
    pixels.
    """
    low, span = flat.min(axis=0), np.ptp(flat, axis=0)
    scale = LONGEST / (float(span.max()) or 1.0)
    width, height = (max(extent * scale, LONGEST / 4) for extent in span)
    shift = (np.array([width, height]) - span * scale) / 2
    at = [
        (MARGIN + shift[0] + (x - low[0]) * scale, head + height - shift[1] - (y - low[1]) * scale)
        for x, y in flat
    ]
    return at, (round(width + 2 * MARGIN), round(head + height + MARGIN))


def _tour_opening(size: tuple[int, int]) -> Iterator[str]:
    yield (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size[0]} {size[1]}" '
        f'width="{size[0]}" '
        f'height="{size[1]}" font-family="sans-serif" font-size="{SIZE_PIXELS}">'
    )
    yield (
        '<defs><marker id="to" viewBox="0 0 8 8" refX="4" refY="4" markerWidth="7" '
        'markerHeight="7" '
        'orient="auto"><path d="M0 0L8 4L0 8z" fill="context-stroke"/></marker></defs>'
    )
    yield f'<rect width="100%" height="100%" fill="{PAPER}"/>'


def _tour_caption(count: int, seen_from: str, closed: bool) -> str:
    hint = "" if count <= MAX_NAMED_VISITS else "; names show when the pointer rests on a dot"
    return f"{'a closed tour' if closed else 'an open tour'} of {count} visits, {seen_from}{hint}"


def _tool_legend(tools: Mapping[str, str], used: Sequence[str], caption: str) -> Iterator[str]:
    lines = [(tools[tool], f"{tool or 'visits'}: {used.count(tool)}") for tool in tools]
    if any(tool_before != tool_after for tool_before, tool_after in pairwise(used)):
        lines.append((TOOL_CHANGE_COLOUR, "on the way to another tool"))
    for number, (colour, legend_text) in enumerate(lines):
        y = MARGIN + number * LINE
        yield f'<rect x="{MARGIN:g}" y="{y - 10:g}" width="11" height="11" fill="{colour}"/>'
        yield _picture_text(legend_text, MARGIN + 18, y)
    yield _picture_text(caption, MARGIN, MARGIN + len(lines) * LINE)


def _way_line(start: tuple[float, float], end: tuple[float, float], colour: str) -> str:
    (x, y), (to_x, to_y) = start, end
    half = f"{(x + to_x) / 2:.1f} {(y + to_y) / 2:.1f}"
    dashes = ' stroke-dasharray="5 4"' if colour == TOOL_CHANGE_COLOUR else ""
    return (
        f'<path class="way" d="M{x:.1f} {y:.1f}L{half}L{to_x:.1f} {to_y:.1f}" fill="none" '
        f'stroke="{colour}"'
        f'{dashes} marker-mid="url(#to)"/>'
    )


def _visit_circle(at: tuple[float, float], colour: str, number: int, name: str) -> str:
    tooltip = escape(f"{number}: {name}")
    ring = f'stroke="{INK}" stroke-width="1.5"' if number == 1 else 'stroke="none"'
    return (
        f'<circle class="visit" cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="{VISIT_RADIUS:g}" '
        f'fill="{colour}" {ring}>'
        f"<title>{tooltip}</title></circle>"
    )


def _visit_names(
    at: Sequence[tuple[float, float]], names: Sequence[str], size: tuple[int, int]
) -> Iterator[str]:
    """The names of visits beside them; in longer tours of the first and the last."""
    name_labels = [(f"start {names[0]}", at[0])]
    if len(names) <= MAX_NAMED_VISITS:
        name_labels += list(zip(names[1:], at[1:], strict=True))
    elif len(names) > 1:
        name_labels.append((f"end {names[-1]}", at[-1]))
    dots = (
        [(x - VISIT_RADIUS, y - VISIT_RADIUS, x + VISIT_RADIUS, y + VISIT_RADIUS) for x, y in at]
        if len(names) <= MAX_NAMED_VISITS
        else []
    )
    for label in place_labels(name_labels, size, dots):
        yield from _visit_name(label)


def _visit_name(label: PictureLabel) -> Iterator[str]:
    if label.far:
        (x, y), (to_x, to_y) = label.point, label.end
        yield f'<line x1="{x:.1f}" y1="{y:.1f}" x2="{to_x:.1f}" y2="{to_y:.1f}" stroke="#999999"/>'
    x, y = label.at
    yield (
        f'<text class="rim" x="{x:.1f}" y="{y:.1f}" stroke="{PAPER}" stroke-width="4" '
        'stroke-linejoin="round">'
        f"{escape(label.text)}</text>"
    )
    yield _picture_text(label.text, x, y)


def _picture_text(label: str, x: float, y: float) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" fill="{INK}">{escape(label)}</text>'
