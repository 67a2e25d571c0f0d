"""The calibration of a scene's camera in a JSON file: written and read with checks."""

import json
from pathlib import Path
from typing import Any

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import read_file
from cellwright.kb.json_text import parse_json
from cellwright.kb.model.part_scene import CameraFound, Numbers
from cellwright.kb.numbers import is_number

MAX_CALIBRATION_VALUE = 1e6
AXIS_TOLERANCE = 1e-6  # how far the axes of a pose may be from right angles and unit lengths
CALIBRATION_HINT = (
    "write it with `handey calibrate ... --keep`, or with the option `calibration` of a driver"
)


def calibration_text(calibration: CameraFound) -> str:
    """What was found, as it is kept."""
    content = {
        "T_world_camera": [list(row) for row in calibration.T_world_camera],
        "focal_px": calibration.focal_px,
        "centre_px": list(calibration.centre_px),
        "covariance": [list(row) for row in calibration.covariance],
        "range": {
            "offset_m": calibration.offset_m,
            "scale": calibration.scale,
            "noise_m": calibration.noise_m,
        },
    }
    return json.dumps(content, indent=1) + "\n"


def load_calibration(path: Path) -> CameraFound:
    """What was found of a camera. Raises `InvalidInput`."""
    try:
        content = parse_json(read_file(path).text)
    except ValueError as error:
        raise _invalid_calibration(path, f"this is no JSON: {error}") from None
    keys = {"T_world_camera", "focal_px", "centre_px", "covariance", "range"}
    if not isinstance(content, dict) or set(content) != keys:
        raise _invalid_calibration(path, f"a calibration has the keys {', '.join(sorted(keys))}")
    T = _read_matrix(path, content, "T_world_camera", 4)
    if T[3] != (0.0, 0.0, 0.0, 1.0) or not _is_rotation(T):
        raise _invalid_calibration(path, "`T_world_camera` is no pose")
    covariance = _read_matrix(path, content, "covariance", 9)
    if any(covariance[n][n] < 0 for n in range(9)):
        raise _invalid_calibration(path, "`covariance` has a negative variance")
    depth = content["range"] if isinstance(content["range"], dict) else {}
    offset, scale, noise = (
        _calibrated_number(path, depth, key) for key in ("offset_m", "scale", "noise_m")
    )
    focal, (u, v) = (
        _calibrated_number(path, content, "focal_px"),
        _read_row(path, "centre_px", content["centre_px"], 2),
    )
    if focal <= 0 or scale <= 0 or noise < 0:
        raise _invalid_calibration(
            path, "`focal_px` and `scale` are above zero, `noise_m` is not below"
        )
    return CameraFound(T, focal, (u, v), covariance, offset, scale, noise)


def _is_rotation(T: tuple[Numbers, ...]) -> bool:
    """Whether the axes of a pose stand on each other, and turn to the right."""
    rows = [row[:3] for row in T[:3]]
    products = [
        abs(sum(x * y for x, y in zip(rows[a], rows[b], strict=True)) - (a == b))
        for a in range(3)
        for b in range(3)
    ]
    (a, b, c), (d, e, f), (g, h, i) = rows
    return (
        max(products) < AXIS_TOLERANCE
        and a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) > 0
    )


def _calibrated_number(path: Path, said: dict[str, Any], key: str) -> float:
    value = said.get(key)
    if not is_number(value, MAX_CALIBRATION_VALUE):
        raise _invalid_calibration(path, f"`{key}` is no number")
    assert isinstance(value, int | float)
    return float(value)


def _read_matrix(path: Path, said: dict[str, Any], key: str, size: int) -> tuple[Numbers, ...]:
    rows = said[key]
    if not isinstance(rows, list) or len(rows) != size:
        raise _invalid_calibration(path, f"`{key}` has to be {size} rows")
    return tuple(_read_row(path, key, row, size) for row in rows)


def _read_row(path: Path, key: str, row: object, size: int) -> Numbers:
    if (
        not isinstance(row, list)
        or len(row) != size
        or not all(is_number(entry, MAX_CALIBRATION_VALUE) for entry in row)
    ):
        raise _invalid_calibration(path, f"`{key}` has to have {size} numbers in a row")
    return tuple(map(float, row))


def _invalid_calibration(path: Path, message: str) -> InvalidInput:
    return InvalidInput([Diagnostic(Source(str(path)), "K413", message, CALIBRATION_HINT)])
