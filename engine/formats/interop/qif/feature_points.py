"""Points to measure on the features of a QIF document, by a sampling scheme for each kind.

On planes, the points lie inside the outline, each as far as possible from those before. On
cylinders and cones, they lie on rings at a quarter and three quarters of the length; the second
ring is turned by half a step. On lines and arcs, they are evenly spaced, half a step from the ends.
On toroidal segments, they lie along the middle of the tube. For opposite planes, a thickness is
measured at points on the first plane. A feature without a scheme is excluded.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from cellwright.engine.formats.interop.qif.nominal_features import alignment_steps, nominal_features
from cellwright.engine.formats.interop.qif.part_faces import Product
from cellwright.engine.formats.interop.qif.point_placement import (
    PartGeometry,
    Placed,
    PointPlacement,
    curve_points,
    section_points,
    surface_points,
)
from cellwright.engine.formats.interop.qif.polygon_regions import row_points, spread_points
from cellwright.engine.formats.interop.qif.qif_document import DocumentReading, read_qif_document
from cellwright.engine.formats.interop.qif.single_points import AskedPoint, points_asked
from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.part_measurements import (
    DrawnFeature,
    Excluded,
    Inspection,
    MeasurementPoint,
    Triple,
)

PLANE_MARGIN = 0.08  # distance of a plane's points from its bounding box, as a share of its extent
PLANE_ROWS = 24
RING_SECTIONS = (0.25, 0.75)
FULL_SWEEP = (0.0, 2 * np.pi)
NO_POINTS_REASONS = {
    "Threaded": "a thread needs a gauge",
    "Group": "each of its members is measured separately",
    "ExtrudedCrossSection": "its cross-section is measured by the features that bound it",
}


def inspection_of(path: Path, unit_m: float = 1e-3, edge_m: float | None = None) -> Inspection:
    """The points at which the features of a QIF document are measured. Raises `InvalidInput`.

    `unit_m` is the unit of length of a document that names none. Points on faces are at least
    `edge_m` away from their edges.
    """
    root, file = read_qif_document(path)
    reading = DocumentReading(root, file, unit_m)
    part = PartGeometry(Product(root, reading), reading.metres, edge_m)
    points: list[MeasurementPoint] = []
    excluded: list[Excluded] = []
    remarks: list[Excluded] = []
    features, steps = nominal_features(root, reading), alignment_steps(root)
    asked = points_asked(root, reading)
    for feature in features:
        placement = _place_points(feature, part)
        if isinstance(placement, str):
            excluded.append(Excluded(feature.name, placement))
        else:
            number = feature.name.removeprefix("f")
            placed = _points_of_feature(feature, placement, steps.get(number, 0))
            points += (
                placed
                if number not in asked
                else (_as_asked(point, asked[number]) for point in placed)
            )
            remarks += [Excluded(feature.name, placement.remark)] if placement.remark else []
    return Inspection(path.stem, tuple(points), tuple(excluded), len(features), tuple(remarks))


def _place_points(feature: DrawnFeature, part: PartGeometry) -> PointPlacement | str:
    """The points of a feature, or why it has none."""
    if feature.kind in NO_POINTS_REASONS:
        return NO_POINTS_REASONS[feature.kind]
    reason = _size_objection(feature)
    wanted = POINT_SCHEMES[feature.kind](feature) if reason is None else []
    placement = part.placed(feature, wanted)
    if placement is None:
        return reason or PointPlacement(wanted)
    return placement


def _size_objection(feature: DrawnFeature) -> str | None:
    """Why the nominal sizes of a feature do not say where its points lie; None if they do."""
    if feature.kind not in POINT_SCHEMES:
        return f"no scheme places points on features of the kind {feature.kind}"
    missing = [size for size in NEEDED_SIZES.get(feature.kind, ()) if not feature.sizes.get(size)]
    if missing:
        return f"the file gives no {' and no '.join(missing).lower()}"
    if not any(feature.along):
        return "the file gives no direction"
    return None


def _points_of_feature(
    feature: DrawnFeature, placement: PointPlacement, step: int
) -> Iterator[MeasurementPoint]:
    thick = feature.kind == "OppositeParallelPlanes"
    kind, nominal = ("thickness", feature.sizes["Width"]) if thick else ("profile", 0.0)
    tolerance = min(feature.tolerances.values(), default=None)
    bore = (
        feature.sizes.get("Diameter")
        if feature.internal and feature.kind in BORE_FEATURES
        else None
    )
    for number, (position, normal) in enumerate(placement.points, 1):
        yield MeasurementPoint(
            f"{feature.name}_{number}",
            feature.name,
            kind,
            _triple_of(position),
            _triple_of(normal),
            tolerance,
            bore,
            step,
            nominal,
        )


def _as_asked(point: MeasurementPoint, asked: AskedPoint) -> MeasurementPoint:
    """A point of a feature that is itself a point, as the document asks for it."""
    name, kind = asked.name or point.name, asked.kind or point.kind
    nominal = asked.nominal_m if asked.nominal_m is not None else 0.0 if kind == "profile" else None
    feature = asked.name or point.feature
    return replace(
        point,
        name=name,
        feature=feature,
        kind=kind,
        nominal_m=nominal,
        bore_m=asked.bore_m,
        tool=asked.tool,
    )


def _triple_of(v: Floats) -> Triple:
    return (float(v[0]), float(v[1]), float(v[2]))


def _unit_of(v: Triple | Floats) -> Floats:
    unit: Floats = np.asarray(v, float) / np.linalg.norm(v)
    return unit


def _feature_frame(feature: DrawnFeature) -> tuple[Floats, Floats, Floats]:
    """Three unit vectors at right angles: the direction of the feature, one across it, and
    their cross product.
    """
    z = _unit_of(feature.along)
    x = np.asarray(
        feature.across if feature.across else np.eye(3)[int(np.argmin(np.abs(z)))], float
    )
    x = x - (x @ z) * z
    if np.linalg.norm(x) < 1e-9:
        x = np.cross(z, np.eye(3)[int(np.argmin(np.abs(z)))])
    x = _unit_of(x)
    return z, x, np.cross(z, x)


def _plane_points(feature: DrawnFeature) -> Placed:
    normal = _unit_of(feature.along)
    if len(feature.outline) < 3:
        return [(np.array(feature.position), normal)]
    z, x, y = _feature_frame(feature)
    corners = np.array(feature.outline)
    flat = (corners - corners[0]) @ np.stack([x, y], axis=1)
    flat_points, areas = row_points([flat], PLANE_ROWS)
    middle = flat_points if len(flat_points) else flat.mean(axis=0)[None]
    low, high = flat.min(axis=0), flat.max(axis=0)
    edge = PLANE_MARGIN * (high - low)
    free = middle[((middle >= low + edge) & (middle <= high - edge)).all(axis=1)]
    chosen = spread_points(
        free if len(free) else middle, surface_points(float(areas.sum()), feature)
    )
    return [(corners[0] + u * x + v * y, z) for u, v in (free if len(free) else middle)[chosen]]


def _sweep_angles(feature: DrawnFeature, count: int, turned: float = 0.0) -> Floats:
    """Angles from `across`, evenly spaced over the sweep; if it is not a full turn, half a step
    from its ends.
    """
    first, last = feature.sweep or FULL_SWEEP
    angles: Floats = (
        first
        + (last - first) * (np.arange(count) + (0.5 if last - first < 6.28 else turned)) / count
    )
    return angles


def _ring_points(feature: DrawnFeature, reach: tuple[float, float], slope: float) -> Placed:
    """Rings on a cylinder (slope 0) or a cone, whose radius grows by `slope` along its axis."""
    z, x, y = _feature_frame(feature)
    first, last = feature.sweep or FULL_SWEEP
    length, radius = reach[1] - reach[0], feature.sizes.get("Diameter", 0.0) / 2
    area = (last - first) * length * (radius + slope * sum(reach) / 2)
    count = max(
        section_points(feature), -(-surface_points(abs(area), feature) // len(RING_SECTIONS))
    )
    sign, placed = (-1.0 if feature.internal else 1.0), []
    for ring, part in enumerate(RING_SECTIONS):
        s = reach[0] + part * length
        for angle in _sweep_angles(feature, count, ring / 2):
            out = np.cos(angle) * x + np.sin(angle) * y
            where = np.array(feature.position) + s * z + (radius + slope * s) * out
            placed.append((where, sign * _unit_of(out - slope * z)))
    return placed


def _cylinder_points(feature: DrawnFeature) -> Placed:
    return _ring_points(feature, (0.0, feature.sizes["Length"]), 0.0)


def _cone_points(feature: DrawnFeature) -> Placed:
    reach = (-feature.sizes.get("SmallEndDistance", 0.0), feature.sizes["LargeEndDistance"])
    return _ring_points(feature, reach, float(np.tan(feature.sizes["HalfAngle"])))


def _line_points(feature: DrawnFeature) -> Placed:
    z, x, _ = _feature_frame(feature)
    length = feature.sizes["Length"]
    count = curve_points(length, feature)
    return [(np.array(feature.position) + length * (i + 0.5) / count * z, x) for i in range(count)]


def _arc_points(feature: DrawnFeature) -> Placed:
    _, x, y = _feature_frame(feature)
    first, last = feature.sweep or FULL_SWEEP
    radius = feature.sizes.get("Radius") or feature.sizes["Diameter"] / 2
    sign, placed = (-1.0 if feature.internal else 1.0), []
    for angle in _sweep_angles(feature, curve_points((last - first) * radius, feature)):
        out = np.cos(angle) * x + np.sin(angle) * y
        placed.append((np.array(feature.position) + radius * out, sign * out))
    return placed


def _torus_points(feature: DrawnFeature) -> Placed:
    """Points along the middle of the tube, at the latitude of the segment's outer edge, a
    quarter turn from the axis.
    """
    z, x, y = _feature_frame(feature)
    first, last = feature.sweep or FULL_SWEEP
    major, minor = feature.sizes["MajorDiameter"] / 2, feature.sizes["MinorDiameter"] / 2
    latitude, sign, placed = 3 * np.pi / 4, (-1.0 if feature.internal else 1.0), []
    for angle in _sweep_angles(
        feature, surface_points((last - first) * major * minor * np.pi / 2, feature)
    ):
        out = np.cos(angle) * x + np.sin(angle) * y
        normal = np.cos(latitude) * out + np.sin(latitude) * z
        placed.append((np.array(feature.position) + major * out + minor * normal, sign * normal))
    return placed


def _opposite_points(feature: DrawnFeature) -> Placed:
    z, x, _ = _feature_frame(feature)
    length, depth = feature.sizes.get("Length", 0.0), feature.sizes.get("Depth", 0.0)
    count = surface_points(length * depth, feature)
    start = np.array(feature.position) + 0.5 * feature.sizes["Width"] * z
    return [(start + length * ((i + 0.5) / count - 0.5) * x, z) for i in range(count)]


def _single_point(feature: DrawnFeature) -> Placed:
    return [(np.array(feature.position), _unit_of(feature.along))]


POINT_SCHEMES: dict[str, Callable[[DrawnFeature], Placed]] = {
    "Plane": _plane_points,
    "Cylinder": _cylinder_points,
    "CylindricalSegment": _cylinder_points,
    "Cone": _cone_points,
    "ConicalSegment": _cone_points,
    "Line": _line_points,
    "Circle": _arc_points,
    "CircularArc": _arc_points,
    "ToroidalSegment": _torus_points,
    "OppositeParallelPlanes": _opposite_points,
    "Point": _single_point,
    "EdgePoint": _single_point,
}
NEEDED_SIZES: dict[str, tuple[str, ...]] = {
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
BORE_FEATURES = frozenset({"Cylinder", "Cone"})
