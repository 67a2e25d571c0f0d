"""How many points a feature needs, and where they lie on the material of its faces or edges.

The rules come from the QIF example `featureRules2` (after Lockheed Martin 100-46, "Inspection and
Acceptance Criteria", 2010), whose unit is the inch. If several rules apply, the largest count is
taken. The rules for a diameter give the number of points on each cross-section, as their text says.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cellwright.engine.formats.interop.qif.part_faces import PartFace, Product
from cellwright.engine.formats.interop.qif.polygon_regions import spread_points
from cellwright.engine.kernels.arrays import Floats, Truths
from cellwright.engine.model.part_measurements import DrawnFeature

INCH_M = 0.0254
DIAMETER_POINTS = ((0.001, 32), (0.002, 24), (0.005, 18), (0.010, 12), (0.020, 8), (0.040, 5))
PROFILE_DENSITY = ((0.010, 0.2), (0.030, 0.1))  # points for each square inch
DEFAULT_COUNT = 3


def surface_points(area_m2: float, feature: DrawnFeature) -> int:
    """Points on a surface: by its area and its profile tolerance."""
    area, profile = area_m2 / INCH_M**2, feature.tolerances.get("SurfaceProfile", math.inf) / INCH_M
    counts = [DEFAULT_COUNT]
    counts += [4] if area > 2 else []
    counts += [5] if area > 25 else []
    density = next((density for limit, density in PROFILE_DENSITY if profile < limit), 0.0)
    return max(*counts, math.ceil(density * area - 1e-9))


def curve_points(length_m: float, feature: DrawnFeature) -> int:
    """Points on a curve: by its length, and by its diameter's tolerance if it has one."""
    length = length_m / INCH_M
    counts = [DEFAULT_COUNT, section_points(feature)]
    counts += [math.ceil(length - 1e-9)] if length < 5 else []
    counts += [5] if length > 5 else []
    return max(counts)


def section_points(feature: DrawnFeature) -> int:
    """Points on each cross-section, by the tolerance of the diameter; 0 if it has none."""
    tolerance = feature.tolerances.get("Diameter", math.inf) / INCH_M
    return next((count for limit, count in DIAMETER_POINTS if tolerance < limit), 0)


Placed = list[tuple[Floats, Floats]]  # positions and normals
# of the way from the edges to the middle: how far points stay away if nobody says it
MARGIN_SHARE = 0.16
NARROW_SHARE = 0.9  # the same share where material is too narrow for the distance that is asked for
ROW_COUNTS = (40, 160)
# how far a place may lie beside a surface, as a share of the size of its face
SURFACE_TOLERANCE = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class MaterialPlaces:
    """Places (n, 3) on material, their normals away from it, how far they are from an edge, and
    the area of each.
    """

    places: Floats
    normals: Floats
    gaps: Floats
    areas: Floats

    def only(self, keep: Truths) -> "MaterialPlaces":
        """The places for which `keep` holds."""
        return MaterialPlaces(
            self.places[keep], self.normals[keep], self.gaps[keep], self.areas[keep]
        )


def material_places(faces: Sequence[PartFace], rows: int = ROW_COUNTS[0]) -> MaterialPlaces:
    """Places all over the material of faces."""
    parts = [_of_face(face, rows) for face in faces]
    return MaterialPlaces(*(np.concatenate([part[i] for part in parts]) for i in range(4)))


def _of_face(face: PartFace, rows: int) -> tuple[Floats, Floats, Floats, Floats]:
    parameters, areas = face.candidates(rows)
    places = face.surface.at(parameters)
    normals, size = face.normals(parameters)
    return places, normals, face.gaps(places), areas * size


@dataclass(frozen=True, slots=True, eq=False)
class PointChoice:
    """Points on material, and how far from an edge they are at least; `narrow` if that is less
    than asked for.
    """

    points: Placed
    gap: float
    narrow: bool


