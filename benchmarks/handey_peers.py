"""Peers on the same scenes: Open3D's registration for localisation (if it is installed), and a
sampler of antipodal grasps.

Open3D: features of both clouds (FPFH), RANSAC over them, then ICP from points to planes, as its own
tutorial does it. It gets what is new in the image as points, and the part as points of its surface.
It knows no "not found", so a share of inliers has to decide: the one that nine tenths of its right
answers reach. Sampler: random points of the surface, a ray in the friction cone against the normal,
kept where it leaves the part within the friction cone of the other side (Nguyen 1988; as in
Dex-Net's sampler).
"""

import time
from dataclasses import replace
from importlib.util import find_spec
from typing import Any

import numpy as np
from handey_physics import drawn_scene
from handey_scenes import Trial, trial

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import difference, rotation, transform
from cellwright.engine.model.geometry import Solid
from cellwright.engine.model.manipulation_values import Assembled, Grasp
from cellwright.engine.model.vision import LocatedPart
from cellwright.engine.pipelines.manipulation.part_grasps import (
    HOLD_TURNS,
    PartHolds,
    jaws_of,
    part_holds,
)
from cellwright.engine.pipelines.manipulation.place_operation import goal_of
from cellwright.engine.pipelines.manipulation.regrasp_paths import possible_holds
from cellwright.engine.pipelines.manipulation.scene_camera import look_for_parts
from cellwright.engine.pipelines.manipulation.workspace import AssemblySite, PlaceTask
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.engine.stages.grasping.grasp_synthesis import blocks_meet
from cellwright.engine.stages.vision.part_localisation import locate_in_image
from cellwright.engine.stages.vision.pose_hypotheses import PartModel
from cellwright.kb.loader.scene_file import load_scene
from cellwright.kb.model.part_scene import Scene
from cellwright.kb.targets import BUNDLED_DOMAINS

Figures = dict[str, Any]
VOXEL_M, STRIDE = 0.003, 2
NEAR_M, NEAR_RAD = 0.002, float(np.radians(1))
SAMPLES = 1000
KEPT = 0.1  # of its right answers a peer may lose by the share that decides


def peers(number: int, first: int) -> Figures:
    """Both peers beside ours, each on the same scenes of the same seeds."""
    found = {"grasps": _grasps(number, first)}
    if find_spec("open3d"):
        found["registration"] = _registration(number, first)
    return found


def _registration(number: int, first: int) -> Figures:
    ours, theirs = _Tally(), _Tally()
    for seed in range(first, first + number):
        for present in (True, False):
            made = trial(seed, present)
            started = time.process_time()
            found = locate_in_image(PartModel(made.part), made.image, made.ground)
            poses = found.equivalent if isinstance(found, LocatedPart) else ()
            ours.note(made, poses, 1.0 if poses else 0.0, time.process_time() - started)
            started = time.process_time()
            T, fitness = _registered(made, seed)
            symmetries = PartModel(made.part).symmetries
            theirs.note(made, [T @ S for S in symmetries], fitness, time.process_time() - started)
    return {"ours": ours.figures(0.5), "Open3D": theirs.figures(None)}


class _Tally:
    """What one way of localisation answered."""

    def __init__(self) -> None:
        self.right, self.wrong, self.absent, self.times = (
            list[float](),
            list[float](),
            list[float](),
            list[float](),
        )

    def note(self, made: Trial, poses: Any, fitness: float, seconds: float) -> None:
        """An answer, with the share by which it is believed."""
        self.times.append(seconds)
        if made.T_camera_part is None:
            self.absent.append(fitness)
            return
        apart = [difference(each, made.T_camera_part) for each in poses]
        good = any(metres < NEAR_M and radians < NEAR_RAD for metres, radians in apart)
        (self.right if good else self.wrong).append(fitness)

    def figures(self, least: float | None) -> Figures:
        """Counts of answers that are believed."""
        if least is None:
            least = float(np.quantile(self.right, KEPT)) if self.right else 1.0
        counts = {
            "right": sum(each >= least for each in self.right),
            "wrong": sum(each >= least for each in self.wrong),
            "found, is not there": sum(each >= least for each in self.absent),
        }
        return {**counts, "of each": len(self.absent), "median_s": float(np.median(self.times))}


def _registered(made: Trial, seed: int) -> tuple[Floats, float]:
    """T_camera_part as Open3D finds it, and the share of the part's points that have a
    neighbour.
    """
    import open3d as o3d  # type: ignore[import-not-found]

    o3d.utility.random.seed(seed)
    registration = o3d.pipelines.registration
    part, scene = _cloud(_surface(made.part, 6000, seed)), _cloud(_new_points(made))
    features = [
        registration.compute_fpfh_feature(
            each, o3d.geometry.KDTreeSearchParamHybrid(5 * VOXEL_M, 100)
        )
        for each in (part, scene)
    ]
    coarse = registration.registration_ransac_based_on_feature_matching(
        part,
        scene,
        *features,
        True,
        1.5 * VOXEL_M,
        registration.TransformationEstimationPointToPoint(False),
        3,
        [
            registration.CorrespondenceCheckerBasedOnEdgeLength(0.9),
            registration.CorrespondenceCheckerBasedOnDistance(1.5 * VOXEL_M),
        ],
        registration.RANSACConvergenceCriteria(100000, 0.999),
    )
    fine = registration.registration_icp(
        part,
        scene,
        VOXEL_M,
        coarse.transformation,
        registration.TransformationEstimationPointToPlane(),
    )
    return np.array(fine.transformation), float(fine.fitness)


