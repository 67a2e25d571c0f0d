"""First guesses of a shape through a few points each, ordered by how many points agree.

Random sample consensus (Fischler & Bolles 1981); cylinders and cones from points with normals as in
Schnabel, Wahl & Klein, "Efficient RANSAC for point-cloud shape detection" (2007). The same points
give the same guesses.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from cellwright.engine.kernels.arrays import Floats, Longs
from cellwright.engine.kernels.rigid import apply, inverse, transform
from cellwright.engine.model.shape_fits import Cloud, FitShape
from cellwright.engine.stages.fitting.shape_distances import shape_distances

GUESSES, LOOKED_AT = 300, 250  # guesses, and points that each is compared with
SAMPLE_SIZES = {
    FitShape.PLANE: 3,
    FitShape.SPHERE: 4,
    FitShape.CYLINDER: 2,
    FitShape.CONE: 3,
    FitShape.CIRCLE: 3,
}
NORMAL_NEIGHBOURS = 14  # of a point, for its normal; more where there are many points
FAR_SIGMAS = 10.0  # standard deviations: what lies farther disagrees no more than this
GUESS_SEED = 20261123


@dataclass(frozen=True, slots=True, eq=False)
class ShapeGuess:
    """Shapes of one kind at T_world_shape (..., 4, 4), with the radius and the angle of each
    (...).
    """

    T: Floats
    radius_m: Floats
    angle_rad: Floats

    def __getitem__(self, number: int | Longs) -> "ShapeGuess":
        return ShapeGuess(self.T[number], self.radius_m[number], self.angle_rad[number])


def guess_shapes(shape: FitShape, cloud: Cloud, best: int) -> list[ShapeGuess]:
    """The best guesses, the one that most points agree with first; none where no few points
    have such a shape.
    """
    random = np.random.default_rng(GUESS_SEED)
    picked = np.stack(
        [
            random.choice(len(cloud.points), SAMPLE_SIZES[shape], replace=False)
            for _ in range(GUESSES)
        ]
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        guess = _shapes_through(shape, cloud.points, picked)
        costs = _guess_costs(shape, cloud, guess, random)
    order = np.argsort(costs, kind="stable")
    return [guess[int(number)] for number in order[:best] if np.isfinite(costs[number])]


def _guess_costs(
    shape: FitShape, cloud: Cloud, guess: ShapeGuess, random: np.random.Generator
) -> Floats:
    """How badly points agree with each guess (m,); infinite for what is no shape."""
    count = len(cloud.points)
    some = random.choice(count, min(count, LOOKED_AT), replace=False)
    sound = (
        np.isfinite(guess.T).all(axis=(1, 2))
        & np.isfinite(guess.radius_m)
        & np.isfinite(guess.angle_rad)
    )
    costs = np.full(len(sound), np.inf)
    if sound.any():
        sound_guess = guess[np.flatnonzero(sound)]
        local = apply(inverse(sound_guess.T), cloud.points[some])
        off = np.abs(
            shape_distances(shape, local, sound_guess.radius_m, sound_guess.angle_rad)
        ).max(axis=-1)
        costs[sound] = np.minimum(
            off / cloud.sigma_m[some], FAR_SIGMAS * _noise_spread(off / cloud.sigma_m[some])
        ).mean(axis=1)
    return costs


def _noise_spread(off: Floats) -> float:
    """What the best guess deviates at most points: guesses from noisy normals lie worse than
    the noise.
    """
    return max(1.0, float(np.median(off, axis=1).min()))


def _shapes_through(shape: FitShape, points: Floats, picked: Longs) -> ShapeGuess:
    """The shapes through picked points (m, k)."""
    chosen, none = points[picked], np.zeros(len(picked))
    if shape is FitShape.PLANE:
        return ShapeGuess(_axis_frames(_normals_of(chosen), chosen.mean(axis=1)), none, none)
    if shape is FitShape.SPHERE:
        centre, radius = _spheres_through(chosen)
        return ShapeGuess(
            transform(np.broadcast_to(np.eye(3), (len(picked), 3, 3)), centre), radius, none
        )
    if shape is FitShape.CIRCLE:
        centre, radius = _circles_through(chosen)
        return ShapeGuess(_axis_frames(_normals_of(chosen), centre), radius, none)
    directions = normals_at(points)[picked]
    return (_cylinders_through if shape is FitShape.CYLINDER else _cones_through)(
        chosen, directions
    )


def normals_at(points: Floats) -> Floats:
    """The normals (n, 3) of a surface at its points, each from its neighbours; their signs mean
    nothing.
    """
    count = min(len(points), max(NORMAL_NEIGHBOURS, len(points) // 16))
    _, near = cKDTree(points).query(points, count)
    around = points[near]
    off = around - around.mean(axis=1, keepdims=True)
    _, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", off, off))
    directions: Floats = vectors[:, :, 0]
    return directions


def _normals_of(chosen: Floats) -> Floats:
    crossed = np.cross(chosen[:, 1] - chosen[:, 0], chosen[:, 2] - chosen[:, 0])
    directions: Floats = crossed / np.linalg.norm(crossed, axis=1, keepdims=True)
    return directions


def _axis_frames(axis: Floats, origin: Floats) -> Floats:
    """Frames (m, 4, 4) with these z axes (m, 3) and origins (m, 3)."""
    helper = np.eye(3)[np.argmin(np.abs(axis), axis=1)]
    x = np.cross(helper, axis)
    x = x / np.linalg.norm(x, axis=1, keepdims=True)
    return transform(np.stack([x, np.cross(axis, x), axis], axis=-1), origin)


def _spheres_through(chosen: Floats) -> tuple[Floats, Floats]:
    """Centres (m, 3) and radii (m,) of the spheres through four points each."""
    edges = chosen[:, 1:] - chosen[:, :1]
    half = 0.5 * (edges**2).sum(axis=2)
    flat = np.abs(np.linalg.det(edges)) < 1e-15
    offset = np.full((len(chosen), 3), np.nan)
    offset[~flat] = np.linalg.solve(edges[~flat], half[~flat][..., None])[..., 0]
    return chosen[:, 0] + offset, np.linalg.norm(offset, axis=1)


def _circles_through(chosen: Floats) -> tuple[Floats, Floats]:
    """Centres (m, 3) and radii (m,) of the circles through three points each."""
    a, b = chosen[:, 1] - chosen[:, 0], chosen[:, 2] - chosen[:, 0]
    crossed = np.cross(a, b)
    square = (crossed**2).sum(axis=1, keepdims=True)
    aa, bb = ((edge**2).sum(axis=1, keepdims=True) for edge in (a, b))
    offset = np.cross(aa * b - bb * a, crossed) / (2.0 * square)
    return chosen[:, 0] + offset, np.linalg.norm(offset, axis=1)


def _cylinders_through(chosen: Floats, directions: Floats) -> ShapeGuess:
    """Each axis is square to both normals; the lines along them meet on it."""
    axis = np.cross(directions[:, 0], directions[:, 1])
    axis = axis / np.linalg.norm(axis, axis=1, keepdims=True)
    T = _axis_frames(axis, chosen[:, 0])
    p = np.einsum("mij,mkj->mki", np.swapaxes(T[:, :3, :3], 1, 2), chosen - chosen[:, :1])[..., :2]
    n = np.einsum("mij,mkj->mki", np.swapaxes(T[:, :3, :3], 1, 2), directions)[..., :2]
    between = n[:, 0, 0] * n[:, 1, 1] - n[:, 0, 1] * n[:, 1, 0]
    step = p[:, 1] - p[:, 0]
    along = (step[:, 0] * n[:, 1, 1] - step[:, 1] * n[:, 1, 0]) / between
    centre = p[:, 0] + along[:, None] * n[:, 0]
    radius = np.linalg.norm(p - centre[:, None], axis=2).mean(axis=1)
    origin = chosen[:, 0] + np.einsum("mij,mj->mi", T[:, :3, :2], centre)
    return ShapeGuess(transform(T[:, :3, :3], origin), radius, np.zeros(len(radius)))


def _cones_through(chosen: Floats, directions: Floats) -> ShapeGuess:
    """Each apex lies on three tangent planes; its axis leans equally to the three points."""
    lost = np.abs(np.linalg.det(directions)) < 1e-9
    apex = np.full((len(chosen), 3), np.nan)
    heights = (directions * chosen).sum(axis=2)
    apex[~lost] = np.linalg.solve(directions[~lost], heights[~lost][..., None])[..., 0]
    rays = chosen - apex[:, None]
    rays = rays / np.linalg.norm(rays, axis=2, keepdims=True)
    axis = _normals_of(rays)
    axis = np.where(((rays * axis[:, None]).sum(axis=2).mean(axis=1) < 0)[:, None], -axis, axis)
    angle = np.arccos(np.clip((rays * axis[:, None]).sum(axis=2).mean(axis=1), -1.0, 1.0))
    height = ((chosen - apex[:, None]) * axis[:, None]).sum(axis=2).mean(axis=1)
    return ShapeGuess(
        _axis_frames(axis, apex + height[:, None] * axis), height * np.tan(angle), angle
    )