def choose_points(
    faces: Sequence[PartFace],
    places: MaterialPlaces,
    wanted: Placed,
    count: int,
    margin: float | None = None,
) -> PointChoice | None:
    """`count` points on faces: those of `wanted` that lie on material, and others from `places`;
    None without any material.

    `margin` is the least distance from an edge; if it is not given, it follows from the size of the
    material.
    """
    if not len(places.places):
        return None
    widest = float(places.gaps.max())
    least = MARGIN_SHARE * widest if margin is None else margin
    least = 0.0 if not np.isfinite(least) else least
    narrow = widest < least
    if narrow:
        least = NARROW_SHARE * widest
    free = places.only(places.gaps >= least)
    taken = [on_face for wish in wanted if (on_face := _on_one(faces, wish[0], least)) is not None]
    at = np.array([place for place, _ in taken]).reshape(-1, 3)
    more = spread_points(free.places, count - len(taken), at)
    points = [*taken, *((free.places[i], free.normals[i]) for i in more)]
    return PointChoice(points[:count], least, narrow)


def _on_one(faces: Sequence[PartFace], place: Floats, least: float) -> tuple[Floats, Floats] | None:
    """A place on the material of one of the faces, at least so far from its edges, with the
    normal; None if it is on none.
    """
    for face in faces:
        parameters = face.lifted(face.surface.parameters(place[None]))
        there = face.surface.at(parameters)
        beside = float(np.linalg.norm(there[0] - place))
        if (
            beside <= SURFACE_TOLERANCE * face.size
            and face.within(parameters)[0]
            and face.gaps(there)[0] >= least
        ):
            return there[0], face.normals(parameters)[0][0]
    return None


def on_material(faces: Sequence[PartFace], places: Floats) -> Truths:
    """Whether each of the places (n, 3) lies on the material of one of the faces, or straight
    before or behind it.
    """
    on_any = np.zeros(len(places), bool)
    for face in faces:
        on_any |= face.within(face.lifted(face.surface.parameters(places)))
    return on_any


CURVE_FEATURES = frozenset(
    {"Line", "Circle", "CircularArc", "Ellipse", "EllipticalArc", "OtherCurve", "PointDefinedCurve"}
)
SURFACE_OF_FEATURE = {
    "Plane": "Plane",
    "Cylinder": "Cylinder",
    "CylindricalSegment": "Cylinder",
    "Cone": "Cone",
    "ConicalSegment": "Cone",
    "Sphere": "Sphere",
    "SphericalSegment": "Sphere",
    "Torus": "Torus",
    "ToroidalSegment": "Torus",
    "OppositeParallelPlanes": "Plane",
}


@dataclass(frozen=True, slots=True)
class PointPlacement:
    """Positions in metres with normals, and what should be said about them."""

    points: Placed
    remark: str = ""


