"""A hypothesis against the image: what agrees, and the pose with which most does.

The surface is compared along its normals (point to plane), and the outline square to itself: the place in the picture where
the part ends is compared with the place where the measured surface ends.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cellwright.engine.kernels.rigid import apply, turned
from cellwright.engine.model.geometry import Floats, Longs, Truths
from cellwright.engine.model.vision import DepthImage, Hypothesis
from cellwright.engine.stages.vision.hypotheses import Model
from cellwright.engine.stages.vision.kernels.rays import Range, draw
from cellwright.engine.stages.vision.kernels.rims import border, ends
from cellwright.engine.stages.vision.outlines import shrunk
from cellwright.engine.stages.vision.residuals import beside_edges, off_px

ROUNDS, MOST_ROUNDS = 6, 14  # of a refinement, and after those, until it is at rest
LEAST_WITHIN = 3.0  # of the noise: what is farther from the surface is not compared in the end
AT_REST_M, AT_REST_RAD = 1e-4, 2e-3  # a step so small is of whole pixels that change sides
LAST = 3  # rounds at the end, in which the outline is compared with the edges themselves
AGREES = 3.5  # of the noise
BEFORE = 10.0  # of the noise: what is in front of the part by more hides it; by less, it contradicts it
LATERAL_PX = 0.05  # the standard deviation of where beams meet a refined pose: on a steep surface, it is one of the depth, too
EDGE_PX = 0.5  # the standard deviation of a place where the surface ends
REACH_PX = 5
POINTS = 1500  # of the surface that are compared in a round, at most


@dataclass(frozen=True, eq=False)
class View:
    """An image, and where it shows only what is known (height, width)."""

    image: DepthImage
    known: Truths

    @cached_property
    def inverse(self) -> Floats:
        """The inverse depths (height, width), 0 where nothing was measured."""
        depth = self.image.depth
        return np.where(depth > 0, 1.0 / np.where(depth > 0, depth, 1.0), 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """A part's picture at a pose, in a window of the image that begins at pixel (v0, u0).

    `depth` and `owner` are those of the part alone; `apart` is how much deeper the image is, nan where nothing is known.
    """

    T: Floats
    v0: int
    u0: int
    depth: Floats
    owner: Longs
    apart: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Rim:
    """Places of the outline: pixels (n, 2) as (u, v), outward directions (n, 2), and how far outside of them the image ends.

    `shift_px` (n,) is nan where this cannot be seen; `continues` (n,) says where the surface does not end.
    """

    at: Floats
    outward: Floats
    shift_px: Floats
    continues: Truths

    @property
    def ended(self) -> Floats:
        """The last pixel that shows the surface and the next one (n, 2, 2); nan where this cannot be seen."""
        steps = self.shift_px[:, None] + [0.0, 1.0]
        found: Floats = np.floor(self.at[:, None] + steps[..., None] * self.outward[:, None] + 0.5)
        return found


def look(model: Model, image: DepthImage, T: Floats, around_px: int = 8) -> Look | None:
    """The part's picture at a pose T_camera_part (4, 4), with some pixels around; None if it lies outside the image."""
    camera = image.camera
    corners = apply(T, model.solid.vertices)
    if corners[:, 2].min() < 1e-3:
        return None
    u, v = camera.pixels(corners)
    u0, v0 = max(0, int(u.min()) - around_px), max(0, int(v.min()) - around_px)
    u1, v1 = min(camera.width, int(u.max()) + around_px + 1), min(camera.height, int(v.max()) + around_px + 1)
    if u1 - u0 < 3 or v1 - v0 < 3:
        return None
    seen = Range((v1 - v0, u1 - u0), camera.focal_px, (camera.centre_px[0] - u0, camera.centre_px[1] - v0))
    draw(seen, np.ascontiguousarray(corners.reshape(-1, 3, 3)), model.solid.facet_of)
    measured = image.depth[v0:v1, u0:u1]
    apart = np.where((measured > 0) & (seen.owner >= 0), measured - seen.depth, np.nan)
    return Look(T, v0, u0, seen.depth, seen.owner, apart)


