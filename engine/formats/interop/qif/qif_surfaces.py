"""Surfaces of a QIF document as maps from parameters to points, with normals and inverses."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.formats.interop.qif.curves import (
    basis_of,
    core_of,
    curve_chain,
    require_knots,
    weights_of,
)
from cellwright.engine.formats.interop.qif.qif_document import (
    DocumentReading,
    QifElement,
    is_true,
    qif_error,
)
from cellwright.engine.kernels.arrays import Floats

Span = tuple[float, float]
Map = Callable[[Floats], Floats]
DERIVATIVE_STEP = 1e-6  # of the domain, for derivatives
INVERSE_GRID = 48  # for the parameters of points on surfaces without a formula for them
NEWTON_ROUNDS = 12


@dataclass(frozen=True, slots=True, eq=False)
class ParametricSurface:
    """`at` takes parameters (n, 2) to points (n, 3). `inverse` takes points near the surface to
    their parameters.

    `domain` bounds u and v. A parameter with a period comes round to the same point.
    """

    kind: str
    at: Map
    domain: tuple[Span, Span]
    periods: tuple[float, float] = (0.0, 0.0)
    inverse: Map | None = None

    def parameters(self, points: Floats) -> Floats:
        """The parameters (n, 2) of points (n, 3) on the surface or near it."""
        return (
            self.inverse(points) if self.inverse is not None else _nearest_parameters(self, points)
        )

    def derivatives(self, parameters: Floats) -> tuple[Floats, Floats]:
        """The derivatives (n, 3) by u and by v."""
        slopes = []
        for axis, (first, last) in enumerate(self.domain):
            step = np.zeros(2)
            step[axis] = DERIVATIVE_STEP * (last - first)
            slopes.append(
                (self.at(parameters + step) - self.at(parameters - step)) / (2 * step[axis])
            )
        return slopes[0], slopes[1]

    def normals(self, parameters: Floats) -> tuple[Floats, Floats]:
        """Unit normals (n, 3), and how large the surface is for each unit of u times v (n,)."""
        across = np.cross(*self.derivatives(parameters))
        size = np.linalg.norm(across, axis=1)
        return across / np.where(size > 0, size, 1.0)[:, None], size


def move_surface(surface: ParametricSurface, turn: Floats, origin: Floats) -> ParametricSurface:
    """The surface after a motion: `turn` (3, 3) applies to columns, then `origin` (3,) is added."""
    at = surface.at

    def parameters(points: Floats) -> Floats:
        return surface.parameters((points - origin) @ turn)

    return replace(surface, at=lambda p: at(p) @ turn.T + origin, inverse=parameters)


def _nearest_parameters(surface: ParametricSurface, points: Floats) -> Floats:
    """Parameters of the points of a surface that are nearest to points: the best of a grid,
    then Gauss-Newton steps.
    """
    axes = [np.linspace(first, last, INVERSE_GRID) for first, last in surface.domain]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    places = surface.at(grid)
    parameters = np.stack(
        [grid[int(np.argmin(((places - point) ** 2).sum(axis=1)))] for point in points]
    )
    low, high = np.array(surface.domain).T
    for _ in range(NEWTON_ROUNDS):
        rest = points - surface.at(parameters)
        u, v = surface.derivatives(parameters)
        a, b, c = (np.einsum("ij,ij->i", *pair) for pair in ((u, u), (u, v), (v, v)))
        p, q = (np.einsum("ij,ij->i", rest, direction) for direction in (u, v))
        size = a * c - b * b
        size = np.where(size > 1e-30, size, np.inf)
        parameters = np.clip(
            parameters + np.stack([(c * p - b * q) / size, (a * q - b * p) / size], axis=1),
            low,
            high,
        )
    return parameters


def unit_vector(v: Floats) -> Floats:
    """The vector with length 1; unchanged if it has none."""
    scaled: Floats = v / max(float(np.linalg.norm(v)), 1e-300)
    return scaled


FULL_TURN = 2 * np.pi


@dataclass(frozen=True, slots=True, eq=False)
class RevolutionFrame:
    """What surfaces of revolution share: a frame (rows x, y, axis) and how parameters are
    scaled to angles and heights.
    """

    origin: Floats
    frame: Floats
    scale: Floats
    shift: float = 0.0

    def scaled(self, p: Floats) -> Floats:
        """Parameters (n, 2) as they stand in formulas."""
        return p * self.scale + (0.0, self.shift)

    def raw(self, scaled: Floats) -> Floats:
        """The inverse of `scaled`."""
        unscaled: Floats = (scaled - (0.0, self.shift)) / self.scale
        return unscaled

    def span(self, axis: int, first: float, last: float) -> Span:
        """A range of an angle or a height as a range of its parameter."""
        shift = self.shift if axis == 1 else 0.0
        ends = sorted(float((bound - shift) / self.scale[axis]) for bound in (first, last))
        return ends[0], ends[1]

    def placed(self, radius: Floats, angle: Floats, height: Floats) -> Floats:
        """Points at cylindrical coordinates."""
        local = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)
        return local @ self.frame + self.origin

    def coordinates(self, points: Floats) -> tuple[Floats, Floats, Floats]:
        """Radius, angle and height of points."""
        x, y, z = ((points - self.origin) @ self.frame.T).T
        return np.hypot(x, y), np.arctan2(y, x), z


def _revolution_frame(
    core: QifElement,
    reading: DocumentReading,
    origin: tuple[str, ...],
    axis: tuple[str, ...],
    across: tuple[str, ...],
) -> RevolutionFrame:
    z = unit_vector(reading.vector(core, *axis))
    x = reading.vector(core, *across)
    x = x - (x @ z) * z
    if np.linalg.norm(x) < 1e-9:
        raise qif_error(reading.where(core), "the beginning of a sweep must lie across the axis")
    x = unit_vector(x)
    scale = [_attribute_number(core, reading, f"scale{name}", 1.0) for name in "UV"]
    if min(scale) <= 0:
        raise qif_error(reading.where(core), "the scale of a parameter must be more than 0")
    turned = -1.0 if is_true(core, "turnedV") else 1.0
    shift = _attribute_number(core, reading, "offsetV", 0.0)
    return RevolutionFrame(
        reading.vector(core, *origin),
        np.stack([x, np.cross(z, x), z]),
        np.array([scale[0], scale[1] * turned]),
        shift,
    )


def _attribute_number(
    core: QifElement, reading: DocumentReading, name: str, otherwise: float
) -> float:
    text = core.attributes.get(name)
    return otherwise if text is None else reading.number(QifElement(name, {}, core.line, text))


def _sweep_span(core: QifElement, reading: DocumentReading) -> Span:
    angles = reading.numbers(core.at("Sweep", "DomainAngle"))
    return (
        (angles[0] * reading.radians, angles[1] * reading.radians)
        if len(angles) == 2
        else (0.0, FULL_TURN)
    )


AXIS_PATHS = (("Axis", "AxisPoint"), ("Axis", "Direction"))


def cylinder_surface(core: QifElement, reading: DocumentReading) -> ParametricSurface:
    """A cylinder: u is the angle from the start of the sweep, v the height."""
    radius = reading.number(core.at("Diameter")) / 2
    return _cone_like(core, reading, "cylinder", radius, 0.0)


def cone_surface(core: QifElement, reading: DocumentReading) -> ParametricSurface:
    """A cone: u is the angle from the start of the sweep, v the height."""
    bottom, top = (reading.number(core.at(f"Diameter{name}")) / 2 for name in ("Bottom", "Top"))
    length = reading.number(core.at("Length"))
    if length == 0:
        raise qif_error(reading.where(core), "a cone without length")
    return _cone_like(core, reading, "cone", bottom, (top - bottom) / length)


def _cone_like(
    core: QifElement, reading: DocumentReading, kind: str, radius: float, slope: float
) -> ParametricSurface:
    """A cylinder or a cone: u is the angle from the start of the sweep, v the height along the
    axis.
    """
    base, length = (
        _revolution_frame(core, reading, *AXIS_PATHS, ("Sweep", "DirBeg")),
        reading.number(core.at("Length")),
    )

    def at(p: Floats) -> Floats:
        angle, height = base.scaled(p).T
        return base.placed(radius + slope * height, angle, height)

    def back(points: Floats) -> Floats:
        far, angle, height = base.coordinates(points)
        height = height + slope * (far - radius - slope * height) / (1 + slope * slope)
        return base.raw(np.stack([angle, height], axis=1))

    domain = (base.span(0, *_sweep_span(core, reading)), base.span(1, 0.0, length))
    return ParametricSurface(kind, at, domain, (FULL_TURN / float(base.scale[0]), 0.0), back)


def _latitude_spans(core: QifElement, reading: DocumentReading) -> tuple[Span, Span]:
    sweep = core.at("LatitudeLongitudeSweep")
    spans = [
        [
            number * reading.radians
            for number in reading.numbers(sweep.at(f"Domain{name}") if sweep else None)
        ]
        or list(otherwise)
        for name, otherwise in (
            ("Longitude", (0.0, FULL_TURN)),
            ("Latitude", (-np.pi / 2, np.pi / 2)),
        )
    ]
    return (spans[0][0], spans[0][-1]), (spans[1][0], spans[1][-1])


def sphere_surface(core: QifElement, reading: DocumentReading) -> ParametricSurface:
    """A sphere: u is the longitude, v the latitude."""
    radius = reading.number(core.at("Diameter")) / 2
    sweep = "LatitudeLongitudeSweep"
    base = _revolution_frame(
        core, reading, ("Location",), (sweep, "DirNorthPole"), (sweep, "DirMeridianPrime")
    )

    def at(p: Floats) -> Floats:
        angle, latitude = base.scaled(p).T
        return base.placed(radius * np.cos(latitude), angle, radius * np.sin(latitude))

    def back(points: Floats) -> Floats:
        far, angle, height = base.coordinates(points)
        return base.raw(np.stack([angle, np.arctan2(height, far)], axis=1))

    east, north = _latitude_spans(core, reading)
    domain = (base.span(0, *east), base.span(1, *north))
    return ParametricSurface("sphere", at, domain, (FULL_TURN / float(base.scale[0]), 0.0), back)


def torus_surface(core: QifElement, reading: DocumentReading) -> ParametricSurface:
    """A torus: u is the longitude, v the latitude."""
    major, minor = (reading.number(core.at(f"Diameter{name}")) / 2 for name in ("Major", "Minor"))
    base = _revolution_frame(
        core, reading, *AXIS_PATHS, ("LatitudeLongitudeSweep", "DirMeridianPrime")
    )

    def at(p: Floats) -> Floats:
        angle, latitude = base.scaled(p).T
        return base.placed(major + minor * np.cos(latitude), angle, minor * np.sin(latitude))

    def back(points: Floats) -> Floats:
        far, angle, height = base.coordinates(points)
        return base.raw(np.stack([angle, np.arctan2(height, far - major)], axis=1))

    east, north = _latitude_spans(core, reading)
    domain = (base.span(0, *east), base.span(1, *north))
    periods = (FULL_TURN / float(base.scale[0]), FULL_TURN / abs(float(base.scale[1])))
    return ParametricSurface("torus", at, domain, periods, back)


def surface_of(element: QifElement, reading: DocumentReading) -> ParametricSurface | None:
    """The surface of an element such as `Plane23`; None if nothing is known about its kind.
    Raises `InvalidInput`.
    """
    core = core_of(element)
    kind = core.tag.removesuffix("23Core") if core is not None else ""
    return (
        SURFACE_KINDS[kind](core, reading) if core is not None and kind in SURFACE_KINDS else None
    )


def _plane_surface(core: QifElement, reading: DocumentReading) -> ParametricSurface:
    origin, u, v = (reading.vector(core, name) for name in ("Origin", "DirU", "DirV"))
    axes = np.stack([u, v])
    if np.linalg.norm(np.cross(u, v)) <= 1e-12 * np.linalg.norm(u) * np.linalg.norm(v):
        raise qif_error(reading.where(core), "the directions of a plane must not be parallel")
    back = np.linalg.pinv(axes)
    return ParametricSurface(
        "plane",
        lambda p: origin + p @ axes,
        (reading.span(core, "domainU"), reading.span(core, "domainV")),
        inverse=lambda points: (points - origin) @ back,
    )


def _nurbs_surface(core: QifElement, reading: DocumentReading) -> ParametricSurface:
    """Control points run along u first."""
    orders = [int(reading.number(core.at(f"Order{name}"))) for name in "UV"]
    knots = [np.array(reading.numbers(core.at(f"Knots{name}"))) for name in "UV"]
    counts = [len(knot_row) - order for knot_row, order in zip(knots, orders, strict=True)]
    for knot_row, order, count in zip(knots, orders, counts, strict=True):
        require_knots(core, knot_row, order, count, reading)
    points = reading.vectors(core, "CPs", 3)
    if len(points) != counts[0] * counts[1]:
        raise qif_error(
            reading.where(core), f"{counts[0]} times {counts[1]} control points are needed"
        )
    weights = weights_of(core, len(points), reading)
    net = np.concatenate([points * weights[:, None], weights[:, None]], axis=1)
    net = net.reshape(counts[1], counts[0], 4)

    def at(p: Floats) -> Floats:
        along, across = (basis_of(knots[i], orders[i], p[:, i]) for i in (0, 1))
        weighted = np.einsum("nu,nv,vuk->nk", along, across, net, optimize=True)
        return np.asarray(weighted[:, :3] / weighted[:, 3:])

    spans = [
        (float(knot_row[order - 1]), float(knot_row[-order]))
        for knot_row, order in zip(knots, orders, strict=True)
    ]
    return ParametricSurface("NURBS", at, (spans[0], spans[1]))


@dataclass(frozen=True, slots=True, eq=False)
class _Rail:
    """A curve as points on it, by a parameter that runs evenly through them over its domain."""

    places: Floats
    domain: Span

    def at(self, t: Floats) -> Floats:
        steps = np.linspace(*self.domain, len(self.places))
        return np.stack([np.interp(t, steps, coordinate) for coordinate in self.places.T], axis=1)


def _rail_of(parent: QifElement, reading: DocumentReading) -> _Rail:
    core = core_of(parent)
    if core is None:
        raise qif_error(reading.where(parent), "this curve has no core")
    return _Rail(curve_chain(core, 3, reading), reading.span(core, "domain"))


def _extrusion_surface(core: QifElement, reading: DocumentReading) -> ParametricSurface | None:
    if (parent := core.at("Curve")) is None:
        return None
    rail = _rail_of(parent, reading)
    direction = reading.vector(core, "TerminationPoint") - rail.places[0]
    return ParametricSurface(
        "extrusion", lambda p: rail.at(p[:, 0]) + p[:, 1:] * direction, (rail.domain, (0.0, 1.0))
    )


def _ruled_surface(core: QifElement, reading: DocumentReading) -> ParametricSurface | None:
    rails = [_rail_of(parent, reading) for parent in core.all("Curve")]
    if len(rails) != 2:
        return None
    first, second = rails
    if is_true(core, "turnedSecondCurve"):
        second = replace(second, places=second.places[::-1])
    second = replace(second, domain=first.domain)
    return ParametricSurface(
        "ruled surface",
        lambda p: (1 - p[:, 1:]) * first.at(p[:, 0]) + p[:, 1:] * second.at(p[:, 0]),
        (first.domain, (0.0, 1.0)),
    )


def _revolution_surface(core: QifElement, reading: DocumentReading) -> ParametricSurface | None:
    """u is the angle, v runs along the curve."""
    if (parent := core.at("Generatrix")) is None:
        return None
    rail = _rail_of(parent, reading)
    origin, z = (
        reading.vector(core, *AXIS_PATHS[0]),
        unit_vector(reading.vector(core, *AXIS_PATHS[1])),
    )
    first, last = reading.span(core, "angle")

    def at(p: Floats) -> Floats:
        arm = rail.at(p[:, 1]) - origin
        along, (cos, sin) = (arm @ z)[:, None] * z, (np.cos(p[:, :1]), np.sin(p[:, :1]))
        turned: Floats = origin + along + cos * (arm - along) + sin * np.cross(z, arm)
        return turned

    period = FULL_TURN if last - first > FULL_TURN - 1e-9 else 0.0
    return ParametricSurface("revolution", at, ((first, last), rail.domain), (period, 0.0))


def _offset_surface(core: QifElement, reading: DocumentReading) -> ParametricSurface | None:
    parent, distance = core.at("Surface"), reading.number(core.at("Distance"))
    base = surface_of(parent, reading) if parent is not None else None
    if base is None:
        return None
    return replace(
        base, kind="offset surface", at=lambda p: base.at(p) + distance * base.normals(p)[0]
    )


SURFACE_KINDS: dict[str, Callable[[QifElement, DocumentReading], ParametricSurface | None]] = {
    "Plane": _plane_surface,
    "Cylinder": cylinder_surface,
    "Cone": cone_surface,
    "Sphere": sphere_surface,
    "Torus": torus_surface,
    "Nurbs": _nurbs_surface,
    "Extrude": _extrusion_surface,
    "Ruled": _ruled_surface,
    "Revolution": _revolution_surface,
    "Offset": _offset_surface,
}
