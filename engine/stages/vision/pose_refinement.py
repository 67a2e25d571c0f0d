"""A pose hypothesis compared with the depth image, and the pose that fits the image best.

A part of nearly the right size agrees with most of an image, place by place. Along an edge of n
places, chance averages out as 1 / sqrt(n), so the median tells what single places cannot: that the
measured surface ends elsewhere. A place at a corner, where another thing begins, does not change
it.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs, Truths
from cellwright.engine.kernels.rigid import apply, rotation_by_vector
from cellwright.engine.model.vision import DepthCamera, DepthImage, PoseHypothesis
from cellwright.engine.stages.vision.kernels.rays import Range, draw
from cellwright.engine.stages.vision.kernels.rims import border, ends
from cellwright.engine.stages.vision.plane_regions import shrink_mask
from cellwright.engine.stages.vision.pose_hypotheses import PartModel

# edges are looked at in pieces about so long: a turned edge is off one way at each end
PIECE_PX = 24.0
MIN_PIECE_PLACES = 12  # places that tell of a piece
# how far a place may be from its edge, and the cosine between their normals
BESIDE_PX, ALONG = 1.5, 0.9
PIXEL_GAP = 0.5  # of it: two pixels side by side are twice that apart, and two at a corner are more
SHORT_PX = 4.0  # edges that look shorter are left out


@dataclass(frozen=True, slots=True, eq=False)
class OutlinePlaces:
    """Places of an outline and the edges they are on: how far (n,) outside of its edge, along the
    `outward` normal (n, 2), the measured surface ends.

    It is nan where no edge is near or no end is seen. `piece` (n,) numbers the pieces of all edges.
    """

    outward: Floats
    beyond_px: Floats
    piece: Longs


def assign_to_edges(
    model: PartModel, camera: DepthCamera, T: Floats, at: Floats, outward: Floats, ended: Floats
) -> OutlinePlaces:
    """The places (n, 2) of a part's outline at T_camera_part (4, 4), each with its edge.

    `outward` (n, 2) are the directions there. Between both pixels of `ended` (n, 2, 2) the measured
    surface ends; they are nan where this is not seen. They are compared with the edges themselves
    and not with the pixels that show the part: along a row of pixels these would be off by up to
    one where nothing is. Of edges that lie side by side, such as those of a face that is seen edge
    on, the outer one makes the outline.
    """
    ends = _outline_edges(model, camera, T)
    if not len(ends):
        return OutlinePlaces(outward, np.full(len(at), np.nan), np.zeros(len(at), dtype=np.int64))
    along = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(along, axis=1)
    share = np.clip(((at[:, None] - ends[:, 0]) * along).sum(axis=2) / length**2, 0.0, 1.0)
    to = ends[:, 0] + share[..., None] * along - at[:, None]
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1) / length[:, None]
    cosine = outward @ normal.T
    near = (np.linalg.norm(to, axis=2) < BESIDE_PX) & (np.abs(cosine) > ALONG)
    farthest = np.where(near, (to * outward[:, None]).sum(axis=2), -np.inf)
    own, row = farthest.argmax(axis=1), np.arange(len(at))
    out = normal[own] * np.sign(cosine[row, own])[:, None]
    last, following = ((ended - ends[own, None, 0]) * out[:, None]).sum(axis=2).T
    middle, unseen = (last + following) / 2, np.maximum((following - last) / 2 - PIXEL_GAP, 0.0)
    beyond = np.sign(middle) * np.maximum(np.abs(middle) - unseen, 0.0)
    pieces = np.maximum(np.rint(length / PIECE_PX), 1.0)
    number = np.minimum(np.floor(share[row, own] * pieces[own]), pieces[own] - 1)
    first = np.concatenate([[0.0], np.cumsum(pieces)])
    return OutlinePlaces(
        out, np.where(near[row, own], beyond, np.nan), (first[own] + number).astype(np.int64)
    )


def outline_deviation_px(beside: OutlinePlaces) -> float:
    """By how many pixels, in the median, that piece of an outline's edges is off that is off
    most; 0 if no piece is seen well.
    """
    measured = ~np.isnan(beside.beyond_px)
    piece, beyond = beside.piece[measured], beside.beyond_px[measured]
    order = np.argsort(piece, kind="stable")
    pieces = np.split(beyond[order], np.nonzero(np.diff(piece[order]))[0] + 1)
    return max(
        (abs(float(np.median(piece))) for piece in pieces if len(piece) >= MIN_PIECE_PLACES),
        default=0.0,
    )


def _outline_edges(model: PartModel, camera: DepthCamera, T: Floats) -> Floats:
    """The edges of a part in the picture (e, 2, 2), each as two ends (u, v), without short ones."""
    corners = apply(T, model.ends.reshape(-1, 3)).reshape(-1, 2, 3)
    corners = corners[corners[:, :, 2].min(axis=1) > 1e-3]
    ends = np.stack(camera.pixels(corners), axis=-1)
    long_edges: Floats = ends[np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) > SHORT_PX]
    return long_edges


# of a refinement, and after those, until it is at rest
REFINEMENT_ROUNDS, MAX_SETTLING_ROUNDS = 6, 14
LEAST_WITHIN = 3.0  # of the noise: what is farther from the surface is not compared in the end
AT_REST_M, AT_REST_RAD = 1e-4, 2e-3  # a step so small is of whole pixels that change sides
CLOSE_ROUNDS = 3  # rounds at the end, in which the outline is compared with the edges themselves
AGREEING_NOISE = 3.5  # of the noise
# of the noise: what is in front of the part by more hides it; by less, it contradicts it
HIDING_NOISE = 10.0
# the standard deviation of where beams meet a refined pose: on a steep surface, it is one of the
# depth, too
LATERAL_PX = 0.05
EDGE_PX = 0.5  # the standard deviation of a place where the surface ends
REACH_PX = 5
MAX_SURFACE_POINTS = 1500  # of the surface that are compared in a round, at most


@dataclass(frozen=True, eq=False)
class ImageView:
    """An image, and where it shows only what is known (height, width)."""

    image: DepthImage
    known: Truths

    @cached_property
    def inverse(self) -> Floats:
        """The inverse depths (height, width), 0 where nothing was measured."""
        depth = self.image.depth
        return np.where(depth > 0, 1.0 / np.where(depth > 0, depth, 1.0), 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class PartPicture:
    """A part's picture at a pose, in a window of the image that begins at pixel (v0, u0).

    `depth` and `owner` are those of the part alone; `apart` is how much deeper the image is, nan
    where nothing is known.
    """

    T: Floats
    v0: int
    u0: int
    depth: Floats
    owner: Longs
    apart: Floats


@dataclass(frozen=True, slots=True, eq=False)
class OutlineRim:
    """Places of the outline: pixels (n, 2) as (u, v), outward directions (n, 2), and how far
    outside of them the image ends.

    `shift_px` (n,) is nan where this cannot be seen; `continues` (n,) says where the surface does
    not end.
    """

    at: Floats
    outward: Floats
    shift_px: Floats
    continues: Truths

    @property
    def ended(self) -> Floats:
        """The last pixel that shows the surface and the next one (n, 2, 2); nan where this
        cannot be seen.
        """
        steps = self.shift_px[:, None] + [0.0, 1.0]
        rim_pixels: Floats = np.floor(
            self.at[:, None] + steps[..., None] * self.outward[:, None] + 0.5
        )
        return rim_pixels


def picture_part(
    model: PartModel, image: DepthImage, T: Floats, around_px: int = 8
) -> PartPicture | None:
    """The part's picture at a pose T_camera_part (4, 4), with some pixels around; None if it
    lies outside the image.
    """
    camera = image.camera
    corners = apply(T, model.solid.vertices)
    if corners[:, 2].min() < 1e-3:
        return None
    u, v = camera.pixels(corners)
    u0, v0 = max(0, int(u.min()) - around_px), max(0, int(v.min()) - around_px)
    u1, v1 = (
        min(camera.width, int(u.max()) + around_px + 1),
        min(camera.height, int(v.max()) + around_px + 1),
    )
    if u1 - u0 < 3 or v1 - v0 < 3:
        return None
    seen = Range(
        (v1 - v0, u1 - u0), camera.focal_px, (camera.centre_px[0] - u0, camera.centre_px[1] - v0)
    )
    draw(seen, np.ascontiguousarray(corners.reshape(-1, 3, 3)), model.solid.facet_of)
    measured = image.depth[v0:v1, u0:u1]
    apart = np.where((measured > 0) & (seen.owner >= 0), measured - seen.depth, np.nan)
    return PartPicture(T, v0, u0, seen.depth, seen.owner, apart)


def judge_pose(
    model: PartModel, view: ImageView, T: Floats, closely: bool = False
) -> PoseHypothesis | None:
    """What an image says of a pose; None if the part would not be in it. Only `closely`, the
    edges are looked at one by one.
    """
    image, seen = view.image, picture_part(model, view.image, T)
    if seen is None:
        return None
    rim = outline_rim(model, view, seen)
    compared = ~np.isnan(seen.apart)
    deviations = _depth_deviations(model, image, seen)
    off = seen.apart / deviations
    apart, vague = off[compared], 2 * np.log(deviations[compared] / image.noise_m)
    agree = int((np.abs(apart) <= AGREEING_NOISE).sum())
    shown = shrink_mask(seen.owner >= 0) & (seen.apart > -HIDING_NOISE * image.noise_m)
    through = int((np.abs(off[compared & shown]) > AGREEING_NOISE).sum())
    informative = rim.continues | ~np.isnan(rim.shift_px)
    shift = np.abs(np.nan_to_num(rim.shift_px, nan=99.0))
    good = informative & (shift <= 2.5)
    explained = np.maximum(AGREEING_NOISE**2 - apart**2 - vague, 0.0).sum()
    ended = np.maximum(AGREEING_NOISE**2 - (shift / EDGE_PX) ** 2, 0.0).sum()
    return PoseHypothesis(
        T,
        agree / max(agree + through, 1),
        agree / max(int(compared.sum()), 1),
        float(good.sum() / max(informative.sum(), 1)),
        agree,
        float(explained + ended) - AGREEING_NOISE**2 * through,
        outline_deviation_px(
            assign_to_edges(model, image.camera, T, rim.at, rim.outward, rim.ended)
        )
        if closely
        else 0.0,
    )


def _depth_deviations(model: PartModel, image: DepthImage, seen: PartPicture) -> Floats:
    """The standard deviation of each pixel's depth (h, w) in a window: noise, and on steep
    surfaces where exactly its beam meets.
    """
    steep = np.hypot(*_facet_planes(model, image, seen.T)[:, :2].T)[seen.owner]
    deviations: Floats = np.hypot(image.noise_m, LATERAL_PX * steep * seen.depth**2)
    return deviations


def outline_rim(model: PartModel, view: ImageView, seen: PartPicture) -> OutlineRim:
    """The outline of a part's picture, compared with the image.

    Where what is known lies beyond, the surface does not continue: there it meets the floor at a
    flat angle.
    """
    image = view.image
    at, outward = border(seen.owner >= 0)
    u, v = at.astype(np.int64).T
    at += [float(seen.u0), float(seen.v0)]
    planes = _facet_planes(model, image, seen.T)[seen.owner[v, u]]
    tolerance, corner = AGREEING_NOISE * image.noise_m, (seen.u0, seen.v0)
    shift, goes_on = ends(
        view.inverse, planes, at, outward, REACH_PX, tolerance, seen.depth, seen.owner, corner
    )
    far = np.rint(at + (REACH_PX - 1) * outward).astype(np.int64)
    known_window = view.known[
        np.clip(far[:, 1], 0, image.camera.height - 1),
        np.clip(far[:, 0], 0, image.camera.width - 1),
    ]
    return OutlineRim(at, outward, shift, goes_on & ~known_window)


def _facet_planes(model: PartModel, image: DepthImage, T: Floats) -> Floats:
    """For each facet, the (a, b, c) of its plane's inverse depth in the pixels (f, 3)."""
    normals = np.array([facet.normal for facet in model.solid.facets]) @ T[:3, :3].T
    offsets = np.array([facet.offset for facet in model.solid.facets]) + normals @ T[:3, 3]
    safe = np.where(np.abs(offsets) > 1e-9, offsets, 1e-9)[:, None]
    m, f, (cx, cy) = normals / safe, image.camera.focal_px, image.camera.centre_px
    return np.stack([m[:, 0] / f, m[:, 1] / f, m[:, 2] - (m[:, 0] * cx + m[:, 1] * cy) / f], axis=1)


