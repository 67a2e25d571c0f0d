"""Curves of a QIF document, in space or in the parameters of a surface, as chains of points.

Every kind of curve of the standard is read: segments, arcs of circles and conics, NURBS, splines of
polynomials, polylines, and aggregates of these. Lengths stay in the unit of the document.
"""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from cellwright.engine.formats.interop.qif.qif_document import (
    DocumentReading,
    QifElement,
    is_true,
    qif_error,
)
from cellwright.engine.kernels.arrays import Floats

POINTS_PER_TURN = 256  # points on a full circle: a chord is at most 0.00008 radii away from its arc
# of the size of a curve: the end of an edge that is farther away does not trim it
TRIM_TOLERANCE = 1e-2
POINTS_PER_SPAN = 24  # points on each stretch between two knots


def curve_chain(core: QifElement, width: int, reading: DocumentReading) -> Floats:
    """Points (n, width) along a curve, n >= 2, from its start to its end. Raises `InvalidInput`.

    `core` is the element with the numbers, such as `Segment12Core`.
    """
    kind = core.tag.removesuffix("Core").removesuffix("12").removesuffix("13")
    if kind not in CURVE_KINDS:
        raise qif_error(reading.where(core), f"unknown kind of curve '{core.tag}'")
    points = CURVE_KINDS[kind](core, width, reading)
    if len(points) < 2:
        raise qif_error(reading.where(core), "a curve needs two points")
    return points


def core_of(curve: QifElement) -> QifElement | None:
    """The element with the numbers in a curve or a surface."""
    return next((child for child in curve.children if child.tag.endswith("Core")), None)


def trim_chain(points: Floats, first: Floats, last: Floats) -> Floats:
    """The stretch of a chain (n, k) from the place nearest to one point to the place nearest to
    another.

    A closed chain is passed over its own start if it must be. A chain is whole if the points are
    the same, or lie beside it.
    """
    places = [_nearest_place(points, end) for end in (first, last)]
    size = float(np.ptp(points, axis=0).max())
    if (
        np.linalg.norm(first - last) <= 1e-9 * size
        or max(gap for _, gap in places) > TRIM_TOLERANCE * size
    ):
        return points
    (start, _), (stop, _) = places
    if start < stop:
        inner = points[int(start) + 1 : int(np.ceil(stop))]
    elif np.linalg.norm(points[0] - points[-1]) <= 1e-6 * size:
        inner = np.concatenate([points[int(start) + 1 :], points[1 : int(np.ceil(stop))]])
    else:
        return points
    return np.concatenate([first[None], inner, last[None]])


def _nearest_place(points: Floats, point: Floats) -> tuple[float, float]:
    """Where a chain is nearest to a point, as the number of a place and a share of the next
    step, and how near.
    """
    start, step = points[:-1], np.diff(points, axis=0)
    size = (step**2).sum(axis=1)
    share = np.clip(((point - start) * step).sum(axis=1) / np.where(size > 0, size, 1.0), 0.0, 1.0)
    gaps = np.linalg.norm(start + share[:, None] * step - point, axis=1)
    at = int(np.argmin(gaps))
    return at + float(share[at]), float(gaps[at])


def _segment_chain(core: QifElement, width: int, reading: DocumentReading) -> Floats:
    return np.stack(
        [reading.vector(core, name, width=width) for name in ("StartPoint", "EndPoint")]
    )


def _polyline_chain(core: QifElement, width: int, reading: DocumentReading) -> Floats:
    return reading.vectors(core, "Points", width)


def _arc_axes(
    core: QifElement, width: int, reading: DocumentReading
) -> tuple[Floats, Floats, Floats]:
    """The centre of an arc, its first direction, and the one a quarter turn on."""
    centre = reading.vector(core, "Center", width=width)
    x = reading.vector(core, "DirBeg", width=width)
    if width == 2:
        y = np.array([-x[1], x[0]]) * (-1.0 if is_true(core, "turned") else 1.0)
    else:
        y = np.cross(reading.vector(core, "Normal"), x)
    return centre, x, y


def _arc_angles(core: QifElement, reading: DocumentReading) -> Floats:
    first, last = reading.span(core, "domain")
    count = max(9, int(np.ceil(abs(last - first) / (2 * np.pi) * POINTS_PER_TURN)) + 1)
    return np.linspace(first, last, min(count, 20 * POINTS_PER_TURN))


def _circle_chain(core: QifElement, width: int, reading: DocumentReading) -> Floats:
    centre, x, y = _arc_axes(core, width, reading)
    radius, t = reading.number(core.at("Radius")), _arc_angles(core, reading)[:, None]
    arc_points: Floats = centre + radius * (np.cos(t) * x + np.sin(t) * y)
    return arc_points


def _conic_chain(core: QifElement, width: int, reading: DocumentReading) -> Floats:
    centre, x, y = _arc_axes(core, width, reading)
    a, b = (reading.number(core.at(name)) for name in ("A", "B"))
    t = _arc_angles(core, reading)[:, None]
    along, across = CONIC_SHAPES.get(
        core.attributes.get("form", "ELLIPSE").upper(), CONIC_SHAPES["ELLIPSE"]
    )
    conic_points: Floats = centre + a * along(t) * x + b * across(t) * y
    return conic_points


