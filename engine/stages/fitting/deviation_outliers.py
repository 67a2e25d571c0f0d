"""Measured deviations that no smooth surface through their neighbours explains.

Through the neighbours of each point a plane of deviations is fitted so that bad ones among them do
not count (Tukey's biweight, by iteratively reweighted least squares: Holland & Welsch 1977). The
point itself is left out. How far it is off is told by the standard deviation of the difference:
that of the value, that of the plane there, and how rough the whole surface is.
"""

from dataclasses import dataclass

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs, Truths

NEAREST, AMONG, LEAST = (
    12,
    30,
    6,
)  # neighbours that count, of so many near ones; fewer than the least tell nothing
NEIGHBOUR_COSINE = 0.9  # cosine between the normals of neighbours
CONSISTENCY_ROUNDS = 12
BIWEIGHT_SIGMAS = 4.685  # standard deviations beyond which a neighbour does not count at all
SIGMA_BY_MEDIAN = 1.4826  # a normal distribution's standard deviation by its median deviation
RIDGE_WEIGHT = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedDeviations:
    """What neighbours let expect of each point (n,), its standard deviation (n,), and whether
    they tell anything (n,).
    """

    value: Floats
    sigma: Floats
    known: Truths

    def off(self, values: Floats, sigma: Floats) -> Floats:
        """How far values (n,) with standard deviations (n,) are from what is expected, by that
        of the difference; 0 where nothing is.
        """
        sigmas_off: Floats = np.where(
            self.known, (values - self.value) / np.hypot(sigma, self.sigma), 0.0
        )
        return sigmas_off


def expect_deviations(
    points: Floats, normals: Floats, values: Floats, sigma: Floats, counts: Truths
) -> ExpectedDeviations:
    """What the neighbours of each point (n, 3), with its outward unit normal (n, 3), say of its
    deviation.

    `values` and their standard deviations `sigma` (n,) are in one unit; only those that `count`
    (n,) are neighbours.
    """
    n = len(points)
    nothing = ExpectedDeviations(np.zeros(n), np.ones(n), np.zeros(n, bool))
    if counts.sum() <= LEAST:
        return nothing
    near, usable = _surface_neighbours(points, normals, counts)
    judged = usable.sum(axis=1) >= LEAST
    beside, by = np.where(usable, values[near], 0.0), np.where(usable, sigma[near], 1.0)
    where = _surface_coordinates(points, normals, near, usable)
    plane, covariance, scale = _neighbour_planes(where, beside, by, usable)
    rough = max(1.0, float(np.median(scale[judged]))) if judged.any() else 1.0
    own = np.sqrt(max(0.0, rough**2 - 1.0)) * sigma
    return ExpectedDeviations(plane, np.hypot(own, rough * np.sqrt(covariance)), judged)


def _surface_neighbours(points: Floats, normals: Floats, counts: Truths) -> tuple[Longs, Truths]:
    """The numbers (n, k) of points near each point, and which of them (n, k) are neighbours on
    the same surface.
    """
    from scipy.spatial import cKDTree

    candidates = np.flatnonzero(counts)
    _, nearest = cKDTree(points[candidates]).query(points, k=min(AMONG, len(candidates)))
    near: Longs = candidates[np.asarray(nearest).reshape(len(points), -1)]
    alike = np.einsum("nkd,nd->nk", normals[near], normals) >= NEIGHBOUR_COSINE
    usable = alike & (near != np.arange(len(points))[:, None])
    return near, usable & (np.cumsum(usable, axis=1) <= NEAREST)


def _surface_coordinates(points: Floats, normals: Floats, near: Longs, usable: Truths) -> Floats:
    """Where neighbours lie along the surface (n, k, 2), by the distance of the farthest of them."""
    away = points[near] - points[:, None]
    least = np.abs(normals).argmin(axis=1)
    u = np.cross(normals, np.eye(3)[least])
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(normals, u)
    flat = np.stack([np.einsum("nkd,nd->nk", away, axis) for axis in (u, v)], axis=2)
    flat = np.where(usable[..., None], flat, 0.0)
    size = np.maximum(np.abs(flat).max(axis=(1, 2)), 1e-12)
    coordinates: Floats = flat / size[:, None, None]
    return coordinates


def _neighbour_planes(
    where: Floats, values: Floats, sigma: Floats, usable: Truths
) -> tuple[Floats, Floats, Floats]:
    """The height (n,) of a plane through neighbours at the point itself, its variance (n,), and
    how rough they are beside it (n,).
    """
    X = np.concatenate([np.ones((*values.shape, 1)), where], axis=2)
    middle = _masked_median(values, usable, 0.0)
    off, weights = (values - middle[:, None]) / sigma, usable.astype(float)
    scale = _robust_scale(off, usable)
    plane, inverse = middle, np.ones((len(values), 3, 3))
    for _ in range(CONSISTENCY_ROUNDS):
        ratio = off / (BIWEIGHT_SIGMAS * np.maximum(scale, 1.0)[:, None])
        weights = (
            np.where(usable & (np.abs(ratio) < 1.0), (1.0 - np.minimum(ratio**2, 1.0)) ** 2, 0.0)
            / sigma**2
        )
        A = np.einsum("nka,nk,nkb->nab", X, weights, X)
        A += (RIDGE_WEIGHT + RIDGE_WEIGHT * np.trace(A, axis1=1, axis2=2))[:, None, None] * np.eye(
            3
        )
        inverse = np.linalg.inv(A)
        coefficients = np.einsum("nab,nkb,nk,nk->na", inverse, X, weights, values)
        off = (values - np.einsum("nka,na->nk", X, coefficients)) / sigma
        scale, plane = _robust_scale(off, usable), coefficients[:, 0]
    return plane, inverse[:, 0, 0], scale


def _robust_scale(off: Floats, usable: Truths) -> Floats:
    return SIGMA_BY_MEDIAN * _masked_median(np.abs(off), usable, 1.0 / SIGMA_BY_MEDIAN)


def _masked_median(values: Floats, usable: Truths, otherwise: float) -> Floats:
    """The median of the usable values in each row (n, k); `otherwise` where none is."""
    count = usable.sum(axis=1)
    rising = np.sort(np.where(usable, values, np.inf), axis=1)
    middle = [
        np.take_along_axis(rising, np.maximum(ranks, 0)[:, None], 1)[:, 0]
        for ranks in ((count - 1) // 2, np.minimum(count // 2, rising.shape[1] - 1))
    ]
    medians: Floats = np.full(len(values), otherwise)
    some = count > 0
    medians[some] = 0.5 * (middle[0][some] + middle[1][some])
    return medians
