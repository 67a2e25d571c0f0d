"""Reads the readings of a calibration from a JSON file that names depth images.

{"plates": [{"distance": 600, "image": "a.npy"}, ...]}
{"empty": "empty.npy", "held": [{"joints": [0, -90, 90, -90, -90, 0], "image": "b.npy"}, ...]}
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cellwright.engine.formats.interop.depth_files import read_depth
from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.pipelines.manipulation.camera_calibration import TargetReadings
from cellwright.engine.pipelines.manipulation.scene_camera import camera_of
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import read_file
from cellwright.kb.json_text import parse_json
from cellwright.kb.model.part_scene import Scene
from cellwright.kb.numbers import is_number

PLATES_EXAMPLE = '{"plates": [{"distance": 600, "image": "a.npy"}]}'
HELD_EXAMPLE = (
    '{"empty": "empty.npy", "held": [{"joints": [0, -90, 90, -90, -90, 0], "image": "b.npy"}]}'
)


def read_plates(file: Path, scene: Scene) -> tuple[list[Floats], list[float]]:
    """Images of plates, and their distances in metres (in the file in millimetres).

    Raises `InvalidInput`.
    """
    entries = list(
        _image_entries(
            file, _read_document(file, PLATES_EXAMPLE), "plates", "distance", PLATES_EXAMPLE
        )
    )
    for n, (_, distance) in enumerate(entries, 1):
        if not is_number(distance) or distance <= 0:
            raise _bad_readings(
                file,
                f"plate {n}: `distance` has to be a positive number of millimetres",
                PLATES_EXAMPLE,
            )
    return [_read_image(file, name, scene) for name, _ in entries], [
        value / 1000 for _, value in entries
    ]


def read_held(file: Path, scene: Scene) -> TargetReadings:
    """Images of a target in the hand at joint values (in the file in degrees), and one without it.

    Raises `InvalidInput`.
    """
    count = len(scene.cell.arms[scene.hand.arm].arm.joints)
    document = _read_document(file, HELD_EXAMPLE)
    entries = list(_image_entries(file, document, "held", "joints", HELD_EXAMPLE))
    for n, (_, joints) in enumerate(entries, 1):
        if not isinstance(joints, list) or len(joints) != count or not all(map(is_number, joints)):
            raise _bad_readings(
                file, f"reading {n}: `joints` has to be {count} numbers", HELD_EXAMPLE
            )
    empty = document.get("empty")
    if not isinstance(empty, str):
        raise _bad_readings(
            file, "`empty` has to name an image of the scene without the target", HELD_EXAMPLE
        )
    joints = tuple(np.radians(np.array(angles, dtype=float)) for _, angles in entries)
    return TargetReadings(
        _read_image(file, empty, scene),
        joints,
        tuple(_read_image(file, name, scene) for name, _ in entries),
    )


def _read_document(file: Path, hint: str) -> dict[str, Any]:
    try:
        document = parse_json(read_file(file).text)
    except ValueError as error:
        raise _bad_readings(file, f"this is no JSON: {error}", hint) from None
    if not isinstance(document, dict):
        raise _bad_readings(file, "this is no mapping", hint)
    return document


def _image_entries(
    file: Path, document: Mapping[str, Any], key: str, about: str, hint: str
) -> Iterator[tuple[str, Any]]:
    """The name of the image, and what else an entry of a list says."""
    listed = document.get(key)
    if not isinstance(listed, list):
        raise _bad_readings(file, f"`{key}` has to be a list", hint)
    for n, entry in enumerate(listed, 1):
        if (
            not isinstance(entry, dict)
            or set(entry) != {about, "image"}
            or not isinstance(entry["image"], str)
        ):
            raise _bad_readings(
                file, f"entry {n} of `{key}` has to have `{about}` and `image`", hint
            )
        yield entry["image"], entry[about]


def _read_image(file: Path, name: str, scene: Scene) -> Floats:
    return read_depth(file.parent / name, camera_of(scene))


def _bad_readings(file: Path, message: str, hint: str) -> InvalidInput:
    return InvalidInput([Diagnostic(Source(str(file)), "K413", message, f"write: {hint}")])
