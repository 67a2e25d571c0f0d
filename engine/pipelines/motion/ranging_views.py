"""What a laser ranging tool sees at the pose from which an arm takes a measurement."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import apply, inverse
from cellwright.engine.model.arm_poses import Box
from cellwright.engine.model.geometry import Solid
from cellwright.engine.model.vision import PixelWindow, RangeImage, Vague, picture_of
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.kinematics.arm_model import carrier_poses
from cellwright.engine.stages.geometry.pictures.picture_surfaces import mesh_of
from cellwright.engine.stages.geometry.world.collision_scene import world_pieces
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.engine.stages.vision.range_patches import PlacedPatch
from cellwright.engine.stages.vision.sensor_images import (
    expected_ranges,
    resolve_ranges,
    scan_solids,
)
from cellwright.kb.model.cell_model import Measuring, Patch, Place, Ranging


@dataclass(frozen=True, slots=True, eq=False)
class ToolEye:
    """Where a tool's eye is, T_world_eye (4, 4), and the bodies before it at T_eye_body (4, 4),
    by name.
    """

    tool: Ranging
    T_world_eye: Floats
    bodies: Mapping[str, tuple[Solid, Floats]]

    def pixel(self, point: Floats) -> tuple[float, float]:
        """Where a point (3,) of the world is seen, as (u, v)."""
        u, v = picture_of(self.tool).pixels(apply(inverse(self.T_world_eye), point[None]))
        return float(u[0]), float(v[0])


def solids_before(world: GeometricWorld, arm: str) -> dict[str, Solid]:
    """The surfaces in the world that an arm's tool may see, by body: of all but the arm and what it
    carries.

    Round bodies are as coarse as their shapes for collisions.
    """
    first = world.first_carriers[arm]
    own = range(first + 1, first + 1 + world.models[arm].joints.count)
    poses = carrier_poses(world.joints, world.configuration[None])[0]
    corners: dict[str, list[Floats]] = {}
    for piece in world_pieces(world):
        if piece.carrier not in own:
            vertices, triangles = mesh_of(piece)
            corners.setdefault(piece.body, []).append(
                apply(poses[piece.carrier], vertices)[triangles]
            )
    surfaces = {
        name: np.concatenate(triangles_of_body)
        for name, triangles_of_body in sorted(corners.items())
    }
    return {
        name: Solid(name, surface, np.zeros(len(surface), dtype=np.int64), ())
        for name, surface in surfaces.items()
    }


def eye_of(
    world: GeometricWorld,
    place: Place,
    how: Measuring,
    ranging: Ranging,
    q: Floats,
    solids: Mapping[str, Solid],
) -> ToolEye:
    """The eye of a place's tool with its arm at configuration `q` (k,), back along the tool's z by
    as much as it looks from.

    The world holds the tool already.
    """
    at = world.moved(place.arm, q)
    back_m = how.sight.back_m if how.sight else 0.0
    features = world.cell.bodies[place.tool].features
    T_tip_eye = inverse(transforms.of_pose(features["tip"])) @ transforms.of_pose(
        features[ranging.eye]
    )
    tip = at.pose("world", f"{place.tool}.tip")
    T = tip @ transforms.translation(0.0, 0.0, -back_m) @ T_tip_eye
    back = inverse(T)
    return ToolEye(ranging, T, {name: (solid, back) for name, solid in solids.items()})


def patch_of(eye: ToolEye, placed: PlacedPatch, point: Floats) -> Patch:
    """A patch as it is kept: where its middle is from that of a point (3,) of the world in the
    picture, in metres there.
    """
    u, v = eye.pixel(point)
    pitch = _pitch_m(eye, point)
    window = placed.window
    middle = ((window.left + window.right - 1) / 2 - u, (window.top + window.bottom - 1) / 2 - v)
    size = (window.right - window.left, window.bottom - window.top)
    return Patch((middle[0] * pitch, middle[1] * pitch), (size[0] * pitch, size[1] * pitch))


def window_of(eye: ToolEye, patch: Patch, point: Floats) -> PixelWindow:
    """The pixels of a kept patch, as far as they are in the picture."""
    (u, v), pitch = eye.pixel(point), _pitch_m(eye, point)
    left_px, top = (
        round(at + off / pitch - size / pitch / 2 + 0.5)
        for at, off, size in zip((u, v), patch.at_m, patch.size_m, strict=True)
    )
    right, bottom = left_px + round(patch.size_m[0] / pitch), top + round(patch.size_m[1] / pitch)
    limits = (eye.tool.width, eye.tool.height)
    low = [
        min(max(0, edge_px), limit) for edge_px, limit in zip((left_px, top), limits, strict=True)
    ]
    high = [
        min(max(0, edge_px), limit) for edge_px, limit in zip((right, bottom), limits, strict=True)
    ]
    return PixelWindow(low[0], low[1], high[0], high[1])


def box_looked_at(eye: ToolEye, point: Floats, reach_m: float) -> Box:
    """The box of all that an eye sees up to `reach_m` beside a point (3,) of the world."""
    ends = np.stack([eye.T_world_eye[:3, 3], point - reach_m, point + reach_m])
    low, high = (
        [round(float(x), 6) for x in corner] for corner in (ends.min(axis=0), ends.max(axis=0))
    )
    return ((low[0], low[1], low[2]), (high[0], high[1], high[2]))


def _pitch_m(eye: ToolEye, point: Floats) -> float:
    """How far apart two pixels see at a point (3,) of the world, square to the beam."""
    far = float(np.linalg.norm(point - eye.T_world_eye[:3, 3]))
    return far / picture_of(eye.tool).focal_px


def take_image(eye: ToolEye, seed: int, displaced_m: Floats | None = None) -> RangeImage:
    """The image that the tool answers there: its ranges are wrapped.

    With `displaced_m` (3,), in the world, everything really lies so far from where it is expected.
    """
    off = np.zeros(3) if displaced_m is None else eye.T_world_eye[:3, :3].T @ displaced_m
    moved = transforms.translation(*off)
    return scan_solids([(solid, moved @ T) for solid, T in eye.bodies.values()], eye.tool, seed)


def unwrap_image(eye: ToolEye, image: RangeImage, expected_to_m: float) -> RangeImage | Vague:
    """An image with whole ranges, by where everything is expected, known to a standard
    deviation.
    """
    return resolve_ranges(
        image, expected_ranges(list(eye.bodies.values()), eye.tool), expected_to_m
    )
