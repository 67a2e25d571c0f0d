"""Camera of a scene: depth images made from the bodies of the cell, and parts found in them."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import inverse, skew
from cellwright.engine.model.vision import DepthCamera, DepthImage, NotLocated, Recognised, Sighting
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.shapes.facet_solids import solid_of
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.engine.stages.vision.part_localisation import KnownScene, locate_in_image
from cellwright.engine.stages.vision.part_recognition import recognise_in_image
from cellwright.engine.stages.vision.plane_regions import regions_of
from cellwright.engine.stages.vision.pose_hypotheses import PartModel
from cellwright.engine.stages.vision.sensor_images import DepthSensor, disturb_image, render_depths
from cellwright.kb.diagnostics import InvalidInput, Source, unknown_name
from cellwright.kb.model.cell_model import BodyKind
from cellwright.kb.model.part_scene import Scene

KNOWN_SIGMAS = 4.0  # of the noise: what is nearer to the known scene is that


@dataclass(frozen=True, slots=True, eq=False)
class SceneView:
    """An image, where the camera was (T_world_camera), what is known in it, and what was found
    of each part.
    """

    image: DepthImage
    T_world_camera: Floats
    ground: KnownScene
    sightings: Mapping[str, Sighting]


def camera_of(scene: Scene) -> DepthCamera:
    """The camera as it was calibrated, else the one that a scene describes."""
    believed, calibrated = made_camera(scene), scene.calibrated
    return (
        believed
        if calibrated is None
        else replace(believed, focal_px=calibrated.focal_px, centre_px=calibrated.centre_px)
    )


def made_camera(scene: Scene) -> DepthCamera:
    """The camera that a scene describes, as its maker tells."""
    entry = scene.camera
    return DepthCamera.viewing(entry.width, entry.height, entry.view_m, entry.distance_m)


def camera_pose(scene: Scene, world: GeometricWorld) -> Floats:
    """T_world_camera (4, 4), as it was calibrated, else as the scene has it."""
    if scene.calibrated is not None:
        return np.array(scene.calibrated.T_world_camera)
    placed = scene.camera.placement
    pose: Floats = world.pose("world", placed.parent) @ transforms.of_pose(placed.pose)
    return pose


def depth_image(
    scene: Scene, world: GeometricWorld, camera: DepthCamera, without: Collection[str] = ()
) -> DepthImage:
    """What a camera at the scene's place sees of the bodies of a world, without error and
    without the arms.
    """
    T = inverse(camera_pose(scene, world))
    shown = [
        body for name, body in world.cell.bodies.items() if name not in without and body.shapes
    ]
    return render_depths(
        [(solid_of(body), T @ world.pose("world", body.name)) for body in shown], camera
    )[0]


def look_for_parts(
    scene: Scene,
    world: GeometricWorld,
    parts: Sequence[str],
    seed: int,
    given: Floats | None = None,
) -> SceneView:
    """Parts as they are found in an image: one `given` (height, width) in metres, else one made
    from the scene.

    Known are all bodies but the parts and the clutter. The floor is the plane of the scene's table.
    """
    camera, entry = camera_of(scene), scene.camera
    if given is None:
        sensor = DepthSensor(entry.noise_m, entry.dropouts)
        image = disturb_image(depth_image(scene, world, camera), sensor, seed)
    else:
        image = correct_depths(scene, given)
    known_depth = depth_image(scene, world, camera, {*parts, *scene.clutter}).depth
    same = (known_depth > 0) & (
        np.abs(image.depth - known_depth) < KNOWN_SIGMAS * max(image.noise_m, 1e-6)
    )
    T_world_camera = camera_pose(scene, world)
    ground = KnownScene(same, (table_plane(scene, world, T_world_camera),))
    sightings = {
        part: locate_in_image(PartModel(solid_of(world.cell.bodies[part])), image, ground)
        for part in parts
    }
    if scene.calibrated is not None:
        known_by = np.array(scene.calibrated.covariance)
        sightings = {
            part: add_camera_doubt(sighting, camera, T_world_camera, known_by)
            for part, sighting in sightings.items()
        }
    return SceneView(image, T_world_camera, ground, sightings)


def seen_edges(looked: SceneView) -> list[tuple[Floats, Floats]]:
    """The straight edges that were found in an image: both ends (2,) of each, as (u, v)."""
    camera, found_edges = looked.image.camera, []
    for region in regions_of(looked.image, looked.ground.known):
        lines = region.lines
        for side in range(2):
            flat = lines.normal * lines.offset[:, None] + lines.along * lines.ends[:, side, None]
            points = np.column_stack([flat, np.full(len(flat), region.offset)]) @ region.axes.T
            found_edges.append(np.stack(camera.pixels(points), axis=-1))
    return [
        (a, b)
        for first, second in zip(found_edges[::2], found_edges[1::2], strict=True)
        for a, b in zip(first, second, strict=True)
    ]


def correct_depths(scene: Scene, depth: Floats) -> DepthImage:
    """What a sensor gave (height, width) in metres, with true depths as far as the range finder
    is calibrated.
    """
    calibrated, camera = scene.calibrated, camera_of(scene)
    if calibrated is None:
        return DepthImage(camera, depth, scene.camera.noise_m)
    true = np.where(
        depth > 0, np.maximum((depth - calibrated.offset_m) / calibrated.scale, 0.0), 0.0
    )
    return DepthImage(camera, true, calibrated.noise_m / calibrated.scale)


def add_camera_doubt(
    sighting: Sighting, camera: DepthCamera, T_world_camera: Floats, covariance: Floats
) -> Sighting:
    """A sighting that is less sure by what is doubted of the camera: `covariance` (9, 9) as in
    `CameraFound`.
    """
    if isinstance(sighting, NotLocated):
        return sighting
    x, y, z = p = sighting.best.T_camera_part[:3, 3]
    J, R = np.zeros((6, 9)), T_world_camera[:3, :3].T
    J[:3, :3] = J[3:, 3:6] = R
    J[:3, 3:6] = -skew(p) @ R
    J[:3, 6:] = -np.array([[x, z, 0.0], [y, 0.0, z], [0.0, 0.0, 0.0]]) / camera.focal_px
    return replace(sighting, covariance=sighting.covariance + J @ covariance @ J.T)


def table_pose(scene: Scene, world: GeometricWorld) -> Floats:
    """T_world_table (4, 4)."""
    pose: Floats = world.pose("world", scene.table.parent) @ transforms.of_pose(scene.table.pose)
    return pose


def table_plane(scene: Scene, world: GeometricWorld, T_world_camera: Floats) -> Floats:
    """The plane of the table (4,) in the camera's frame."""
    T = inverse(T_world_camera) @ table_pose(scene, world)
    return np.append(T[:3, 2], T[:3, 2] @ T[:3, 3])


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """What was recognised, in which image, among which parts."""

    answer: Recognised
    image: DepthImage
    models: Mapping[str, PartModel]


