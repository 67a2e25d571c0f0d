"""Surfaces of a QIF document: points and normals at parameters, and the parameters of points.

Planes, cylinders, cones, spheres, tori, NURBS, extrusions, revolutions, ruled surfaces and offsets are read. Lengths stay in the unit of the document.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.formats.interop.qif.curves import basis_of, chain, core_of, require_knots, weights_of
from cellwright.engine.formats.interop.qif.document import Element, wrong
from cellwright.engine.formats.interop.qif.parametric import Span, Surface, unit
from cellwright.engine.formats.interop.qif.reading import Reading, is_true
from cellwright.engine.formats.interop.qif.rounds import AXIS, TURN, cone, cylinder, sphere, torus
from cellwright.engine.kernels.arrays import Floats


def surface(element: Element, reading: Reading) -> Surface | None:
    """The surface of an element such as `Plane23`; None if nothing is known about its kind. Raises `InvalidInput`."""
    core = core_of(element)
    kind = core.tag.removesuffix("23Core") if core is not None else ""
    return KINDS[kind](core, reading) if core is not None and kind in KINDS else None


def _plane(core: Element, reading: Reading) -> Surface:
    origin, u, v = (reading.vector(core, name) for name in ("Origin", "DirU", "DirV"))
    axes = np.stack([u, v])
    if np.linalg.norm(np.cross(u, v)) <= 1e-12 * np.linalg.norm(u) * np.linalg.norm(v):
        raise wrong(reading.where(core), "the directions of a plane must not be parallel")
    back = np.linalg.pinv(axes)
    return Surface(
        "plane",
        lambda p: origin + p @ axes,
        (reading.span(core, "domainU"), reading.span(core, "domainV")),
        inverse=lambda points: (points - origin) @ back,
    )


def _nurbs(core: Element, reading: Reading) -> Surface:
    """Control points run along u first."""
    orders = [int(reading.number(core.at(f"Order{name}"))) for name in "UV"]
    knots = [np.array(reading.numbers(core.at(f"Knots{name}"))) for name in "UV"]
    counts = [len(each) - order for each, order in zip(knots, orders, strict=True)]
    for each, order, count in zip(knots, orders, counts, strict=True):
        require_knots(core, each, order, count, reading)
    points = reading.vectors(core, "CPs", 3)
    if len(points) != counts[0] * counts[1]:
        raise wrong(reading.where(core), f"{counts[0]} times {counts[1]} control points are needed")
    weights = weights_of(core, len(points), reading)
    net = np.concatenate([points * weights[:, None], weights[:, None]], axis=1)
    net = net.reshape(counts[1], counts[0], 4)

    def at(p: Floats) -> Floats:
        along, across = (basis_of(knots[i], orders[i], p[:, i]) for i in (0, 1))
        found = np.einsum("nu,nv,vuk->nk", along, across, net, optimize=True)
        return np.asarray(found[:, :3] / found[:, 3:])

    spans = [(float(each[order - 1]), float(each[-order])) for each, order in zip(knots, orders, strict=True)]
    return Surface("NURBS", at, (spans[0], spans[1]))


@dataclass(frozen=True, slots=True, eq=False)
class _Rail:
    """A curve as points on it, by a parameter that runs evenly through them over its domain."""

    places: Floats
    domain: Span

    def at(self, t: Floats) -> Floats:
        steps = np.linspace(*self.domain, len(self.places))
        return np.stack([np.interp(t, steps, each) for each in self.places.T], axis=1)


def _rail(parent: Element, reading: Reading) -> _Rail:
    core = core_of(parent)
    if core is None:
        raise wrong(reading.where(parent), "this curve has no core")
    return _Rail(chain(core, 3, reading), reading.span(core, "domain"))


def _extrusion(core: Element, reading: Reading) -> Surface | None:
    if (parent := core.at("Curve")) is None:
        return None
    rail = _rail(parent, reading)
    way = reading.vector(core, "TerminationPoint") - rail.places[0]
    return Surface("extrusion", lambda p: rail.at(p[:, 0]) + p[:, 1:] * way, (rail.domain, (0.0, 1.0)))


def _ruled(core: Element, reading: Reading) -> Surface | None:
    rails = [_rail(parent, reading) for parent in core.all("Curve")]
    if len(rails) != 2:
        return None
    first, second = rails
    if is_true(core, "turnedSecondCurve"):
        second = replace(second, places=second.places[::-1])
    second = replace(second, domain=first.domain)
    return Surface(
        "ruled surface",
        lambda p: (1 - p[:, 1:]) * first.at(p[:, 0]) + p[:, 1:] * second.at(p[:, 0]),
        (first.domain, (0.0, 1.0)),
    )


def _revolution(core: Element, reading: Reading) -> Surface | None:
    """u is the angle, v runs along the curve."""
    if (parent := core.at("Generatrix")) is None:
        return None
    rail = _rail(parent, reading)
    origin, z = reading.vector(core, *AXIS[0]), unit(reading.vector(core, *AXIS[1]))
    first, last = reading.span(core, "angle")

    def at(p: Floats) -> Floats:
        arm = rail.at(p[:, 1]) - origin
        along, (cos, sin) = (arm @ z)[:, None] * z, (np.cos(p[:, :1]), np.sin(p[:, :1]))
        found: Floats = origin + along + cos * (arm - along) + sin * np.cross(z, arm)
        return found

    period = TURN if last - first > TURN - 1e-9 else 0.0
    return Surface("revolution", at, ((first, last), rail.domain), (period, 0.0))


def _offset(core: Element, reading: Reading) -> Surface | None:
    parent, distance = core.at("Surface"), reading.number(core.at("Distance"))
    base = surface(parent, reading) if parent is not None else None
    if base is None:
        return None
    return replace(base, kind="offset surface", at=lambda p: base.at(p) + distance * base.normals(p)[0])


KINDS: dict[str, Callable[[Element, Reading], Surface | None]] = {
    "Plane": _plane,
    "Cylinder": cylinder,
    "Cone": cone,
    "Sphere": sphere,
    "Torus": torus,
    "Nurbs": _nurbs,
    "Extrude": _extrusion,
    "Ruled": _ruled,
    "Revolution": _revolution,
    "Offset": _offset,
}
