"""What was found of a scene's camera, kept in a file in JSON: metres, radians and pixels; poses are rows of matrices."""

import json
from pathlib import Path
from typing import Any

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import read_file
from cellwright.kb.json_text import parsed
from cellwright.kb.model.scene import CameraFound, Numbers
from cellwright.kb.numbers import is_number

LARGEST = 1e6
UNIT = 1e-6  # how far the axes of a pose may be from right angles and unit lengths
HINT = "write it with `handey calibrate ... --keep`, or with the option `calibration` of a driver"


def calibration_text(found: CameraFound) -> str:
    """What was found, as it is kept."""
    content = {
        "T_world_camera": [list(row) for row in found.T_world_camera],
        "focal_px": found.focal_px,
        "centre_px": list(found.centre_px),
        "covariance": [list(row) for row in found.covariance],
        "range": {"offset_m": found.offset_m, "scale": found.scale, "noise_m": found.noise_m},
    }
    return json.dumps(content, indent=1) + "\n"


def load_calibration(path: Path) -> CameraFound:
    """What was found of a camera. Raises `InvalidInput`."""
    try:
        said = parsed(read_file(path).text)
    except ValueError as error:
        raise _refused(path, f"this is no JSON: {error}") from None
    keys = {"T_world_camera", "focal_px", "centre_px", "covariance", "range"}
    if not isinstance(said, dict) or set(said) != keys:
        raise _refused(path, f"a calibration has the keys {', '.join(sorted(keys))}")
    T = _matrix(path, said, "T_world_camera", 4)
    if T[3] != (0.0, 0.0, 0.0, 1.0) or not _turned(T):
        raise _refused(path, "`T_world_camera` is no pose")
    covariance = _matrix(path, said, "covariance", 9)
    if any(covariance[n][n] < 0 for n in range(9)):
        raise _refused(path, "`covariance` has a negative variance")
    depth = said["range"] if isinstance(said["range"], dict) else {}
    offset, scale, noise = (_number(path, depth, key) for key in ("offset_m", "scale", "noise_m"))
    focal, (u, v) = _number(path, said, "focal_px"), _row(path, "centre_px", said["centre_px"], 2)
    if focal <= 0 or scale <= 0 or noise < 0:
        raise _refused(path, "`focal_px` and `scale` are above zero, `noise_m` is not below")
    return CameraFound(T, focal, (u, v), covariance, offset, scale, noise)


def _turned(T: tuple[Numbers, ...]) -> bool:
    """Whether the axes of a pose stand on each other, and turn to the right."""
    rows = [row[:3] for row in T[:3]]
    products = [
        abs(sum(x * y for x, y in zip(rows[a], rows[b], strict=True)) - (a == b))
        for a in range(3)
        for b in range(3)
    ]
    (a, b, c), (d, e, f), (g, h, i) = rows
    return max(products) < UNIT and a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) > 0


def _number(path: Path, said: dict[str, Any], key: str) -> float:
    value = said.get(key)
    if not is_number(value, LARGEST):
        raise _refused(path, f"`{key}` is no number")
    assert isinstance(value, int | float)
    return float(value)


def _matrix(path: Path, said: dict[str, Any], key: str, size: int) -> tuple[Numbers, ...]:
    rows = said[key]
    if not isinstance(rows, list) or len(rows) != size:
        raise _refused(path, f"`{key}` has to be {size} rows")
    return tuple(_row(path, key, row, size) for row in rows)


def _row(path: Path, key: str, row: object, size: int) -> Numbers:
    if not isinstance(row, list) or len(row) != size or not all(is_number(each, LARGEST) for each in row):
        raise _refused(path, f"`{key}` has to have {size} numbers in a row")
    return tuple(map(float, row))


def _refused(path: Path, message: str) -> InvalidInput:
    return InvalidInput([Diagnostic(Source(str(path)), "K413", message, HINT)])