def recognised_in(
    scene: Scene, parts: Sequence[str], seed: int, given: Floats | None = None
) -> Seen:
    """The parts that are seen in an image: one `given` (height, width) in metres, else one made
    from the scene.

    `parts` are the candidates; without them all parts of the scene are. All other bodies stand
    where the scene says. Raises `InvalidInput`.
    """
    world, camera = GeometricWorld.of(scene.cell), camera_of(scene)
    own = [name for name, body in scene.cell.bodies.items() if body.kind is BodyKind.PART]
    for name in parts:
        if name not in own:
            raise InvalidInput([unknown_name("part", name, own, Source(scene.name))])
    if given is None:
        sensor = DepthSensor(scene.camera.noise_m, scene.camera.dropouts)
        image = disturb_image(depth_image(scene, world, camera), sensor, seed)
    else:
        image = DepthImage(camera, given, scene.camera.noise_m)
    without = depth_image(scene, world, camera, {*own, *scene.clutter}).depth
    known_pixels = (without > 0) & (
        np.abs(image.depth - without) < KNOWN_SIGMAS * max(scene.camera.noise_m, 1e-6)
    )
    models = {name: PartModel(solid_of(scene.cell.bodies[name])) for name in parts or own}
    ground = KnownScene(known_pixels, (table_plane(scene, world, camera_pose(scene, world)),))
    return Seen(recognise_in_image(models, image, ground), image, models)
