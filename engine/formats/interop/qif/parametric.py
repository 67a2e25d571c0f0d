"""A surface as a map from parameters to points, with normals, motions, and the parameters of points."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.kernels.arrays import Floats

Span = tuple[float, float]
Map = Callable[[Floats], Floats]
STEP = 1e-6  # of the domain, for derivatives
GRID = 48  # for the parameters of points on surfaces without a formula for them
ROUNDS = 12


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """`at` takes parameters (n, 2) to points (n, 3). `inverse` takes points near the surface to their parameters.

    `domain` bounds u and v. A parameter with a period comes round to the same point.
    """

    kind: str
    at: Map
    domain: tuple[Span, Span]
    periods: tuple[float, float] = (0.0, 0.0)
    inverse: Map | None = None

    def parameters(self, points: Floats) -> Floats:
        """The parameters (n, 2) of points (n, 3) on the surface or near it."""
        return self.inverse(points) if self.inverse is not None else _nearest(self, points)

    def derivatives(self, parameters: Floats) -> tuple[Floats, Floats]:
        """The derivatives (n, 3) by u and by v."""
        found = []
        for axis, (first, last) in enumerate(self.domain):
            step = np.zeros(2)
            step[axis] = STEP * (last - first)
            found.append((self.at(parameters + step) - self.at(parameters - step)) / (2 * step[axis]))
        return found[0], found[1]

    def normals(self, parameters: Floats) -> tuple[Floats, Floats]:
        """Unit normals (n, 3), and how large the surface is for each unit of u times v (n,)."""
        across = np.cross(*self.derivatives(parameters))
        size = np.linalg.norm(across, axis=1)
        return across / np.where(size > 0, size, 1.0)[:, None], size


def moved(surface: Surface, turn: Floats, origin: Floats) -> Surface:
    """The surface after a motion: `turn` (3, 3) applies to columns, then `origin` (3,) is added."""
    at = surface.at

    def parameters(points: Floats) -> Floats:
        return surface.parameters((points - origin) @ turn)

    return replace(surface, at=lambda p: at(p) @ turn.T + origin, inverse=parameters)


def _nearest(surface: Surface, points: Floats) -> Floats:
    """Parameters of the points of a surface that are nearest to points: the best of a grid, then Gauss-Newton steps."""
    axes = [np.linspace(first, last, GRID) for first, last in surface.domain]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    places = surface.at(grid)
    found = np.stack([grid[int(np.argmin(((places - point) ** 2).sum(axis=1)))] for point in points])
    low, high = np.array(surface.domain).T
    for _ in range(ROUNDS):
        rest = points - surface.at(found)
        u, v = surface.derivatives(found)
        a, b, c = (np.einsum("ij,ij->i", *pair) for pair in ((u, u), (u, v), (v, v)))
        p, q = (np.einsum("ij,ij->i", rest, each) for each in (u, v))
        size = a * c - b * b
        size = np.where(size > 1e-30, size, np.inf)
        found = np.clip(found + np.stack([(c * p - b * q) / size, (a * q - b * p) / size], axis=1), low, high)
    return found


def unit(v: Floats) -> Floats:
    """The vector with length 1; unchanged if it has none."""
    found: Floats = v / max(float(np.linalg.norm(v)), 1e-300)
    return found
