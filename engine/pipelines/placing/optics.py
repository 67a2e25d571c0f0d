"""A camera as it really is, which may differ from what is believed of it: where it stands, what it makes of depths, and the images that it takes."""

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.kernels.rigid import inverse, transform, turned
from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.vision import Camera
from cellwright.engine.pipelines.placing.looking import camera_of, camera_pose
from cellwright.engine.stages.geometry.shapes.solids import solid_of
from cellwright.engine.stages.geometry.world.model import World
from cellwright.engine.stages.vision.images import Sensor, disturbed, rendered
from cellwright.kb.model.scene import Scene

DISTANCES = (
    0.6,
    0.7,
    0.8,
    0.9,
    1.0,
    1.1,
    1.2,
)  # of plates: shares of the distance for which the camera is made
LEAN = 0.01  # how far a plate leans: the standard deviation for each axis


@dataclass(frozen=True, slots=True)
class Errors:
    """How a camera differs from what is believed of it: a displacement and a turn along its own axes, its focal length (a factor), its
    centre in pixels, and depths: an offset and a factor.
    """

    along_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    focal: float = 1.0
    centre_px: tuple[float, float] = (0.0, 0.0)
    offset_m: float = 0.0
    scale: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Optics:
    """A camera: `T_world_camera`, intrinsics, and a measured depth is `offset_m` + `scale` times the true one, with noise."""

    camera: Camera
    T_world_camera: Floats
    sensor: Sensor
    offset_m: float = 0.0
    scale: float = 1.0

    @classmethod
    def of(cls, scene: Scene, errors: Errors = Errors()) -> "Optics":
        """The camera that is believed, with errors."""
        believed, found = camera_of(scene), scene.calibrated
        u, v = (
            believed.centre_px[0] + errors.centre_px[0],
            believed.centre_px[1] + errors.centre_px[1],
        )
        camera = replace(believed, focal_px=believed.focal_px * errors.focal, centre_px=(u, v))
        T = camera_pose(scene, World.of(scene.cell)) @ transform(
            turned(np.array(errors.turn_rad)), np.array(errors.along_m)
        )
        offset, scale = (found.offset_m, found.scale) if found is not None else (0.0, 1.0)
        sensor = Sensor(scene.camera.noise_m, scene.camera.dropouts)
        return cls(camera, T, sensor, offset + errors.offset_m, scale * errors.scale)

    def image(self, world: World, seed: int, without: Collection[str] = ()) -> Floats:
        """The depths (height, width) that it measures of the bodies of a world, without the arms."""
        T = inverse(self.T_world_camera)
        bodies = [body for name, body in world.cell.bodies.items() if name not in without and body.shapes]
        exact = rendered(
            [(solid_of(body), T @ world.pose("world", body.name)) for body in bodies], self.camera
        )[0]
        return disturbed(replace(exact, depth=self._measured(exact.depth)), self.sensor, seed).depth

    def plates(self, distance_m: float, seed: int) -> tuple[list[Floats], list[float]]:
        """The depths that it measures of plates across its axis that lean a little, and how far these are."""
        random = np.random.default_rng(seed)
        v, u = np.mgrid[: self.camera.height, : self.camera.width].astype(float)
        rays, images = self.camera.rays(u, v), []
        distances = [share * distance_m for share in DISTANCES]
        for n, distance in enumerate(distances):
            normal = np.array([*random.normal(0, LEAN, 2), 1.0])
            exact = rendered([], self.camera)[0]
            measured = replace(exact, depth=self._measured(distance / (rays @ normal)))
            images.append(disturbed(measured, self.sensor, 100 * seed + n).depth)
        return images, distances

    def _measured(self, depth: Floats) -> Floats:
        found: Floats = np.where(depth > 0, np.maximum(self.offset_m + self.scale * depth, 0.0), 0.0)
        return found


def drawn_errors(seed: int) -> Errors:
    """Errors as they are after a camera was mounted by hand."""
    random = np.random.default_rng(seed)
    x, y, z = random.normal(0, 0.006, 3)
    a, b, c = random.normal(0, np.radians(0.8), 3)
    focal, (u, v) = 1 + random.normal(0, 0.004), random.normal(0, 1.5, 2)
    offset, scale = random.normal(0, 0.004), 1 + random.normal(0, 0.004)
    return Errors((x, y, z), (a, b, c), float(focal), (float(u), float(v)), float(offset), float(scale))
