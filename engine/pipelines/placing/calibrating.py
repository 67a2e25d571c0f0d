"""Calibration of a scene's camera: as a range finder before a plate, and where it stands, by a target that the arm holds.

Readings come from a cell, or are made: then the camera stands a little off from where the scene has it, and where is told, too.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from engine.kernels.rigid import inverse, rotation, transform, turned
from engine.model.geometry import Floats
from engine.model.vision import DepthImage, Located
from engine.pipelines.placing.holding import Holds, Reach, holds_of, with_hand
from engine.pipelines.placing.looking import camera_of, camera_pose, depth_image
from engine.stages.geometry import transforms
from engine.stages.geometry.shapes.solids import solid_of
from engine.stages.geometry.world.model import World
from engine.stages.vision.calibration import (
    CameraCalibration,
    RangeCalibration,
    calibrated_camera,
    calibrated_range,
)
from engine.stages.vision.hypotheses import Model
from engine.stages.vision.images import Sensor, disturbed, rendered
from engine.stages.vision.localisation import Ground, locate
from kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from kb.model.cell import BodyKind, Placement
from kb.model.scene import Scene

DISTANCES = (0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2)  # shares of the distance for which the camera is made
OFF_M, OFF_RAD = (
    0.006,
    np.radians(0.8),
)  # how far the camera is moved when readings are made: standard deviations for each axis
LEAN_RAD = 0.6  # how far the hand leans at most, about each axis
HOLD = 0  # the number of the hold with which the target is held: any serves
SEEN = 0.6  # the share of the target that the hand must leave to be seen
DRAWN = 60  # poses of the hand that are tried for each that is wanted
CHANGED = 6.0  # times the noise: what differs more from the empty scene is new


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """Depth images (height, width) in metres of a target in the hand, at joint values (k,); and one of the scene without them."""

    empty: Floats
    joints: tuple[Floats, ...]
    depths: tuple[Floats, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Made:
    """Readings that were made, with what is hidden in them: where the camera stood."""

    readings: Readings
    T_world_camera: Floats


def calibrate_range(scene: Scene, images: Sequence[Floats], distances_m: Sequence[float]) -> RangeCalibration:
    """What the range finder errs by, from images of a plate across its axis. Raises `InvalidInput` for too few distances."""
    camera = camera_of(scene)
    try:
        found = [DepthImage(camera, each, scene.camera.noise_m) for each in images]
        return calibrated_range(found, distances_m)
    except ValueError as error:
        raise InvalidInput([Diagnostic(Source("--readings"), "K107", str(error), "add images")]) from None


def plates(scene: Scene, seed: int) -> tuple[list[Floats], list[float], tuple[float, float]]:
    """Images of plates at distances, by a range finder with a hidden offset and scale, which are told last."""
    random = np.random.default_rng(seed)
    offset, scale = float(random.normal(0, 0.004)), float(1 + random.normal(0, 0.004))
    camera, entry, images = camera_of(scene), scene.camera, []
    distances = [share * entry.distance_m for share in DISTANCES]
    v, u = np.mgrid[: camera.height, : camera.width].astype(float)
    rays = camera.rays(u, v)
    for n, distance in enumerate(distances):
        normal = np.array([*random.normal(0, 0.01, 2), 1.0])
        true = DepthImage(camera, offset + scale * distance / (rays @ normal), 0.0)
        images.append(disturbed(true, Sensor(entry.noise_m, entry.dropouts), 100 * seed + n).depth)
    return images, distances, (offset, scale)


def _holds(scene: Scene, target: str) -> Holds:
    """The holds of a target. Raises `InvalidInput` if there is none."""
    bodies = scene.cell.bodies
    parts = [name for name, body in bodies.items() if body.kind is BodyKind.PART and body.shapes]
    if target not in parts:
        raise InvalidInput([unknown_name("part", target, parts, Source("TARGET"))])
    holds = holds_of(scene, solid_of(bodies[target]))
    if not len(holds.poses):
        message, hint = f"the hand cannot hold {target}", "take a part with two opposite faces"
        raise InvalidInput([Diagnostic(Source("TARGET"), "K005", message, hint)])
    return holds


def calibrate_camera(scene: Scene, target: str, readings: Readings) -> CameraCalibration:
    """Where the camera stands, from readings. Raises `InvalidInput` if the target is found too seldom, or turns too little."""
    holds = _holds(scene, target)
    world, camera, noise = World.of(scene.cell), camera_of(scene), scene.camera.noise_m
    model, found, hands = Model(holds.solid), list[Located](), list[Floats]()
    for q, depth in zip(readings.joints, readings.depths, strict=True):
        new = (depth > 0) & (np.abs(depth - readings.empty) > CHANGED * max(noise, 1e-6))
        sighting = locate(model, DepthImage(camera, depth, noise), Ground(~new))
        if isinstance(sighting, Located) and len(sighting.equivalent) == 1:
            found.append(sighting)
            hands.append(world.moved(scene.hand.arm, q).pose("world", f"{scene.hand.arm}.tool"))
    try:
        return calibrated_camera(hands, found, camera_pose(scene, world), inverse(holds.poses[HOLD]))
    except ValueError as error:
        hint = "take more images, and a part that looks the same from no two sides"
        raise InvalidInput([Diagnostic(Source(target), "K005", str(error), hint)]) from None


def made(scene: Scene, target: str, number: int, seed: int) -> Made:
    """Readings of a camera that stands somewhere else than the scene has it, at poses of the arm that are free and show the target."""
    random = np.random.default_rng(seed)
    holds = _holds(scene, target)
    world = World.of(scene.cell)
    T = camera_pose(scene, world) @ transform(
        turned(random.normal(0, OFF_RAD, 3)), random.normal(0, OFF_M, 3)
    )
    there = replace(scene.camera, placement=Placement("world", transforms.to_pose(T)))
    hidden = replace(scene, camera=there)
    opening = holds.grasps[holds.grasp_of[HOLD]].opening
    held = with_hand(world, scene, holds.jaws, opening).put(
        target, f"{scene.hand.arm}.tool", inverse(holds.poses[HOLD])
    )
    joints = tuple(_free_poses(scene, held, target, number, random))
    empty = _seen(hidden, world, {target}, 1000 * seed)
    depths = [
        _seen(hidden, held.moved(scene.hand.arm, q), set(), 1000 * seed + n) for n, q in enumerate(joints, 1)
    ]
    return Made(Readings(empty, joints, tuple(depths)), T)


def _seen(scene: Scene, world: World, without: set[str], seed: int) -> Floats:
    image = depth_image(scene, world, camera_of(scene), without)
    return disturbed(image, Sensor(scene.camera.noise_m, scene.camera.dropouts), seed).depth


def _free_poses(
    scene: Scene, held: World, target: str, number: int, random: np.random.Generator
) -> Iterator[Floats]:
    """Joint values (k,) with which the target is seen and nothing is touched; the hand lies across the camera's axis."""
    arm, found = scene.hand.arm, 0
    own = frozenset(frozenset((target, name)) for name in held.cell.bodies if name not in scene.cell.bodies)
    reach = Reach(held, arm, own)
    T_camera = camera_pose(scene, held)
    for _ in range(DRAWN * number):
        if found == number:
            return
        hand = _drawn(scene, T_camera, random)
        qs = reach.configurations(hand, held.configuration)
        if len(qs) and _shows(scene, held, target, qs[0]):
            found += 1
            yield qs[0]


