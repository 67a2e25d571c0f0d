"""Solids for tests: prisms over polygons, about the middle of their height."""

from collections.abc import Sequence

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.geometry import Solid
from cellwright.engine.stages.geometry.shapes.facet_solids import make_solid, triangulate_polygon

Polygon = Sequence[tuple[float, float]]


def prism(name: str, polygon: Polygon, height: float) -> Solid:
    """The prism over a polygon, counter-clockwise, from -height / 2 to height / 2."""
    flat = np.array(polygon, dtype=float)
    low = np.column_stack([flat, np.full(len(flat), -height / 2)])
    high = low + np.array([0.0, 0.0, height])
    up = np.array([0.0, 0.0, 1.0])
    surfaces = [
        ("top", triangulate_polygon(high, up)),
        ("bottom", triangulate_polygon(low[::-1], -up)),
    ]
    for n in range(len(flat)):
        m = (n + 1) % len(flat)
        side: Floats = np.array([low[n], low[m], high[m], high[n]])
        normal = np.cross(side[1] - side[0], side[2] - side[1])
        surfaces.append(
            (f"side_{n + 1}", triangulate_polygon(side, normal / np.linalg.norm(normal)))
        )
    return make_solid(name, surfaces)


def block(x: float, y: float, z: float) -> Solid:
    """A block about the origin."""
    return prism("block", [(-x / 2, -y / 2), (x / 2, -y / 2), (x / 2, y / 2), (-x / 2, y / 2)], z)


def ell(a: float, b: float, thick: float, height: float) -> Solid:
    """An angle with legs of lengths a and b."""
    return prism("ell", [(0, 0), (a, 0), (a, thick), (thick, thick), (thick, b), (0, b)], height)
