"""Plane faces of an image, measured: their normals, their areas, and how far they are from each other."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.solid import Solid
from cellwright.engine.model.vision import DepthImage
from cellwright.engine.stages.vision.outlines import Region

SMALL = 0.01  # of a solid's surface: smaller facets are not looked for
SPREAD = 60  # points that stand for a face


@dataclass(frozen=True, slots=True, eq=False)
class Face:
    """A plane face: the points (k, 3) on it, normal . x = `offset_m`, its area as far as it is seen, and its pixels.

    `number` is that of a facet where it belongs to a model.
    """

    normal: Floats
    offset_m: float
    area_m2: float
    points: Floats
    pixels: int = 0
    number: int = -1


def face_of(image: DepthImage, region: Region) -> Face:
    """A plane region of an image as a face, in the frame of the camera."""
    points = np.column_stack([region.inside, np.full(len(region.inside), region.offset)]) @ region.axes.T
    # A pixel covers depth^3 / (focal^2 |offset|) of a plane.
    covered = points[:, 2] ** 3 / (image.camera.focal_px**2 * abs(region.offset))
    some = np.linspace(0, len(points) - 1, min(SPREAD, len(points))).astype(int)
    area = float(covered.mean() * region.pixels)
    return Face(region.axes[:, 2], region.offset, area, points[some], region.pixels)


def faces_of(solid: Solid) -> list[Face]:
    """The larger facets of a solid, in its own frame."""
    a, b, c = np.moveaxis(solid.corners, 1, 0)
    areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    found = []
    for number, facet in enumerate(solid.facets):
        area = float(areas[solid.facet_of == number].sum())
        if area > SMALL * areas.sum():
            corners = facet.edges.reshape(-1, 3)
            found.append(Face(facet.normal, facet.offset, area, corners, number=number))
    return found


def farthest(one: Floats, other: Floats) -> float:
    """How far two points (n, 3), (m, 3) are apart at most, one of each: of polygons, by their corners."""
    return float(np.linalg.norm(one[:, None] - other[None], axis=2).max())


def independent(normals: Sequence[Floats], least: float) -> int:
    """How many directions normals span: singular values of at least `least`."""
    if not normals:
        return 0
    return int((np.linalg.svd(np.array(normals), compute_uv=False) > least).sum())
