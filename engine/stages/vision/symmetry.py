"""The turns that map a solid onto itself, wholly or in part."""

import numpy as np

from cellwright.engine.kernels.rigid import apply, inverse, transform
from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.solid import Facet, Solid

SAME = 1e-4  # of the size
LIKE_M, LIKE, MOST = (
    0.003,
    0.6,
    6,
)  # how near points must be to a facet, which share of them must be, and how many poses are given
APART = 0.02  # entries of poses that differ by less are of one pose


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


def likenesses(
    solid: Solid, known: tuple[Floats, ...], points: Floats, normals: Floats
) -> tuple[Floats, ...]:
    """Poses (4, 4) in which most of some points (n, 3) on a solid, with their normals, lie on its facets' planes, except for those that are known.
    The likest come first.

    What tells such a pose from the true one may be hidden. Each maps an edge of the largest facet onto the line of another edge,
    beginning at one of its ends.
    """
    anchor = max(solid.facets, key=lambda each: float(np.linalg.norm(np.ptp(each.edges, axis=(0, 1)))))
    back = inverse(_frame(anchor, 0))
    planes = np.array([facet.normal for facet in solid.facets])
    offsets = np.array([facet.offset for facet in solid.facets])
    found: list[tuple[float, Floats]] = []
    for facet in solid.facets:
        for n in range(len(facet.edges)):
            T = _frame(facet, n) @ back
            near = (np.abs(apply(T, points) @ planes.T - offsets) < LIKE_M) & (
                normals @ T[:3, :3].T @ planes.T > 1 - 1e-3
            )
            share = float(near.any(axis=1).mean())
            others = [*known, *(other for _, other in found)]
            if share > LIKE and all(np.abs(T - other).max() > APART for other in others):
                found.append((share, T))
    return tuple(T for _, T in sorted(found, key=lambda pair: -pair[0])[:MOST])


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
