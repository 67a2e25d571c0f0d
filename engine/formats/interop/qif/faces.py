"""Faces of a part: surfaces with the loops that bound their material, as a QIF document describes them (`Product`).

A loop is read from its curves in the parameters of the surface. If a curve is missing there, or does not lie on the edge in
space, the edges in space are taken instead. Loops that go round a cylinder, a sphere or the like are closed by a seam.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from cellwright.engine.formats.interop.qif.curves import chain, core_of, trimmed
from cellwright.engine.formats.interop.qif.document import Element
from cellwright.engine.formats.interop.qif.loops import Loop, bounds, dense
from cellwright.engine.formats.interop.qif.parametric import Surface, moved
from cellwright.engine.formats.interop.qif.reading import Reading, is_true
from cellwright.engine.formats.interop.qif.regions import inside, rows
from cellwright.engine.formats.interop.qif.surfaces import surface
from cellwright.engine.kernels.arrays import Floats, Truths

AGREEMENT = 2e-3  # how far a curve may lie from its edge, as a share of the size of the face
FINE = 400  # places along the longest extent of a face, by which distances to edges are told
Motion = tuple[Floats, Floats]
STILL: Motion = (np.eye(3), np.zeros(3))


@dataclass(frozen=True, slots=True, eq=False)
class Face:
    """The material between `outer` and `holes`: closed polygons in the parameters of the surface.

    `gaps` says how far points (n, 3) are at least from the real edges, infinite without any. `turned` says that the normal of the
    surface points into the material.
    """

    name: str
    surface: Surface
    outer: tuple[Floats, ...]
    holes: tuple[Floats, ...]
    gaps: Callable[[Floats], Floats]
    size: float
    turned: bool

    def within(self, parameters: Floats) -> Truths:
        """Whether each of the parameters (n, 2) lies on material."""
        found = inside(self.outer, parameters)
        if self.holes:
            found &= ~inside(self.holes, parameters)
        return found

    def lifted(self, parameters: Floats) -> Floats:
        """The parameters moved by whole periods into the range of the outer loop, as far as that goes."""
        low = np.concatenate(self.outer).min(axis=0) if self.outer else np.zeros(2)
        found = parameters.copy()
        for axis, period in enumerate(self.surface.periods):
            if period:
                found[:, axis] = low[axis] + (found[:, axis] - low[axis]) % period
        return found

    def candidates(self, count: int) -> tuple[Floats, Floats]:
        """Parameters (n, 2) of points on material, on `count` rows, and the area in parameters of each."""
        found, areas = rows([*self.outer, *self.holes], count)
        if not (self.holes and any(self.surface.periods)):
            return found, areas
        keep = self.within(found)  # holes that also stand one period further may lie outside
        return found[keep], areas[keep]

    def normals(self, parameters: Floats) -> tuple[Floats, Floats]:
        """Unit normals (n, 3) away from the material, and the size of the surface for each unit of u times v."""
        normals, size = self.surface.normals(parameters)
        return (-normals if self.turned else normals), size


class Product:
    """The faces and edges of a document, made when they are asked for."""

    def __init__(self, root: Element, reading: Reading) -> None:
        self._reading = reading
        self._found = {each.attributes["id"]: each for each in _all(root) if "id" in each.attributes}
        self._faces: dict[str, Face | None] = {}
        self._motions = dict(self._body_motions(root))
        self._reversed = frozenset(_reversed(root))
        self._meeting: dict[str, tuple[str, ...]] | None = None

    def kind(self, name: str) -> str:
        """The tag of the element with an id; empty if there is none."""
        return self._found[name].tag if name in self._found else ""

    def surface_kind(self, name: str) -> str:
        """The tag of the surface of a face."""
        return self._at(self._found[name], "Surface").tag if name in self._found else ""

    def face(self, name: str) -> Face | None:
        """The face of an id; None if it is not known, or its surface is not. Raises `InvalidInput`."""
        if name not in self._faces:
            element = self._found.get(name)
            is_face = element is not None and element.tag == "Face"
            self._faces[name] = self._face(name, element) if is_face and element is not None else None
        return self._faces[name]

    def edge(self, name: str) -> Floats | None:
        """Points (n, 3) along the edge of an id; None if it is not known."""
        element = self._found.get(name)
        points = self._curve13(element) if element is not None and element.tag == "Edge" else None
        if points is None:
            return None
        bodies = (self._motions[each] for each in (name, *self.faces_at(name)) if each in self._motions)
        turn, origin = next(bodies, STILL)
        return points @ turn.T + origin

    def faces_at(self, edge: str) -> tuple[str, ...]:
        """The ids of the faces that meet in an edge."""
        if self._meeting is None:
            self._meeting = self._meetings()
        return self._meeting.get(edge, ())

    def _meetings(self) -> dict[str, tuple[str, ...]]:
        """The faces at each edge."""
        found: dict[str, dict[str, None]] = {}
        for name, element in self._found.items():
            for loop in self._loop_ids(element) if element.tag == "Face" else ():
                for coedge in _coedges(self._found.get(loop)):
                    found.setdefault(coedge.text_at("EdgeOriented", "Id"), {})[name] = None
        return {edge: tuple(names) for edge, names in found.items()}

    def _at(self, element: Element, tag: str) -> Element:
        """The element that a reference leads to; an empty one if it leads nowhere."""
        return self._found.get(element.text_at(tag, "Id"), Element("", {}, element.line))

    def _motion(self, element: Element) -> Motion:
        matrix = self._found.get(element.text_at("Transform", "Id"))
        if matrix is None:
            return STILL
        turn = matrix.at("Rotation")
        axes = [self._reading.vector(turn, f"{name}Direction") for name in "XYZ"] if turn else list(np.eye(3))
        origin = self._reading.vector(matrix, "Origin") if matrix.at("Origin") else np.zeros(3)
        return np.stack(axes, axis=1), origin

    def _body_motions(self, root: Element) -> Iterator[tuple[str, Motion]]:
        bodies = root.at("Product", "TopologySet", "BodySet")
        for body in bodies.children if bodies is not None else ():
            if body.at("Transform", "Id") is not None:
                members = [group for tag in ("FaceIds", "EdgeIds") if (group := body.at(tag)) is not None]
                for each in (item for group in members for item in group.all("Id")):
                    yield each.text.strip(), self._motion(body)

    def _curve13(self, edge: Element) -> Floats | None:
        """Points along an edge in space, in its own direction."""
        curve = self._at(edge, "Curve")
        if (core := core_of(curve)) is None:
            return None
        turn, origin = self._motion(curve)
        points = chain(core, 3, self._reading) @ turn.T + origin
        ends = [self._vertex(edge, name) for name in ("VertexBeg", "VertexEnd")]
        if ends[0] is not None and ends[1] is not None:
            points = trimmed(points, ends[0], ends[1])
        return points

    def _vertex(self, edge: Element, tag: str) -> Floats | None:
        point = self._at(self._at(edge, tag), "Point")
        return self._reading.vector(point, "XYZ") if point.at("XYZ") is not None else None

    def _face(self, name: str, element: Element) -> Face | None:
        of = self._at(element, "Surface")
        base = surface(of, self._reading)
        if base is None:
            return None
        base = _after(base, self._motion(of))
        loops = [self._found[each] for each in self._loop_ids(element) if each in self._found]
        whole = [found for each in loops if (found := self._loop(each, base)).edges]
        turned = is_true(element, "turned") != (name in self._reversed)
        placed = _after(base, self._motions.get(name, STILL))
        return _bounded(name, base, placed, whole, is_true(element, "hasOuter", otherwise=True), turned)

    def _loop_ids(self, face: Element) -> list[str]:
        group = face.at("LoopIds")
        return [each.text.strip() for each in group.all("Id")] if group is not None else []

    def _loop(self, loop: Element, base: Surface) -> Loop:
        """The edges of a loop in the parameters of the surface."""
        found = []
        for coedge in _coedges(loop):
            oriented = coedge.at("EdgeOriented")
            name = oriented.text_at("Id") if oriented is not None else ""
            edge = self._found.get(name)
            space = self._curve13(edge) if edge is not None else None
            if space is not None and oriented is not None and is_true(oriented, "turned"):
                space = space[::-1]
            if (flat := self._flat(coedge, space, base)) is not None:
                found.append((name, flat))
        return Loop(loop.attributes.get("form", "UNKNOWN"), tuple(found))

    def _flat(self, coedge: Element, space: Floats | None, base: Surface) -> Floats | None:
        """Points of a coedge in the parameters of the surface."""
        core = core_of(self._at(coedge, "Curve12"))
        flat = chain(core, 2, self._reading) if core is not None else None
        if space is None or (flat is not None and _agree(base.at(flat[[0, -1]]), space)):
            return flat
        return _unwrapped(base, space)


def _all(element: Element) -> Iterator[Element]:
    stack = [element]
    while stack:
        found = stack.pop()
        yield found
        stack += found.children


def _reversed(root: Element) -> Iterator[str]:
    """The ids of the faces whose shell is turned against them."""
    shells = root.at("Product", "TopologySet", "ShellSet")
    for shell in shells.children if shells is not None else ():
        group = shell.at("FaceIds")
        if group is not None and is_true(shell, "turned"):
            yield from (each.text.strip() for each in group.all("Id"))


def _coedges(loop: Element | None) -> Iterator[Element]:
    group = loop.at("CoEdges") if loop is not None else None
    return group.all("CoEdge") if group is not None else iter(())


def _agree(ends: Floats, space: Floats) -> bool:
    """Whether two ends are those of a chain of points in space, in one order or the other."""
    own = space[[0, -1]]
    size = max(float(np.ptp(space, axis=0).max()), 1e-9)
    gap = min(float(np.abs(ends - own).max()), float(np.abs(ends - own[::-1]).max()))
    return gap <= AGREEMENT * size + 1e-6


def _unwrapped(base: Surface, space: Floats) -> Floats:
    """Parameters along points in space, without jumps by a period. At a pole the angle is that of the nearest neighbour."""
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


def _angle_is_sure(base: Surface, flat: Floats, axis: int) -> Truths:
    """Where a parameter moves a point at all: not at a pole."""
    speed = np.linalg.norm(base.derivatives(flat)[axis], axis=1)
    found: Truths = speed > 1e-6 * max(float(speed.max()), 1e-300)
    return found


def _after(base: Surface, motion: Motion) -> Surface:
    return base if motion is STILL else moved(base, *motion)


def _bounded(
    name: str, base: Surface, placed: Surface, loops: Sequence[Loop], has_outer: bool, turned: bool
) -> Face:
    """The face between loops on a surface that its body has `placed`. An edge that it uses twice is a seam, not a border."""
    outer, holes = bounds(loops, base, has_outer)
    used = Counter(edge for loop in loops for edge, _ in loop.edges)
    border = [flat for loop in loops for edge, flat in loop.edges if not edge or used[edge] == 1]
    size = float(np.ptp(placed.at(np.concatenate(outer)), axis=0).max())
    edges = [dense(placed, each, size / FINE) for each in border]
    return Face(name, placed, outer, holes, _gaps(edges, size / FINE), size, turned)


def _gaps(edges: Sequence[Floats], apart: float) -> Callable[[Floats], Floats]:
    """The least that the distance (n,) to edges can be, known from points along them that are at most `apart`."""
    from scipy.spatial import cKDTree

    if not edges:
        return lambda places: np.full(len(places), np.inf)
    near = cKDTree(np.concatenate(edges), 32, compact_nodes=False, balanced_tree=False)

    def gaps(places: Floats) -> Floats:
        far, _ = near.query(places)
        found: Floats = np.sqrt(np.maximum(far**2 - (apart / 2) ** 2, 0.0))
        return found

    return gaps
