"""Plane regions of a depth image, the straight edges where they end, and their measures."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from cellwright.engine.kernels.arrays import Floats, Longs, Truths
from cellwright.engine.model.geometry import Solid
from cellwright.engine.model.vision import DepthCamera, DepthImage
from cellwright.engine.stages.vision.kernels.regions import Grower, block, blocks, grow, release
from cellwright.engine.stages.vision.kernels.rims import border

ON_LINE_PX = 1.2
MAX_TURN_COSINE = np.cos(np.radians(25))
SHORTEST_PX = 8
MAX_LINES_PER_REGION = 8
LINE_CANDIDATES = 60


@dataclass(frozen=True, slots=True, eq=False)
class StraightEdges:
    """Straight edges of a plane region or a facet, in two coordinates on its plane: the points p
    with `normal` . p = `offset`.

    `normal` (n, 2) points outwards. `ends` (n, 2) are where an edge begins and ends, along the
    normal turned to the left.
    """

    normal: Floats
    offset: Floats
    ends: Floats

    @property
    def along(self) -> Floats:
        """The directions (n, 2) of the edges."""
        directions: Floats = np.stack([-self.normal[:, 1], self.normal[:, 0]], axis=1)
        return directions


def lines_through(points: Floats, outward: Floats, pitch_m: float) -> StraightEdges:
    """Straight edges through border points (n, 2) with outward directions (n, 2), the longest
    first.
    """
    fitted_lines: list[tuple[Floats, float, Floats]] = []
    length = np.linalg.norm(outward, axis=1, keepdims=True)
    normals = outward / np.where(length > 0, length, 1.0)
    while len(points) >= SHORTEST_PX and len(fitted_lines) < MAX_LINES_PER_REGION:
        chosen = _consensus_points(points, normals, pitch_m)
        line = _fit_line(points[chosen], normals[chosen], pitch_m)
        if line is None:
            break
        on, entry = line
        fitted_lines.append(entry)
        keep = np.ones(len(points), dtype=bool)
        keep[np.nonzero(chosen)[0][on]] = False
        points, normals = points[keep], normals[keep]
    normal = np.array([line[0] for line in fitted_lines]).reshape(-1, 2)
    return StraightEdges(
        normal,
        np.array([line[1] for line in fitted_lines]),
        np.array([line[2] for line in fitted_lines]).reshape(-1, 2),
    )


def _consensus_points(points: Floats, normals: Floats, pitch_m: float) -> Truths:
    """The points (n,) on the line, through one of them and square to its direction, that most
    lie on.
    """
    some = np.linspace(0, len(points) - 1, min(len(points), LINE_CANDIDATES)).astype(int)
    height = points @ normals[some].T - (points[some] * normals[some]).sum(axis=1)
    on = (np.abs(height) < ON_LINE_PX * pitch_m) & (normals @ normals[some].T > MAX_TURN_COSINE)
    chosen: Truths = on[:, int(np.argmax(on.sum(axis=0)))]
    for _ in range(2):
        if chosen.sum() < 3:
            break
        normal, offset = _least_squares(points[chosen], normals[chosen])
        chosen = (np.abs(points @ normal - offset) < ON_LINE_PX * pitch_m) & (
            normals @ normal > MAX_TURN_COSINE
        )
    return chosen


def _least_squares(points: Floats, normals: Floats) -> tuple[Floats, float]:
    middle = points.sum(axis=0) / len(points)
    (xx, xy), (_, yy) = (points - middle).T @ (points - middle)
    along = 0.5 * math.atan2(2.0 * xy, xx - yy)
    normal = np.array([-math.sin(along), math.cos(along)])
    if normal @ normals.sum(axis=0) <= 0:
        normal = -normal
    return normal, float(normal @ middle)


def _fit_line(
    points: Floats, normals: Floats, pitch_m: float
) -> tuple[Truths, tuple[Floats, float, Floats]] | None:
    """The longest stretch of points on a line, and the line; None if it is too short."""
    if len(points) < SHORTEST_PX:
        return None
    normal, _ = _least_squares(points, normals)
    s = points @ np.array([-normal[1], normal[0]])
    order = np.argsort(s)
    breaks = np.nonzero(np.diff(s[order]) > 8 * pitch_m)[0] + 1
    longest = max(np.split(order, breaks), key=len)
    on = np.zeros(len(points), dtype=bool)
    on[longest] = True
    if len(longest) < SHORTEST_PX:
        return None
    normal, offset = _least_squares(points[on], normals[on])
    s = points[on] @ np.array([-normal[1], normal[0]])
    return on, (normal, offset, np.array([s.min() - pitch_m / 2, s.max() + pitch_m / 2]))


SIDE, STRIDE = 8, 4  # pixels: of blocks that regions grow from
PLANAR_SIGMAS = 1.5  # of the noise: what a plane block may deviate
GROWTH_SIGMAS = 3.5  # of the noise: how far from its plane a region grows
MIN_REGION_PX = 120
MAX_REGIONS = 24  # regions
BEYOND_BORDER_PX = (2.0, 4.0, 6.0)  # how many pixels outside the border the image is looked at
EDGE_STEP_SIGMAS = 4.0  # of the noise: what lies farther is beyond an edge


@dataclass(frozen=True, slots=True, eq=False)
class PlaneRegion:
    """A plane region: `axes` (3, 3) are two axes on it and its normal towards the camera, as
    columns.

    Its points are `axes` @ (x, y, offset). `inside` (s, 2) are some of its points, `lines` its
    edges.
    """

    axes: Floats
    offset: float
    inside: Floats
    lines: StraightEdges
    pixels: int


def regions_of(image: DepthImage, known: Truths) -> list[PlaneRegion]:
    """The plane regions of an image, the largest first; pixels of what is `known` (height,
    width) belong to none.
    """
    depth = image.depth
    inverse = np.where(depth > 0, 1.0 / np.where(depth > 0, depth, 1.0), 0.0)
    label = np.where(known, -1, 0).astype(np.int64)
    grower = Grower(inverse, label)
    planes = _grow_regions(grower, image.noise_m)
    boxes = ndimage.find_objects(np.maximum(label, 0), max_label=len(planes))
    regions = [
        region
        for n, (plane, box) in enumerate(zip(planes, boxes, strict=True))
        if box is not None
        and (region := _measure_region(image, inverse, label, n + 1, plane, box)) is not None
    ]
    return sorted(regions, key=lambda region_entry: -region_entry.pixels)


def _grow_regions(grower: Grower, noise_m: float) -> list[Floats]:
    """The planes (3,) of the regions, which `grower` has numbered from 1 on; from the flattest
    blocks.
    """
    flat = blocks(grower, SIDE, STRIDE)
    order = np.argsort(flat, axis=None, kind="stable")
    planes: list[Floats] = []
    for row, column in zip(*np.unravel_index(order, flat.shape), strict=True):
        if flat[row, column] > PLANAR_SIGMAS * noise_m or len(planes) >= MAX_REGIONS:
            break
        if block(grower, int(column) * STRIDE, int(row) * STRIDE, SIDE) > PLANAR_SIGMAS * noise_m:
            continue
        size = grow(grower, len(planes) + 1, GROWTH_SIGMAS * noise_m)
        if size >= MIN_REGION_PX:
            planes.append(np.array(grower.plane))
        elif size:
            release(grower, -2)
    return planes


def frame_of(plane: Floats, camera: DepthCamera) -> tuple[Floats, float]:
    """Axes (3, 3) and offset of the plane whose inverse depth is (a, b, c) in the pixels."""
    (a, b, c), (cx, cy) = plane, camera.centre_px
    normal = np.array([a * camera.focal_px, b * camera.focal_px, a * cx + b * cy + c])
    length = float(np.linalg.norm(normal))
    return axes_of(-normal / length), -1.0 / length


def axes_of(normal: Floats) -> Floats:
    """Two axes square to a unit normal, and the normal, as columns of a rotation (3, 3)."""
    across = np.eye(3)[int(np.argmin(np.abs(normal)))]
    first = np.cross(across, normal)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(normal, first), normal], axis=1)


def _measure_region(
    image: DepthImage,
    inverse: Floats,
    label: Longs,
    number: int,
    plane: Floats,
    box: tuple[slice, slice],
) -> PlaneRegion | None:
    rows, columns = (slice(max(0, span.start - 3), span.stop + 3) for span in box)
    mask = ndimage.binary_fill_holes(label[rows, columns] == number)
    at, outward = border(mask)
    at += [columns.start, rows.start]
    ends = _ending_pixels(inverse, plane, at, outward, image.noise_m)
    axes, offset = frame_of(plane, image.camera)
    shown, outer = at[ends] + 0.5 * outward[ends], at[ends] + outward[ends]
    points = on_plane(image.camera, axes, offset, shown)
    normals = on_plane(image.camera, axes, offset, outer) - points
    inner_v, inner_u = np.nonzero(shrink_mask(shrink_mask(mask)))
    if not len(inner_u):
        return None
    some = np.linspace(0, len(inner_u) - 1, 60).astype(int)
    inside = np.stack([inner_u[some] + columns.start, inner_v[some] + rows.start], axis=1).astype(
        float
    )
    rays = image.camera.rays(at[:, 0], at[:, 1]).mean(axis=0)
    flat = max(0.3, -float(rays @ axes[:, 2]) / float(np.linalg.norm(rays)))
    pitch = -offset / flat / image.camera.focal_px / flat
    lines = lines_through(points, normals, pitch)
    return PlaneRegion(
        axes, offset, on_plane(image.camera, axes, offset, inside), lines, int(mask.sum())
    )


def shrink_mask(mask: Truths) -> Truths:
    """The pixels of a mask all of whose four neighbours are in it; what lies outside the
    picture counts as in it.
    """
    inner: Truths = mask.copy()
    inner[1:] &= mask[:-1]
    inner[:-1] &= mask[1:]
    inner[:, 1:] &= mask[:, :-1]
    inner[:, :-1] &= mask[:, 1:]
    return inner


def _ending_pixels(
    inverse: Floats, plane: Floats, at: Floats, outward: Floats, noise_m: float
) -> Truths:
    """At which border pixels (n, 2), as (u, v), what lies beyond is farther away (n,)."""
    apart, answered = beyond_plane(
        inverse, plane, at[:, None] + np.array(BEYOND_BORDER_PX)[:, None] * outward[:, None]
    )
    farther = answered & (apart > EDGE_STEP_SIGMAS * noise_m)
    nearer = answered & (apart < -EDGE_STEP_SIGMAS * noise_m)
    before = np.maximum.accumulate(farther, axis=1)
    is_end: Truths = np.asarray(farther.any(axis=1) & ~(nearer & ~before).any(axis=1))
    return is_end


def beyond_plane(inverse: Floats, plane: Floats, at: Floats) -> tuple[Floats, Truths]:
    """How much deeper the image is than planes (3, ...) at places (..., 2), as (u, v), in
    metres; and whether it is known there.
    """
    u, v = np.rint(at[..., 0]).astype(np.int64), np.rint(at[..., 1]).astype(np.int64)
    height, width = inverse.shape
    inside = (u >= 0) & (v >= 0) & (u < width) & (v < height)
    w = np.where(inside, inverse.reshape(-1)[np.where(inside, v * width + u, 0)], 0.0)
    expected = plane[0] * u + plane[1] * v + plane[2]
    return (expected - w) / np.maximum(expected, 1e-9) ** 2, w > 0


def on_plane(camera: DepthCamera, axes: Floats, offset: float, at: Floats) -> Floats:
    """The two coordinates (n, 2), on a plane, of what pixels (n, 2), as (u, v), see of it."""
    rays = camera.rays(at[:, 0], at[:, 1])
    points = rays * (offset / (rays @ axes[:, 2]))[:, None]
    plane_points: Floats = points @ axes[:, :2]
    return plane_points


MIN_FACET_SHARE = 0.01  # of a solid's surface: smaller facets are not looked for
FACE_POINTS = 60  # points that stand for a face


@dataclass(frozen=True, slots=True, eq=False)
class SeenFace:
    """A plane face: the points (k, 3) on it, normal . x = `offset_m`, its area as far as it is
    seen, and its pixels.

    `number` is that of a facet where it belongs to a model.
    """

    normal: Floats
    offset_m: float
    area_m2: float
    points: Floats
    pixels: int = 0
    number: int = -1


def face_of(image: DepthImage, region: PlaneRegion) -> SeenFace:
    """A plane region of an image as a face, in the frame of the camera."""
    points = (
        np.column_stack([region.inside, np.full(len(region.inside), region.offset)]) @ region.axes.T
    )
    # A pixel covers depth^3 / (focal^2 |offset|) of a plane.
    covered = points[:, 2] ** 3 / (image.camera.focal_px**2 * abs(region.offset))
    some = np.linspace(0, len(points) - 1, min(FACE_POINTS, len(points))).astype(int)
    area = float(covered.mean() * region.pixels)
    return SeenFace(region.axes[:, 2], region.offset, area, points[some], region.pixels)


def faces_of(solid: Solid) -> list[SeenFace]:
    """The larger facets of a solid, in its own frame."""
    a, b, c = np.moveaxis(solid.corners, 1, 0)
    areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    faces = []
    for number, facet in enumerate(solid.facets):
        area = float(areas[solid.facet_of == number].sum())
        if area > MIN_FACET_SHARE * areas.sum():
            corners = facet.edges.reshape(-1, 3)
            faces.append(SeenFace(facet.normal, facet.offset, area, corners, number=number))
    return faces


def farthest_distance(first: Floats, second: Floats) -> float:
    """How far two points (n, 3), (m, 3) are apart at most, one of each: of polygons, by their
    corners.
    """
    return float(np.linalg.norm(first[:, None] - second[None], axis=2).max())


def count_directions(normals: Sequence[Floats], least: float) -> int:
    """How many directions normals span: singular values of at least `least`."""
    if not normals:
        return 0
    return int((np.linalg.svd(np.array(normals), compute_uv=False) > least).sum())
