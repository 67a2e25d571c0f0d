"""Loops around material, in the parameters of a surface: pieces joined, closed over seams, and told as points in space."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cellwright.engine.formats.interop.qif.parametric import Surface
from cellwright.engine.kernels.arrays import Floats, Longs

NEAR = 1e-3  # of a period: gaps this near to whole periods are seams
PARTS = 16
CLEARLY = 1e-6  # of the domain: a piece is turned only if it then fits better by more than this
MOST = 20_000  # points along one edge


@dataclass(frozen=True, slots=True, eq=False)
class Loop:
    """The edges of a loop in order: their ids, and points (n, 2) along each in parameters. `form` is OUTER, INNER or another."""

    form: str
    edges: tuple[tuple[str, Floats], ...]


def bounds(
    loops: Sequence[Loop], base: Surface, has_outer: bool
) -> tuple[tuple[Floats, ...], tuple[Floats, ...]]:
    """The closed polygons around material, and those around holes in it.

    Without an outer loop, the domain of the surface bounds the material.
    """
    joined = [(each.form, _joined([flat for _, flat in each.edges], base)) for each in loops]
    round_about = [flat for _, flat in joined if _turns(flat, base).any()]
    closed = [(form, flat) for form, flat in joined if not _turns(flat, base).any()]
    outer = [flat for form, flat in closed if has_outer and form not in ("INNER", "SLIT")]
    holes = [flat for form, flat in closed if not has_outer or form == "INNER"]
    outer += _seamed(round_about, base)
    outer = outer or [_natural(base)]
    return tuple(outer), tuple(copy for hole in holes for copy in _copies(hole, outer, base))


def _joined(pieces: Sequence[Floats], base: Surface) -> Floats:
    """Pieces one behind the other. Pieces that run the other way are turned, gaps of whole periods are closed."""
    first = pieces[0]
    if len(pieces) > 1 and _gap(first, pieces[1], base) > _gap(first[::-1], pieces[1], base) + CLEARLY:
        first = first[::-1]
    found = [first]
    for piece in pieces[1:]:
        last = found[-1][-1]
        forth, back = (_distance(last, end, base) for end in (piece[0], piece[-1]))
        piece = piece if forth <= back + CLEARLY else piece[::-1]
        found.append(piece - _whole(piece[0] - last, base) * np.array(base.periods))
    return np.concatenate(found)


def _gap(first: Floats, second: Floats, base: Surface) -> float:
    return min(_distance(first[-1], end, base) for end in (second[0], second[-1]))


def _distance(p: Floats, q: Floats, base: Surface) -> float:
    """How far two parameters are from each other, round the surface, as shares of the domain."""
    size = [max(last - first, 1e-300) for first, last in base.domain]
    gap = q - p
    for axis, period in enumerate(base.periods):
        if period:
            gap[axis] -= period * round(gap[axis] / period)
    return float(np.abs(gap / size).max())


def _whole(gap: Floats, base: Surface) -> Longs:
    """How many periods a gap has along each axis, if it has nearly a whole number of them; otherwise 0."""
    found = np.zeros(2, np.int64)
    for axis, period in enumerate(base.periods):
        if period and abs(gap[axis] / period - round(gap[axis] / period)) < NEAR:
            found[axis] = round(gap[axis] / period)
    return found


def _turns(flat: Floats, base: Surface) -> Longs:
    """How often a chain of points goes round the surface along each axis before it comes back."""
    return _whole(flat[-1] - flat[0], base)


def _seamed(chains: Sequence[Floats], base: Surface) -> list[Floats]:
    """Polygons from chains that go round the surface: two make a band; one reaches to the end of the surface at its left."""
    found, left = [], list(chains)
    while len(left) > 1:
        first = left.pop(0)
        turns = _turns(first, base)
        second = next((each for each in left if (_turns(each, base) == -turns).all()), None)
        if second is None:
            second = left[0]
            found.append(_band(first, second[::-1], base))
        else:
            found.append(_band(first, second, base))
        left = [each for each in left if each is not second]
    return found + [_cap(each, base) for each in left]


def _band(first: Floats, second: Floats, base: Surface) -> Floats:
    """The polygon between two chains that go round in opposite directions."""
    periods = np.array([period or 1.0 for period in base.periods])
    shift = np.round((second[0] - first[-1]) / periods) * np.array(base.periods)
    return np.concatenate([first, second - shift])


def _cap(flat: Floats, base: Surface) -> Floats:
    """The polygon between a chain and the end of the surface at its left: a pole, a tip or the end of its domain."""
    axis = int(np.argmax(np.abs(_turns(flat, base))))
    other = 1 - axis
    leftwards = _turns(flat, base)[axis] * (1 if axis == 0 else -1) > 0
    stop = base.domain[other][1 if leftwards else 0]
    ends = flat[[-1, 0]].copy()
    ends[:, other] = stop
    return np.concatenate([flat, ends])


def _natural(base: Surface) -> Floats:
    (a, b), (c, d) = base.domain
    return np.array([[a, c], [b, c], [b, d], [a, d]])


def _copies(hole: Floats, outer: Sequence[Floats], base: Surface) -> list[Floats]:
    """A hole wherever whole periods bring it to the outer loops."""
    around = np.concatenate(outer)
    low, high = around.min(axis=0), around.max(axis=0)
    found = []
    for i in range(-2, 3) if base.periods[0] else (0,):
        for j in range(-2, 3) if base.periods[1] else (0,):
            copy = hole + np.array([i * base.periods[0], j * base.periods[1]])
            if (copy.max(axis=0) >= low).all() and (copy.min(axis=0) <= high).all():
                found.append(copy)
    return found


def dense(base: Surface, flat: Floats, apart: float) -> Floats:
    """Points (n, 3) along a chain of parameters, at most about `apart` from one another."""
    fine = _divided(flat, np.full(len(flat) - 1, PARTS))
    ways = np.linalg.norm(np.diff(base.at(fine), axis=0), axis=1)
    counts = np.maximum(1, np.ceil(ways / max(apart, float(ways.sum()) / MOST, 1e-300)))
    return base.at(_divided(fine, counts.astype(np.int64)))


def _divided(flat: Floats, counts: Longs) -> Floats:
    """A chain with each step divided into as many as `counts` says."""
    if not len(counts):
        return flat
    at = np.repeat(np.arange(len(counts)), counts)
    part = (np.arange(len(at)) - np.repeat(np.cumsum(counts) - counts, counts)) / counts[at]
    found = flat[at] + part[:, None] * (flat[at + 1] - flat[at])
    return np.concatenate([found, flat[-1:]])
