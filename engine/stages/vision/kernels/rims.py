# cython: language_level=3, annotation_typing=False, infer_types=True, boundscheck=False
# cython: wraparound=False, initializedcheck=False, cdivision=True
"""The border of a mask of pixels, and where the measured surface ends near it."""

import math

import numpy as np

from cellwright.engine.kernels.arrays import Bytes, Floats, Longs, Truths, refuse_unless

AROUND, SQUARE = (
    4,
    18,
)  # pixels, and pixels squared: how far around a border pixel its direction is taken from


def border(mask: Truths) -> tuple[Floats, Floats]:
    """The border pixels (n, 2) of a mask, as (u, v), and the directions (n, 2) out of it: away from
    what is near and in it.

    A pixel of the mask is on its border if one of its four neighbours is in the picture, and not in
    the mask.
    """
    height, width = mask.shape
    refuse_unless("mask", mask, np.bool_, (height, width))
    inside = mask.view(np.uint8)
    places, ways = np.empty((height * width, 2)), np.empty((height * width, 2))
    count = _border(inside, places, ways)
    return places[:count].copy(), ways[:count].copy()


def _border(inside: Bytes, places: Floats, ways: Floats) -> int:
    count, height, width = 0, inside.shape[0], inside.shape[1]
    for v in range(height):
        for u in range(width):
            if inside[v, u] and _ends(inside, u, v) and _outward(inside, u, v, ways, count):
                places[count, 0], places[count, 1] = u, v
                count += 1
    return count


def _ends(inside: Bytes, u: int, v: int) -> bool:
    """Whether a neighbour of a pixel is in the picture, and not in the mask."""
    return bool(
        (v > 0 and not inside[v - 1, u])
        or (v + 1 < inside.shape[0] and not inside[v + 1, u])
        or (u > 0 and not inside[v, u - 1])
        or (u + 1 < inside.shape[1] and not inside[v, u + 1])
    )


def _outward(inside: Bytes, u: int, v: int, ways: Floats, row: int) -> bool:
    """Set the direction out of the mask at a pixel; false if there is none."""
    across, down = 0, 0
    for y in range(max(-AROUND, -v), min(AROUND, inside.shape[0] - 1 - v) + 1):
        for x in range(max(-AROUND, -u), min(AROUND, inside.shape[1] - 1 - u) + 1):
            if x * x + y * y <= SQUARE and inside[v + y, u + x]:
                across -= x
                down -= y
    if across == 0 and down == 0:
        return False
    length = math.sqrt(1.0 * (across * across + down * down))
    ways[row, 0], ways[row, 1] = across / length, down / length
    return True


def ends(
    inverse: Floats,
    planes: Floats,
    at: Floats,
    outward: Floats,
    reach: int,
    tolerance_m: float,
    depth: Floats,
    owner: Longs,
    corner: tuple[int, int],
) -> tuple[Floats, Truths]:
    """How many pixels outside of border places at (n, 2) the measured surface ends, and where it
    goes on (n,).

    `inverse` are inverse depths (height, width), 0 where nothing is known; `planes` (n, 3) those of
    the surface, linear in the pixel. It is looked along `outward` (n, 2), up to `reach` pixels in
    both ways. The first is nan where no end is seen.

    `depth` and `owner` (h, w) are the part's own picture, whose first pixel is `corner` (u, v) of
    the image. On the way from inside, its other facets may be crossed, which lie elsewhere than the
    plane: where they are seen as deep as they are, the part goes on; where they are not, this says
    nothing of where this facet ends.
    """
    count = len(at)
    refuse_unless("inverse depths", inverse, np.float64, inverse.shape)
    for what, array, columns in (
        ("planes", planes, 3),
        ("places", at, 2),
        ("directions", outward, 2),
    ):
        refuse_unless(what, array, np.float64, (count, columns))
    refuse_unless("depths of the part", depth, np.float64, depth.shape)
    refuse_unless("owners", owner, np.int64, depth.shape)
    shift, goes_on = np.full(count, np.nan), np.zeros(count, dtype=bool)
    u0, v0 = corner
    _ended(
        inverse,
        planes,
        at,
        outward,
        reach,
        tolerance_m,
        depth,
        owner,
        u0,
        v0,
        shift,
        goes_on.view(np.uint8),
    )
    return shift, goes_on


def _ended(
    inverse: Floats,
    planes: Floats,
    at: Floats,
    outward: Floats,
    reach: int,
    tolerance_m: float,
    depth: Floats,
    owner: Longs,
    u0: int,
    v0: int,
    shift: Floats,
    goes_on: Bytes,
) -> None:
    for n in range(at.shape[0]):
        on, near, first, deeper = 0, 0, reach + 1, False
        own = _owner(owner, at[n, 0] - u0, at[n, 1] - v0)
        for step in range(-reach, reach + 1):
            u = math.floor(at[n, 0] + step * outward[n, 0] + 0.5)
            v = math.floor(at[n, 1] + step * outward[n, 1] + 0.5)
            other = _owner(owner, u - u0, v - v0) if step < 0 else own
            if other >= 0 and other != own:
                apart = _deeper(inverse, depth, u, v, u0, v0)
            else:
                apart = _apart(inverse, planes, n, u, v)
            if abs(apart) <= tolerance_m:
                on += 1
                near += 1 if step < 2 - reach else 0
            elif apart < UNKNOWN and first > reach and (other < 0 or other == own):
                first, deeper = step, apart > 0.0
        if near > 0 and on >= 3:
            goes_on[n] = first > reach
            if deeper and first > -reach:
                shift[n] = first - 1.0


UNKNOWN = 1e30  # how much deeper the image is where nothing is measured


def _owner(owner: Longs, u: float, v: float) -> int:
    """Which facet of the part a pixel of its picture shows; negative if none."""
    if u < 0.0 or v < 0.0 or u >= owner.shape[1] or v >= owner.shape[0]:
        return -1
    row, column = int(v), int(u)
    return int(owner[row, column])


def _deeper(inverse: Floats, depth: Floats, u: float, v: float, u0: int, v0: int) -> float:
    """How much deeper, in metres, a pixel is than the part's picture."""
    if u < 0.0 or v < 0.0 or u >= inverse.shape[1] or v >= inverse.shape[0]:
        return UNKNOWN
    row, column = int(v), int(u)
    w = inverse[row, column]
    return UNKNOWN if w <= 0.0 else float(1.0 / w - depth[row - v0, column - u0])


def _apart(inverse: Floats, planes: Floats, n: int, u: float, v: float) -> float:
    """How much deeper, in metres, a pixel is than a plane."""
    if u < 0.0 or v < 0.0 or u >= inverse.shape[1] or v >= inverse.shape[0]:
        return UNKNOWN
    row, column = int(v), int(u)
    w = inverse[row, column]
    if w <= 0.0:
        return UNKNOWN
    expected = planes[n, 0] * u + planes[n, 1] * v + planes[n, 2]
    above = max(expected, 1e-9)
    return float((expected - w) / (above * above))
