"""The turns that map a solid onto itself."""

import numpy as np

from engine.kernels.rigid import apply, inverse, transform
from engine.model.geometry import Floats
from engine.model.solid import Facet, Solid

SAME = 1e-4  # of the size


def symmetries(solid: Solid) -> tuple[Floats, ...]:
    """All poses (4, 4) of a solid in its own frame in which it looks the same, the identity first.

    Each maps one edge of the first facet to an edge of some facet. Those that map all vertices to vertices are right.
    """
    points = np.unique(np.round(solid.vertices, 9), axis=0)
    size = float(np.ptp(points, axis=0).max())
    anchor = solid.facets[0]
    back = inverse(_frame(anchor, 0))
    length = _length(anchor, 0)
    found: list[Floats] = [np.eye(4)]
    for facet in solid.facets:
        if len(facet.edges) != len(anchor.edges):
            continue
        for n in range(len(facet.edges)):
            T = _frame(facet, n) @ back
            if abs(_length(facet, n) - length) > SAME * size or not _onto_itself(points, T, SAME * size):
                continue
            if all(np.abs(T - other).max() > 10 * SAME for other in found):
                found.append(T)
    return tuple(found)


def _frame(facet: Facet, n: int) -> Floats:
    """The frame (4, 4) at the start of an edge: along it, to the inside, outwards."""
    along = facet.edges[n, 1] - facet.edges[n, 0]
    along = along / np.linalg.norm(along)
    R = np.stack([along, np.cross(facet.normal, along), facet.normal], axis=1)
    return transform(R, facet.edges[n, 0])


def _length(facet: Facet, n: int) -> float:
    return float(np.linalg.norm(facet.edges[n, 1] - facet.edges[n, 0]))


def _onto_itself(points: Floats, T: Floats, within: float) -> bool:
    moved = apply(T, points)
    apart = np.linalg.norm(moved[:, None] - points[None], axis=2)
    return bool((apart.min(axis=1) < within).all())