def _drawn(scene: Scene, T_camera: Floats, random: np.random.Generator) -> Floats:
    """A pose of the hand before the camera, across its axis."""
    distance, half = scene.camera.distance_m, scene.camera.view_m / 2
    aside = random.uniform(-0.4, 0.4, 2) * half
    at = np.array([*aside, random.uniform(0.65, 0.9) * distance])  # in the camera's frame
    turn = rotation((0.0, 0.0, 1.0), random.uniform(-np.pi, np.pi))
    roll = rotation((0.0, 0.0, 1.0), random.uniform(-np.pi, np.pi))
    across = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    lean = turned(random.uniform(-LEAN_RAD, LEAN_RAD, 3))
    return T_camera @ transform(turn @ lean @ across @ roll, at)


def _shows(scene: Scene, held: World, target: str, q: Floats) -> bool:
    """Whether enough of the target is seen, and all of it lies in the picture."""
    world, camera = held.moved(scene.hand.arm, q), camera_of(scene)
    T = inverse(camera_pose(scene, world))
    bodies = [body for body in world.cell.bodies.values() if body.shapes]
    placed = [(solid_of(body), T @ world.pose("world", body.name)) for body in bodies]
    owner = rendered(placed, camera)[1]
    mine = next(n for n, body in enumerate(bodies) if body.name == target)
    alone = rendered([placed[mine]], camera)[1] == 0
    inside = not (alone[0].any() or alone[-1].any() or alone[:, 0].any() or alone[:, -1].any())
    return bool(inside and alone.any() and (owner == mine).sum() >= SEEN * alone.sum())
