"""Workspace of PLACE: the site, obstacles seen in it, and the task of moving one part."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property

import numpy as np
from scipy import ndimage

from cellwright.engine.kernels.arrays import Floats, Truths
from cellwright.engine.kernels.rigid import apply, inverse
from cellwright.engine.model.geometry import Solid
from cellwright.engine.model.motion_values import Strategy
from cellwright.engine.pipelines.manipulation.part_grasps import PartHolds, part_holds
from cellwright.engine.pipelines.manipulation.scene_camera import SceneView, table_pose
from cellwright.engine.stages.geometry.shapes.facet_solids import solid_of
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.engine.stages.vision.sensor_images import render_depths
from cellwright.kb.model.body_shapes import Box, PlacedShape, Pose
from cellwright.kb.model.cell_model import Body, BodyKind, Placement
from cellwright.kb.model.part_scene import Scene

SIGHT_STRIDE_PX = 5  # pixels between lines of sight
GROWN_PX = 4  # around the part's picture, which are the part's own edges
NEARBY_M = 0.3
CELL_M = 0.015  # of the grid of columns
LOW_M = 0.004


@dataclass(frozen=True, eq=False)
class UnknownThings:
    """What an image shows that is neither known nor one of the parts found, each with its
    T_camera_part.
    """

    looked: SceneView
    parts: tuple[tuple[Solid, Floats], ...]

    @cached_property
    def _shown(self) -> Truths:
        """The pixels (height, width) that show it; single ones are noise."""
        camera, depth = self.looked.image.camera, self.looked.image.depth
        own = render_depths(self.parts, camera)[1] >= 0
        shown = (
            (depth > 0)
            & ~self.looked.ground.known
            & ~ndimage.binary_dilation(own, iterations=GROWN_PX)
        )
        opened: Truths = shown & ndimage.binary_opening(shown, iterations=2)
        return opened

    def _points(self, stride: int) -> tuple[Floats, Floats]:
        """Rays (n, 3) of some of the pixels, and the points (n, 3) that they meet."""
        v, u = np.nonzero(self._shown)
        keep = (v % stride == 0) & (u % stride == 0)
        rays = self.looked.image.camera.rays(u[keep].astype(float), v[keep].astype(float))
        return rays, rays * self.looked.image.depth[v[keep], u[keep]][:, None]

    @cached_property
    def _lines(self) -> Floats:
        """What it hides: lines of sight down to the floor, as triangles (m, 3, 3) without area
        in the camera's frame.
        """
        rays, first = self._points(SIGHT_STRIDE_PX)
        last = rays * np.maximum(_floor_depth(self.looked, rays), first[:, 2])[:, None]
        return np.stack([first, last, last], axis=1)

    def lines(self, T_world_part: Floats) -> Floats:
        """Those lines of sight that are near a part at a pose, in its frame."""
        T_camera_part = inverse(self.looked.T_world_camera) @ T_world_part
        near = np.linalg.norm(self._lines[:, 0] - T_camera_part[:3, 3], axis=1) < NEARBY_M
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


def _floor_depth(looked: SceneView, rays: Floats) -> Floats:
    """How deep the floor lies along rays (n, 3); 0 without a floor."""
    if not looked.ground.floors:
        return np.zeros(len(rays))
    floor = looked.ground.floors[0]
    slope = rays @ floor[:3]
    depth: Floats = np.where(slope < -1e-9, floor[3] / np.where(slope < -1e-9, slope, -1.0), 0.0)
    return depth


UNKNOWN_BODY = "unknown_things"  # the body that stands for all that is only seen


class HandApproachKind(StrEnum):
    """How the hand comes to a grasp.

    `straight` is along its own axis. `complete` does so where it can, and else looks at all ways on
    a grid in the grasp plane. By `potential` it is drawn by the grasp and pushed off by what stands
    around, as Handey's was, and may be stuck.
    """

    STRAIGHT = "straight"
    COMPLETE = "complete"
    POTENTIAL = "potential"


@dataclass(frozen=True, slots=True)
class MotionManner:
    """How the hand comes to a part, and how motions between are looked for."""

    coming: HandApproachKind = HandApproachKind.STRAIGHT
    strategy: Strategy = Strategy.CONNECT


USUAL_MANNER = MotionManner()


@dataclass(frozen=True, eq=False)
class PlaceTask:
    """A part to be placed: the scene, the world as far as it is known, the part's pose found and
    its goal, and its holds.

    `crowded` is the world with all that is only seen, as columns. `solids` are the surfaces of
    bodies, `unknown` is what the image shows beside them, `manner` how the hand is to come and go.
    """

    scene: Scene
    world: GeometricWorld
    crowded: GeometricWorld
    part: str
    T_start: Floats
    T_goal: Floats
    holds: PartHolds
    solids: Mapping[str, Solid]
    unknown: UnknownThings
    T_world_table: Floats
    manner: MotionManner = USUAL_MANNER

    def obstacles(self, T_world_part: Floats) -> Floats:
        """All that is around a part when it is at a pose, as triangles (m, 3, 3) in its frame:
        bodies, and what is only seen.
        """
        back = inverse(T_world_part)
        points = [
            apply(back @ self.world.pose("world", name), self.solids[name].vertices).reshape(
                -1, 3, 3
            )
            for name in self.world.cell.bodies
            if name != self.part and name in self.solids
        ]
        return np.concatenate([*points, self.unknown.lines(T_world_part)])


@dataclass(frozen=True, eq=False)
class AssemblySite:
    """The scene, the world without its clutter, what was seen, and where parts were found:
    T_world_part by name.
    """

    scene: Scene
    world: GeometricWorld
    looked: SceneView
    found: Mapping[str, Floats]
    manner: MotionManner = USUAL_MANNER
    _holds: dict[str, PartHolds] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        scene: Scene,
        world: GeometricWorld,
        looked: SceneView,
        found_poses: Mapping[str, Floats],
        manner: MotionManner = USUAL_MANNER,
    ) -> "AssemblySite":
        """The site of a scene: its clutter is not known, and parts are where they were found."""
        cleared = without_bodies(world, scene.clutter)
        for name, T in found_poses.items():
            cleared = cleared.put(name, "world", T)
        return cls(scene, cleared, looked, found_poses, manner)

    @cached_property
    def solids(self) -> dict[str, Solid]:
        """The surfaces of all bodies that have one, also of clutter."""
        return {
            name: solid_of(body) for name, body in self.scene.cell.bodies.items() if body.shapes
        }

    @cached_property
    def unknown(self) -> UnknownThings:
        """What is seen and nobody has modelled."""
        back = inverse(self.looked.T_world_camera)
        return UnknownThings(
            self.looked, tuple((self.solids[name], back @ T) for name, T in self.found.items())
        )

    @cached_property
    def columns(self) -> Body:
        """What is seen and nobody has modelled, as a body in the frame of the table."""
        shapes = self.unknown.columns(table_pose(self.scene, self.world))
        return Body(UNKNOWN_BODY, BodyKind.FIXTURE, Placement(), shapes)

    def holds(self, part: str) -> PartHolds:
        """The holds of a part."""
        if part not in self._holds:
            self._holds[part] = part_holds(self.scene, self.solids[part])
        return self._holds[part]

    def task(
        self,
        part: str,
        ends: tuple[Floats, Floats],
        others: Mapping[str, Floats] | None = None,
        absent: Collection[str] = (),
    ) -> PlaceTask:
        """To move a part from one pose in the world to another, with other bodies at poses, and
        without those that are absent.

        Clutter that has a pose is known from then on.
        """
        world, others = without_bodies(self.world, absent), others or {}
        met = {
            name: self.scene.cell.bodies[name] for name in others if name not in world.cell.bodies
        }
        cell = replace(world.cell, bodies={**world.cell.bodies, **met})
        world = replace(world, cell=cell).put(part, "world", ends[0])
        for name, T in others.items():
            world = world.put(name, "world", T)
        table = table_pose(self.scene, self.world)
        cell = replace(world.cell, bodies={**world.cell.bodies, UNKNOWN_BODY: self.columns})
        crowded = replace(world, cell=cell).put(UNKNOWN_BODY, "world", table)
        return PlaceTask(
            self.scene,
            world,
            crowded,
            part,
            *ends,
            self.holds(part),
            self.solids,
            self.unknown,
            table,
            self.manner,
        )


def without_bodies(world: GeometricWorld, names: Collection[str]) -> GeometricWorld:
    """The world without some bodies."""
    if not names:
        return world
    bodies = {name: body for name, body in world.cell.bodies.items() if name not in names}
    placed = {
        name: fixed for name, fixed in world.placed.items() if name.partition(".")[0] not in names
    }
    return replace(world, cell=replace(world.cell, bodies=bodies), placed=placed)
