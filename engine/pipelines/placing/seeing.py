"""What a camera does in a run: calibrations and depth maps are operations with replies, and what they find is used from then on.

| step | what it does | its reply |
| --- | --- | --- |
| `calibrate_range` | shows plates at known distances to the range finder | `range(Offset, Scale, Noise)` in um, millionths, um |
| `calibrate_camera` | the arm holds the target before the camera in many poses | `camera(Focal, Column, Row, Within)` in thousandths of a pixel, um |
| `check_camera` | the arm holds it there once | `off(Off)` in um, or `displaced` |
| `take_depth_map` | takes an image | `map(Number, Seen)`; of a thousand pixels, how many have a depth |
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cellwright.engine.kernels.rigid import difference, inverse
from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.vision import Located
from cellwright.engine.pipelines.placing.calibrating import (
    CHANGED,
    Readings,
    calibrate_camera,
    calibrate_range,
    with_camera,
    with_range,
)
from cellwright.engine.pipelines.placing.looking import camera_pose, corrected
from cellwright.engine.pipelines.placing.optics import Optics
from cellwright.engine.pipelines.placing.showing import HOLD, held_target, shown, target_holds
from cellwright.engine.stages.geometry.world.model import World
from cellwright.engine.stages.vision.calibration import RangeCalibration
from cellwright.engine.stages.vision.hypotheses import Model
from cellwright.engine.stages.vision.localisation import Ground, locate
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader.calibration import calibration_text
from cellwright.kb.model.scene import Scene

IMAGES = 12  # of the target, for a calibration
TRIES = 3  # of a check, where the target is not found in an image
OFF_M, OFF_RAD = 0.002, float(np.radians(1))  # a camera that errs by more has to be calibrated
NOTHING_SEEN = 0.01  # the share of pixels without which there is no image
Shows = Callable[[Scene, Sequence[Floats]], Iterator[tuple[Floats, World]]]


def held_still(scene: Scene, joints: Sequence[Floats]) -> Iterator[tuple[Floats, World]]:
    """An arm that is always where its joints say, with the target in its hand: the joint values (k,), and the world then."""
    held = held_target(scene, scene.target, World.of(scene.cell))
    for q in joints:
        yield q, held.moved(scene.hand.arm, q)


@dataclass
class Seeing:
    """A camera in a run: `scene` is what is believed of it, `optics` how it is.

    `shows` has the arm hold the target at joint values, and `world` tells what else is there. What was found is kept in `keep`, and depth maps
    in the folder `maps`, if these are given.
    """

    scene: Scene
    optics: Optics
    world: Callable[[], World]
    shows: Shows = held_still
    seed: int = 0
    keep: Path | None = None
    maps: Path | None = None
    looks: int = 0

    def carry_out(self, step: str) -> str | None:
        """The reply to a step; None for one that is not of a camera."""
        acts: dict[str, Callable[[], str]] = {
            "calibrate_range": self.calibrate_range,
            "calibrate_camera": self.calibrate_camera,
            "check_camera": self.check_camera,
            "take_depth_map": self.take_depth_map,
        }
        return acts[step]() if step in acts else None

    def image(self) -> Floats:
        """The depths (height, width) that the camera measures now."""
        self.looks += 1
        return self.optics.image(self.world(), 1000 * self.seed + self.looks)

    def calibrate_range(self) -> str:
        """Plates are shown, and depths are corrected by what was found."""
        found = self._plates()
        if found is None:
            return "no_plate"
        self._believe(with_range(self.scene, found))
        offset, noise = round(1e6 * found.offset_m), round(1e6 * found.noise_m)
        return f"range({offset}, {round(1e6 * found.scale)}, {noise})"

    def range_is_true(self) -> bool:
        """Plates are shown, and stand where they are seen, or not."""
        found, known, distance = self._plates(), self.scene.calibrated, self.scene.camera.distance_m
        if found is None:
            return False
        offset, scale = (known.offset_m, known.scale) if known is not None else (0.0, 1.0)
        return abs(found.offset_m - offset + (found.scale - scale) * distance) < OFF_M / 2

    def calibrate_camera(self) -> str:
        """The target is shown, and the camera is believed where it was found."""
        try:
            found = calibrate_camera(self.scene, self.scene.target, self._readings(IMAGES))
        except InvalidInput:
            return "no_target"
        self._believe(with_camera(self.scene, found))
        lens = [round(1000 * each) for each in (found.camera.focal_px, *found.camera.centre_px)]
        within = 3 * float(np.sqrt(np.linalg.eigvalsh(found.covariance[:3, :3])[-1]))
        return f"camera({lens[0]}, {lens[1]}, {lens[2]}, {round(1e6 * within)})"

    def check_camera(self) -> str:
        """The target is shown, and found where the arm holds it, or not."""
        off = self.off()
        if off is None:
            return "no_target"
        metres, radians = off
        return "displaced" if metres > OFF_M or radians > OFF_RAD else f"off({round(1e6 * metres)})"

    def off(self) -> tuple[float, float] | None:
        """How far (m, rad) from where the arm holds it the target is seen; None if it is not found."""
        holds = target_holds(self.scene, self.scene.target)
        readings, world = self._readings(TRIES), World.of(self.scene.cell)
        for q, depth in zip(readings.joints, readings.depths, strict=True):
            image = corrected(self.scene, depth)
            new = (depth > 0) & (np.abs(depth - readings.empty) > CHANGED * image.noise_m)
            sighting = locate(Model(holds.solid), image, Ground(~new))
            if isinstance(sighting, Located):
                hand = world.moved(self.scene.hand.arm, q).pose("world", f"{self.scene.hand.arm}.tool")
                expected = inverse(camera_pose(self.scene, world)) @ hand @ inverse(holds.poses[HOLD])
                metres, radians = min(
                    (difference(expected, each) for each in sighting.equivalent),
                    key=lambda pair: float(pair[0]),
                )
                return float(metres), float(radians)
        return None

    def take_depth_map(self) -> str:
        """An image is taken, and kept if maps are kept."""
        depth = self.image()
        share = float((depth > 0).mean())
        if share < NOTHING_SEEN:
            return "dark"
        if self.maps is not None:
            self.maps.mkdir(parents=True, exist_ok=True)
            np.save(self.maps / f"map_{self.looks}.npy", depth)
        return f"map({self.looks}, {round(1000 * share)})"

    def _plates(self) -> RangeCalibration | None:
        """What the range finder errs by, as plates show it; None if it shows none."""
        self.looks += 1
        plates = self.optics.plates(self.scene.camera.distance_m, 1000 * self.seed + self.looks)
        try:
            return calibrate_range(self.scene, *plates)
        except InvalidInput:
            return None

    def _readings(self, number: int) -> Readings:
        self.looks += 1
        random = np.random.default_rng((self.seed, self.looks))
        joints = shown(self.scene, self.scene.target, number, random)
        empty = self.optics.image(self.world(), 1000 * self.seed + self.looks, {self.scene.target})
        found, depths = list[Floats](), list[Floats]()
        for q, world in self.shows(self.scene, joints):
            self.looks += 1
            found.append(q)
            depths.append(self.optics.image(world, 1000 * self.seed + self.looks))
        return Readings(empty, tuple(found), tuple(depths))

    def _believe(self, scene: Scene) -> None:
        self.scene = scene
        if self.keep is not None and scene.calibrated is not None:
            self.keep.write_text(calibration_text(scene.calibrated), "utf-8")
