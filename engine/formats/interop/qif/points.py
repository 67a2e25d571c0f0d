"""Points on features: their number comes from `counts`, and their places from a scheme for each kind.

On planes, the points lie inside the outline, each as far as possible from those before. On cylinders and cones, they lie on
rings at a quarter and three quarters of the length; the second ring is turned by half a step. On lines and arcs, they are
evenly spaced, half a step from the ends. On toroidal segments, they lie along the middle of the tube. For opposite planes, a
thickness is measured at points on the first plane. A feature without a scheme is excluded.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from cellwright.engine.formats.interop.qif.alignment import alignment_steps
from cellwright.engine.formats.interop.qif.counts import curve_points, section_points, surface_points
from cellwright.engine.formats.interop.qif.document import read_document
from cellwright.engine.formats.interop.qif.faces import Product
from cellwright.engine.formats.interop.qif.features import features_of
from cellwright.engine.formats.interop.qif.material import Placed
from cellwright.engine.formats.interop.qif.parts import Part, Placement
from cellwright.engine.formats.interop.qif.points_read import Asked, points_asked
from cellwright.engine.formats.interop.qif.reading import Reading
from cellwright.engine.formats.interop.qif.regions import rows, spread
from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.measurement import Excluded, Feature, Inspection, MeasurementPoint, Triple

MARGIN = 0.08  # distance of a plane's points from its bounding box, as a share of its extent
ROWS = 24
SECTIONS = (0.25, 0.75)
FULL = (0.0, 2 * np.pi)
REASONS = {
    "Threaded": "a thread needs a gauge",
    "Group": "each of its members is measured separately",
    "ExtrudedCrossSection": "its cross-section is measured by the features that bound it",
}


def inspection_of(path: Path, unit_m: float = 1e-3, edge_m: float | None = None) -> Inspection:
    """The points at which the features of a QIF document are measured. Raises `InvalidInput`.

    `unit_m` is the unit of length of a document that names none. Points on faces are at least `edge_m` away from their edges.
    """
    root, file = read_document(path)
    reading = Reading(root, file, unit_m)
    part = Part(Product(root, reading), reading.metres, edge_m)
    points: list[MeasurementPoint] = []
    excluded: list[Excluded] = []
    remarks: list[Excluded] = []
    features, steps = features_of(root, reading), alignment_steps(root)
    asked = points_asked(root, reading)
    for feature in features:
        found = _placed(feature, part)
        if isinstance(found, str):
            excluded.append(Excluded(feature.name, found))
        else:
            number = feature.name.removeprefix("f")
            placed = _points(feature, found, steps.get(number, 0))
            points += placed if number not in asked else (_as_asked(each, asked[number]) for each in placed)
            remarks += [Excluded(feature.name, found.remark)] if found.remark else []
    return Inspection(path.stem, tuple(points), tuple(excluded), len(features), tuple(remarks))


def _placed(feature: Feature, part: Part) -> Placement | str:
    """The points of a feature, or why it has none."""
    if feature.kind in REASONS:
        return REASONS[feature.kind]
    reason = _unmeasurable(feature)
    wanted = SCHEMES[feature.kind](feature) if reason is None else []
    found = part.placed(feature, wanted)
    if found is None:
        return reason or Placement(wanted)
    return found


def _unmeasurable(feature: Feature) -> str | None:
    """Why the nominal sizes of a feature do not say where its points lie; None if they do."""
    if feature.kind not in SCHEMES:
        return f"no scheme places points on features of the kind {feature.kind}"
    missing = [size for size in SIZES.get(feature.kind, ()) if not feature.sizes.get(size)]
    if missing:
        return f"the file gives no {' and no '.join(missing).lower()}"
    if not any(feature.along):
        return "the file gives no direction"
    return None


def _points(feature: Feature, placement: Placement, step: int) -> Iterator[MeasurementPoint]:
    thick = feature.kind == "OppositeParallelPlanes"
    kind, nominal = ("thickness", feature.sizes["Width"]) if thick else ("profile", 0.0)
    tolerance = min(feature.tolerances.values(), default=None)
    bore = feature.sizes.get("Diameter") if feature.internal and feature.kind in BORES else None
    for number, (position, normal) in enumerate(placement.points, 1):
        yield MeasurementPoint(
            f"{feature.name}_{number}",
            feature.name,
            kind,
            _triple(position),
            _triple(normal),
            tolerance,
            bore,
            step,
            nominal,
        )


def _as_asked(point: MeasurementPoint, asked: Asked) -> MeasurementPoint:
    """A point of a feature that is itself a point, as the document asks for it."""
    name, kind = asked.name or point.name, asked.kind or point.kind
    nominal = asked.nominal_m if asked.nominal_m is not None else 0.0 if kind == "profile" else None
    feature = asked.name or point.feature
    return replace(
        point, name=name, feature=feature, kind=kind, nominal_m=nominal, bore_m=asked.bore_m, tool=asked.tool
    )


def _triple(v: Floats) -> Triple:
    return (float(v[0]), float(v[1]), float(v[2]))


def _unit(v: Triple | Floats) -> Floats:
    found: Floats = np.asarray(v, float) / np.linalg.norm(v)
    return found


def _frame(feature: Feature) -> tuple[Floats, Floats, Floats]:
    """Three unit vectors at right angles: the direction of the feature, one across it, and their cross product."""
    z = _unit(feature.along)
    x = np.asarray(feature.across if feature.across else np.eye(3)[int(np.argmin(np.abs(z)))], float)
    x = x - (x @ z) * z
    if np.linalg.norm(x) < 1e-9:
        x = np.cross(z, np.eye(3)[int(np.argmin(np.abs(z)))])
    x = _unit(x)
    return z, x, np.cross(z, x)


def _plane(feature: Feature) -> Placed:
    normal = _unit(feature.along)
    if len(feature.outline) < 3:
        return [(np.array(feature.position), normal)]
    z, x, y = _frame(feature)
    corners = np.array(feature.outline)
    flat = (corners - corners[0]) @ np.stack([x, y], axis=1)
    found, areas = rows([flat], ROWS)
    middle = found if len(found) else flat.mean(axis=0)[None]
    low, high = flat.min(axis=0), flat.max(axis=0)
    edge = MARGIN * (high - low)
    free = middle[((middle >= low + edge) & (middle <= high - edge)).all(axis=1)]
    chosen = spread(free if len(free) else middle, surface_points(float(areas.sum()), feature))
    return [(corners[0] + u * x + v * y, z) for u, v in (free if len(free) else middle)[chosen]]


def _angles(feature: Feature, count: int, turned: float = 0.0) -> Floats:
    """Angles from `across`, evenly spaced over the sweep; if it is not a full turn, half a step from its ends."""
    first, last = feature.sweep or FULL
    found: Floats = (
        first + (last - first) * (np.arange(count) + (0.5 if last - first < 6.28 else turned)) / count
    )
    return found


def _rings(feature: Feature, reach: tuple[float, float], slope: float) -> Placed:
    """Rings on a cylinder (slope 0) or a cone, whose radius grows by `slope` along its axis."""
    z, x, y = _frame(feature)
    first, last = feature.sweep or FULL
    length, radius = reach[1] - reach[0], feature.sizes.get("Diameter", 0.0) / 2
    area = (last - first) * length * (radius + slope * sum(reach) / 2)
    count = max(section_points(feature), -(-surface_points(abs(area), feature) // len(SECTIONS)))
    sign, placed = (-1.0 if feature.internal else 1.0), []
    for ring, part in enumerate(SECTIONS):
        s = reach[0] + part * length
        for angle in _angles(feature, count, ring / 2):
            out = np.cos(angle) * x + np.sin(angle) * y
            where = np.array(feature.position) + s * z + (radius + slope * s) * out
            placed.append((where, sign * _unit(out - slope * z)))
    return placed


def _cylinder(feature: Feature) -> Placed:
    return _rings(feature, (0.0, feature.sizes["Length"]), 0.0)


def _cone(feature: Feature) -> Placed:
    reach = (-feature.sizes.get("SmallEndDistance", 0.0), feature.sizes["LargeEndDistance"])
    return _rings(feature, reach, float(np.tan(feature.sizes["HalfAngle"])))


def _line(feature: Feature) -> Placed:
    z, x, _ = _frame(feature)
    length = feature.sizes["Length"]
    count = curve_points(length, feature)
    return [(np.array(feature.position) + length * (i + 0.5) / count * z, x) for i in range(count)]


def _arc(feature: Feature) -> Placed:
    _, x, y = _frame(feature)
    first, last = feature.sweep or FULL
    radius = feature.sizes.get("Radius") or feature.sizes["Diameter"] / 2
    sign, placed = (-1.0 if feature.internal else 1.0), []
    for angle in _angles(feature, curve_points((last - first) * radius, feature)):
        out = np.cos(angle) * x + np.sin(angle) * y
        placed.append((np.array(feature.position) + radius * out, sign * out))
    return placed


def _torus(feature: Feature) -> Placed:
    """Points along the middle of the tube, at the latitude of the segment's outer edge, a quarter turn from the axis."""
    z, x, y = _frame(feature)
    first, last = feature.sweep or FULL
    major, minor = feature.sizes["MajorDiameter"] / 2, feature.sizes["MinorDiameter"] / 2
    latitude, sign, placed = 3 * np.pi / 4, (-1.0 if feature.internal else 1.0), []
    for angle in _angles(feature, surface_points((last - first) * major * minor * np.pi / 2, feature)):
        out = np.cos(angle) * x + np.sin(angle) * y
        normal = np.cos(latitude) * out + np.sin(latitude) * z
        placed.append((np.array(feature.position) + major * out + minor * normal, sign * normal))
    return placed