def refine_pose(
    model: PartModel, view: ImageView, T: Floats, rounds: int = REFINEMENT_ROUNDS
) -> tuple[Floats, Floats]:
    """The pose near to one that fits the image a little better after some rounds, and its
    covariance (6, 6) about the part's origin.
    """
    covariance = np.full((6, 6), np.inf)
    for round_ in range(rounds):
        bettered = _improve_pose(model, view, T, max(LEAST_WITHIN, 8.0 - 2.0 * round_))
        if bettered is None:
            break
        T, covariance, step = bettered
        if round_ > 2 and np.abs(step[:3]).max() < 2e-5 and np.abs(step[3:]).max() < 2e-4:
            break
    return T, covariance


def settle_pose(model: PartModel, view: ImageView, T: Floats) -> tuple[Floats, Floats]:
    """The pose near to one that fits the image best, and its covariance (6, 6) about the part's
    origin.

    Pixels and places of the outline that belong to it change with the pose, so it may take many
    rounds. In the last ones, the outline is compared with the edges themselves, which are not bound
    to pixels.
    """
    T, covariance = refine_pose(model, view, T)
    for closely, most in ((False, MAX_SETTLING_ROUNDS), (True, CLOSE_ROUNDS)):
        for _ in range(most):
            bettered = _improve_pose(model, view, T, LEAST_WITHIN, closely)
            if bettered is None:
                break
            T, step_covariance, step = bettered
            covariance = (
                covariance if closely else step_covariance
            )  # places at corners are on no edge, but tell as much
            if np.abs(step[:3]).max() < AT_REST_M and np.abs(step[3:]).max() < AT_REST_RAD:
                break
    return T, covariance


