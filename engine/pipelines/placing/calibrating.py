"""Calibration of a scene's camera: as a range finder before a plate, and where it stands, by a target that the arm holds.

Readings come from a cell, or are made, by a camera that errs in a way that is told then. What was found is kept with the scene.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.kernels.rigid import inverse
from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.vision import DepthImage, Located
from cellwright.engine.pipelines.placing.looking import camera_of, camera_pose, corrected, made_camera
from cellwright.engine.pipelines.placing.optics import Optics, drawn_errors
from cellwright.engine.pipelines.placing.showing import HOLD, held_target, shown, target_holds
from cellwright.engine.stages.geometry.world.model import World
from cellwright.engine.stages.vision.calibration import (
    CameraCalibration,
    RangeCalibration,
    calibrated_camera,
    calibrated_range,
)
from cellwright.engine.stages.vision.hypotheses import Model
from cellwright.engine.stages.vision.localisation import Ground, locate
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.scene import CameraFound, Scene

CHANGED = 6.0  # times the noise: what differs more from the empty scene is new
ROUNDS = 2  # the target is located again with the intrinsics that were found


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """Depth images (height, width) in metres of a target in the hand, at joint values (k,); and one of the scene without them."""

    empty: Floats
    joints: tuple[Floats, ...]
    depths: tuple[Floats, ...]


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
    drawn = drawn_errors(seed)
    optics = replace(Optics.of(scene), offset_m=drawn.offset_m, scale=drawn.scale)
    return *optics.plates(scene.camera.distance_m, seed), (optics.offset_m, optics.scale)


def calibrate_camera(scene: Scene, target: str, readings: Readings) -> CameraCalibration:
    """Where the camera stands, and its intrinsics, from readings.

    Raises `InvalidInput` if the target is found too seldom, or turns too little.
    """
    holds = target_holds(scene, target)
    held, made, now = inverse(holds.poses[HOLD]), made_camera(scene), scene
    for _ in range(ROUNDS):
        hands, found = _sighted(now, Model(holds.solid), readings)
        try:
            solved = calibrated_camera(
                hands, found, camera_of(now), camera_pose(now, World.of(now.cell)), held, made
            )
        except ValueError as error:
            hint = "take more images, and a part that looks the same from no two sides"
            raise InvalidInput([Diagnostic(Source(target), "K005", str(error), hint)]) from None
        held, now = solved.T_hand_target, with_camera(now, solved)
    return solved


def _sighted(scene: Scene, model: Model, readings: Readings) -> tuple[list[Floats], list[Located]]:
    """Where the hand was (T_world_hand) where the target was found, and how it was."""
    world, found, hands = World.of(scene.cell), list[Located](), list[Floats]()
    for q, depth in zip(readings.joints, readings.depths, strict=True):
        image = corrected(scene, depth)
        new = (depth > 0) & (np.abs(depth - readings.empty) > CHANGED * max(image.noise_m, 1e-6))
        sighting = locate(model, image, Ground(~new))
        if isinstance(sighting, Located) and len(sighting.equivalent) == 1:
            found.append(sighting)
            hands.append(world.moved(scene.hand.arm, q).pose("world", f"{scene.hand.arm}.tool"))
    return hands, found


def made(scene: Scene, target: str, number: int, seed: int) -> tuple[Readings, Optics]:
    """Readings of a camera that errs, which is told, at poses of the arm that are free and show the target."""
    drawn = replace(drawn_errors(seed), offset_m=0.0, scale=1.0)  # the range finder is calibrated by itself
    optics = Optics.of(scene, drawn)
    joints = shown(scene, target, number, np.random.default_rng(seed))
    return taken(scene, target, joints, optics, seed), optics


def taken(scene: Scene, target: str, joints: Sequence[Floats], optics: Optics, seed: int) -> Readings:
    """The images that a camera takes of a target that an arm holds exactly where its joints say."""
    held = held_target(scene, target, World.of(scene.cell))
    depths = [optics.image(held.moved(scene.hand.arm, q), 1000 * seed + n) for n, q in enumerate(joints, 1)]
    return Readings(optics.image(World.of(scene.cell), 1000 * seed, {target}), tuple(joints), tuple(depths))


def with_range(scene: Scene, found: RangeCalibration) -> Scene:
    """The scene whose looks are corrected by what its range finder errs by."""
    known = replace(_known(scene), offset_m=found.offset_m, scale=found.scale, noise_m=found.noise_m)
    return replace(scene, calibrated=known)


def with_camera(scene: Scene, found: CameraCalibration) -> Scene:
    """The scene whose camera stands where it was found, and is as it was found."""
    known = replace(
        _known(scene),
        T_world_camera=_rows(found.T_world_camera),
        focal_px=found.camera.focal_px,
        centre_px=found.camera.centre_px,
        covariance=_rows(found.covariance),
    )
    return replace(scene, calibrated=known)


def _known(scene: Scene) -> CameraFound:
    """What is known of the camera; what was never calibrated is as the scene says, and is not doubted."""
    if scene.calibrated is not None:
        return scene.calibrated
    T, camera = camera_pose(scene, World.of(scene.cell)), camera_of(scene)
    nothing = _rows(np.zeros((9, 9)))
    return CameraFound(_rows(T), camera.focal_px, camera.centre_px, nothing, noise_m=scene.camera.noise_m)


def _rows(matrix: Floats) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(map(float, row)) for row in matrix)
