"""Readings for a calibration, from a JSON file beside their depth images.

{"plates": [{"distance": 600, "image": "a.npy"}, ...]}
{"empty": "empty.npy", "held": [{"joints": [0, -90, 90, -90, -90, 0], "image": "b.npy"}, ...]}
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cellwright.engine.formats.interop.depth_files import read_depth
from cellwright.engine.model.geometry import Floats
from cellwright.engine.pipelines.placing.calibrating import Readings
from cellwright.engine.pipelines.placing.looking import camera_of
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import read_file
from cellwright.kb.json_text import parsed
from cellwright.kb.model.scene import Scene
from cellwright.kb.numbers import is_number

PLATES = '{"plates": [{"distance": 600, "image": "a.npy"}]}'
HELD = '{"empty": "empty.npy", "held": [{"joints": [0, -90, 90, -90, -90, 0], "image": "b.npy"}]}'


def read_plates(file: Path, scene: Scene) -> tuple[list[Floats], list[float]]:
    """Images of plates, and their distances in metres (in the file in millimetres). Raises `InvalidInput`."""
    found = list(_entries(file, _document(file, PLATES), "plates", "distance", PLATES))
    for n, (_, distance) in enumerate(found, 1):
        if not is_number(distance) or distance <= 0:
            raise _refused(file, f"plate {n}: `distance` has to be a positive number of millimetres", PLATES)
    return [_image(file, name, scene) for name, _ in found], [value / 1000 for _, value in found]


def read_held(file: Path, scene: Scene) -> Readings:
    """Images of a target in the hand at joint values (in the file in degrees), and one without it. Raises `InvalidInput`."""
    count = len(scene.cell.arms[scene.hand.arm].arm.joints)
    document = _document(file, HELD)
    found = list(_entries(file, document, "held", "joints", HELD))
    for n, (_, joints) in enumerate(found, 1):
        if not isinstance(joints, list) or len(joints) != count or not all(map(is_number, joints)):
            raise _refused(file, f"reading {n}: `joints` has to be {count} numbers", HELD)
    empty = document.get("empty")
    if not isinstance(empty, str):
        raise _refused(file, "`empty` has to name an image of the scene without the target", HELD)
    joints = tuple(np.radians(np.array(each, dtype=float)) for _, each in found)
    return Readings(_image(file, empty, scene), joints, tuple(_image(file, name, scene) for name, _ in found))


def _document(file: Path, hint: str) -> dict[str, Any]:
    try:
        found = parsed(read_file(file).text)
    except ValueError as error:
        raise _refused(file, f"this is no JSON: {error}", hint) from None
    if not isinstance(found, dict):
        raise _refused(file, "this is no mapping", hint)
    return found


def _entries(
    file: Path, document: Mapping[str, Any], key: str, about: str, hint: str
) -> Iterator[tuple[str, Any]]:
    """The name of the image, and what else an entry of a list says."""
    listed = document.get(key)
    if not isinstance(listed, list):
        raise _refused(file, f"`{key}` has to be a list", hint)
    for n, entry in enumerate(listed, 1):
        if (
            not isinstance(entry, dict)
            or set(entry) != {about, "image"}
            or not isinstance(entry["image"], str)
        ):
            raise _refused(file, f"entry {n} of `{key}` has to have `{about}` and `image`", hint)
        yield entry["image"], entry[about]


def _image(file: Path, name: str, scene: Scene) -> Floats:
    return read_depth(file.parent / name, camera_of(scene))


def _refused(file: Path, message: str, hint: str) -> InvalidInput:
    return InvalidInput([Diagnostic(Source(str(file)), "K413", message, f"write: {hint}")])