@dataclass(frozen=True, slots=True)
class PartGeometry:
    """The faces and edges of a part.

    One unit of its lengths is `metres`; points stay `edge_m` away from edges.
    """

    product: Product
    metres: float
    edge_m: float | None = None

    def placed(self, feature: DrawnFeature, wanted: Placed) -> PointPlacement | str | None:
        """The points of a feature: those of `wanted` that are on its material, and others for the
        rest.

        A text says why it can have none. None if the document does not say what faces or edges it
        consists of.
        """
        if feature.kind in ("Point", "EdgePoint"):
            return None
        if feature.kind in CURVE_FEATURES:
            return self._along(feature, wanted)
        faces = self._faces(feature)
        if not faces:
            return None
        if feature.kind == "OppositeParallelPlanes":
            return self._opposite(feature, faces, wanted)
        return self._over(feature, faces, material_places(faces), wanted)

    def _faces(self, feature: DrawnFeature) -> list[PartFace]:
        """The faces of a feature that have its kind; all of its faces if none has."""
        kind = SURFACE_OF_FEATURE.get(feature.kind, "")
        own = [name for name in feature.entities if self.product.kind(name) == "Face"]
        like = [name for name in own if self.product.surface_kind(name).startswith(kind)]
        return [face for name in like or own if (face := self.product.face(name)) is not None]

    def _over(
        self,
        feature: DrawnFeature,
        faces: Sequence[PartFace],
        places: MaterialPlaces,
        wanted: Placed,
    ) -> PointPlacement | str:
        """Points on faces, from some of the places on them."""
        count = len(wanted)
        if feature.kind in ("Plane", "OppositeParallelPlanes") or not wanted:
            count, wanted = surface_points(float(places.areas.sum()) * self.metres**2, feature), []
        if len(places.places) < 4 * count:
            places = material_places(faces, ROW_COUNTS[1])
        scaled = [(position / self.metres, normal) for position, normal in wanted]
        margin = self.edge_m / self.metres if self.edge_m is not None else None
        choice = choose_points(faces, places, scaled, count, margin)
        if choice is None:
            return "its faces have no material between their loops"
        return PointPlacement(
            [(position * self.metres, normal) for position, normal in choice.points],
            f"has no place {_mm_text(self.edge_m)} away from its edges: its points are "
            f"{_mm_text(choice.gap * self.metres)} away"
            if choice.narrow
            else "",
        )

    def _opposite(
        self, feature: DrawnFeature, faces: Sequence[PartFace], wanted: Placed
    ) -> PointPlacement | str | None:
        """Points on the first of two opposite planes where the second one is behind them."""
        along = np.array(feature.along)
        ahead = [face for face in faces if _faces_along(face, along)]
        behind = [face for face in faces if face not in ahead]
        if not ahead or not behind:
            return None
        places = material_places(ahead, ROW_COUNTS[1])
        both = places.only(on_material(behind, places.places))
        if not len(both.places):
            return "its two planes do not lie opposite to each other anywhere"
        return self._over(feature, ahead, both, wanted)

    def _along(self, feature: DrawnFeature, wanted: Placed) -> PointPlacement | None:
        """Points along edges, evenly spaced, half a step from the ends, with the mean normal of
        the faces there.
        """
        edges = [
            (name, chain)
            for name in feature.entities
            if (chain := self.product.edge(name)) is not None
        ]
        if not edges:
            return None
        lengths = [
            float(np.linalg.norm(np.diff(chain, axis=0), axis=1).sum()) for _, chain in edges
        ]
        total = sum(lengths)
        count = curve_points(total * self.metres, feature)
        edge_points: Placed = []
        start = 0.0
        for (name, chain), length in zip(edges, lengths, strict=True):
            steps = (np.arange(count) + 0.5) / count * total - start
            for place in _at_lengths(chain, steps[(steps >= 0) & (steps < length)]):
                normal = self._normal(name, place)
                edge_points.append(
                    (
                        place * self.metres,
                        normal if normal is not None else _scheme_normal(wanted, len(edge_points)),
                    )
                )
            start += length
        return PointPlacement(edge_points)

    def _normal(self, edge: str, place: Floats) -> Floats | None:
        """The mean of the normals of the faces that meet in an edge; None without faces."""
        faces = [
            face
            for name in self.product.faces_at(edge)
            if (face := self.product.face(name)) is not None
        ]
        normals = [
            face.normals(face.lifted(face.surface.parameters(place[None])))[0][0] for face in faces
        ]
        if not normals:
            return None
        mean: Floats = np.sum(normals, axis=0)
        size = float(np.linalg.norm(mean))
        return mean / size if size > 1e-6 else normals[0]


def _faces_along(face: PartFace, along: Floats) -> bool:
    """Whether the normals of a face point along a direction."""
    parameters, _ = face.candidates(3)
    return bool(len(parameters)) and float(face.normals(parameters[:1])[0][0] @ along) > 0


def _at_lengths(chain: Floats, lengths: Floats) -> Floats:
    """Points (m, 3) at lengths (m,) along a chain of points."""
    arc_lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(chain, axis=0), axis=1))])
    return np.stack([np.interp(lengths, arc_lengths, coordinate) for coordinate in chain.T], axis=1)


def _scheme_normal(wanted: Placed, number: int) -> Floats:
    """The normal of the scheme's own points, where no face gives one."""
    return wanted[min(number, len(wanted) - 1)][1] if wanted else np.array([0.0, 0.0, 1.0])


def _mm_text(metres: float | None) -> str:
    return f"{(metres or 0.0) * 1e3:.3g} mm"