def _nurbs_chain(core: QifElement, width: int, reading: DocumentReading) -> Floats:
    order = int(reading.number(core.at("Order")))
    knots = np.array(reading.numbers(core.at("Knots")))
    points = reading.vectors(core, "CPs", width)
    weights = weights_of(core, len(points), reading)
    require_knots(core, knots, order, len(points), reading)
    first, last = (
        reading.span(core, "domain") if "domain" in core.attributes else (knots[0], knots[-1])
    )
    inner = np.unique(knots)
    stops = np.concatenate([[first], inner[(inner > first) & (inner < last)], [last]])
    t = np.concatenate(
        [np.linspace(a, b, POINTS_PER_SPAN, endpoint=False) for a, b in pairwise(stops)]
    )
    basis = basis_of(knots, order, np.append(t, last)) * weights
    curve_points: Floats = basis @ points / basis.sum(axis=1, keepdims=True)
    return curve_points


def weights_of(core: QifElement, count: int, reading: DocumentReading) -> Floats:
    """The weights (count,) of control points; all 1 without any."""
    given = reading.numbers(core.at("Weights"))
    if given and (len(given) != count or min(given) <= 0):
        raise qif_error(
            reading.where(core.at("Weights")), f"{count} weights above 0 are needed here"
        )
    return np.array(given or [1.0] * count)


def require_knots(
    core: QifElement, knots: Floats, order: int, count: int, reading: DocumentReading
) -> None:
    """Refuse knots that do not fit to the control points."""
    if not 1 < order <= count or len(knots) != order + count or (np.diff(knots) < 0).any():
        raise qif_error(
            reading.where(core),
            f"{count} control points and order {order} need {count + order} rising knots",
        )


def basis_of(knots: Floats, order: int, t: Floats) -> Floats:
    """The values (n, m) of m B-splines at n parameters (Cox 1972, de Boor 1972).

    Parameters outside are moved to the ends.
    """
    count = len(knots) - order
    t = np.clip(t, knots[order - 1], knots[count])
    # the stretch that the end belongs to
    last = np.searchsorted(knots, knots[count], side="left") - 1
    at = np.minimum(np.searchsorted(knots, t, side="right") - 1, last)
    values = np.zeros((len(t), len(knots) - 1))
    values[np.arange(len(t)), at] = 1.0
    for degree in range(1, order):
        width = len(knots) - 1 - degree
        rise, fall = (
            knots[degree : degree + width] - knots[:width],
            knots[degree + 1 :] - knots[1 : width + 1],
        )
        up = np.where(rise > 0, (t[:, None] - knots[:width]) / np.where(rise > 0, rise, 1), 0)
        down = np.where(
            fall > 0, (knots[degree + 1 :] - t[:, None]) / np.where(fall > 0, fall, 1), 0
        )
        values = up * values[:, :width] + down * values[:, 1 : width + 1]
    return values


def _spline_chain(core: QifElement, width: int, reading: DocumentReading) -> Floats:
    """Polynomials one after another; each counts its parameter from its first knot, or from 0
    to 1 if normalized.
    """
    knots, coefficients = (
        reading.numbers(core.at("Knots")),
        reading.vectors(core, "Coefficients", width),
    )
    orders = [int(order_number) for order_number in reading.numbers(core.at("Orders"))]
    if (
        len(orders) + 1 != len(knots)
        or sum(orders) != len(coefficients)
        or min(orders, default=0) < 1
    ):
        raise qif_error(reading.where(core), "knots, orders and coefficients do not fit together")
    pieces, start = [], 0
    for order, first, last in zip(orders, knots, knots[1:], strict=False):
        t = np.linspace(0, 1 if is_true(core, "normalized") else last - first, POINTS_PER_SPAN)
        powers = t[:, None] ** np.arange(order)
        pieces.append(powers @ coefficients[start : start + order])
        start += order
    return np.concatenate(pieces)


def _aggregate_chain(core: QifElement, width: int, reading: DocumentReading) -> Floats:
    pieces = []
    for part in (core.at("SubCurves") or core).all("SubCurve"):
        inner = core_of(part)
        if inner is None:
            raise qif_error(reading.where(part), "this part of a curve has no core")
        piece = curve_chain(inner, width, reading)
        pieces.append(piece[::-1] if is_true(part, "turned") else piece)
    if not pieces:
        raise qif_error(reading.where(core), "the curve has no parts")
    return np.concatenate(pieces)


Shape = Callable[[Floats], Floats]
CONIC_SHAPES: dict[str, tuple[Shape, Shape]] = {
    "ELLIPSE": (np.cos, np.sin),
    "HYPERBOLA": (np.cosh, np.sinh),
    "PARABOLA": (np.square, np.positive),
}
CURVE_KINDS: dict[str, Callable[[QifElement, int, DocumentReading], Floats]] = {
    "Segment": _segment_chain,
    "Polyline": _polyline_chain,
    "ArcCircular": _circle_chain,
    "ArcConic": _conic_chain,
    "Nurbs": _nurbs_chain,
    "Spline": _spline_chain,
    "Aggregate": _aggregate_chain,
}
