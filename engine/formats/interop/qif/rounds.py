"""Surfaces of revolution with formulas of their own: cylinders, cones, spheres and tori of a QIF document."""

from dataclasses import dataclass

import numpy as np

from cellwright.engine.formats.interop.qif.document import Element, wrong
from cellwright.engine.formats.interop.qif.parametric import Span, Surface, unit
from cellwright.engine.formats.interop.qif.reading import Reading, is_true
from cellwright.engine.kernels.arrays import Floats

TURN = 2 * np.pi


@dataclass(frozen=True, slots=True, eq=False)
class Round:
    """What surfaces of revolution share: a frame (rows x, y, axis) and how parameters are scaled to angles and heights."""

    origin: Floats
    frame: Floats
    scale: Floats
    shift: float = 0.0

    def scaled(self, p: Floats) -> Floats:
        """Parameters (n, 2) as they stand in formulas."""
        return p * self.scale + (0.0, self.shift)

    def raw(self, scaled: Floats) -> Floats:
        """The inverse of `scaled`."""
        found: Floats = (scaled - (0.0, self.shift)) / self.scale
        return found

    def span(self, axis: int, first: float, last: float) -> Span:
        """A range of an angle or a height as a range of its parameter."""
        shift = self.shift if axis == 1 else 0.0
        ends = sorted(float((each - shift) / self.scale[axis]) for each in (first, last))
        return ends[0], ends[1]

    def placed(self, radius: Floats, angle: Floats, height: Floats) -> Floats:
        """Points at cylindrical coordinates."""
        local = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)
        return local @ self.frame + self.origin

    def coordinates(self, points: Floats) -> tuple[Floats, Floats, Floats]:
        """Radius, angle and height of points."""
        x, y, z = ((points - self.origin) @ self.frame.T).T
        return np.hypot(x, y), np.arctan2(y, x), z


def _round(
    core: Element, reading: Reading, origin: tuple[str, ...], axis: tuple[str, ...], across: tuple[str, ...]
) -> Round:
    z = unit(reading.vector(core, *axis))
    x = reading.vector(core, *across)
    x = x - (x @ z) * z
    if np.linalg.norm(x) < 1e-9:
        raise wrong(reading.where(core), "the beginning of a sweep must lie across the axis")
    x = unit(x)
    scale = [_attribute(core, reading, f"scale{name}", 1.0) for name in "UV"]
    if min(scale) <= 0:
        raise wrong(reading.where(core), "the scale of a parameter must be more than 0")
    turned = -1.0 if is_true(core, "turnedV") else 1.0
    shift = _attribute(core, reading, "offsetV", 0.0)
    return Round(
        reading.vector(core, *origin),
        np.stack([x, np.cross(z, x), z]),
        np.array([scale[0], scale[1] * turned]),
        shift,
    )


def _attribute(core: Element, reading: Reading, name: str, otherwise: float) -> float:
    text = core.attributes.get(name)
    return otherwise if text is None else reading.number(Element(name, {}, core.line, text))


def _sweep(core: Element, reading: Reading) -> Span:
    angles = reading.numbers(core.at("Sweep", "DomainAngle"))
    return (angles[0] * reading.radians, angles[1] * reading.radians) if len(angles) == 2 else (0.0, TURN)


AXIS = (("Axis", "AxisPoint"), ("Axis", "Direction"))


def cylinder(core: Element, reading: Reading) -> Surface:
    """A cylinder: u is the angle from the start of the sweep, v the height."""
    radius = reading.number(core.at("Diameter")) / 2
    return _cone_like(core, reading, "cylinder", radius, 0.0)


def cone(core: Element, reading: Reading) -> Surface:
    """A cone: u is the angle from the start of the sweep, v the height."""
    bottom, top = (reading.number(core.at(f"Diameter{name}")) / 2 for name in ("Bottom", "Top"))
    length = reading.number(core.at("Length"))
    if length == 0:
        raise wrong(reading.where(core), "a cone without length")
    return _cone_like(core, reading, "cone", bottom, (top - bottom) / length)


def _cone_like(core: Element, reading: Reading, kind: str, radius: float, slope: float) -> Surface:
    """A cylinder or a cone: u is the angle from the start of the sweep, v the height along the axis."""
    base, length = _round(core, reading, *AXIS, ("Sweep", "DirBeg")), reading.number(core.at("Length"))

    def at(p: Floats) -> Floats:
        angle, height = base.scaled(p).T
        return base.placed(radius + slope * height, angle, height)

    def back(points: Floats) -> Floats:
        far, angle, height = base.coordinates(points)
        height = height + slope * (far - radius - slope * height) / (1 + slope * slope)
        return base.raw(np.stack([angle, height], axis=1))

    domain = (base.span(0, *_sweep(core, reading)), base.span(1, 0.0, length))
    return Surface(kind, at, domain, (TURN / float(base.scale[0]), 0.0), back)


def _latitudes(core: Element, reading: Reading) -> tuple[Span, Span]:
    sweep = core.at("LatitudeLongitudeSweep")
    found = [
        [each * reading.radians for each in reading.numbers(sweep.at(f"Domain{name}") if sweep else None)]
        or list(otherwise)
        for name, otherwise in (("Longitude", (0.0, TURN)), ("Latitude", (-np.pi / 2, np.pi / 2)))
    ]
    return (found[0][0], found[0][-1]), (found[1][0], found[1][-1])


def sphere(core: Element, reading: Reading) -> Surface:
    """A sphere: u is the longitude, v the latitude."""
    radius = reading.number(core.at("Diameter")) / 2
    sweep = "LatitudeLongitudeSweep"
    base = _round(core, reading, ("Location",), (sweep, "DirNorthPole"), (sweep, "DirMeridianPrime"))

    def at(p: Floats) -> Floats:
        angle, latitude = base.scaled(p).T
        return base.placed(radius * np.cos(latitude), angle, radius * np.sin(latitude))

    def back(points: Floats) -> Floats:
        far, angle, height = base.coordinates(points)
        return base.raw(np.stack([angle, np.arctan2(height, far)], axis=1))

    east, north = _latitudes(core, reading)
    domain = (base.span(0, *east), base.span(1, *north))
    return Surface("sphere", at, domain, (TURN / float(base.scale[0]), 0.0), back)


def torus(core: Element, reading: Reading) -> Surface:
    """A torus: u is the longitude, v the latitude."""
    major, minor = (reading.number(core.at(f"Diameter{name}")) / 2 for name in ("Major", "Minor"))
    base = _round(core, reading, *AXIS, ("LatitudeLongitudeSweep", "DirMeridianPrime"))

    def at(p: Floats) -> Floats:
        angle, latitude = base.scaled(p).T
        return base.placed(major + minor * np.cos(latitude), angle, minor * np.sin(latitude))

    def back(points: Floats) -> Floats:
        far, angle, height = base.coordinates(points)
        return base.raw(np.stack([angle, np.arctan2(height, far - major)], axis=1))

    east, north = _latitudes(core, reading)
    domain = (base.span(0, *east), base.span(1, *north))
    periods = (TURN / float(base.scale[0]), TURN / abs(float(base.scale[1])))
    return Surface("torus", at, domain, periods, back)
