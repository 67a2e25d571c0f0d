"""Driver `camera`: a simulated cell whose camera makes images, is calibrated and maps depths.

Steps and their replies:

- `calibrate_range` shows plates at known distances to the range finder; `range(Offset, Scale,
  Noise)` in um, millionths, um.
- `calibrate_camera` holds the target before the camera in many poses; `camera(Focal, Column, Row,
  Within)` in thousandths of a pixel, um.
- `check_camera` holds the target there once; `off(Off)` in um, or `displaced`.
- `take_depth_map` takes an image; `map(Number, Seen)`: of a thousand pixels, how many have a depth.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import radians
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import difference, inverse
from cellwright.engine.model.vision import LocatedPart
from cellwright.engine.pipelines.manipulation.camera_calibration import (
    CHANGE_SIGMAS,
    TARGET_HOLD,
    TargetReadings,
    calibrate_camera,
    calibrate_range,
    held_target,
    scene_with_camera,
    showing_configurations,
    target_holds,
    with_range,
)
from cellwright.engine.pipelines.manipulation.camera_optics import (
    CameraErrors,
    CameraOptics,
    drawn_errors,
)
from cellwright.engine.pipelines.manipulation.scene_camera import camera_pose, correct_depths
from cellwright.engine.pipelines.simulators import HiddenCell, Simulator, fault_base, settings_of
from cellwright.engine.ports import DriverSetup
from cellwright.engine.stages.diagnosis.fault_problems import CURED, NOT_CURED
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.engine.stages.vision.part_localisation import KnownScene, locate_in_image
from cellwright.engine.stages.vision.pose_hypotheses import PartModel
from cellwright.engine.stages.vision.sensor_calibration import RangeCalibration
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.loader.calibration_file import calibration_text
from cellwright.kb.loader.scene_file import load_scene
from cellwright.kb.model.part_scene import Scene
from cellwright.kb.numbers import NumberError, read_decimal

CALIBRATION_IMAGES = 12  # of the target, for a calibration
MAX_CHECK_IMAGES = 3  # of a check, where the target is not found in an image
OFF_M, OFF_RAD = 0.002, float(np.radians(1))  # a camera that errs by more has to be calibrated
NOTHING_SEEN = 0.01  # the share of pixels without which there is no image
Shows = Callable[[Scene, Sequence[Floats]], Iterator[tuple[Floats, GeometricWorld]]]


def held_still(scene: Scene, joints: Sequence[Floats]) -> Iterator[tuple[Floats, GeometricWorld]]:
    """An arm that is always where its joints say, with the target in its hand: the joint values
    (k,), and the world then.
    """
    held_world = held_target(scene, scene.target, GeometricWorld.of(scene.cell))
    for q in joints:
        yield q, held_world.moved(scene.hand.arm, q)


@dataclass
class RunCamera:
    """A camera in a run: `scene` is what is believed of it, `optics` how it is.

    `shows` has the arm hold the target at joint values, and `world` tells what else is there. What
    was found is kept in `keep`, and depth maps in the folder `maps`, if these are given.
    """

    scene: Scene
    optics: CameraOptics
    world: Callable[[], GeometricWorld]
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
        calibration = self._plates()
        if calibration is None:
            return "no_plate"
        self._believe(with_range(self.scene, calibration))
        offset, noise = round(1e6 * calibration.offset_m), round(1e6 * calibration.noise_m)
        return f"range({offset}, {round(1e6 * calibration.scale)}, {noise})"

    def range_is_true(self) -> bool:
        """Plates are shown, and stand where they are seen, or not."""
        found_range, calibrated, distance = (
            self._plates(),
            self.scene.calibrated,
            self.scene.camera.distance_m,
        )
        if found_range is None:
            return False
        offset, scale = (
            (calibrated.offset_m, calibrated.scale) if calibrated is not None else (0.0, 1.0)
        )
        return (
            abs(found_range.offset_m - offset + (found_range.scale - scale) * distance) < OFF_M / 2
        )

    def calibrate_camera(self) -> str:
        """The target is shown, and the camera is believed where it was found."""
        try:
            calibration = calibrate_camera(
                self.scene, self.scene.target, self._readings(CALIBRATION_IMAGES)
            )
        except InvalidInput:
            return "no_target"
        self._believe(scene_with_camera(self.scene, calibration))
        lens = [
            round(1000 * length)
            for length in (calibration.camera.focal_px, *calibration.camera.centre_px)
        ]
        within = 3 * float(np.sqrt(np.linalg.eigvalsh(calibration.covariance[:3, :3])[-1]))
        return f"camera({lens[0]}, {lens[1]}, {lens[2]}, {round(1e6 * within)})"

    def check_camera(self) -> str:
        """The target is shown, and found where the arm holds it, or not."""
        off = self.off()
        if off is None:
            return "no_target"
        metres, radians = off
        return "displaced" if metres > OFF_M or radians > OFF_RAD else f"off({round(1e6 * metres)})"

    def off(self) -> tuple[float, float] | None:
        """How far (m, rad) from where the arm holds it the target is seen; None if it is not
        found.
        """
        holds = target_holds(self.scene, self.scene.target)
        readings, world = self._readings(MAX_CHECK_IMAGES), GeometricWorld.of(self.scene.cell)
        for q, depth in zip(readings.joints, readings.depths, strict=True):
            image = correct_depths(self.scene, depth)
            new = (depth > 0) & (np.abs(depth - readings.empty) > CHANGE_SIGMAS * image.noise_m)
            sighting = locate_in_image(PartModel(holds.solid), image, KnownScene(~new))
            if isinstance(sighting, LocatedPart):
                hand = world.moved(self.scene.hand.arm, q).pose(
                    "world", f"{self.scene.hand.arm}.tool"
                )
                expected = (
                    inverse(camera_pose(self.scene, world))
                    @ hand
                    @ inverse(holds.poses[TARGET_HOLD])
                )
                metres, radians = min(
                    (
                        difference(expected, T_camera_target)
                        for T_camera_target in sighting.equivalent
                    ),
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

    def _readings(self, number: int) -> TargetReadings:
        self.looks += 1
        random = np.random.default_rng((self.seed, self.looks))
        joints = showing_configurations(self.scene, self.scene.target, number, random)
        empty = self.optics.image(self.world(), 1000 * self.seed + self.looks, {self.scene.target})
        configurations, depths = list[Floats](), list[Floats]()
        for q, world in self.shows(self.scene, joints):
            self.looks += 1
            configurations.append(q)
            depths.append(self.optics.image(world, 1000 * self.seed + self.looks))
        return TargetReadings(empty, tuple(configurations), tuple(depths))

    def _believe(self, scene: Scene) -> None:
        self.scene = scene
        if self.keep is not None and scene.calibrated is not None:
            self.keep.write_text(calibration_text(scene.calibrated), "utf-8")


REPAIR_OPERATIONS = {
    "calibrate_the_camera": "calibrate_camera",
    "calibrate_the_range": "calibrate_range",
}


class InnerCell(Protocol):
    """The cell without its camera."""

    def take(self, text: str, expects: str, part: Sequence[float] = ()) -> str | None:
        """Carry out a step: its reply."""
        ...

    def told(self) -> Mapping[str, Any]:
        """What the reply to the last step tells beside its text."""
        ...

    def missing(self, looked_at: Sequence[str]) -> str:
        """The first of some facts that is not so."""
        ...

    def answer(self, action: str) -> str:
        """The outcome of a test or a repair."""
        ...

    def say(self, choices: Sequence[str]) -> str:
        """What a person answers."""
        ...


@dataclass
class CameraCell:
    """A cell whose camera is `seeing`; all else is that of `inner`."""

    inner: InnerCell
    seeing: RunCamera

    def take(self, text: str, expects: str, part: Sequence[float] = ()) -> str | None:
        """Carry out a step: its reply, from an image if it is a step of the camera that nothing
        else hinders.
        """
        reply = self.inner.take(text, expects, part)
        if reply is None or reply.partition("(")[0] != expects.partition("(")[0]:
            return reply
        return self.seeing.carry_out(text.partition("(")[0]) or reply

    def told(self) -> Mapping[str, Any]:
        """What the reply to the last step tells beside its text."""
        return self.inner.told()

    def missing(self, looked_at: Sequence[str]) -> str:
        """The first of some facts that is not so."""
        return self.inner.missing(looked_at)

    def say(self, choices: Sequence[str]) -> str:
        """What a person answers."""
        return self.inner.say(choices)

    def answer(self, action: str) -> str:
        """The outcome of a test or a repair."""
        inner_answer = self.inner.answer(action)
        return camera_answer(self.seeing, action) or inner_answer


def camera_answer(seeing: RunCamera, action: str) -> str:
    """The outcome of a test or a repair of the camera; empty for another one."""
    if action == "show_the_plate":
        return "true_depths" if seeing.range_is_true() else "false_depths"
    if action == "show_the_target":
        return "displaced" if seeing.check_camera() == "displaced" else "agrees"
    if action in REPAIR_OPERATIONS:
        reply = seeing.carry_out(REPAIR_OPERATIONS[action]) or ""
        return NOT_CURED if reply in ("no_plate", "no_target") else CURED
    return ""


def seeing_of(
    options: Mapping[str, str],
    seed: int,
    shows: Callable[[Scene], tuple[Shows, Callable[[], GeometricWorld]]] | None = None,
) -> RunCamera:
    """The camera that the options of a driver describe. Raises `InvalidInput`."""
    scene = load_scene(Path(options["scene"]))
    if not scene.target:
        message = f"the scene {scene.name} has no target that is held before its camera"
        raise InvalidInput(
            [Diagnostic(Source("--option scene"), "K005", message, "name a part: `target: gauge`")]
        )
    how = (held_still, lambda: GeometricWorld.of(scene.cell)) if shows is None else shows(scene)
    keep, maps = (Path(options[key]) if key in options else None for key in ("calibration", "maps"))
    return RunCamera(
        scene, CameraOptics.of(scene, errors_of(options, seed)), how[1], how[0], seed, keep, maps
    )


def errors_of(options: Mapping[str, str], seed: int) -> CameraErrors:
    """By what a camera errs, in mm, degrees, percent and pixels; drawn by the seed where
    nothing is said. Raises `InvalidInput`.
    """
    if not any(key in options for key in ("moved", "lens", "depths")):
        return drawn_errors(seed)
    x, y, z, a, b, c = _option_numbers(options, "moved", 6)
    focal, u, v = _option_numbers(options, "lens", 3)
    offset, scale = _option_numbers(options, "depths", 2)
    return CameraErrors(
        (x / 1000, y / 1000, z / 1000),
        (radians(a), radians(b), radians(c)),
        1 + focal / 100,
        (u, v),
        offset / 1000,
        1 + scale / 100,
    )


def _option_numbers(options: Mapping[str, str], name: str, count: int) -> list[float]:
    if name not in options:
        return [0.0] * count
    try:
        numbers = [read_decimal(text.strip()) for text in options[name].split(",")]
    except NumberError:
        numbers = []
    if len(numbers) != count:
        reason = f"'{options[name][:60]}' is not {count} numbers"
        hint = {
            "moved": "moved=5,0,-3,0,0.5,0 (mm, degrees)",
            "lens": "lens=0.4,1,-2 (percent, pixels)",
        }
        raise InvalidInput(
            [
                Diagnostic(
                    Source(f"--option {name}"),
                    "K107",
                    reason,
                    f"write {hint.get(name, 'depths=3,0.2 (mm, percent)')}",
                )
            ]
        )
    return numbers


CAMERA_OPTIONS = ("scene", "calibration", "maps", "moved", "lens", "depths")


def camera_simulator(setup: DriverSetup) -> Simulator:
    """The simulated cell of a scene for a run.

    Options: those of the simulator, `scene`, and those of its camera. Raises `InvalidInput`.
    """
    settings = settings_of(setup, CAMERA_OPTIONS)
    asked_for_scene(setup)
    cell = HiddenCell(setup.problem, fault_base(setup.problem), settings.injections, setup.seed)
    return Simulator(CameraCell(cell, seeing_of(setup.options, setup.seed)), settings)


def asked_for_scene(setup: DriverSetup) -> None:
    """Refuse options without a scene. Raises `InvalidInput`."""
    if "scene" not in setup.options:
        hint = "name a scene: --option scene=domains/handey/scene.yaml"
        raise InvalidInput(
            [Diagnostic(Source("--option"), "K408", "this driver needs a scene", hint)]
        )
