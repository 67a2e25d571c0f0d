"""Parts three ways: convex pieces for collision, faces for distances, vertices for vision.

The three views are those of the THEMSE cell. Blocks and polyhedra have named faces, edges and vertices; round
shapes have none.
"""

import math
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

from cellwright.engine.kernels.geometry.angles import sine_cosine, unit_vectors
from cellwright.engine.kernels.linear import matmul, norm
from cellwright.engine.model.geometry import Floats
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.shapes.bored import plate_pieces, ring_pieces
from cellwright.engine.stages.geometry.shapes.hull import FlatError, hull_triangles
from cellwright.engine.stages.geometry.shapes.meshes import convex_pieces
from cellwright.kb.diagnostics import Diagnostic, InvalidInput
from cellwright.kb.model.shapes import (
    LARGEST,
    Box,
    Cylinder,
    HeightField,
    Mesh,
    PlacedShape,
    Plate,
    PointSet,
    Polyhedron,
    Ring,
    Shape,
    Sphere,
    Tube,
)

TINY = 1e-9  # metres: what is thinner is nothing
THIN = 1e-6  # of a grid's width: what is thinner has no volume
SIDES = 16  # sides of the prism around a cylinder: its corners lie at most 2 % outside


@dataclass(frozen=True, slots=True, eq=False)
class Core:
    """A convex piece: the hull of `vertices` (n, 3), grown by `radius_m`.

    With `box` it is a block along the axes, centred at the origin.
    """

    vertices: Floats
    radius_m: float = 0.0
    box: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class PatchFace:
    """A planar face: corners (n, 3) counter-clockwise from outside, and its outward unit normal (3,)."""

    name: str
    corners: Floats
    normal: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """Faces, edges (each the two ends, (2, 3)) and vertices (3,) of a part by name."""

    faces: dict[str, PatchFace]
    edges: dict[str, Floats]
    vertices: dict[str, Floats]


def cores(shape: Shape) -> list[Core]:
    """The convex pieces of a shape in its own frame. Raises `InvalidInput` for one without volume."""
    match shape:
        case Sphere():
            return [Core(np.zeros((1, 3)), shape.radius_m)]
        case Tube():
            half = shape.length_m / 2
            return [Core(np.array([[0.0, 0.0, -half], [0.0, 0.0, half]]), shape.radius_m)]
        case Box():
            return [Core(_corners(shape), box=True)]
        case Cylinder():
            return [Core(_prism(shape))]
        case _:
            return _several(shape)


def _several(shape: Ring | Plate | Polyhedron | Mesh | HeightField | PointSet) -> list[Core]:
    match shape:
        case Ring():
            return [Core(piece) for piece in ring_pieces(shape)]
        case Plate():
            return [Core(piece) for piece in plate_pieces(shape)]
        case Polyhedron():
            return _polyhedron(shape)
        case Mesh():
            return [Core(piece) for piece in _scaled(shape)]
        case HeightField():
            return _columns(shape)
        case PointSet():
            return [Core(np.array([point]), shape.radius_m) for point in shape.points_m]


def _scaled(mesh: Mesh) -> list[Floats]:
    """The corners of a mesh's pieces. Raises `InvalidInput` also for one that is larger than any cell, or nothing at all."""
    pieces = [piece * mesh.scale for piece in convex_pieces(Path(mesh.path), mesh.where)]
    corners = np.concatenate(pieces)
    if not np.abs(corners).max() <= LARGEST:
        message, hint = f"the mesh is larger than {LARGEST:g} m", "check its unit, and `scale`"
        raise InvalidInput([Diagnostic(mesh.where, "K702", message, hint)])
    if np.ptp(corners, axis=0).min() < TINY:
        message, hint = "the scaled mesh has no volume", "check its unit, and `scale`"
        raise InvalidInput([Diagnostic(mesh.where, "K702", message, hint)])
    return pieces


def _corners(box: Box) -> Floats:
    return np.array(list(product((-0.5, 0.5), repeat=3))) * box.size_m


def _prism(cylinder: Cylinder) -> Floats:
    """A prism around a cylinder: its sides touch the cylinder from outside."""
    angles = (np.arange(SIDES) + 0.5) * 2 * math.pi / SIDES
    radius = cylinder.radius_m / sine_cosine(math.pi / SIDES)[1]
    ring = radius * unit_vectors(angles)
    ends = [
        np.column_stack([ring, np.full(SIDES, z)]) for z in (-cylinder.length_m / 2, cylinder.length_m / 2)
    ]
    return np.concatenate(ends)


def _polyhedron(shape: Polyhedron) -> list[Core]:
    pieces = shape.pieces or (tuple(shape.vertices),)
    found = []
    for piece in pieces:
        vertices = np.array([shape.vertices[name] for name in piece], dtype=float).reshape(-1, 3)
        try:
            hull_triangles(vertices)
        except FlatError as error:
            message = f"a convex piece has no volume: {error}"
            raise InvalidInput([Diagnostic(shape.where, "K702", message, "give it another vertex")]) from None
        found.append(Core(vertices))
    return found


