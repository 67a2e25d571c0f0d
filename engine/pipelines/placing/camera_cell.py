"""A simulated cell with a camera that really makes images: what it replies is what was found in them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import radians
from pathlib import Path
from typing import Any, Protocol

from cellwright.engine.pipelines.placing.optics import Errors, Optics, drawn_errors
from cellwright.engine.pipelines.placing.seeing import Seeing, Shows, held_still
from cellwright.engine.stages.diagnosis.knowledge import CURED, NOT_CURED
from cellwright.engine.stages.geometry.world.model import World
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.loader.scene import load_scene
from cellwright.kb.model.scene import Scene
from cellwright.kb.numbers import NumberError, decimal

REPAIRS = {"calibrate_the_camera": "calibrate_camera", "calibrate_the_range": "calibrate_range"}


class Inner(Protocol):
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

    inner: Inner
    seeing: Seeing

    def take(self, text: str, expects: str, part: Sequence[float] = ()) -> str | None:
        """Carry out a step: its reply, from an image if it is a step of the camera that nothing else hinders."""
        said = self.inner.take(text, expects, part)
        if said is None or said.partition("(")[0] != expects.partition("(")[0]:
            return said
        return self.seeing.carry_out(text.partition("(")[0]) or said

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
        other = self.inner.answer(action)
        return camera_answer(self.seeing, action) or other


def camera_answer(seeing: Seeing, action: str) -> str:
    """The outcome of a test or a repair of the camera; empty for another one."""
    if action == "show_the_plate":
        return "true_depths" if seeing.range_is_true() else "false_depths"
    if action == "show_the_target":
        return "displaced" if seeing.check_camera() == "displaced" else "agrees"
    if action in REPAIRS:
        said = seeing.carry_out(REPAIRS[action]) or ""
        return NOT_CURED if said in ("no_plate", "no_target") else CURED
    return ""


def seeing_of(
    options: Mapping[str, str],
    seed: int,
    shows: Callable[[Scene], tuple[Shows, Callable[[], World]]] | None = None,
) -> Seeing:
    """The camera that the options of a driver describe. Raises `InvalidInput`."""
    scene = load_scene(Path(options["scene"]))
    if not scene.target:
        message = f"the scene {scene.name} has no target that is held before its camera"
        raise InvalidInput(
            [Diagnostic(Source("--option scene"), "K005", message, "name a part: `target: gauge`")]
        )
    how = (held_still, lambda: World.of(scene.cell)) if shows is None else shows(scene)
    keep, maps = (Path(options[key]) if key in options else None for key in ("calibration", "maps"))
    return Seeing(scene, Optics.of(scene, errors_of(options, seed)), how[1], how[0], seed, keep, maps)


def errors_of(options: Mapping[str, str], seed: int) -> Errors:
    """By what a camera errs, in mm, degrees, percent and pixels; drawn by the seed where nothing is said. Raises `InvalidInput`."""
    if not any(key in options for key in ("moved", "lens", "depths")):
        return drawn_errors(seed)
    x, y, z, a, b, c = _numbers(options, "moved", 6)
    focal, u, v = _numbers(options, "lens", 3)
    offset, scale = _numbers(options, "depths", 2)
    return Errors(
        (x / 1000, y / 1000, z / 1000),
        (radians(a), radians(b), radians(c)),
        1 + focal / 100,
        (u, v),
        offset / 1000,
        1 + scale / 100,
    )


def _numbers(options: Mapping[str, str], name: str, count: int) -> list[float]:
    if name not in options:
        return [0.0] * count
    try:
        found = [decimal(each.strip()) for each in options[name].split(",")]
    except NumberError:
        found = []
    if len(found) != count:
        said = f"'{options[name][:60]}' is not {count} numbers"
        hint = {"moved": "moved=5,0,-3,0,0.5,0 (mm, degrees)", "lens": "lens=0.4,1,-2 (percent, pixels)"}
        raise InvalidInput(
            [
                Diagnostic(
                    Source(f"--option {name}"),
                    "K107",
                    said,
                    f"write {hint.get(name, 'depths=3,0.2 (mm, percent)')}",
                )
            ]
        )
    return found
