"""Part shapes as convex pieces for collision, faces for distances, and vertices for vision.

A hole becomes a prism within the round one, so that the pieces leave out nothing that is solid.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise, product
from pathlib import Path

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.geometry.angles import sine_cosine, unit_vectors
from cellwright.engine.kernels.linear import matmul, norm
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.shapes.hulls import FlatError, hull_triangles
from cellwright.engine.stages.geometry.shapes.meshes import convex_pieces
from cellwright.kb.diagnostics import NOWHERE, Diagnostic, InvalidInput
from cellwright.kb.model.body_shapes import (
    MAX_MAGNITUDE,
    Box,
    Cylinder,
    HeightField,
    Hole,
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

RING_SIDES = 16  # of a ring
KEPT_SHAPES = 256  # shapes whose pieces are kept: a scene is made anew for every state
HOLE_SIDES = 12  # of a hole in a plate
Rectangle = tuple[float, float, float, float]  # least x and y, greatest x and y


@lru_cache(maxsize=KEPT_SHAPES)
def ring_pieces(ring: Ring) -> list[Floats]:
    """A sector (8, 3) for each side; the outer sides touch the ring from outside."""
    outer = _circle_corners(RING_SIDES) * (ring.radius_m / sine_cosine(math.pi / RING_SIDES)[1])
    return _sector_prisms(_circle_corners(RING_SIDES) * ring.inner_m, outer, ring.length_m)


@lru_cache(maxsize=KEPT_SHAPES)
def plate_pieces(plate: Plate) -> list[Floats]:
    """The prisms (n, 3) that fill a plate."""
    x, y, z = plate.size_m
    rest: list[Rectangle] = [(-x / 2, -y / 2, x / 2, y / 2)]
    pieces: list[Floats] = []
    for hole in plate.holes:
        square = _square_around(hole)
        rest = [part for rectangle in rest for part in _cut_rectangle(rectangle, square)]
        pieces += _frame_prisms(hole, z)
    return [*(_block_vertices(rectangle, z) for rectangle in rest), *pieces]


def _circle_corners(sides: int) -> Floats:
    angles = (np.arange(sides) + 0.5) * 2 * math.pi / sides
    return unit_vectors(angles)


def _sector_prisms(inner: Floats, outer: Floats, length_m: float) -> list[Floats]:
    """The prisms between the corners (n, 2) of an inner and an outer polygon."""
    prisms = []
    for n in range(len(inner)):
        m = (n + 1) % len(inner)
        prisms.append(_prism_vertices(np.stack([inner[n], outer[n], outer[m], inner[m]]), length_m))
    return prisms


def _prism_vertices(corners: Floats, length_m: float) -> Floats:
    half = length_m / 2
    return np.concatenate(
        [np.column_stack([corners, np.full(len(corners), z)]) for z in (-half, half)]
    )


def _square_around(hole: Hole) -> Rectangle:
    (x, y), r = hole.at_m, hole.radius_m
    return (x - r, y - r, x + r, y + r)


def _frame_prisms(hole: Hole, length_m: float) -> list[Floats]:
    """What the square around a hole keeps: the prisms between the round hole and the square."""
    around, per_side = _circle_corners(HOLE_SIDES), HOLE_SIDES // 4
    prisms = []
    for quarter in range(4):
        angle = (quarter + 0.5) * math.pi / 2
        corner = math.sqrt(2.0) * unit_vectors(np.array(angle))
        arc = around[quarter * per_side : (quarter + 1) * per_side]
        sides = [_quarter_axis(quarter), *arc, _quarter_axis(quarter + 1)]
        for first, second in pairwise(sides):
            corners = np.stack([first, corner, second]) * hole.radius_m + hole.at_m
            prisms.append(_prism_vertices(corners, length_m))
    return prisms


def _quarter_axis(quarter: int) -> Floats:
    angle = quarter * math.pi / 2
    return unit_vectors(np.array(angle))


def _block_vertices(rectangle: Rectangle, length_m: float) -> Floats:
    x, y, u, v = rectangle
    return _prism_vertices(np.array([[x, y], [u, y], [u, v], [x, v]]), length_m)


def _cut_rectangle(rectangle: Rectangle, hole: Rectangle) -> list[Rectangle]:
    """The rectangles that are left of one when a square is cut out."""
    x, y, u, v = rectangle
    x_min, low, right, high = max(x, hole[0]), max(y, hole[1]), min(u, hole[2]), min(v, hole[3])
    if x_min >= right or low >= high:
        return [rectangle]
    parts = [(x, y, x_min, v), (right, y, u, v), (x_min, y, right, low), (x_min, high, right, v)]
    return [part for part in parts if part[2] > part[0] and part[3] > part[1]]


MIN_THICKNESS_M = 1e-9  # metres: what is thinner is nothing
MIN_HEIGHT_SHARE = 1e-6  # of a grid's width: what is thinner has no volume
PRISM_SIDES = 16  # sides of the prism around a cylinder: its corners lie at most 2 % outside


@dataclass(frozen=True, slots=True, eq=False)
class ConvexCore:
    """A convex piece: the hull of `vertices` (n, 3), grown by `radius_m`.

    With `box` it is a block along the axes, centred at the origin.
    """

    vertices: Floats
    radius_m: float = 0.0
    box: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class PatchFace:
    """A planar face: corners (n, 3) counter-clockwise from outside, and its outward unit normal
    (3,).
    """

    name: str
    corners: Floats
    normal: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """Faces, edges (each the two ends, (2, 3)) and vertices (3,) of a part by name."""

    faces: dict[str, PatchFace]
    edges: dict[str, Floats]
    vertices: dict[str, Floats]


def shape_cores(shape: Shape) -> list[ConvexCore]:
    """The convex pieces of a shape in its own frame.

    Raises `InvalidInput` for one without volume.
    """
    match shape:
        case Sphere():
            return [ConvexCore(np.zeros((1, 3)), shape.radius_m)]
        case Tube():
            half = shape.length_m / 2
            return [ConvexCore(np.array([[0.0, 0.0, -half], [0.0, 0.0, half]]), shape.radius_m)]
        case Box():
            return [ConvexCore(_box_corners(shape), box=True)]
        case Cylinder():
            return [ConvexCore(_cylinder_prism(shape))]
        case _:
            return _several_cores(shape)


def _several_cores(
    shape: Ring | Plate | Polyhedron | Mesh | HeightField | PointSet,
) -> list[ConvexCore]:
    match shape:
        case Ring():
            return [ConvexCore(piece) for piece in ring_pieces(shape)]
        case Plate():
            return [ConvexCore(piece) for piece in plate_pieces(shape)]
        case Polyhedron():
            return _polyhedron_cores(shape)
        case Mesh():
            return [ConvexCore(piece) for piece in _scaled_mesh(shape)]
        case HeightField():
            return _height_columns(shape)
        case PointSet():
            return [ConvexCore(np.array([point]), shape.radius_m) for point in shape.points_m]


def _scaled_mesh(mesh: Mesh) -> list[Floats]:
    """The corners of a mesh's pieces.

    Raises `InvalidInput` also for one that is larger than any cell, or nothing at all.
    """
    pieces = [piece * mesh.scale for piece in convex_pieces(Path(mesh.path), mesh.where)]
    corners = np.concatenate(pieces)
    if not np.abs(corners).max() <= MAX_MAGNITUDE:
        message, hint = (
            f"the mesh is larger than {MAX_MAGNITUDE:g} m",
            "check its unit, and `scale`",
        )
        raise InvalidInput([Diagnostic(mesh.where, "K702", message, hint)])
    if np.ptp(corners, axis=0).min() < MIN_THICKNESS_M:
        message, hint = "the scaled mesh has no volume", "check its unit, and `scale`"
        raise InvalidInput([Diagnostic(mesh.where, "K702", message, hint)])
    return pieces


def _box_corners(box: Box) -> Floats:
    return np.array(list(product((-0.5, 0.5), repeat=3))) * box.size_m


def _cylinder_prism(cylinder: Cylinder) -> Floats:
    """A prism around a cylinder: its sides touch the cylinder from outside."""
    angles = (np.arange(PRISM_SIDES) + 0.5) * 2 * math.pi / PRISM_SIDES
    radius = cylinder.radius_m / sine_cosine(math.pi / PRISM_SIDES)[1]
    ring = radius * unit_vectors(angles)
    ends = [
        np.column_stack([ring, np.full(PRISM_SIDES, z)])
        for z in (-cylinder.length_m / 2, cylinder.length_m / 2)
    ]
    return np.concatenate(ends)


def _polyhedron_cores(shape: Polyhedron) -> list[ConvexCore]:
    pieces = shape.pieces or (tuple(shape.vertices),)
    polyhedron_cores = []
    for piece in pieces:
        vertices = np.array([shape.vertices[name] for name in piece], dtype=float).reshape(-1, 3)
        try:
            hull_triangles(vertices)
        except FlatError as error:
            message = f"a convex piece has no volume: {error}"
            raise InvalidInput(
                [Diagnostic(shape.where, "K702", message, "give it another vertex")]
            ) from None
        polyhedron_cores.append(ConvexCore(vertices))
    return polyhedron_cores


def _height_columns(field: HeightField) -> list[ConvexCore]:
    """Two prisms under each grid square, one for each triangle of the surface.

    Raises `InvalidInput` where the surface is flat and not above the floor.
    """
    heights = np.array(field.heights_m)
    dx, dy = field.spacing_m
    height_prisms = []
    for row, column in np.ndindex(heights.shape[0] - 1, heights.shape[1] - 1):
        square = [(row + i, column + j) for i, j in ((0, 0), (0, 1), (1, 1), (1, 0))]
        for corners in (square[:3], [square[0], *square[2:]]):
            top = np.array([(c * dx, r * dy, heights[r, c]) for r, c in corners])
            bottom = top.copy()
            bottom[:, 2] = np.minimum(field.floor_m, top[:, 2].min())
            if top[:, 2].max() - bottom[0, 2] < MIN_HEIGHT_SHARE * max(dx, dy):
                message = f"the height field has no volume at row {row + 1}, column {column + 1}"
                raise InvalidInput(
                    [Diagnostic(field.where, "K702", message, "give it a lower `floor`")]
                )
            height_prisms.append(ConvexCore(np.unique(np.concatenate([top, bottom]), axis=0)))
    return height_prisms


BOX_FACES = {  # name: the axis of its normal, and the sign
    "right": (0, 1),
    "left": (0, -1),
    "back": (1, 1),
    "front": (1, -1),
    "top": (2, 1),
    "bottom": (2, -1),
}


def shape_features(placed: PlacedShape) -> Features:
    """The named faces, edges and vertices of a placed shape; None for round shapes.

    The names of a block's features are fixed.
    """
    T = transforms.of_pose(placed.pose)
    match placed.shape:
        case Box():
            return _moved_features(T, *_box_features(placed.shape))
        case Polyhedron():
            return _moved_features(T, *_polyhedron_features(placed.shape))
        case _:
            return Features({}, {}, {})


def _moved_features(
    T: Floats, vertices: dict[str, Floats], faces: dict[str, list[str]], edges: dict[str, list[str]]
) -> Features:
    placed = {name: transforms.apply(T, point[None])[0] for name, point in vertices.items()}
    return Features(
        {
            name: _patch_face(name, np.array([placed[v] for v in corners]))
            for name, corners in faces.items()
        },
        {name: np.array([placed[v] for v in ends]) for name, ends in edges.items()},
        placed,
    )


def _patch_face(name: str, corners: Floats) -> PatchFace:
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
    sides = [
        [("left", -1), ("right", 1)],
        [("front", -1), ("back", 1)],
        [("bottom", -1), ("top", 1)],
    ]
    vertices = {f"{x}_{y}_{z}": half * (i, j, k) for (x, i), (y, j), (z, k) in product(*sides)}
    faces: dict[str, list[str]] = {}
    for name, (axis, side) in BOX_FACES.items():
        u, v = (axis + 1) % 3, (axis + 2) % 3
        around = [(-1, -1), (1, -1), (1, 1), (-1, 1)][::side]
        faces[name] = [_vertex_name(vertices, {axis: side, u: a, v: b}) for a, b in around]
    names = sorted(vertices)
    edges: dict[str, list[str]] = {}
    for index, a in enumerate(names):
        for b in names[index + 1 :]:
            common = [part for part in a.split("_") if part in b.split("_")]
            if len(common) == 2:
                edges["_".join(common)] = [a, b]
    return vertices, faces, edges


def _vertex_name(vertices: dict[str, Floats], signs: dict[int, int]) -> str:
    return next(
        name
        for name, p in vertices.items()
        if all(p[axis] * sign > 0 for axis, sign in signs.items())
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
    """Errors in the named faces: fewer than three vertices, not planar, or (in a convex polyhedron)
    turned inwards.
    """
    problems = []
    vertices = {name: np.array(point) for name, point in shape.vertices.items()}
    middle = np.mean(list(vertices.values()), axis=0)
    for face in shape.faces:
        corners = np.array([vertices[name] for name in face.vertices]).reshape(-1, 3)
        size = float(np.ptp(corners, axis=0).max()) if len(corners) else 0.0
        problem, hint = _face_problem(corners, size, middle, convex=not shape.pieces)
        if problem:
            where = shape.where if face.where == NOWHERE else face.where
            problems.append(Diagnostic(where, "K702", f"face '{face.name}' {problem}", hint))
    return problems


def _face_problem(corners: Floats, size: float, middle: Floats, convex: bool) -> tuple[str, str]:
    normal = (
        np.cross(corners, np.roll(corners, -1, axis=0)).sum(axis=0)
        if len(corners) > 2
        else np.zeros(3)
    )
    length = norm(normal)
    if len(corners) < 3 or length < 1e-12 * max(size, 1e-12) ** 2:
        return "has no area", "name three or more of its corners"
    height = matmul(corners - corners[0], normal / length)
    if np.abs(height).max() > 1e-6 * size:
        return "is not planar", "split it into triangles"
    if convex and matmul(corners[0] - middle, normal) < 0:
        return "is turned inwards", "name its vertices counter-clockwise as seen from outside"
    return "", ""