def _improve_pose(
    model: PartModel, view: ImageView, T: Floats, within: float, closely: bool = False
) -> tuple[Floats, Floats, Floats] | None:
    """The pose after one step, its covariance (6, 6) and the step (6,); None if the image says
    too little.
    """
    seen = picture_part(model, view.image, T)
    if seen is None:
        return None
    rows, lacks, weights = _pose_equations(model, view, seen, within, closely)
    if len(lacks) < 12:
        return None
    values, vectors = np.linalg.eigh((rows * weights[:, None]).T @ rows)
    covariance: Floats = (vectors / np.maximum(values, 1e-6)) @ vectors.T
    step: Floats = covariance @ (rows.T @ (weights * lacks))
    improved = T.copy()
    improved[:3, 3] += step[:3]
    improved[:3, :3] = rotation_by_vector(step[3:]) @ T[:3, :3]
    return improved, covariance, step


def _pose_equations(
    model: PartModel, view: ImageView, seen: PartPicture, within: float, closely: bool
) -> tuple[Floats, Floats, Floats]:
    """Rows (n, 6), what they lack in metres (n,), and weights (n,), for a displacement and a
    turn about the part's origin.
    """
    surface = _surface_equations(model, view.image, seen, within)
    rim = outline_rim(model, view, seen)
    if closely:
        beside = assign_to_edges(model, view.image.camera, seen.T, rim.at, rim.outward, rim.ended)
        rim = replace(rim, outward=beside.outward, shift_px=beside.beyond_px)
    ended = _rim_equations(view.image, seen, rim)
    return tuple(np.concatenate(pair) for pair in zip(surface, ended, strict=True))  # type: ignore[return-value]


