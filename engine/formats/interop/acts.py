"""What an operator does, from a JSON file: joint values in degrees with what the jaws do, and bodies that are shifted.

[{"joints": [0, -90, 90, -90, -90, 0], "jaws": "close"},
 {"body": "brick", "at": [450, -280, 60], "rpy": [0, 0, 20]}]
"""

from pathlib import Path
from typing import Any

import numpy as np

from cellwright.engine.pipelines.placing.watching import Act, Event, Jaws, Shifted
from cellwright.engine.stages.geometry import transforms
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import read_file
from cellwright.kb.json_text import parsed
from cellwright.kb.model.scene import Scene
from cellwright.kb.model.shapes import Pose
from cellwright.kb.numbers import is_number

KEYS = ({"joints", "jaws"}, {"body", "at", "rpy"})


def read_acts(file: Path, scene: Scene) -> list[Event]:
    """The events in a file. Raises `InvalidInput`."""
    try:
        listed = parsed(read_file(file).text)
    except ValueError as error:
        raise _refused(file, f"this is no JSON: {error}") from None
    if not isinstance(listed, list):
        raise _refused(file, "this is no list of acts")
    return [_event(each, n, file, scene) for n, each in enumerate(listed, 1)]


def _event(entry: Any, number: int, file: Path, scene: Scene) -> Event:
    where = f"act {number}"
    if not isinstance(entry, dict) or not {"joints", "body"} & set(entry):
        raise _refused(file, f"{where} has neither `joints` nor a `body`")
    known = KEYS["body" in entry]
    if odd := sorted(set(entry) - known):
        raise _refused(file, f"{where} has the unknown key '{odd[0]}'")
    if "body" in entry:
        if not isinstance(entry["body"], str) or entry["body"] not in scene.cell.bodies:
            raise _refused(file, f"{where}: there is no body '{entry['body']}'")
        at, turned = _numbers(entry, "at", 3, where, file), _numbers(entry, "rpy", 3, where, file)
        pose = Pose((at[0] / 1000, at[1] / 1000, at[2] / 1000), tuple(np.radians(turned).tolist()))
        return Shifted(entry["body"], transforms.of_pose(pose))
    jaws = entry.get("jaws", Jaws.STAY)
    if jaws not in list(Jaws):
        raise _refused(file, f"{where}: `jaws` is one of {', '.join(Jaws)}")
    count = len(scene.cell.arms[scene.hand.arm].arm.joints)
    return Act(np.radians(_numbers(entry, "joints", count, where, file)), Jaws(jaws))


def _numbers(entry: dict[str, Any], key: str, count: int, where: str, file: Path) -> list[float]:
    """So many finite numbers; zeros where a turn is left out."""
    found = entry.get(key, [0.0] * count if key == "rpy" else None)
    if not isinstance(found, list) or len(found) != count:
        raise _refused(file, f"{where}: `{key}` has to be {count} numbers")
    if not all(map(is_number, found)):
        raise _refused(file, f"{where}: `{key}` has to be {count} numbers")
    return [float(x) for x in found]


def _refused(file: Path, message: str) -> InvalidInput:
    hint = 'write: [{"joints": [0, -90, 90, -90, -90, 0], "jaws": "close"}]'
    return InvalidInput([Diagnostic(Source(str(file)), "K413", message, hint)])
