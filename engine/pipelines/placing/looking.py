"""What the camera of a scene sees: depth images made from the bodies of the cell, and the part found in them."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.kernels.rigid import inverse, skew
from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.vision import Camera, DepthImage, NotLocated, Sighting
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.shapes.solids import solid_of
from cellwright.engine.stages.geometry.world.model import World
from cellwright.engine.stages.vision.hypotheses import Model
from cellwright.engine.stages.vision.images import Sensor, disturbed, rendered
from cellwright.engine.stages.vision.localisation import Ground, locate
from cellwright.engine.stages.vision.outlines import regions_of
from cellwright.kb.model.scene import Scene

KNOWN = 4.0  # of the noise: what is nearer to the known scene is that


@dataclass(frozen=True, slots=True, eq=False)
class Looked:
    """An image, where the camera was (T_world_camera), what is known in it, and what was found of each part."""

    image: DepthImage
    T_world_camera: Floats
    ground: Ground
    sightings: Mapping[str, Sighting]


def camera_of(scene: Scene) -> Camera:
    """The camera as it was calibrated, else the one that a scene describes."""
    made, found = made_camera(scene), scene.calibrated
    return made if found is None else replace(made, focal_px=found.focal_px, centre_px=found.centre_px)


def made_camera(scene: Scene) -> Camera:
    """The camera that a scene describes, as its maker tells."""
    entry = scene.camera
    return Camera.viewing(entry.width, entry.height, entry.view_m, entry.distance_m)


def camera_pose(scene: Scene, world: World) -> Floats:
    """T_world_camera (4, 4), as it was calibrated, else as the scene has it."""
    if scene.calibrated is not None:
        return np.array(scene.calibrated.T_world_camera)
    placed = scene.camera.placement
    found: Floats = world.pose("world", placed.parent) @ transforms.of_pose(placed.pose)
    return found


def depth_image(scene: Scene, world: World, camera: Camera, without: Collection[str] = ()) -> DepthImage:
    """What a camera at the scene's place sees of the bodies of a world, without error and without the arms."""
    T = inverse(camera_pose(scene, world))
    shown = [body for name, body in world.cell.bodies.items() if name not in without and body.shapes]
    return rendered([(solid_of(body), T @ world.pose("world", body.name)) for body in shown], camera)[0]


def look(scene: Scene, world: World, parts: Sequence[str], seed: int, given: Floats | None = None) -> Looked:
    """Parts as they are found in an image: one `given` (height, width) in metres, else one made from the scene.

    Known are all bodies but the parts and the clutter. The floor is the plane of the scene's table.
    """
    camera, entry = camera_of(scene), scene.camera
    if given is None:
        sensor = Sensor(entry.noise_m, entry.dropouts)
        image = disturbed(depth_image(scene, world, camera), sensor, seed)
    else:
        image = corrected(scene, given)
    known = depth_image(scene, world, camera, {*parts, *scene.clutter}).depth
    same = (known > 0) & (np.abs(image.depth - known) < KNOWN * max(image.noise_m, 1e-6))
    T_world_camera = camera_pose(scene, world)
    ground = Ground(same, (floor(scene, world, T_world_camera),))
    found = {part: locate(Model(solid_of(world.cell.bodies[part])), image, ground) for part in parts}
    if scene.calibrated is not None:
        known_by = np.array(scene.calibrated.covariance)
        found = {part: doubted(each, camera, T_world_camera, known_by) for part, each in found.items()}
    return Looked(image, T_world_camera, ground, found)


def edges_of(looked: Looked) -> list[tuple[Floats, Floats]]:
    """The straight edges that were found in an image: both ends (2,) of each, as (u, v)."""
    camera, found = looked.image.camera, []
    for region in regions_of(looked.image, looked.ground.known):
        lines = region.lines
        for side in range(2):
            flat = lines.normal * lines.offset[:, None] + lines.along * lines.ends[:, side, None]
            points = np.column_stack([flat, np.full(len(flat), region.offset)]) @ region.axes.T
            found.append(np.stack(camera.pixels(points), axis=-1))
    return [
        (a, b)
        for one, other in zip(found[::2], found[1::2], strict=True)
        for a, b in zip(one, other, strict=True)
    ]


def corrected(scene: Scene, depth: Floats) -> DepthImage:
    """What a sensor gave (height, width) in metres, with true depths as far as the range finder is calibrated."""
    found, camera = scene.calibrated, camera_of(scene)
    if found is None:
        return DepthImage(camera, depth, scene.camera.noise_m)
    true = np.where(depth > 0, np.maximum((depth - found.offset_m) / found.scale, 0.0), 0.0)
    return DepthImage(camera, true, found.noise_m / found.scale)


def doubted(sighting: Sighting, camera: Camera, T_world_camera: Floats, covariance: Floats) -> Sighting:
    """A sighting that is less sure by what is doubted of the camera: `covariance` (9, 9) as in `CameraFound`."""
    if isinstance(sighting, NotLocated):
        return sighting
    x, y, z = p = sighting.best.T_camera_part[:3, 3]
    J, R = np.zeros((6, 9)), T_world_camera[:3, :3].T
    J[:3, :3] = J[3:, 3:6] = R
    J[:3, 3:6] = -skew(p) @ R
    J[:3, 6:] = -np.array([[x, z, 0.0], [y, 0.0, z], [0.0, 0.0, 0.0]]) / camera.focal_px
    return replace(sighting, covariance=sighting.covariance + J @ covariance @ J.T)


def table_pose(scene: Scene, world: World) -> Floats:
    """T_world_table (4, 4)."""
    found: Floats = world.pose("world", scene.table.parent) @ transforms.of_pose(scene.table.pose)
    return found


def floor(scene: Scene, world: World, T_world_camera: Floats) -> Floats:
    """The plane of the table (4,) in the camera's frame."""
    T = inverse(T_world_camera) @ table_pose(scene, world)
    return np.append(T[:3, 2], T[:3, 2] @ T[:3, 3])