def judged(model: Model, view: View, T: Floats, closely: bool = False) -> Hypothesis | None:
    """What an image says of a pose; None if the part would not be in it. Only `closely`, the edges are looked at one by one."""
    image, seen = view.image, look(model, view.image, T)
    if seen is None:
        return None
    rim = outline(model, view, seen)
    known = ~np.isnan(seen.apart)
    deviations = _deviations(model, image, seen)
    off = seen.apart / deviations
    apart, vague = off[known], 2 * np.log(deviations[known] / image.noise_m)
    agree = int((np.abs(apart) <= AGREES).sum())
    shown = shrunk(seen.owner >= 0) & (seen.apart > -BEFORE * image.noise_m)
    through = int((np.abs(off[known & shown]) > AGREES).sum())
    told = rim.continues | ~np.isnan(rim.shift_px)
    shift = np.abs(np.nan_to_num(rim.shift_px, nan=99.0))
    good = told & (shift <= 2.5)
    explained = np.maximum(AGREES**2 - apart**2 - vague, 0.0).sum()
    ended = np.maximum(AGREES**2 - (shift / EDGE_PX) ** 2, 0.0).sum()
    return Hypothesis(
        T,
        agree / max(agree + through, 1),
        agree / max(int(known.sum()), 1),
        float(good.sum() / max(told.sum(), 1)),
        agree,
        float(explained + ended) - AGREES**2 * through,
        off_px(beside_edges(model, image.camera, T, rim.at, rim.outward, rim.ended)) if closely else 0.0,
    )


def _deviations(model: Model, image: DepthImage, seen: Look) -> Floats:
    """The standard deviation of each pixel's depth (h, w) in a window: noise, and on steep surfaces where exactly its beam meets."""
    steep = np.hypot(*_planes(model, image, seen.T)[:, :2].T)[seen.owner]
    found: Floats = np.hypot(image.noise_m, LATERAL_PX * steep * seen.depth**2)
    return found


def outline(model: Model, view: View, seen: Look) -> Rim:
    """The outline of a part's picture, compared with the image.

    Where what is known lies beyond, the surface does not continue: there it meets the floor at a flat angle.
    """
    image = view.image
    at, outward = border(seen.owner >= 0)
    u, v = at.astype(np.int64).T
    at += [float(seen.u0), float(seen.v0)]
    planes = _planes(model, image, seen.T)[seen.owner[v, u]]
    tolerance, corner = AGREES * image.noise_m, (seen.u0, seen.v0)
    shift, goes_on = ends(
        view.inverse, planes, at, outward, REACH_PX, tolerance, seen.depth, seen.owner, corner
    )
    far = np.rint(at + (REACH_PX - 1) * outward).astype(np.int64)
    known = view.known[
        np.clip(far[:, 1], 0, image.camera.height - 1), np.clip(far[:, 0], 0, image.camera.width - 1)
    ]
    return Rim(at, outward, shift, goes_on & ~known)


def _planes(model: Model, image: DepthImage, T: Floats) -> Floats:
    """For each facet, the (a, b, c) of its plane's inverse depth in the pixels (f, 3)."""
    normals = np.array([facet.normal for facet in model.solid.facets]) @ T[:3, :3].T
    offsets = np.array([facet.offset for facet in model.solid.facets]) + normals @ T[:3, 3]
    safe = np.where(np.abs(offsets) > 1e-9, offsets, 1e-9)[:, None]
    m, f, (cx, cy) = normals / safe, image.camera.focal_px, image.camera.centre_px
    return np.stack([m[:, 0] / f, m[:, 1] / f, m[:, 2] - (m[:, 0] * cx + m[:, 1] * cy) / f], axis=1)


def refined(model: Model, view: View, T: Floats, rounds: int = ROUNDS) -> tuple[Floats, Floats]:
    """The pose near to one that fits the image a little better after some rounds, and its covariance (6, 6) about the part's origin."""
    covariance = np.full((6, 6), np.inf)
    for round_ in range(rounds):
        bettered = _bettered(model, view, T, max(LEAST_WITHIN, 8.0 - 2.0 * round_))
        if bettered is None:
            break
        T, covariance, step = bettered
        if round_ > 2 and np.abs(step[:3]).max() < 2e-5 and np.abs(step[3:]).max() < 2e-4:
            break
    return T, covariance


