"""Faces and edges of a part from a QIF document: surfaces, and loops that bound their material."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from cellwright.engine.formats.interop.qif.curves import core_of, curve_chain, trim_chain
from cellwright.engine.formats.interop.qif.polygon_regions import points_inside, row_points
from cellwright.engine.formats.interop.qif.qif_document import DocumentReading, QifElement, is_true
from cellwright.engine.formats.interop.qif.qif_surfaces import (
    ParametricSurface,
    move_surface,
    surface_of,
)
from cellwright.engine.kernels.arrays import Floats, Longs, Truths

SEAM_TOLERANCE = 1e-3  # of a period: gaps this near to whole periods are seams
PARTS_OF_STEP = 16
# of the domain: a piece is turned only if it then fits better by more than this
TURN_ADVANTAGE = 1e-6
MAX_EDGE_POINTS = 20_000  # points along one edge


@dataclass(frozen=True, slots=True, eq=False)
class Loop:
    """The edges of a loop in order: their ids, and points (n, 2) along each in parameters.

    `form` is OUTER, INNER or another.
    """

    form: str
    edges: tuple[tuple[str, Floats], ...]


def material_polygons(
    loops: Sequence[Loop], base: ParametricSurface, has_outer: bool
) -> tuple[tuple[Floats, ...], tuple[Floats, ...]]:
    """The closed polygons around material, and those around holes in it.

    Without an outer loop, the domain of the surface bounds the material.
    """
    joined = [(loop.form, _join_pieces([flat for _, flat in loop.edges], base)) for loop in loops]
    round_about = [flat for _, flat in joined if _turns_around(flat, base).any()]
    closed = [(form, flat) for form, flat in joined if not _turns_around(flat, base).any()]
    outer = [flat for form, flat in closed if has_outer and form not in ("INNER", "SLIT")]
    holes = [flat for form, flat in closed if not has_outer or form == "INNER"]
    outer += _close_seams(round_about, base)
    outer = outer or [_domain_polygon(base)]
    return tuple(outer), tuple(copy for hole in holes for copy in _hole_copies(hole, outer, base))


def _join_pieces(pieces: Sequence[Floats], base: ParametricSurface) -> Floats:
    """Pieces one behind the other.

    Pieces that run the other way are turned, gaps of whole periods are closed.
    """
    first = pieces[0]
    if (
        len(pieces) > 1
        and _gap_between(first, pieces[1], base)
        > _gap_between(first[::-1], pieces[1], base) + TURN_ADVANTAGE
    ):
        first = first[::-1]
    pieces_joined = [first]
    for piece in pieces[1:]:
        last = pieces_joined[-1][-1]
        forth, back = (_parameter_distance(last, end, base) for end in (piece[0], piece[-1]))
        piece = piece if forth <= back + TURN_ADVANTAGE else piece[::-1]
        pieces_joined.append(piece - _whole_periods(piece[0] - last, base) * np.array(base.periods))
    return np.concatenate(pieces_joined)


def _gap_between(first: Floats, second: Floats, base: ParametricSurface) -> float:
    return min(_parameter_distance(first[-1], end, base) for end in (second[0], second[-1]))


def _parameter_distance(p: Floats, q: Floats, base: ParametricSurface) -> float:
    """How far two parameters are from each other, round the surface, as shares of the domain."""
    size = [max(last - first, 1e-300) for first, last in base.domain]
    gap = q - p
    for axis, period in enumerate(base.periods):
        if period:
            gap[axis] -= period * round(gap[axis] / period)
    return float(np.abs(gap / size).max())


def _whole_periods(gap: Floats, base: ParametricSurface) -> Longs:
    """How many periods a gap has along each axis, if it has nearly a whole number of them;
    otherwise 0.
    """
    periods = np.zeros(2, np.int64)
    for axis, period in enumerate(base.periods):
        if period and abs(gap[axis] / period - round(gap[axis] / period)) < SEAM_TOLERANCE:
            periods[axis] = round(gap[axis] / period)
    return periods


def _turns_around(flat: Floats, base: ParametricSurface) -> Longs:
    """How often a chain of points goes round the surface along each axis before it comes back."""
    return _whole_periods(flat[-1] - flat[0], base)


def _close_seams(chains: Sequence[Floats], base: ParametricSurface) -> list[Floats]:
    """Polygons from chains that go round the surface: two make a band; one reaches to the end
    of the surface at its left.
    """
    polygons, left = [], list(chains)
    while len(left) > 1:
        first = left.pop(0)
        turns = _turns_around(first, base)
        second = next(
            (chain for chain in left if (_turns_around(chain, base) == -turns).all()), None
        )
        if second is None:
            second = left[0]
            polygons.append(_band_polygon(first, second[::-1], base))
        else:
            polygons.append(_band_polygon(first, second, base))
        left = [chain for chain in left if chain is not second]
    return polygons + [_cap_polygon(chain, base) for chain in left]


def _band_polygon(first: Floats, second: Floats, base: ParametricSurface) -> Floats:
    """The polygon between two chains that go round in opposite directions."""
    periods = np.array([period or 1.0 for period in base.periods])
    shift = np.round((second[0] - first[-1]) / periods) * np.array(base.periods)
    return np.concatenate([first, second - shift])


def _cap_polygon(flat: Floats, base: ParametricSurface) -> Floats:
    """The polygon between a chain and the end of the surface at its left: a pole, a tip or the
    end of its domain.
    """
    axis = int(np.argmax(np.abs(_turns_around(flat, base))))
    across = 1 - axis
    leftwards = _turns_around(flat, base)[axis] * (1 if axis == 0 else -1) > 0
    stop = base.domain[across][1 if leftwards else 0]
    ends = flat[[-1, 0]].copy()
    ends[:, across] = stop
    return np.concatenate([flat, ends])


def _domain_polygon(base: ParametricSurface) -> Floats:
    (a, b), (c, d) = base.domain
    return np.array([[a, c], [b, c], [b, d], [a, d]])


def _hole_copies(hole: Floats, outer: Sequence[Floats], base: ParametricSurface) -> list[Floats]:
    """A hole wherever whole periods bring it to the outer loops."""
    around = np.concatenate(outer)
    low, high = around.min(axis=0), around.max(axis=0)
    copies = []
    for i in range(-2, 3) if base.periods[0] else (0,):
        for j in range(-2, 3) if base.periods[1] else (0,):
            copy = hole + np.array([i * base.periods[0], j * base.periods[1]])
            if (copy.max(axis=0) >= low).all() and (copy.min(axis=0) <= high).all():
                copies.append(copy)
    return copies


def densify_chain(base: ParametricSurface, flat: Floats, apart: float) -> Floats:
    """Points (n, 3) along a chain of parameters, at most about `apart` from one another."""
    fine = _divide_steps(flat, np.full(len(flat) - 1, PARTS_OF_STEP))
    ways = np.linalg.norm(np.diff(base.at(fine), axis=0), axis=1)
    counts = np.maximum(1, np.ceil(ways / max(apart, float(ways.sum()) / MAX_EDGE_POINTS, 1e-300)))
    return base.at(_divide_steps(fine, counts.astype(np.int64)))


def _divide_steps(flat: Floats, counts: Longs) -> Floats:
    """A chain with each step divided into as many as `counts` says."""
    if not len(counts):
        return flat
    at = np.repeat(np.arange(len(counts)), counts)
    part = (np.arange(len(at)) - np.repeat(np.cumsum(counts) - counts, counts)) / counts[at]
    points = flat[at] + part[:, None] * (flat[at + 1] - flat[at])
    return np.concatenate([points, flat[-1:]])


EDGE_AGREEMENT = 2e-3  # how far a curve may lie from its edge, as a share of the size of the face
# places along the longest extent of a face, by which distances to edges are told
PLACES_ALONG_FACE = 400
Motion = tuple[Floats, Floats]
IDENTITY_MOTION: Motion = (np.eye(3), np.zeros(3))


@dataclass(frozen=True, slots=True, eq=False)
class PartFace:
    """The material between `outer` and `holes`: closed polygons in the parameters of the surface.

    `gaps` says how far points (n, 3) are at least from the real edges, infinite without any.
    `turned` says that the normal of the surface points into the material.
    """

    name: str
    surface: ParametricSurface
    outer: tuple[Floats, ...]
    holes: tuple[Floats, ...]
    gaps: Callable[[Floats], Floats]
    size: float
    turned: bool

    def within(self, parameters: Floats) -> Truths:
        """Whether each of the parameters (n, 2) lies on material."""
        on_material = points_inside(self.outer, parameters)
        if self.holes:
            on_material &= ~points_inside(self.holes, parameters)
        return on_material

    def lifted(self, parameters: Floats) -> Floats:
        """The parameters moved by whole periods into the range of the outer loop, as far as
        that goes.
        """
        low = np.concatenate(self.outer).min(axis=0) if self.outer else np.zeros(2)
        shifted = parameters.copy()
        for axis, period in enumerate(self.surface.periods):
            if period:
                shifted[:, axis] = low[axis] + (shifted[:, axis] - low[axis]) % period
        return shifted

    def candidates(self, count: int) -> tuple[Floats, Floats]:
        """Parameters (n, 2) of points on material, on `count` rows, and the area in parameters
        of each.
        """
        parameters, areas = row_points([*self.outer, *self.holes], count)
        if not (self.holes and any(self.surface.periods)):
            return parameters, areas
        keep = self.within(parameters)  # holes that also stand one period further may lie outside
        return parameters[keep], areas[keep]

    def normals(self, parameters: Floats) -> tuple[Floats, Floats]:
        """Unit normals (n, 3) away from the material, and the size of the surface for each unit
        of u times v.
        """
        normals, size = self.surface.normals(parameters)
        return (-normals if self.turned else normals), size


class Product:
    """The faces and edges of a document, made when they are asked for."""

    def __init__(self, root: QifElement, reading: DocumentReading) -> None:
        self._reading = reading
        self._found = {
            element.attributes["id"]: element
            for element in _all_elements(root)
            if "id" in element.attributes
        }
        self._faces: dict[str, PartFace | None] = {}
        self._motions = dict(self._body_motions(root))
        self._reversed = frozenset(_reversed_faces(root))
        self._meeting: dict[str, tuple[str, ...]] | None = None

    def kind(self, name: str) -> str:
        """The tag of the element with an id; empty if there is none."""
        return self._found[name].tag if name in self._found else ""

    def surface_kind(self, name: str) -> str:
        """The tag of the surface of a face."""
        return self._at(self._found[name], "Surface").tag if name in self._found else ""

    def face(self, name: str) -> PartFace | None:
        """The face of an id; None if it is not known, or its surface is not.

        Raises `InvalidInput`.
        """
        if name not in self._faces:
            element = self._found.get(name)
            is_face = element is not None and element.tag == "Face"
            self._faces[name] = (
                self._face(name, element) if is_face and element is not None else None
            )
        return self._faces[name]

    def edge(self, name: str) -> Floats | None:
        """Points (n, 3) along the edge of an id; None if it is not known."""
        element = self._found.get(name)
        points = self._curve13(element) if element is not None and element.tag == "Edge" else None
        if points is None:
            return None
        bodies = (
            self._motions[entity]
            for entity in (name, *self.faces_at(name))
            if entity in self._motions
        )
        turn, origin = next(bodies, IDENTITY_MOTION)
        return points @ turn.T + origin

    def faces_at(self, edge: str) -> tuple[str, ...]:
        """The ids of the faces that meet in an edge."""
        if self._meeting is None:
            self._meeting = self._meetings()
        return self._meeting.get(edge, ())

    def _meetings(self) -> dict[str, tuple[str, ...]]:
        """The faces at each edge."""
        faces_of_edges: dict[str, dict[str, None]] = {}
        for name, element in self._found.items():
            for loop in self._loop_ids(element) if element.tag == "Face" else ():
                for coedge in _coedges_of(self._found.get(loop)):
                    faces_of_edges.setdefault(coedge.text_at("EdgeOriented", "Id"), {})[name] = None
        return {edge: tuple(names) for edge, names in faces_of_edges.items()}

    def _at(self, element: QifElement, tag: str) -> QifElement:
        """The element that a reference leads to; an empty one if it leads nowhere."""
        return self._found.get(element.text_at(tag, "Id"), QifElement("", {}, element.line))

    def _motion(self, element: QifElement) -> Motion:
        matrix = self._found.get(element.text_at("Transform", "Id"))
        if matrix is None:
            return IDENTITY_MOTION
        turn = matrix.at("Rotation")
        axes = (
            [self._reading.vector(turn, f"{name}Direction") for name in "XYZ"]
            if turn
            else list(np.eye(3))
        )
        origin = self._reading.vector(matrix, "Origin") if matrix.at("Origin") else np.zeros(3)
        return np.stack(axes, axis=1), origin

    def _body_motions(self, root: QifElement) -> Iterator[tuple[str, Motion]]:
        bodies = root.at("Product", "TopologySet", "BodySet")
        for body in bodies.children if bodies is not None else ():
            if body.at("Transform", "Id") is not None:
                members = [
                    group for tag in ("FaceIds", "EdgeIds") if (group := body.at(tag)) is not None
                ]
                for id_element in (item for group in members for item in group.all("Id")):
                    yield id_element.text.strip(), self._motion(body)

    def _curve13(self, edge: QifElement) -> Floats | None:
        """Points along an edge in space, in its own direction."""
        curve = self._at(edge, "Curve")
        if (core := core_of(curve)) is None:
            return None
        turn, origin = self._motion(curve)
        points = curve_chain(core, 3, self._reading) @ turn.T + origin
        ends = [self._vertex(edge, name) for name in ("VertexBeg", "VertexEnd")]
        if ends[0] is not None and ends[1] is not None:
            points = trim_chain(points, ends[0], ends[1])
        return points

    def _vertex(self, edge: QifElement, tag: str) -> Floats | None:
        point = self._at(self._at(edge, tag), "Point")
        return self._reading.vector(point, "XYZ") if point.at("XYZ") is not None else None

    def _face(self, name: str, element: QifElement) -> PartFace | None:
        of = self._at(element, "Surface")
        base = surface_of(of, self._reading)
        if base is None:
            return None
        base = _move_surface(base, self._motion(of))
        loops = [
            self._found[loop_id] for loop_id in self._loop_ids(element) if loop_id in self._found
        ]
        whole = [
            face_loop
            for loop_element in loops
            if (face_loop := self._loop(loop_element, base)).edges
        ]
        turned = is_true(element, "turned") != (name in self._reversed)
        placed = _move_surface(base, self._motions.get(name, IDENTITY_MOTION))
        return _bounded_face(
            name, base, placed, whole, is_true(element, "hasOuter", otherwise=True), turned
        )

    def _loop_ids(self, face: QifElement) -> list[str]:
        group = face.at("LoopIds")
        return (
            [id_element.text.strip() for id_element in group.all("Id")] if group is not None else []
        )

    def _loop(self, loop: QifElement, base: ParametricSurface) -> Loop:
        """The edges of a loop in the parameters of the surface."""
        edges = []
        for coedge in _coedges_of(loop):
            oriented = coedge.at("EdgeOriented")
            name = oriented.text_at("Id") if oriented is not None else ""
            edge = self._found.get(name)
            space = self._curve13(edge) if edge is not None else None
            if space is not None and oriented is not None and is_true(oriented, "turned"):
                space = space[::-1]
            if (flat := self._flat(coedge, space, base)) is not None:
                edges.append((name, flat))
        return Loop(loop.attributes.get("form", "UNKNOWN"), tuple(edges))

    def _flat(
        self, coedge: QifElement, space: Floats | None, base: ParametricSurface
    ) -> Floats | None:
        """Points of a coedge in the parameters of the surface."""
        core = core_of(self._at(coedge, "Curve12"))
        flat = curve_chain(core, 2, self._reading) if core is not None else None
        if space is None or (flat is not None and _ends_agree(base.at(flat[[0, -1]]), space)):
            return flat
        return _unwrap_parameters(base, space)


def _all_elements(element: QifElement) -> Iterator[QifElement]:
    stack = [element]
    while stack:
        popped = stack.pop()
        yield popped
        stack += popped.children


def _reversed_faces(root: QifElement) -> Iterator[str]:
    """The ids of the faces whose shell is turned against them."""
    shells = root.at("Product", "TopologySet", "ShellSet")
    for shell in shells.children if shells is not None else ():
        group = shell.at("FaceIds")
        if group is not None and is_true(shell, "turned"):
            yield from (id_element.text.strip() for id_element in group.all("Id"))


def _coedges_of(loop: QifElement | None) -> Iterator[QifElement]:
    group = loop.at("CoEdges") if loop is not None else None
    return group.all("CoEdge") if group is not None else iter(())


def _ends_agree(ends: Floats, space: Floats) -> bool:
    """Whether two ends are those of a chain of points in space, in one order or the other."""
    own = space[[0, -1]]
    size = max(float(np.ptp(space, axis=0).max()), 1e-9)
    gap = min(float(np.abs(ends - own).max()), float(np.abs(ends - own[::-1]).max()))
    return gap <= EDGE_AGREEMENT * size + 1e-6


def _unwrap_parameters(base: ParametricSurface, space: Floats) -> Floats:
    """Parameters along points in space, without jumps by a period.

    At a pole the angle is that of the nearest neighbour.
    """
    flat = base.parameters(space)
    for axis, period in enumerate(base.periods):
        if period:
            sure = _angle_is_sure(base, flat, axis)
            if sure.any():
                at = np.arange(len(flat))
                nearest = at[sure][np.argmin(np.abs(at[:, None] - at[sure]), axis=1)]
                flat[:, axis] = flat[nearest, axis]
            flat[:, axis] = np.unwrap(flat[:, axis], period=period)
    return flat


def _angle_is_sure(base: ParametricSurface, flat: Floats, axis: int) -> Truths:
    """Where a parameter moves a point at all: not at a pole."""
    speed = np.linalg.norm(base.derivatives(flat)[axis], axis=1)
    is_sure: Truths = speed > 1e-6 * max(float(speed.max()), 1e-300)
    return is_sure


def _move_surface(base: ParametricSurface, motion: Motion) -> ParametricSurface:
    return base if motion is IDENTITY_MOTION else move_surface(base, *motion)


def _bounded_face(
    name: str,
    base: ParametricSurface,
    placed: ParametricSurface,
    loops: Sequence[Loop],
    has_outer: bool,
    turned: bool,
) -> PartFace:
    """The face between loops on a surface that its body has `placed`.

    An edge that it uses twice is a seam, not a border.
    """
    outer, holes = material_polygons(loops, base, has_outer)
    used = Counter(edge for loop in loops for edge, _ in loop.edges)
    border = [flat for loop in loops for edge, flat in loop.edges if not edge or used[edge] == 1]
    size = float(np.ptp(placed.at(np.concatenate(outer)), axis=0).max())
    edges = [densify_chain(placed, border_edge, size / PLACES_ALONG_FACE) for border_edge in border]
    return PartFace(
        name, placed, outer, holes, _gaps_to_edges(edges, size / PLACES_ALONG_FACE), size, turned
    )


def _gaps_to_edges(edges: Sequence[Floats], apart: float) -> Callable[[Floats], Floats]:
    """The least that the distance (n,) to edges can be, known from points along them that are
    at most `apart`.
    """
    from scipy.spatial import cKDTree

    if not edges:
        return lambda places: np.full(len(places), np.inf)
    near = cKDTree(np.concatenate(edges), 32, compact_nodes=False, balanced_tree=False)

    def gaps(places: Floats) -> Floats:
        far, _ = near.query(places)
        gap: Floats = np.sqrt(np.maximum(far**2 - (apart / 2) ** 2, 0.0))
        return gap

    return gaps
