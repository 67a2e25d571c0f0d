"""Bodies as solids with plane facets and edges, for vision and grasping.

A body of several shapes has the surfaces of all of them; what one hides of another is not cut away.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs
from cellwright.engine.kernels.linear import matmul, norm
from cellwright.engine.kernels.rigid import apply
from cellwright.engine.model.geometry import Facet, Solid
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.shapes.hulls import hull_triangles
from cellwright.engine.stages.geometry.shapes.meshes import read_mesh
from cellwright.engine.stages.geometry.shapes.part_shapes import shape_cores, shape_features
from cellwright.kb.model.body_shapes import Mesh, PlacedShape
from cellwright.kb.model.cell_model import Body

SAME_POINT = 1e-6  # of the size: what is nearer is one point, or lies in one plane


def solid_of(body: Body) -> Solid:
    """The surface of a body.

    Raises `InvalidInput` for a shape without volume, `ValueError` for a body without a shape.
    """
    if not body.shapes:
        raise ValueError(f"'{body.name}' has no shape")
    return make_solid(body.name, [part for placed in body.shapes for part in _shape_faces(placed)])


def _shape_faces(placed: PlacedShape) -> list[tuple[str, Floats]]:
    """Names and triangles (t, 3, 3) of what a shape's surface is made of; the name is empty if
    the surface has none.
    """
    named = shape_features(placed).faces
    if named:
        return [
            (name, triangulate_polygon(face.corners, face.normal)) for name, face in named.items()
        ]
    T = transforms.of_pose(placed.pose)
    if isinstance(placed.shape, Mesh):
        mesh = read_mesh(Path(placed.shape.path))
        corners = (mesh.vertices * np.array(placed.shape.scale))[mesh.triangles]
        corners = corners[:, ::-1] if np.prod(placed.shape.scale) < 0 else corners
        return [("", apply(T, corners))]
    hulls = [(core, hull_triangles(core.vertices)) for core in shape_cores(placed.shape)]
    return [("", apply(T, core.vertices[triangles])) for core, triangles in hulls]


def triangulate_polygon(corners: Floats, normal: Floats) -> Floats:
    """The triangles (n - 2, 3, 3) of a plane polygon (n, 3) without holes, by cutting off ears
    (Meisters 1975).
    """
    open_, ears = list(range(len(corners))), []
    while len(open_) > 3:
        ear = next((n for n in range(len(open_)) if _is_ear(corners, open_, n, normal)), 0)
        ears.append([open_[ear - 1], open_[ear], open_[(ear + 1) % len(open_)]])
        del open_[ear]
    triangles: Floats = corners[np.array([*ears, open_])]
    return triangles


def _is_ear(corners: Floats, open_: Sequence[int], n: int, normal: Floats) -> bool:
    """Whether corner n is convex, and its triangle holds no other corner."""
    a, b, c = (corners[open_[k % len(open_)]] for k in (n - 1, n, n + 1))
    if matmul(np.cross(b - a, c - b), normal) <= 0:
        return False
    remaining = np.array(
        [corners[k] for k in open_ if not any((corners[k] == x).all() for x in (a, b, c))]
    )
    if not len(remaining):
        return True
    inside = np.ones(len(remaining), dtype=bool)
    for p, q in ((a, b), (b, c), (c, a)):
        inside &= matmul(np.cross(q - p, remaining - p), normal) >= 0
    return not bool(inside.any())


def make_solid(name: str, surfaces: Sequence[tuple[str, Floats]]) -> Solid:
    """The solid with these surfaces: names, and triangles (t, 3, 3) counter-clockwise seen from
    outside.
    """
    corners = np.concatenate([triangles for _, triangles in surfaces])
    labels = [label for label, triangles in surfaces for _ in triangles]
    area = np.linalg.norm(_corner_normals(corners), axis=1)
    size = float(np.ptp(corners.reshape(-1, 3), axis=0).max())
    keep = area > (SAME_POINT * size) ** 2
    corners, labels = (
        corners[keep],
        [label for label, is_kept in zip(labels, keep, strict=True) if is_kept],
    )
    ids = _number_corners(corners, size)
    group = _group_triangles(corners, ids, labels, size)
    owner = {
        (int(a), int(b)): n
        for n, t in enumerate(ids)
        for a, b in zip(t, np.roll(t, -1), strict=True)
    }
    points = np.zeros((int(ids.max()) + 1, 3))
    points[ids.reshape(-1)] = corners.reshape(-1, 3)
    facets = [
        _make_facet(n, group, ids, points, corners, labels, owner)
        for n in range(int(group.max()) + 1)
    ]
    return Solid(name, np.ascontiguousarray(corners), group, tuple(facets))


def _corner_normals(corners: Floats) -> Floats:
    normals: Floats = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return normals


def _number_corners(corners: Floats, size: float) -> Longs:
    """Numbers (m, 3) of the corners: the same for those at one point."""
    rounded = np.round(corners.reshape(-1, 3) / (SAME_POINT * size)).astype(np.int64)
    ids: Longs = np.unique(rounded, axis=0, return_inverse=True)[1].reshape(-1, 3)
    return ids


def _group_triangles(corners: Floats, ids: Longs, labels: Sequence[str], size: float) -> Longs:
    """The number of the facet of each triangle (m,): neighbours in one plane and of one name
    are one.
    """
    normals = _corner_normals(corners)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    by_edge = {
        (int(a), int(b)): n
        for n, t in enumerate(ids)
        for a, b in zip(t, np.roll(t, -1), strict=True)
    }
    group, count = np.full(len(ids), -1, dtype=np.int64), 0
    for first in range(len(ids)):
        if group[first] >= 0:
            continue
        stack, group[first] = [first], count
        while stack:
            t = ids[stack.pop()]
            for a, b in zip(t, np.roll(t, -1), strict=True):
                neighbour = by_edge.get((int(b), int(a)), -1)
                if neighbour < 0 or group[neighbour] >= 0 or labels[neighbour] != labels[first]:
                    continue
                height = np.abs(
                    matmul(corners[neighbour] - corners[first, 0], normals[first])
                ).max()
                if (
                    height < 10 * SAME_POINT * size
                    and matmul(normals[neighbour], normals[first]) > 1 - 1e-6
                ):
                    group[neighbour] = count
                    stack.append(neighbour)
        count += 1
    return group


def _make_facet(
    n: int,
    group: Longs,
    ids: Longs,
    points: Floats,
    corners: Floats,
    labels: Sequence[str],
    owner: dict[tuple[int, int], int],
) -> Facet:
    own = np.nonzero(group == n)[0]
    normal = _corner_normals(corners[own]).sum(axis=0)
    normal /= norm(normal)
    directed = [(int(a), int(b)) for t in ids[own] for a, b in zip(t, np.roll(t, -1), strict=True)]
    inside = set(directed)
    rim = _straighten_rim([edge for edge in directed if edge[::-1] not in inside], points)
    edges = np.array([[points[a], points[b]] for a, b, _, _ in rim]).reshape(-1, 2, 3)
    convex = np.array(
        [
            _falls_back(owner.get((d, c)), corners, points[d] - points[c], normal)
            for _, _, c, d in rim
        ]
    )
    name = labels[int(own[0])] or f"facet_{n + 1}"
    return Facet(
        name,
        normal,
        float(matmul(corners[own].reshape(-1, 3).mean(axis=0), normal)),
        edges,
        convex.astype(bool),
    )


def _straighten_rim(rim: list[tuple[int, int]], points: Floats) -> list[tuple[int, int, int, int]]:
    """Edges (from, to) of which none goes straight on from another, each with one of the edges
    that it was made of.
    """
    after: dict[int, list[int]] = {}
    for a, b in rim:
        after.setdefault(a, []).append(b)
    starts = {b: a for a, b in rim}
    edges = []
    for a, b in rim:
        before = starts.get(a)
        if (
            before is not None
            and len(after[a]) == 1
            and _goes_straight(points[before], points[a], points[b])
        ):
            continue
        end, previous = b, a
        while len(after.get(end, ())) == 1 and _goes_straight(
            points[previous], points[end], points[after[end][0]]
        ):
            previous, end = end, after[end][0]
        edges.append((a, end, a, b))
    return edges


def _goes_straight(a: Floats, b: Floats, c: Floats) -> bool:
    before, after = b - a, c - b
    length = norm(before) * norm(after)
    return bool(matmul(before, after) > 0 and norm(np.cross(before, after)) < 1e-5 * length)


def _falls_back(neighbour: int | None, corners: Floats, along: Floats, normal: Floats) -> bool:
    """Whether the facet of a triangle beyond an edge turns away from the outside."""
    if neighbour is None:
        return True
    neighbour_normal = _corner_normals(corners[neighbour][None])[0]
    return bool(matmul(neighbour_normal, np.cross(normal, along)) < 0)
