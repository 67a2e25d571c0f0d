"""What stands around a part in the image: everything that is neither known nor the part, and all that it hides."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import ndimage

from cellwright.engine.kernels.rigid import apply, inverse
from cellwright.engine.model.geometry import Floats, Truths
from cellwright.engine.model.solid import Solid
from cellwright.engine.pipelines.placing.looking import Looked
from cellwright.engine.stages.vision.images import rendered
from cellwright.kb.model.shapes import Box, PlacedShape, Pose

STRIDE = 5  # pixels between lines of sight
GROWN_PX = 4  # around the part's picture, which are the part's own edges
NEAR_M = 0.3
CELL_M = 0.015  # of the grid of columns
LOW_M = 0.004


@dataclass(frozen=True, eq=False)
class Unknown:
    """What an image shows that is neither known nor one of the parts found, each with its T_camera_part."""

    looked: Looked
    parts: tuple[tuple[Solid, Floats], ...]

    @cached_property
    def _shown(self) -> Truths:
        """The pixels (height, width) that show it; single ones are noise."""
        camera, depth = self.looked.image.camera, self.looked.image.depth
        own = rendered(self.parts, camera)[1] >= 0
        found = (depth > 0) & ~self.looked.ground.known & ~ndimage.binary_dilation(own, iterations=GROWN_PX)
        opened: Truths = found & ndimage.binary_opening(found, iterations=2)
        return opened

    def _points(self, stride: int) -> tuple[Floats, Floats]:
        """Rays (n, 3) of some of the pixels, and the points (n, 3) that they meet."""
        v, u = np.nonzero(self._shown)
        keep = (v % stride == 0) & (u % stride == 0)
        rays = self.looked.image.camera.rays(u[keep].astype(float), v[keep].astype(float))
        return rays, rays * self.looked.image.depth[v[keep], u[keep]][:, None]

    @cached_property
    def _lines(self) -> Floats:
        """What it hides: lines of sight down to the floor, as triangles (m, 3, 3) without area in the camera's frame."""
        rays, first = self._points(STRIDE)
        last = rays * np.maximum(_floor_depth(self.looked, rays), first[:, 2])[:, None]
        return np.stack([first, last, last], axis=1)

    def lines(self, T_world_part: Floats) -> Floats:
        """Those lines of sight that are near a part at a pose, in its frame."""
        T_camera_part = inverse(self.looked.T_world_camera) @ T_world_part
        near = np.linalg.norm(self._lines[:, 0] - T_camera_part[:3, 3], axis=1) < NEAR_M
        return apply(inverse(T_camera_part), self._lines[near].reshape(-1, 3)).reshape(-1, 3, 3)

    def columns(self, T_world_table: Floats) -> tuple[PlacedShape, ...]:
        """Blocks from the table up to the highest of it, on a grid, in the table's frame."""
        points = apply(inverse(T_world_table) @ self.looked.T_world_camera, self._points(2)[1])
        cells = np.floor(points[:, :2] / CELL_M).astype(np.int64)
        places, owner = np.unique(cells, axis=0, return_inverse=True)
        heights = np.zeros(len(places))
        np.maximum.at(heights, owner.reshape(-1), points[:, 2])
        return tuple(
            PlacedShape(
                Box((CELL_M, CELL_M, float(height))),
                Pose(((x + 0.5) * CELL_M, (y + 0.5) * CELL_M, float(height) / 2)),
            )
            for (x, y), height in zip(places.tolist(), heights, strict=True)
            if height > LOW_M
        )


def _floor_depth(looked: Looked, rays: Floats) -> Floats:
    """How deep the floor lies along rays (n, 3); 0 without a floor."""
    if not looked.ground.floors:
        return np.zeros(len(rays))
    floor = looked.ground.floors[0]
    slope = rays @ floor[:3]
    found: Floats = np.where(slope < -1e-9, floor[3] / np.where(slope < -1e-9, slope, -1.0), 0.0)
    return found
