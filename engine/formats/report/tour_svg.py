"""A tour as a picture: visits and the ways between them, in the plane in which they lie, coloured by tool."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from xml.sax.saxutils import escape

import numpy as np

from cellwright.engine.formats.report.palette import colours
from cellwright.engine.formats.report.svg import INK, PAPER
from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.tour import Tour, TourProblem
from cellwright.engine.stages.geometry.pictures.labels import SIZE_PIXELS, Label, placed

LONGEST, MARGIN, LINE = 860.0, 30.0, 18.0  # pixels: the longer side, the margin, a line of the legend
NAMED = 60  # visits that are named; of longer tours, the first and the last
POINT = 3.0  # radius of a visit
CHANGE = "#9a9fa8"  # ways on which the tool is changed
FLAT = 0.5  # points lie in a plane if they spread across it less than this share of what they spread along it
LETTER = 6.5  # pixels of a letter, on average
UPRIGHT = 0.95  # the cosine of the steepest slope that is still seen from above


def picture(tour: Tour, problem: TourProblem) -> str | None:
    """The SVG; None if some visit has no position."""
    visits = [problem.visits[each] for each in tour.order]
    places = [visit.position for visit in visits if visit.position is not None]
    if not places or len(places) < len(visits):
        return None
    flat, seen_from = _flat(np.array(places, dtype=float))
    tools = colours(sorted({visit.tool for visit in visits}))
    head = MARGIN + LINE * (len(tools) + 3)
    caption = _caption(len(visits), seen_from, problem.closed)
    at, (width, height) = _fitted(flat, head)
    size = max(width, round(2 * MARGIN + LETTER * len(caption))), height
    ways = [*pairwise(range(len(at))), *([(len(at) - 1, 0)] if problem.closed and len(at) > 2 else [])]
    used = [visit.tool for visit in visits]
    body = [
        *_legend(tools, used, caption),
        *(_way(at[a], at[b], tools[used[a]] if used[a] == used[b] else CHANGE) for a, b in ways),
        *(_visit(at[n], tools[visit.tool], n + 1, visit.name) for n, visit in enumerate(visits)),
        *_names(at, [visit.name for visit in visits], size),
    ]
    return "\n".join([*_opening(size), *body, "</svg>"]) + "\n"


def _flat(places: Floats) -> tuple[Floats, str]:
    """Positions (n, 2 or 3) as coordinates (n, 2) to the right and up, and from where they are seen.

    Points that lie near an upright or slanting plane are seen along its normal, from the side of the origin.
    """
    if places.shape[1] < 3:
        return places[:, :2], "x to the right, y upwards"
    middle = places.mean(axis=0)
    _, spread, axes = np.linalg.svd(places - middle, full_matrices=True)
    normal = axes[2] if axes[2] @ middle <= 0 else -axes[2]
    lies_flat = len(spread) > 2 and spread[1] > 0 and spread[2] < FLAT * spread[1]
    if not lies_flat or abs(normal[2]) > UPRIGHT:
        return places[:, :2], "seen from above: x to the right, y upwards"
    up = np.array([0.0, 0.0, 1.0]) - normal[2] * normal
    up /= np.linalg.norm(up)
    along = ", ".join(f"{each + 0.0:.2f}" for each in -normal.round(2))
    return places @ np.stack([np.cross(up, normal), up], axis=1), f"seen along ({along}), z upwards"


def _fitted(flat: Floats, head: float) -> tuple[list[tuple[float, float]], tuple[int, int]]:
    """Where points (n, 2) are in the picture below its head, and the size of the picture in pixels."""
    low, span = flat.min(axis=0), np.ptp(flat, axis=0)
    scale = LONGEST / (float(span.max()) or 1.0)
    width, height = (max(each * scale, LONGEST / 4) for each in span)
    shift = (np.array([width, height]) - span * scale) / 2
    at = [
        (MARGIN + shift[0] + (x - low[0]) * scale, head + height - shift[1] - (y - low[1]) * scale)
        for x, y in flat
    ]
    return at, (round(width + 2 * MARGIN), round(head + height + MARGIN))


def _opening(size: tuple[int, int]) -> Iterator[str]:
    yield (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size[0]} {size[1]}" width="{size[0]}" '
        f'height="{size[1]}" font-family="sans-serif" font-size="{SIZE_PIXELS}">'
    )
    yield (
        '<defs><marker id="to" viewBox="0 0 8 8" refX="4" refY="4" markerWidth="7" markerHeight="7" '
        'orient="auto"><path d="M0 0L8 4L0 8z" fill="context-stroke"/></marker></defs>'
    )
    yield f'<rect width="100%" height="100%" fill="{PAPER}"/>'


def _caption(count: int, seen_from: str, closed: bool) -> str:
    hint = "" if count <= NAMED else "; names show when the pointer rests on a dot"
    return f"{'a closed tour' if closed else 'an open tour'} of {count} visits, {seen_from}{hint}"


def _legend(tools: Mapping[str, str], used: Sequence[str], caption: str) -> Iterator[str]:
    lines = [(tools[tool], f"{tool or 'visits'}: {used.count(tool)}") for tool in tools]
    if any(one != other for one, other in pairwise(used)):
        lines.append((CHANGE, "on the way to another tool"))
    for number, (colour, said) in enumerate(lines):
        y = MARGIN + number * LINE
        yield f'<rect x="{MARGIN:g}" y="{y - 10:g}" width="11" height="11" fill="{colour}"/>'
        yield _text(said, MARGIN + 18, y)
    yield _text(caption, MARGIN, MARGIN + len(lines) * LINE)


def _way(start: tuple[float, float], end: tuple[float, float], colour: str) -> str:
    (x, y), (to_x, to_y) = start, end
    half = f"{(x + to_x) / 2:.1f} {(y + to_y) / 2:.1f}"
    dashes = ' stroke-dasharray="5 4"' if colour == CHANGE else ""
    return (
        f'<path class="way" d="M{x:.1f} {y:.1f}L{half}L{to_x:.1f} {to_y:.1f}" fill="none" stroke="{colour}"'
        f'{dashes} marker-mid="url(#to)"/>'
    )


def _visit(at: tuple[float, float], colour: str, number: int, name: str) -> str:
    said = escape(f"{number}: {name}")
    ring = f'stroke="{INK}" stroke-width="1.5"' if number == 1 else 'stroke="none"'
    return (
        f'<circle class="visit" cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="{POINT:g}" fill="{colour}" {ring}>'
        f"<title>{said}</title></circle>"
    )


def _names(at: Sequence[tuple[float, float]], names: Sequence[str], size: tuple[int, int]) -> Iterator[str]:
    """The names of visits beside them; in longer tours of the first and the last."""
    said = [(f"start {names[0]}", at[0])]
    if len(names) <= NAMED:
        said += list(zip(names[1:], at[1:], strict=True))
    elif len(names) > 1:
        said.append((f"end {names[-1]}", at[-1]))
    dots = [(x - POINT, y - POINT, x + POINT, y + POINT) for x, y in at] if len(names) <= NAMED else []
    for label in placed(said, size, dots):
        yield from _name(label)


def _name(label: Label) -> Iterator[str]:
    if label.far:
        (x, y), (to_x, to_y) = label.point, label.end
        yield f'<line x1="{x:.1f}" y1="{y:.1f}" x2="{to_x:.1f}" y2="{to_y:.1f}" stroke="#999999"/>'
    x, y = label.at
    yield (
        f'<text class="rim" x="{x:.1f}" y="{y:.1f}" stroke="{PAPER}" stroke-width="4" stroke-linejoin="round">'
        f"{escape(label.text)}</text>"
    )
    yield _text(label.text, x, y)


def _text(said: str, x: float, y: float) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" fill="{INK}">{escape(said)}</text>'