def settled(model: Model, view: View, T: Floats) -> tuple[Floats, Floats]:
    """The pose near to one that fits the image best, and its covariance (6, 6) about the part's origin.

    Pixels and places of the outline that belong to it change with the pose, so it may take many rounds. In the last ones, the outline is compared with
    the edges themselves, which are not bound to pixels.
    """
    T, covariance = refined(model, view, T)
    for closely, most in ((False, MOST_ROUNDS), (True, LAST)):
        for _ in range(most):
            bettered = _bettered(model, view, T, LEAST_WITHIN, closely)
            if bettered is None:
                break
            T, told, step = bettered
            covariance = covariance if closely else told  # places at corners are on no edge, but tell as much
            if np.abs(step[:3]).max() < AT_REST_M and np.abs(step[3:]).max() < AT_REST_RAD:
                break
    return T, covariance


def _bettered(
    model: Model, view: View, T: Floats, within: float, closely: bool = False
) -> tuple[Floats, Floats, Floats] | None:
    """The pose after one step, its covariance (6, 6) and the step (6,); None if the image says too little."""
    seen = look(model, view.image, T)
    if seen is None:
        return None
    rows, lacks, weights = _equations(model, view, seen, within, closely)
    if len(lacks) < 12:
        return None
    values, vectors = np.linalg.eigh((rows * weights[:, None]).T @ rows)
    covariance: Floats = (vectors / np.maximum(values, 1e-6)) @ vectors.T
    step: Floats = covariance @ (rows.T @ (weights * lacks))
    found = T.copy()
    found[:3, 3] += step[:3]
    found[:3, :3] = turned(step[3:]) @ T[:3, :3]
    return found, covariance, step


def _equations(
    model: Model, view: View, seen: Look, within: float, closely: bool
) -> tuple[Floats, Floats, Floats]:
    """Rows (n, 6), what they lack in metres (n,), and weights (n,), for a displacement and a turn about the part's origin."""
    surface = _surface(model, view.image, seen, within)
    rim = outline(model, view, seen)
    if closely:
        beside = beside_edges(model, view.image.camera, seen.T, rim.at, rim.outward, rim.ended)
        rim = replace(rim, outward=beside.outward, shift_px=beside.beyond_px)
    ended = _rim(view.image, seen, rim)
    return tuple(np.concatenate(pair) for pair in zip(surface, ended, strict=True))  # type: ignore[return-value]


def _surface(model: Model, image: DepthImage, seen: Look, within: float) -> tuple[Floats, Floats, Floats]:
    v, u = np.nonzero(np.abs(np.nan_to_num(seen.apart, nan=9.0)) < within * image.noise_m)
    if len(v) > POINTS:
        some = np.linspace(0, len(v) - 1, POINTS).astype(int)
        gain, v, u = len(v) / POINTS, v[some], u[some]
    else:
        gain = 1.0
    rays = image.camera.rays((u + seen.u0).astype(float), (v + seen.v0).astype(float))
    normals = np.array([facet.normal for facet in model.solid.facets]) @ seen.T[:3, :3].T
    n = normals[seen.owner[v, u]]
    slope = (n * rays).sum(axis=1)
    points = rays * seen.depth[v, u][:, None] - seen.T[:3, 3]
    lacks = slope * seen.apart[v, u]
    weights = gain / (image.noise_m * np.maximum(np.abs(slope), 0.05)) ** 2
    return np.concatenate([n, _crossed(points, n)], axis=1), lacks, weights


def _crossed(one: Floats, other: Floats) -> Floats:
    """The cross products (n, 3) of rows: `np.cross` without what it does for other shapes."""
    (a, b, c), (x, y, z) = one.T, other.T
    return np.stack([b * z - c * y, c * x - a * z, a * y - b * x], axis=1)


def _rim(image: DepthImage, seen: Look, rim: Rim) -> tuple[Floats, Floats, Floats]:
    told = ~np.isnan(rim.shift_px)
    at, outward, shift = rim.at[told], rim.outward[told], rim.shift_px[told]
    rays = image.camera.rays(at[:, 0], at[:, 1])
    v, u = (at - [seen.u0, seen.v0]).astype(int).T[::-1]
    depth = seen.depth[v, u]
    m = np.column_stack([outward, -(outward * rays[:, :2]).sum(axis=1)])
    pitch = depth / image.camera.focal_px
    points = rays * depth[:, None] - seen.T[:3, 3]
    weights = 1.0 / (EDGE_PX * pitch) ** 2
    return np.concatenate([m, _crossed(points, m)], axis=1), shift * pitch, weights