def _surface_equations(
    model: PartModel, image: DepthImage, seen: PartPicture, within: float
) -> tuple[Floats, Floats, Floats]:
    v, u = np.nonzero(np.abs(np.nan_to_num(seen.apart, nan=9.0)) < within * image.noise_m)
    if len(v) > MAX_SURFACE_POINTS:
        some = np.linspace(0, len(v) - 1, MAX_SURFACE_POINTS).astype(int)
        gain, v, u = len(v) / MAX_SURFACE_POINTS, v[some], u[some]
    else:
        gain = 1.0
    rays = image.camera.rays((u + seen.u0).astype(float), (v + seen.v0).astype(float))
    normals = np.array([facet.normal for facet in model.solid.facets]) @ seen.T[:3, :3].T
    n = normals[seen.owner[v, u]]
    slope = (n * rays).sum(axis=1)
    points = rays * seen.depth[v, u][:, None] - seen.T[:3, 3]
    lacks = slope * seen.apart[v, u]
    weights = gain / (image.noise_m * np.maximum(np.abs(slope), 0.05)) ** 2
    return np.concatenate([n, _cross_rows(points, n)], axis=1), lacks, weights


def _cross_rows(first: Floats, second: Floats) -> Floats:
    """The cross products (n, 3) of rows: `np.cross` without what it does for other shapes."""
    (a, b, c), (x, y, z) = first.T, second.T
    return np.stack([b * z - c * y, c * x - a * z, a * y - b * x], axis=1)


def _rim_equations(
    image: DepthImage, seen: PartPicture, rim: OutlineRim
) -> tuple[Floats, Floats, Floats]:
    informative = ~np.isnan(rim.shift_px)
    at, outward, shift = rim.at[informative], rim.outward[informative], rim.shift_px[informative]
    rays = image.camera.rays(at[:, 0], at[:, 1])
    v, u = (at - [seen.u0, seen.v0]).astype(int).T[::-1]
    depth = seen.depth[v, u]
    m = np.column_stack([outward, -(outward * rays[:, :2]).sum(axis=1)])
    pitch = depth / image.camera.focal_px
    points = rays * depth[:, None] - seen.T[:3, 3]
    weights = 1.0 / (EDGE_PX * pitch) ** 2
    return np.concatenate([m, _cross_rows(points, m)], axis=1), shift * pitch, weights