def _columns(field: HeightField) -> list[Core]:
    """Two prisms under each grid square, one for each triangle of the surface.

    Raises `InvalidInput` where the surface is flat and not above the floor.
    """
    heights = np.array(field.heights_m)
    dx, dy = field.spacing_m
    found = []
    for row, column in np.ndindex(heights.shape[0] - 1, heights.shape[1] - 1):
        square = [(row + i, column + j) for i, j in ((0, 0), (0, 1), (1, 1), (1, 0))]
        for corners in (square[:3], [square[0], *square[2:]]):
            top = np.array([(c * dx, r * dy, heights[r, c]) for r, c in corners])
            bottom = top.copy()
            bottom[:, 2] = np.minimum(field.floor_m, top[:, 2].min())
            if top[:, 2].max() - bottom[0, 2] < THIN * max(dx, dy):
                message = f"the height field has no volume at row {row + 1}, column {column + 1}"
                raise InvalidInput([Diagnostic(field.where, "K702", message, "give it a lower `floor`")])
            found.append(Core(np.unique(np.concatenate([top, bottom]), axis=0)))
    return found


BOX_FACES = {  # name: the axis of its normal, and the sign
    "right": (0, 1),
    "left": (0, -1),
    "back": (1, 1),
    "front": (1, -1),
    "top": (2, 1),
    "bottom": (2, -1),
}


def features(placed: PlacedShape) -> Features:
    """The named faces, edges and vertices of a placed shape; None for round shapes.

    The names of a block's features are fixed.
    """
    T = transforms.of_pose(placed.pose)
    match placed.shape:
        case Box():
            return _moved(T, *_box_features(placed.shape))
        case Polyhedron():
            return _moved(T, *_polyhedron_features(placed.shape))
        case _:
            return Features({}, {}, {})


def _moved(
    T: Floats, vertices: dict[str, Floats], faces: dict[str, list[str]], edges: dict[str, list[str]]
) -> Features:
    placed = {name: transforms.apply(T, point[None])[0] for name, point in vertices.items()}
    return Features(
        {name: _face(name, np.array([placed[v] for v in corners])) for name, corners in faces.items()},
        {name: np.array([placed[v] for v in ends]) for name, ends in edges.items()},
        placed,
    )


def _face(name: str, corners: Floats) -> PatchFace:
    """A planar face of these corners.

    Its normal is from Newell's formula, which works if some corners lie on one line.
    """
    normal = np.cross(corners, np.roll(corners, -1, axis=0)).sum(axis=0)
    return PatchFace(name, corners, normal / norm(normal))


def _box_features(box: Box) -> tuple[dict[str, Floats], dict[str, list[str]], dict[str, list[str]]]:
    """The features of a block.

    A vertex has the names of the three sides that meet there, an edge those of two.
    """
    half = np.array(box.size_m) / 2
    sides = [[("left", -1), ("right", 1)], [("front", -1), ("back", 1)], [("bottom", -1), ("top", 1)]]
    vertices = {f"{x}_{y}_{z}": half * (i, j, k) for (x, i), (y, j), (z, k) in product(*sides)}
    faces: dict[str, list[str]] = {}
    for name, (axis, side) in BOX_FACES.items():
        u, v = (axis + 1) % 3, (axis + 2) % 3
        around = [(-1, -1), (1, -1), (1, 1), (-1, 1)][::side]
        faces[name] = [_at(vertices, {axis: side, u: a, v: b}) for a, b in around]
    names = sorted(vertices)
    edges: dict[str, list[str]] = {}
    for index, a in enumerate(names):
        for b in names[index + 1 :]:
            common = [part for part in a.split("_") if part in b.split("_")]
            if len(common) == 2:
                edges["_".join(common)] = [a, b]
    return vertices, faces, edges


def _at(vertices: dict[str, Floats], signs: dict[int, int]) -> str:
    return next(
        name for name, p in vertices.items() if all(p[axis] * sign > 0 for axis, sign in signs.items())
    )


def _polyhedron_features(
    shape: Polyhedron,
) -> tuple[dict[str, Floats], dict[str, list[str]], dict[str, list[str]]]:
    return (
        {name: np.array(point) for name, point in shape.vertices.items()},
        {face.name: list(face.vertices) for face in shape.faces},
        {edge.name: list(edge.vertices) for edge in shape.edges},
    )


def check_polyhedron(shape: Polyhedron) -> list[Diagnostic]:
    """Errors in the named faces: fewer than three vertices, not planar, or (in a convex polyhedron) turned
    inwards.
    """
    found = []
    vertices = {name: np.array(point) for name, point in shape.vertices.items()}
    middle = np.mean(list(vertices.values()), axis=0)
    for face in shape.faces:
        corners = np.array([vertices[name] for name in face.vertices]).reshape(-1, 3)
        size = float(np.ptp(corners, axis=0).max()) if len(corners) else 0.0
        problem, hint = _face_problem(corners, size, middle, convex=not shape.pieces)
        if problem:
            found.append(Diagnostic(shape.where, "K702", f"face '{face.name}' {problem}", hint))
    return found


def _face_problem(corners: Floats, size: float, middle: Floats, convex: bool) -> tuple[str, str]:
    normal = np.cross(corners, np.roll(corners, -1, axis=0)).sum(axis=0) if len(corners) > 2 else np.zeros(3)
    length = norm(normal)
    if len(corners) < 3 or length < 1e-12 * max(size, 1e-12) ** 2:
        return "has no area", "name three or more of its corners"
    height = matmul(corners - corners[0], normal / length)
    if np.abs(height).max() > 1e-6 * size:
        return "is not planar", "split it into triangles"
    if convex and matmul(corners[0] - middle, normal) < 0:
        return "is turned inwards", "name its vertices counter-clockwise as seen from outside"
    return "", ""
