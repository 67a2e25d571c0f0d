"""Plane regions of a depth image, and the straight edges where they end.

An edge counts where what lies beyond it is farther away: there the surface itself ends. Where something nearer begins, the
region is merely hidden, and its border says nothing about the part.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from cellwright.engine.model.geometry import Floats, Longs, Truths
from cellwright.engine.model.vision import Camera, DepthImage
from cellwright.engine.stages.vision.kernels.regions import Grower, block, blocks, grow, release
from cellwright.engine.stages.vision.kernels.rims import border
from cellwright.engine.stages.vision.lines import Lines, lines_through

SIDE, STRIDE = 8, 4  # pixels: of blocks that regions grow from
PLANAR = 1.5  # of the noise: what a plane block may deviate
GROWS = 3.5  # of the noise: how far from its plane a region grows
LEAST_PX = 120
MOST = 24  # regions
BEYOND = (2.0, 4.0, 6.0)  # how many pixels outside the border the image is looked at
STEP = 4.0  # of the noise: what lies farther is beyond an edge


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """A plane region: `axes` (3, 3) are two axes on it and its normal towards the camera, as columns.

    Its points are `axes` @ (x, y, offset). `inside` (s, 2) are some of its points, `lines` its edges.
    """

    axes: Floats
    offset: float
    inside: Floats
    lines: Lines
    pixels: int


def regions_of(image: DepthImage, known: Truths) -> list[Region]:
    """The plane regions of an image, the largest first; pixels of what is `known` (height, width) belong to none."""
    depth = image.depth
    inverse = np.where(depth > 0, 1.0 / np.where(depth > 0, depth, 1.0), 0.0)
    label = np.where(known, -1, 0).astype(np.int64)
    grower = Grower(inverse, label)
    planes = _grown(grower, image.noise_m)
    boxes = ndimage.find_objects(np.maximum(label, 0), max_label=len(planes))
    found = [
        region
        for n, (plane, box) in enumerate(zip(planes, boxes, strict=True))
        if box is not None and (region := _region(image, inverse, label, n + 1, plane, box)) is not None
    ]
    return sorted(found, key=lambda each: -each.pixels)


def _grown(grower: Grower, noise_m: float) -> list[Floats]:
    """The planes (3,) of the regions, which `grower` has numbered from 1 on; from the flattest blocks."""
    flat = blocks(grower, SIDE, STRIDE)
    order = np.argsort(flat, axis=None, kind="stable")
    planes: list[Floats] = []
    for row, column in zip(*np.unravel_index(order, flat.shape), strict=True):
        if flat[row, column] > PLANAR * noise_m or len(planes) >= MOST:
            break
        if block(grower, int(column) * STRIDE, int(row) * STRIDE, SIDE) > PLANAR * noise_m:
            continue
        size = grow(grower, len(planes) + 1, GROWS * noise_m)
        if size >= LEAST_PX:
            planes.append(np.array(grower.plane))
        elif size:
            release(grower, -2)
    return planes


def frame_of(plane: Floats, camera: Camera) -> tuple[Floats, float]:
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


def _region(
    image: DepthImage, inverse: Floats, label: Longs, number: int, plane: Floats, box: tuple[slice, slice]
) -> Region | None:
    rows, columns = (slice(max(0, each.start - 3), each.stop + 3) for each in box)
    mask = ndimage.binary_fill_holes(label[rows, columns] == number)
    at, outward = border(mask)
    at += [columns.start, rows.start]
    ends = _ends(inverse, plane, at, outward, image.noise_m)
    axes, offset = frame_of(plane, image.camera)
    shown, outer = at[ends] + 0.5 * outward[ends], at[ends] + outward[ends]
    points = on_plane(image.camera, axes, offset, shown)
    normals = on_plane(image.camera, axes, offset, outer) - points
    inner_v, inner_u = np.nonzero(shrunk(shrunk(mask)))
    if not len(inner_u):
        return None
    some = np.linspace(0, len(inner_u) - 1, 60).astype(int)
    inside = np.stack([inner_u[some] + columns.start, inner_v[some] + rows.start], axis=1).astype(float)
    rays = image.camera.rays(at[:, 0], at[:, 1]).mean(axis=0)
    flat = max(0.3, -float(rays @ axes[:, 2]) / float(np.linalg.norm(rays)))
    pitch = -offset / flat / image.camera.focal_px / flat
    lines = lines_through(points, normals, pitch)
    return Region(axes, offset, on_plane(image.camera, axes, offset, inside), lines, int(mask.sum()))


def shrunk(mask: Truths) -> Truths:
    """The pixels of a mask all of whose four neighbours are in it; what lies outside the picture counts as in it."""
    found: Truths = mask.copy()
    found[1:] &= mask[:-1]
    found[:-1] &= mask[1:]
    found[:, 1:] &= mask[:, :-1]
    found[:, :-1] &= mask[:, 1:]
    return found


def _ends(inverse: Floats, plane: Floats, at: Floats, outward: Floats, noise_m: float) -> Truths:
    """At which border pixels (n, 2), as (u, v), what lies beyond is farther away (n,)."""
    apart, known = beyond_plane(inverse, plane, at[:, None] + np.array(BEYOND)[:, None] * outward[:, None])
    farther = known & (apart > STEP * noise_m)
    nearer = known & (apart < -STEP * noise_m)
    before = np.maximum.accumulate(farther, axis=1)
    found: Truths = np.asarray(farther.any(axis=1) & ~(nearer & ~before).any(axis=1))
    return found


def beyond_plane(inverse: Floats, plane: Floats, at: Floats) -> tuple[Floats, Truths]:
    """How much deeper the image is than planes (3, ...) at places (..., 2), as (u, v), in metres; and whether it is known there."""
    u, v = np.rint(at[..., 0]).astype(np.int64), np.rint(at[..., 1]).astype(np.int64)
    height, width = inverse.shape
    inside = (u >= 0) & (v >= 0) & (u < width) & (v < height)
    w = np.where(inside, inverse.reshape(-1)[np.where(inside, v * width + u, 0)], 0.0)
    expected = plane[0] * u + plane[1] * v + plane[2]
    return (expected - w) / np.maximum(expected, 1e-9) ** 2, w > 0


def on_plane(camera: Camera, axes: Floats, offset: float, at: Floats) -> Floats:
    """The two coordinates (n, 2), on a plane, of what pixels (n, 2), as (u, v), see of it."""
    rays = camera.rays(at[:, 0], at[:, 1])
    points = rays * (offset / (rays @ axes[:, 2]))[:, None]
    found: Floats = points @ axes[:, :2]
    return found
