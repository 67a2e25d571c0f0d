"""What a command line says of an execution by physics."""

from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from typing import TYPE_CHECKING

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from cellwright.kb.numbers import NumberError, decimal

if TYPE_CHECKING:
    from cellwright.engine.pipelines.placing.optics import Errors
    from cellwright.engine.pipelines.workshop.running import Shift
    from cellwright.kb.model.scene import Scene


def shifts_of(scene: "Scene", shifted: Sequence[str], removed: Sequence[str]) -> "list[Shift]":
    """What is moved (PART=X,Y,TURN in mm and degrees) or taken away after it was seen. Raises `InvalidInput`."""
    needs_mujoco("--execute")
    return list(_shifts(scene, shifted, removed))


def knock_of(text: str) -> "Errors":
    """By how much the camera was knocked: X,Y,Z,A,B,C in mm and degrees, along and about its own axes. Raises `InvalidInput`."""
    from cellwright.engine.pipelines.placing.camera_cell import errors_of
    from cellwright.engine.pipelines.placing.optics import Errors

    return errors_of({"moved": text}, 0) if text else Errors()


def needs_mujoco(option: str) -> None:
    """Refuse what physics is needed for where MuJoCo is not installed. Raises `InvalidInput`."""
    if find_spec("mujoco") is None:
        message, hint = f"{option} needs MuJoCo, which is not installed", "pip install 'cellwright[mujoco]'"
        raise InvalidInput([Diagnostic(Source(option), "K414", message, hint)])


def _shifts(scene: "Scene", shifted: Sequence[str], removed: Sequence[str]) -> "Iterator[Shift]":
    from math import radians

    from cellwright.engine.pipelines.workshop.running import Shift

    for text in shifted:
        part, _, numbers = text.partition("=")
        x, y, turn = _three(numbers, text)
        yield Shift(_part(scene, part, "--shift", fixed=True), (x / 1000, y / 1000), radians(turn))
    for part in removed:
        yield Shift(_part(scene, part, "--remove"), away=True)


def _three(numbers: str, text: str) -> tuple[float, float, float]:
    try:
        found = [decimal(each.strip()) for each in numbers.split(",")]
    except NumberError:
        found = []
    if len(found) != 3:
        said = f"'{text}' does not say how a part is moved"
        raise InvalidInput(
            [Diagnostic(Source("--shift"), "K107", said, "write wall_2=20,-10,15: mm, mm, degrees")]
        )
    return found[0], found[1], found[2]


def _part(scene: "Scene", name: str, option: str, fixed: bool = False) -> str:
    from cellwright.kb.model.cell import BodyKind

    kinds = (BodyKind.PART, BodyKind.FIXTURE) if fixed else (BodyKind.PART,)
    parts = [each for each, body in scene.cell.bodies.items() if body.kind in kinds]
    if name not in parts:
        raise InvalidInput(
            [unknown_name("part or fixture" if fixed else "part", name, parts, Source(option))]
        )
    return name
