"""Straight edges through border points on a plane."""

import math
from dataclasses import dataclass

import numpy as np

from cellwright.engine.model.geometry import Floats, Truths

ON_LINE_PX = 1.2
TURN = np.cos(np.radians(25))
SHORTEST_PX = 8
LINES = 8
CANDIDATES = 60


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """Straight edges of a plane region or a facet, in two coordinates on its plane: the points p with `normal` . p = `offset`.

    `normal` (n, 2) points outwards. `ends` (n, 2) are where an edge begins and ends, along the normal turned to the left.
    """

    normal: Floats
    offset: Floats
    ends: Floats

    @property
    def along(self) -> Floats:
        """The directions (n, 2) of the edges."""
        found: Floats = np.stack([-self.normal[:, 1], self.normal[:, 0]], axis=1)
        return found


def lines_through(points: Floats, outward: Floats, pitch_m: float) -> Lines:
    """Straight edges through border points (n, 2) with outward directions (n, 2), the longest first."""
    found: list[tuple[Floats, float, Floats]] = []
    length = np.linalg.norm(outward, axis=1, keepdims=True)
    normals = outward / np.where(length > 0, length, 1.0)
    while len(points) >= SHORTEST_PX and len(found) < LINES:
        chosen = _consensus(points, normals, pitch_m)
        line = _fitted(points[chosen], normals[chosen], pitch_m)
        if line is None:
            break
        on, entry = line
        found.append(entry)
        keep = np.ones(len(points), dtype=bool)
        keep[np.nonzero(chosen)[0][on]] = False
        points, normals = points[keep], normals[keep]
    normal = np.array([each[0] for each in found]).reshape(-1, 2)
    return Lines(
        normal, np.array([each[1] for each in found]), np.array([each[2] for each in found]).reshape(-1, 2)
    )


def _consensus(points: Floats, normals: Floats, pitch_m: float) -> Truths:
    """The points (n,) on the line, through one of them and square to its direction, that most lie on."""
    some = np.linspace(0, len(points) - 1, min(len(points), CANDIDATES)).astype(int)
    height = points @ normals[some].T - (points[some] * normals[some]).sum(axis=1)
    on = (np.abs(height) < ON_LINE_PX * pitch_m) & (normals @ normals[some].T > TURN)
    chosen: Truths = on[:, int(np.argmax(on.sum(axis=0)))]
    for _ in range(2):
        if chosen.sum() < 3:
            break
        normal, offset = _least_squares(points[chosen], normals[chosen])
        chosen = (np.abs(points @ normal - offset) < ON_LINE_PX * pitch_m) & (normals @ normal > TURN)
    return chosen


def _least_squares(points: Floats, normals: Floats) -> tuple[Floats, float]:
    middle = points.sum(axis=0) / len(points)
    (xx, xy), (_, yy) = (points - middle).T @ (points - middle)
    along = 0.5 * math.atan2(2.0 * xy, xx - yy)
    normal = np.array([-math.sin(along), math.cos(along)])
    if normal @ normals.sum(axis=0) <= 0:
        normal = -normal
    return normal, float(normal @ middle)


def _fitted(
    points: Floats, normals: Floats, pitch_m: float
) -> tuple[Truths, tuple[Floats, float, Floats]] | None:
    """The longest stretch of points on a line, and the line; None if it is too short."""
    if len(points) < SHORTEST_PX:
        return None
    normal, _ = _least_squares(points, normals)
    s = points @ np.array([-normal[1], normal[0]])
    order = np.argsort(s)
    breaks = np.nonzero(np.diff(s[order]) > 8 * pitch_m)[0] + 1
    longest = max(np.split(order, breaks), key=len)
    on = np.zeros(len(points), dtype=bool)
    on[longest] = True
    if len(longest) < SHORTEST_PX:
        return None
    normal, offset = _least_squares(points[on], normals[on])
    s = points[on] @ np.array([-normal[1], normal[0]])
    return on, (normal, offset, np.array([s.min() - pitch_m / 2, s.max() + pitch_m / 2]))
