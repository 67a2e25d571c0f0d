"""What scanners see, by rays that MuJoCo casts in the whole cell: whatever is kept is seen, and
what is refused is hidden.
"""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("mujoco")

import mujoco

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.pipelines.motion.measurement_poses import known_poses
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.collision.mujoco_backend import MujocoChecker
from cellwright.engine.stages.geometry.world.collision_scene import collision_scene_of
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.loader.cell import cell_of
from cellwright.kb.model.body_shapes import Box, PlacedShape, Pose
from cellwright.kb.model.cell_model import Body, BodyKind, Cell, Placement

PROBLEM = "bulkhead/twelve_points"
STATIONS = {"left": -1.6, "middle": 0.0, "right": 1.6}
LASER_POINTS = {"m4": (0.0, -0.5), "m8": (0.0, 0.15), "m12": (0.0, 0.75)}
LIFTED_M = 0.002


def with_posts(cell: Cell, rng: np.random.Generator) -> Cell:
    """The cell with posts that stand off the web around the points of the scanner, and a screen
    before one of them.
    """
    shapes = tuple(
        PlacedShape(
            Box(tuple(rng.uniform(0.02, 0.06, 3))),
            Pose(
                (
                    x + rng.uniform(-0.12, 0.12),
                    y + rng.uniform(-0.12, 0.12),
                    rng.uniform(-0.2, -0.05),
                ),
                tuple(rng.uniform(-1, 1, 3)),
            ),
        )
        for x, y in LASER_POINTS.values()
        for _ in range(2)
    )
    screen = PlacedShape(Box((0.3, 0.3, 0.01)), Pose((*LASER_POINTS["m4"], -0.04), (0.0, 0.0, 0.0)))
    posts = Body("posts", BodyKind.FIXTURE, Placement("bulkhead"), (*shapes, screen))
    return replace(cell, bodies={**cell.bodies, "posts": posts})


def hit(world: GeometricWorld, q: Floats, eyes: Floats, ends: Floats) -> set[str]:
    """The bodies, without the arm and its tool, that rays from eyes (e, 3) to ends (n, 3) meet,
    by MuJoCo.
    """
    checker = MujocoChecker(collision_scene_of(world.moved("t3_746", q)))
    model, data = checker._model, checker._state
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    found, geom = set[str](), np.zeros(1, dtype=np.int32)
    names = {number: checker.scene.pieces[n] for n, number in enumerate(checker._geoms)}
    for eye in eyes:
        for end in ends:
            start, way = eye.copy(), end - eye
            length = float(np.linalg.norm(way))
            way = way / length
            while length > 1e-4:
                far = mujoco.mj_ray(model, data, start, way, None, 1, -1, geom)
                if far < 0.0 or far >= length:
                    break
                piece = names[int(geom[0])]
                if piece.carrier == 0:
                    found.add(piece.body)
                    break
                start, length = start + (far + 1e-4) * way, length - far - 1e-4
    return found


def looking(
    world: GeometricWorld, q: Floats, point: tuple[float, float], side: float
) -> tuple[Floats, Floats]:
    """The eyes (2, 3) at a configuration, and points (25, 3) of the patch, by plain geometry of
    the file's numbers.
    """
    T = world.moved("t3_746", q).pose("world", "slra")
    eyes = np.array([(-0.05, 0.06, 0.39), (0.06, -0.06, 0.39)])
    surface = world.pose("world", "bulkhead")
    across = surface[:3, :3].T @ T[:3, 0] * np.array([1.0, 1.0, 0.0])
    x = across / np.linalg.norm(across)
    y = np.cross([0.0, 0.0, 1.0], x)
    share = np.linspace(-side / 2, side / 2, 5)
    spots = [np.array([*point, -LIFTED_M]) + a * x + b * y for a in share for b in share]
    return transforms.apply(T, eyes), transforms.apply(surface, np.array(spots))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_rays_of_mujoco_confirm_what_is_seen_and_what_is_not(seed: int) -> None:
    cell = with_posts(cell_of(PROBLEM), np.random.default_rng(seed))
    blind = replace(
        cell, measuring={**cell.measuring, "slra": replace(cell.measuring["slra"], sight=None)}
    )
    sighted, all_poses = (
        known_poses(problem_of(PROBLEM), each, geometry_backend()) for each in (cell, blind)
    )
    hidden = 0
    for (name, tool, station), poses in all_poses.poses.items():
        if tool != "slra":
            continue
        world = GeometricWorld.of(cell).guided("carriage", STATIONS[station]).held("slra", "t3_746")
        kept = sighted.poses[name, tool, station]
        for way in kept.straight:
            assert kept.patch is not None
            assert (
                hit(
                    world, way[0], *looking(world, way[0], LASER_POINTS[name], kept.patch.size_m[0])
                )
                == set()
            )
        met = [
            hit(world, way[0], *looking(world, way[0], LASER_POINTS[name], 0.02))
            for way in poses.straight
        ]
        if not kept.reached and poses.reached:
            assert all(met)
            assert "between it and the" in kept.reason
            hidden += 1
    assert hidden
