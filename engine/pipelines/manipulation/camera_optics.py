"""Camera as it really is: its true pose, lens and depth errors, and the images that it takes."""

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import inverse, rotation_by_vector, transform
from cellwright.engine.model.vision import DepthCamera
from cellwright.engine.pipelines.manipulation.scene_camera import camera_of, camera_pose
from cellwright.engine.stages.geometry.shapes.facet_solids import solid_of
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.engine.stages.vision.sensor_images import DepthSensor, disturb_image, render_depths
from cellwright.kb.model.part_scene import Scene

PLATE_DISTANCES_M = (
    0.6,
    0.7,
    0.8,
    0.9,
    1.0,
    1.1,
    1.2,
)  # of plates: shares of the distance for which the camera is made
PLATE_LEAN_RAD = 0.01  # how far a plate leans: the standard deviation for each axis


@dataclass(frozen=True, slots=True)
class CameraErrors:
    """How a camera differs from what is believed of it: a displacement and a turn along its own
    axes, its focal length (a factor), its centre in pixels, and depths: an offset and a factor.
    """

    along_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    focal: float = 1.0
    centre_px: tuple[float, float] = (0.0, 0.0)
    offset_m: float = 0.0
    scale: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class CameraOptics:
    """A camera: `T_world_camera`, intrinsics, and a measured depth is `offset_m` + `scale`
    times the true one, with noise.
    """

    camera: DepthCamera
    T_world_camera: Floats
    sensor: DepthSensor
    offset_m: float = 0.0
    scale: float = 1.0

    @classmethod
    def of(cls, scene: Scene, errors: CameraErrors = CameraErrors()) -> "CameraOptics":
        """The camera that is believed, with errors."""
        believed, calibrated = camera_of(scene), scene.calibrated
        u, v = (
            believed.centre_px[0] + errors.centre_px[0],
            believed.centre_px[1] + errors.centre_px[1],
        )
        camera = replace(believed, focal_px=believed.focal_px * errors.focal, centre_px=(u, v))
        T = camera_pose(scene, GeometricWorld.of(scene.cell)) @ transform(
            rotation_by_vector(np.array(errors.turn_rad)), np.array(errors.along_m)
        )
        offset, scale = (
            (calibrated.offset_m, calibrated.scale) if calibrated is not None else (0.0, 1.0)
        )
        sensor = DepthSensor(scene.camera.noise_m, scene.camera.dropouts)
        return cls(camera, T, sensor, offset + errors.offset_m, scale * errors.scale)

    def image(self, world: GeometricWorld, seed: int, without: Collection[str] = ()) -> Floats:
        """The depths (height, width) that it measures of the bodies of a world, without the
        arms.
        """
        T = inverse(self.T_world_camera)
        bodies = [
            body for name, body in world.cell.bodies.items() if name not in without and body.shapes
        ]
        exact = render_depths(
            [(solid_of(body), T @ world.pose("world", body.name)) for body in bodies], self.camera
        )[0]
        return disturb_image(
            replace(exact, depth=self._measured(exact.depth)), self.sensor, seed
        ).depth

    def plates(self, distance_m: float, seed: int) -> tuple[list[Floats], list[float]]:
        """The depths that it measures of plates across its axis that lean a little, and how far
        these are.
        """
        random = np.random.default_rng(seed)
        v, u = np.mgrid[: self.camera.height, : self.camera.width].astype(float)
        rays, images = self.camera.rays(u, v), []
        distances = [share * distance_m for share in PLATE_DISTANCES_M]
        for n, distance in enumerate(distances):
            normal = np.array([*random.normal(0, PLATE_LEAN_RAD, 2), 1.0])
            exact = render_depths([], self.camera)[0]
            measured = replace(exact, depth=self._measured(distance / (rays @ normal)))
            images.append(disturb_image(measured, self.sensor, 100 * seed + n).depth)
        return images, distances

    def _measured(self, depth: Floats) -> Floats:
        measured: Floats = np.where(
            depth > 0, np.maximum(self.offset_m + self.scale * depth, 0.0), 0.0
        )
        return measured


def drawn_errors(seed: int) -> CameraErrors:
    """Errors as they are after a camera was mounted by hand."""
    random = np.random.default_rng(seed)
    x, y, z = random.normal(0, 0.006, 3)
    a, b, c = random.normal(0, np.radians(0.8), 3)
    focal, (u, v) = 1 + random.normal(0, 0.004), random.normal(0, 1.5, 2)
    offset, scale = random.normal(0, 0.004), 1 + random.normal(0, 0.004)
    return CameraErrors(
        (x, y, z), (a, b, c), float(focal), (float(u), float(v)), float(offset), float(scale)
    )
