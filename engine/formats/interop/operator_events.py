"""Reads what an operator does from a JSON file: joint moves with the jaws, and shifted bodies.

[{"joints": [0, -90, 90, -90, -90, 0], "jaws": "close"},
 {"body": "brick", "at": [450, -280, 60], "rpy": [0, 0, 20]}]
"""

from pathlib import Path
from typing import Any

import numpy as np

from cellwright.engine.pipelines.manipulation.arm_monitoring import (
    BodyShifted,
    Event,
    JawsAct,
    OperatorAct,
)
from cellwright.engine.stages.geometry import transforms
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import read_file
from cellwright.kb.json_text import parse_json
from cellwright.kb.model.body_shapes import Pose
from cellwright.kb.model.part_scene import Scene
from cellwright.kb.numbers import is_number

EVENT_KEYS = ({"joints", "jaws"}, {"body", "at", "rpy"})


def read_acts(file: Path, scene: Scene) -> list[Event]:
    """The events in a file. Raises `InvalidInput`."""
    try:
        listed = parse_json(read_file(file).text)
    except ValueError as error:
        raise _bad_events(file, f"this is no JSON: {error}") from None
    if not isinstance(listed, list):
        raise _bad_events(file, "this is no list of acts")
    return [_operator_event(entry, n, file, scene) for n, entry in enumerate(listed, 1)]


def _operator_event(entry: Any, number: int, file: Path, scene: Scene) -> Event:
    where = f"act {number}"
    if not isinstance(entry, dict) or not {"joints", "body"} & set(entry):
        raise _bad_events(file, f"{where} has neither `joints` nor a `body`")
    known = EVENT_KEYS["body" in entry]
    if odd := sorted(set(entry) - known):
        raise _bad_events(file, f"{where} has the unknown key '{odd[0]}'")
    if "body" in entry:
        if not isinstance(entry["body"], str) or entry["body"] not in scene.cell.bodies:
            raise _bad_events(file, f"{where}: there is no body '{entry['body']}'")
        at, turned = (
            _finite_numbers(entry, "at", 3, where, file),
            _finite_numbers(entry, "rpy", 3, where, file),
        )
        pose = Pose((at[0] / 1000, at[1] / 1000, at[2] / 1000), tuple(np.radians(turned).tolist()))
        return BodyShifted(entry["body"], transforms.of_pose(pose))
    jaws = entry.get("jaws", JawsAct.STAY)
    if jaws not in list(JawsAct):
        raise _bad_events(file, f"{where}: `jaws` is one of {', '.join(JawsAct)}")
    count = len(scene.cell.arms[scene.hand.arm].arm.joints)
    return OperatorAct(
        np.radians(_finite_numbers(entry, "joints", count, where, file)), JawsAct(jaws)
    )


def _finite_numbers(
    entry: dict[str, Any], key: str, count: int, where: str, file: Path
) -> list[float]:
    """So many finite numbers; zeros where a turn is left out."""
    numbers = entry.get(key, [0.0] * count if key == "rpy" else None)
    if not isinstance(numbers, list) or len(numbers) != count:
        raise _bad_events(file, f"{where}: `{key}` has to be {count} numbers")
    if not all(map(is_number, numbers)):
        raise _bad_events(file, f"{where}: `{key}` has to be {count} numbers")
    return [float(x) for x in numbers]


def _bad_events(file: Path, message: str) -> InvalidInput:
    hint = 'write: [{"joints": [0, -90, 90, -90, -90, 0], "jaws": "close"}]'
    return InvalidInput([Diagnostic(Source(str(file)), "K413", message, hint)])