def _cloud(points: Floats) -> Any:
    import open3d as o3d

    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points)).voxel_down_sample(VOXEL_M)
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(2.5 * VOXEL_M, 30))
    cloud.orient_normals_towards_camera_location()
    return cloud


def _new_points(made: Trial) -> Floats:
    """What is new in an image as points (n, 3) in the camera's frame."""
    v, u = np.nonzero((made.image.depth > 0) & ~made.ground.known)
    keep = (v % STRIDE == 0) & (u % STRIDE == 0)
    v, u = v[keep], u[keep]
    found: Floats = (
        made.image.camera.rays(u.astype(float), v.astype(float)) * made.image.depth[v, u][:, None]
    )
    return found


def _surface(solid: Solid, count: int, seed: int) -> Floats:
    return _sampled(solid, count, np.random.default_rng(seed))[0]


def _sampled(solid: Solid, count: int, random: np.random.Generator) -> tuple[Floats, Floats]:
    """Points (n, 3) spread over a surface, and their normals."""
    a, b, c = np.moveaxis(solid.corners, 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    chosen = random.choice(len(area), count, p=area / area.sum())
    u, v = random.random((2, count, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    normals = np.array([solid.facets[n].normal for n in solid.facet_of[chosen]])
    return a[chosen] + u * (b - a)[chosen] + v * (c - a)[chosen], normals


def _grasps(number: int, first: int) -> Figures:
    """In how many scenes some grasp serves both where the part lies and at its goal, and what
    finding all grasps takes.
    """
    scene = load_scene(BUNDLED_DOMAINS / "handey" / "scene.yaml")
    figures: dict[str, Figures] = {}
    for seed in range(first, first + number):
        task = _task(scene, seed)
        solid = task.holds.solid
        for name in ("ours", "antipodal samples"):
            started = time.process_time()
            holds = part_holds(scene, solid) if name == "ours" else _antipodal(scene, solid, seed)
            seconds = time.process_time() - started
            own = replace(task, holds=holds)
            both = possible_holds(own, task.T_start) & possible_holds(own, task.T_goal)
            entry = figures.setdefault(
                name, {"scenes": 0, "one grasp serves both ends": 0, "holds": [], "s": []}
            )
            entry["scenes"] += 1
            entry["one grasp serves both ends"] += int(both.any())
            entry["holds"].append(len(holds.poses))
            entry["s"].append(seconds)
    return {
        name: {**each, "holds": float(np.median(each["holds"])), "s": float(np.median(each["s"]))}
        for name, each in figures.items()
    }


def _task(scene: Scene, seed: int) -> PlaceTask:
    drawn, T = drawn_scene(scene, "angle", seed)
    world = GeometricWorld.of(drawn.cell)
    goal = goal_of(drawn, world, ("angle",), "base")
    assert isinstance(goal, Assembled)
    T_goal = world.pose("world", "base") @ goal.poses["angle"]
    return AssemblySite.of(drawn, world, look_for_parts(drawn, world, (), seed), {"angle": T}).task(
        "angle", (T, T_goal)
    )


def _antipodal(scene: Scene, solid: Solid, seed: int) -> PartHolds:
    """Holds at sampled points whose lines lie in the friction cones of both sides, where the
    hand meets nothing of the part.
    """
    random, jaws = np.random.default_rng(seed), jaws_of(scene)
    found = []
    for point, normal in zip(*_sampled(solid, SAMPLES, random), strict=True):
        way = -normal + random.normal(size=3) * jaws.friction / 3
        way /= np.linalg.norm(way)
        through = _leaves(solid, point + 1e-6 * way, way)
        if through is None:
            continue
        width, other = through
        cone = 1 / np.sqrt(1 + jaws.friction**2)
        if width > jaws.opening_m or -(way @ normal) < cone or way @ other < cone:
            continue
        x = way
        start = np.cross(x, np.eye(3)[int(np.argmin(np.abs(x)))])
        start /= np.linalg.norm(start)
        R = np.stack([x, np.cross(start, x), start], axis=1)
        turn = rotation((1.0, 0.0, 0.0), np.arange(HOLD_TURNS) * 2 * np.pi / HOLD_TURNS)
        T = transform(R @ turn, np.repeat((point + way * width / 2)[None], HOLD_TURNS, axis=0))
        free = ~blocks_meet(T, *jaws.blocks((width,)), solid.corners)
        if free.any():
            found.append(Grasp(("", ""), width, T, free, 1.0))
    return PartHolds(solid, jaws, tuple(found))


def _leaves(solid: Solid, start: Floats, way: Floats) -> tuple[float, Floats] | None:
    """How far a ray goes inside a solid, and the normal where it leaves (Moller & Trumbore
    1997).
    """
    a, b, c = np.moveaxis(solid.corners, 1, 0)
    one, other = b - a, c - a
    across = np.cross(way, other)
    determinant = (one * across).sum(axis=1)
    safe = np.where(np.abs(determinant) > 1e-12, determinant, np.inf)
    u = ((start - a) * across).sum(axis=1) / safe
    turned = np.cross(start - a, one)
    v, t = (turned @ way) / safe, (turned * other).sum(axis=1) / safe
    hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-4) & np.isfinite(safe)
    if not hit.any():
        return None
    n = int(np.argmin(np.where(hit, t, np.inf)))
    return float(t[n]), solid.facets[int(solid.facet_of[n])].normal
