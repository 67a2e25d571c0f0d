"""Where the points of features lie on a part: on the material of its faces, or along its edges."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cellwright.engine.formats.interop.qif.counts import curve_points, surface_points
from cellwright.engine.formats.interop.qif.faces import Face, Product
from cellwright.engine.formats.interop.qif.material import ROWS, Placed, Pool, chosen, on_material, pool
from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.measurement import Feature

CURVES = frozenset(
    {"Line", "Circle", "CircularArc", "Ellipse", "EllipticalArc", "OtherCurve", "PointDefinedCurve"}
)
SURFACES = {
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
class Placement:
    """Positions in metres with normals, and what should be said about them."""

    points: Placed
    remark: str = ""


@dataclass(frozen=True, slots=True)
class Part:
    """The faces and edges of a part. One unit of its lengths is `metres`; points stay `edge_m` away from edges."""

    product: Product
    metres: float
    edge_m: float | None = None

    def placed(self, feature: Feature, wanted: Placed) -> Placement | str | None:
        """The points of a feature: those of `wanted` that are on its material, and others for the rest.

        A text says why it can have none. None if the document does not say what faces or edges it consists of.
        """
        if feature.kind in ("Point", "EdgePoint"):
            return None
        if feature.kind in CURVES:
            return self._along(feature, wanted)
        faces = self._faces(feature)
        if not faces:
            return None
        if feature.kind == "OppositeParallelPlanes":
            return self._opposite(feature, faces, wanted)
        return self._over(feature, faces, pool(faces), wanted)

    def _faces(self, feature: Feature) -> list[Face]:
        """The faces of a feature that have its kind; all of its faces if none has."""
        kind = SURFACES.get(feature.kind, "")
        own = [name for name in feature.entities if self.product.kind(name) == "Face"]
        like = [name for name in own if self.product.surface_kind(name).startswith(kind)]
        return [face for name in like or own if (face := self.product.face(name)) is not None]

    def _over(self, feature: Feature, faces: Sequence[Face], places: Pool, wanted: Placed) -> Placement | str:
        """Points on faces, from some of the places on them."""
        count = len(wanted)
        if feature.kind in ("Plane", "OppositeParallelPlanes") or not wanted:
            count, wanted = surface_points(float(places.areas.sum()) * self.metres**2, feature), []
        if len(places.places) < 4 * count:
            places = pool(faces, ROWS[1])
        scaled = [(position / self.metres, normal) for position, normal in wanted]
        margin = self.edge_m / self.metres if self.edge_m is not None else None
        found = chosen(faces, places, scaled, count, margin)
        if found is None:
            return "its faces have no material between their loops"
        return Placement(
            [(position * self.metres, normal) for position, normal in found.points],
            f"has no place {_mm(self.edge_m)} away from its edges: its points are {_mm(found.gap * self.metres)} away"
            if found.narrow
            else "",
        )

    def _opposite(self, feature: Feature, faces: Sequence[Face], wanted: Placed) -> Placement | str | None:
        """Points on the first of two opposite planes where the second one is behind them."""
        along = np.array(feature.along)
        ahead = [face for face in faces if _faces_along(face, along)]
        behind = [face for face in faces if face not in ahead]
        if not ahead or not behind:
            return None
        places = pool(ahead, ROWS[1])
        both = places.only(on_material(behind, places.places))
        if not len(both.places):
            return "its two planes do not lie opposite to each other anywhere"
        return self._over(feature, ahead, both, wanted)

    def _along(self, feature: Feature, wanted: Placed) -> Placement | None:
        """Points along edges, evenly spaced, half a step from the ends, with the mean normal of the faces there."""
        edges = [(name, chain) for name in feature.entities if (chain := self.product.edge(name)) is not None]
        if not edges:
            return None
        lengths = [float(np.linalg.norm(np.diff(chain, axis=0), axis=1).sum()) for _, chain in edges]
        total = sum(lengths)
        count = curve_points(total * self.metres, feature)
        found: Placed = []
        start = 0.0
        for (name, chain), length in zip(edges, lengths, strict=True):
            steps = (np.arange(count) + 0.5) / count * total - start
            for place in _at_lengths(chain, steps[(steps >= 0) & (steps < length)]):
                normal = self._normal(name, place)
                found.append(
                    (place * self.metres, normal if normal is not None else _other(wanted, len(found)))
                )
            start += length
        return Placement(found)

    def _normal(self, edge: str, place: Floats) -> Floats | None:
        """The mean of the normals of the faces that meet in an edge; None without faces."""
        faces = [
            face for name in self.product.faces_at(edge) if (face := self.product.face(name)) is not None
        ]
        normals = [face.normals(face.lifted(face.surface.parameters(place[None])))[0][0] for face in faces]
        if not normals:
            return None
        mean: Floats = np.sum(normals, axis=0)
        size = float(np.linalg.norm(mean))
        return mean / size if size > 1e-6 else normals[0]


def _faces_along(face: Face, along: Floats) -> bool:
    """Whether the normals of a face point along a direction."""
    parameters, _ = face.candidates(3)
    return bool(len(parameters)) and float(face.normals(parameters[:1])[0][0] @ along) > 0


def _at_lengths(chain: Floats, lengths: Floats) -> Floats:
    """Points (m, 3) at lengths (m,) along a chain of points."""
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(chain, axis=0), axis=1))])
    return np.stack([np.interp(lengths, way, each) for each in chain.T], axis=1)


def _other(wanted: Placed, number: int) -> Floats:
    """The normal of the scheme's own points, where no face gives one."""
    return wanted[min(number, len(wanted) - 1)][1] if wanted else np.array([0.0, 0.0, 1.0])


def _mm(metres: float | None) -> str:
    return f"{(metres or 0.0) * 1e3:.3g} mm"
