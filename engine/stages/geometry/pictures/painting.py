"""The order in which triangles are painted, so that nearer ones cover those behind them.

A binary space partition in the coordinates of the picture (Fuchs, Kedem & Naylor 1980): the plane of one triangle
parts the others, and a triangle that crosses the plane is cut. Surfaces that pass through each other are shown
correctly, too.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cellwright.engine.model.geometry import Floats, Longs

FLAT_PIXELS = 1e-3  # a corner this near to a plane lies on it
FEW = 64  # triangles that are compared pair by pair
CANDIDATES = 6  # planes that are tried for each cut
CUT_COSTS = 8  # a cut triangle counts as much as this many triangles too many on one side


@dataclass(frozen=True, slots=True, eq=False)
class Painted:
    """Triangles (m, 3, 3) that face the viewer, in pixels to the right, down and towards the viewer. Each has the number of
    the given triangle that it is a part of, and of its convex piece (m,).
    """

    corners: Floats
    source: Longs
    piece: Longs

    def at(self, chosen: Longs) -> "Painted":
        """Some of the triangles."""
        return Painted(self.corners[chosen], self.source[chosen], self.piece[chosen])


def back_to_front(corners: Floats, piece: Longs) -> tuple[Floats, Longs]:
    """Triangles (n, 3, 3) and the number of the given triangle that each is a part of (n,), the farthest first.

    `corners` (m, 3, 3) are in pixels to the right, down and towards the viewer; `piece` (m,) tells which triangles belong to
    one convex piece. Each triangle must face the viewer: those of one piece then never cover each other.
    """
    random = np.random.default_rng(0)
    waiting = [(Painted(corners, np.arange(len(corners)), piece), False)]
    done = []
    while waiting:
        group, flat = waiting.pop()
        if flat or _in_any_order(group):
            done.append(group)
        else:
            behind, level, ahead = _parted(group, random)
            waiting += [(ahead, False), (level, True), (behind, False)]
    return np.concatenate([each.corners for each in done]), np.concatenate([each.source for each in done])


def _in_any_order(group: Painted) -> bool:
    """Whether no triangle of the group can cover one of another piece."""
    if len(group.piece) < 2 or (group.piece == group.piece[0]).all():
        return True
    if len(group.piece) > FEW:
        return False
    low, high = group.corners[:, :, :2].min(axis=1), group.corners[:, :, :2].max(axis=1)
    meet = (low[:, None] < high[None]).all(axis=2) & (low[None] < high[:, None]).all(axis=2)
    return not (meet & (group.piece[:, None] != group.piece[None])).any()


def _parted(group: Painted, random: np.random.Generator) -> tuple[Painted, Painted, Painted]:
    """What lies behind the plane of one triangle, on it, and before it."""
    tried = random.choice(len(group.corners), min(CANDIDATES, len(group.corners)), replace=False)
    tries = _distances(group.corners, group.corners[tried])
    before, after = np.any(tries < -FLAT_PIXELS, axis=2), np.any(tries > FLAT_PIXELS, axis=2)
    costs = CUT_COSTS * (before & after).sum(axis=1) + np.abs(before.sum(axis=1) - after.sum(axis=1))
    best = int(costs.argmin())
    behind, ahead, away = before[best], after[best], tries[best]
    cut = np.flatnonzero(behind & ahead)
    parts = [
        _joined(group.at(np.flatnonzero(side & ~other)), _cut(group.at(cut), sign * away[cut]))
        for side, other, sign in ((behind, ahead, -1.0), (ahead, behind, 1.0))
    ]
    return parts[0], group.at(np.flatnonzero(~behind & ~ahead)), parts[1]


def _distances(corners: Floats, planes: Floats) -> Floats:
    """How far corners (m, 3, 3) lie before the planes of triangles (k, 3, 3), seen by the viewer: (k, m, 3)."""
    normals = np.cross(planes[:, 1] - planes[:, 0], planes[:, 2] - planes[:, 0])
    normals *= np.sign(normals[:, 2:]) / np.linalg.norm(normals, axis=1, keepdims=True)
    away = np.einsum("kc,mvc->kmv", normals, corners)
    found: Floats = away - np.einsum("kc,kc->k", normals, planes[:, 0])[:, None, None]
    return found


def _joined(one: Painted, other: Painted) -> Painted:
    return Painted(
        *(
            np.concatenate([getattr(one, name), getattr(other, name)])
            for name in ("corners", "source", "piece")
        )
    )


def _cut(group: Painted, away: Floats) -> Painted:
    """The parts of triangles on the side where `away` (m, 3) is positive."""
    parts: list[Floats] = []
    of: list[int] = []
    for number, (corners, distances) in enumerate(zip(group.corners, away, strict=True)):
        kept = _clipped(corners, distances)
        parts += [np.stack([kept[0], kept[n], kept[n + 1]]) for n in range(1, len(kept) - 1)]
        of += [number] * (len(kept) - 2)
    shown = Painted(np.array(parts).reshape(-1, 3, 3), group.source[of], group.piece[of])
    return shown.at(np.flatnonzero(np.abs(doubled_area(shown.corners)) > FLAT_PIXELS**2))


def _clipped(corners: Floats, away: Floats) -> Sequence[Floats]:
    """The corners of the part of one triangle (3, 3) where `away` (3,) is positive, in their order."""
    kept: list[Floats] = []
    for this, following in ((0, 1), (1, 2), (2, 0)):
        if away[this] >= 0:
            kept.append(corners[this])
        if away[this] * away[following] < 0:
            share = away[this] / (away[this] - away[following])
            kept.append(corners[this] + share * (corners[following] - corners[this]))
    return kept


def doubled_area(corners: Floats) -> Floats:
    """Twice the area (m,) of triangles (m, 3, 3) in square pixels. It is negative for those that face the viewer."""
    a, b, c = (corners[:, k, :2] for k in range(3))
    found: Floats = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (c[:, 0] - a[:, 0]) * (b[:, 1] - a[:, 1])
    return found