def _opposite(feature: Feature) -> Placed:
    z, x, _ = _frame(feature)
    length, depth = feature.sizes.get("Length", 0.0), feature.sizes.get("Depth", 0.0)
    count = surface_points(length * depth, feature)
    start = np.array(feature.position) + 0.5 * feature.sizes["Width"] * z
    return [(start + length * ((i + 0.5) / count - 0.5) * x, z) for i in range(count)]


def _point(feature: Feature) -> Placed:
    return [(np.array(feature.position), _unit(feature.along))]


SCHEMES: dict[str, Callable[[Feature], Placed]] = {
    "Plane": _plane,
    "Cylinder": _cylinder,
    "CylindricalSegment": _cylinder,
    "Cone": _cone,
    "ConicalSegment": _cone,
    "Line": _line,
    "Circle": _arc,
    "CircularArc": _arc,
    "ToroidalSegment": _torus,
    "OppositeParallelPlanes": _opposite,
    "Point": _point,
    "EdgePoint": _point,
}
SIZES: dict[str, tuple[str, ...]] = {
    "Cylinder": ("Diameter", "Length"),
    "CylindricalSegment": ("Diameter", "Length"),
    "Cone": ("LargeEndDistance", "HalfAngle"),
    "ConicalSegment": ("LargeEndDistance", "HalfAngle"),
    "Line": ("Length",),
    "Circle": ("Diameter",),
    "CircularArc": ("Radius",),
    "ToroidalSegment": ("MajorDiameter", "MinorDiameter"),
    "OppositeParallelPlanes": ("Width",),
}
BORES = frozenset({"Cylinder", "Cone"})
