"""Camera calibration: ranges by a plate, and the pose by a target that the arm holds up."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import inverse, rotation, rotation_by_vector, transform
from cellwright.engine.model.vision import DepthImage, LocatedPart
from cellwright.engine.pipelines.manipulation.camera_optics import CameraOptics, drawn_errors
from cellwright.engine.pipelines.manipulation.part_grasps import (
    ArmReach,
    PartHolds,
    part_holds,
    with_hand,
)
from cellwright.engine.pipelines.manipulation.scene_camera import (
    camera_of,
    camera_pose,
    correct_depths,
    made_camera,
)
from cellwright.engine.stages.geometry.shapes.facet_solids import solid_of
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.engine.stages.vision.part_localisation import KnownScene, locate_in_image
from cellwright.engine.stages.vision.pose_hypotheses import PartModel
from cellwright.engine.stages.vision.sensor_calibration import (
    CameraCalibration,
    RangeCalibration,
    fit_camera_calibration,
    fit_range_calibration,
)
from cellwright.engine.stages.vision.sensor_images import render_depths
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from cellwright.kb.model.cell_model import BodyKind
from cellwright.kb.model.part_scene import CameraFound, Scene

HAND_LEAN_RAD = 0.6  # how far the hand leans at most, about each axis
TARGET_HOLD = 0  # the number of the hold with which the target is held: any serves
MIN_TARGET_SEEN = 0.6  # the share of the target that the hand must leave to be seen
MAX_DRAWN_POSES = 60  # poses of the hand that are tried for each that is wanted


def target_holds(scene: Scene, target: str) -> PartHolds:
    """The holds of a target. Raises `InvalidInput` if there is none."""
    bodies = scene.cell.bodies
    parts = [name for name, body in bodies.items() if body.kind is BodyKind.PART and body.shapes]
    if target not in parts:
        raise InvalidInput([unknown_name("part", target, parts, Source("TARGET"))])
    holds = part_holds(scene, solid_of(bodies[target]))
    if not len(holds.poses):
        message, hint = f"the hand cannot hold {target}", "take a part with two opposite faces"
        raise InvalidInput([Diagnostic(Source("TARGET"), "K005", message, hint)])
    return holds


def held_target(scene: Scene, target: str, world: GeometricWorld) -> GeometricWorld:
    """A world in which the hand holds the target."""
    holds = target_holds(scene, target)
    opening = holds.grasps[holds.grasp_of[TARGET_HOLD]].opening
    held_world = with_hand(world, scene, holds.jaws, opening)
    return held_world.put(target, f"{scene.hand.arm}.tool", inverse(holds.poses[TARGET_HOLD]))


def showing_configurations(
    scene: Scene, target: str, number: int, random: np.random.Generator
) -> tuple[Floats, ...]:
    """Joint values (k,) that touch nothing, and with which the camera sees the target well; up
    to `number` of them.
    """
    return tuple(
        _free_poses(
            scene, held_target(scene, target, GeometricWorld.of(scene.cell)), target, number, random
        )
    )


def _free_poses(
    scene: Scene, held_world: GeometricWorld, target: str, number: int, random: np.random.Generator
) -> Iterator[Floats]:
    """Joint values (k,) with which the target is seen and nothing is touched; the hand lies
    across the camera's axis.
    """
    arm, count = scene.hand.arm, 0
    own = frozenset(
        frozenset((target, name))
        for name in held_world.cell.bodies
        if name not in scene.cell.bodies
    )
    reach = ArmReach(held_world, arm, own)
    T_camera = camera_pose(scene, held_world)
    for _ in range(MAX_DRAWN_POSES * number):
        if count == number:
            return
        hand = _draw_hand_pose(scene, T_camera, random)
        qs = reach.configurations(hand, held_world.configuration)
        if len(qs) and _shows_target(scene, held_world, target, qs[0]):
            count += 1
            yield qs[0]


def _draw_hand_pose(scene: Scene, T_camera: Floats, random: np.random.Generator) -> Floats:
    """A pose of the hand before the camera, across its axis."""
    distance, half = scene.camera.distance_m, scene.camera.view_m / 2
    aside = random.uniform(-0.4, 0.4, 2) * half
    at = np.array([*aside, random.uniform(0.65, 0.9) * distance])  # in the camera's frame
    turn = rotation((0.0, 0.0, 1.0), random.uniform(-np.pi, np.pi))
    roll = rotation((0.0, 0.0, 1.0), random.uniform(-np.pi, np.pi))
    across = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    lean = rotation_by_vector(random.uniform(-HAND_LEAN_RAD, HAND_LEAN_RAD, 3))
    return T_camera @ transform(turn @ lean @ across @ roll, at)


def _shows_target(scene: Scene, held_world: GeometricWorld, target: str, q: Floats) -> bool:
    """Whether enough of the target is seen, and all of it lies in the picture."""
    world, camera = held_world.moved(scene.hand.arm, q), camera_of(scene)
    T = inverse(camera_pose(scene, world))
    bodies = [body for body in world.cell.bodies.values() if body.shapes]
    placed = [(solid_of(body), T @ world.pose("world", body.name)) for body in bodies]
    owner = render_depths(placed, camera)[1]
    mine = next(n for n, body in enumerate(bodies) if body.name == target)
    alone = render_depths([placed[mine]], camera)[1] == 0
    inside = not (alone[0].any() or alone[-1].any() or alone[:, 0].any() or alone[:, -1].any())
    return bool(inside and alone.any() and (owner == mine).sum() >= MIN_TARGET_SEEN * alone.sum())


CHANGE_SIGMAS = 6.0  # times the noise: what differs more from the empty scene is new
CALIBRATION_ROUNDS = 2  # the target is located again with the intrinsics that were found


@dataclass(frozen=True, slots=True, eq=False)
class TargetReadings:
    """Depth images (height, width) in metres of a target in the hand, at joint values (k,); and
    one of the scene without them.
    """

    empty: Floats
    joints: tuple[Floats, ...]
    depths: tuple[Floats, ...]


def calibrate_range(
    scene: Scene, images: Sequence[Floats], distances_m: Sequence[float]
) -> RangeCalibration:
    """What the range finder errs by, from images of a plate across its axis.

    Raises `InvalidInput` for too few distances.
    """
    camera = camera_of(scene)
    try:
        depth_images = [DepthImage(camera, image, scene.camera.noise_m) for image in images]
        return fit_range_calibration(depth_images, distances_m)
    except ValueError as error:
        raise InvalidInput(
            [Diagnostic(Source("--readings"), "K107", str(error), "add images")]
        ) from None


def plate_images(scene: Scene, seed: int) -> tuple[list[Floats], list[float], tuple[float, float]]:
    """Images of plates at distances, by a range finder with a hidden offset and scale, which
    are told last.
    """
    drawn = drawn_errors(seed)
    optics = replace(CameraOptics.of(scene), offset_m=drawn.offset_m, scale=drawn.scale)
    return *optics.plates(scene.camera.distance_m, seed), (optics.offset_m, optics.scale)


def calibrate_camera(scene: Scene, target: str, readings: TargetReadings) -> CameraCalibration:
    """Where the camera stands, and its intrinsics, from readings.

    Raises `InvalidInput` if the target is found too seldom, or turns too little.
    """
    holds = target_holds(scene, target)
    T_target_hand, believed, now = inverse(holds.poses[TARGET_HOLD]), made_camera(scene), scene
    for _ in range(CALIBRATION_ROUNDS):
        hands, sightings = _located_hands(now, PartModel(holds.solid), readings)
        try:
            solved = fit_camera_calibration(
                hands,
                sightings,
                camera_of(now),
                camera_pose(now, GeometricWorld.of(now.cell)),
                T_target_hand,
                believed,
            )
        except ValueError as error:
            hint = "take more images, and a part that looks the same from no two sides"
            raise InvalidInput([Diagnostic(Source(target), "K005", str(error), hint)]) from None
        T_target_hand, now = solved.T_hand_target, scene_with_camera(now, solved)
    return solved


def _located_hands(
    scene: Scene, model: PartModel, readings: TargetReadings
) -> tuple[list[Floats], list[LocatedPart]]:
    """Where the hand was (T_world_hand) where the target was found, and how it was."""
    world, sightings, hands = GeometricWorld.of(scene.cell), list[LocatedPart](), list[Floats]()
    for q, depth in zip(readings.joints, readings.depths, strict=True):
        image = correct_depths(scene, depth)
        new = (depth > 0) & (
            np.abs(depth - readings.empty) > CHANGE_SIGMAS * max(image.noise_m, 1e-6)
        )
        sighting = locate_in_image(model, image, KnownScene(~new))
        if isinstance(sighting, LocatedPart) and len(sighting.equivalent) == 1:
            sightings.append(sighting)
            hands.append(world.moved(scene.hand.arm, q).pose("world", f"{scene.hand.arm}.tool"))
    return hands, sightings


def made_readings(
    scene: Scene, target: str, number: int, seed: int
) -> tuple[TargetReadings, CameraOptics]:
    """Readings of a camera that errs, which is told, at poses of the arm that are free and show
    the target.
    """
    # the range finder is calibrated by itself
    drawn = replace(drawn_errors(seed), offset_m=0.0, scale=1.0)
    optics = CameraOptics.of(scene, drawn)
    joints = showing_configurations(scene, target, number, np.random.default_rng(seed))
    return take_images(scene, target, joints, optics, seed), optics


def take_images(
    scene: Scene, target: str, joints: Sequence[Floats], optics: CameraOptics, seed: int
) -> TargetReadings:
    """The images that a camera takes of a target that an arm holds exactly where its joints say."""
    held_world = held_target(scene, target, GeometricWorld.of(scene.cell))
    depths = [
        optics.image(held_world.moved(scene.hand.arm, q), 1000 * seed + n)
        for n, q in enumerate(joints, 1)
    ]
    return TargetReadings(
        optics.image(GeometricWorld.of(scene.cell), 1000 * seed, {target}),
        tuple(joints),
        tuple(depths),
    )


def with_range(scene: Scene, calibration: RangeCalibration) -> Scene:
    """The scene whose looks are corrected by what its range finder errs by."""
    camera = replace(
        _known_camera(scene),
        offset_m=calibration.offset_m,
        scale=calibration.scale,
        noise_m=calibration.noise_m,
    )
    return replace(scene, calibrated=camera)


def scene_with_camera(scene: Scene, calibration: CameraCalibration) -> Scene:
    """The scene whose camera stands where it was found, and is as it was found."""
    camera = replace(
        _known_camera(scene),
        T_world_camera=_matrix_rows(calibration.T_world_camera),
        focal_px=calibration.camera.focal_px,
        centre_px=calibration.camera.centre_px,
        covariance=_matrix_rows(calibration.covariance),
    )
    return replace(scene, calibrated=camera)


def _known_camera(scene: Scene) -> CameraFound:
    """What is known of the camera; what was never calibrated is as the scene says, and is not
    doubted.
    """
    if scene.calibrated is not None:
        return scene.calibrated
    T, camera = camera_pose(scene, GeometricWorld.of(scene.cell)), camera_of(scene)
    nothing = _matrix_rows(np.zeros((9, 9)))
    return CameraFound(
        _matrix_rows(T), camera.focal_px, camera.centre_px, nothing, noise_m=scene.camera.noise_m
    )


def _matrix_rows(matrix: Floats) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(map(float, row)) for row in matrix)
