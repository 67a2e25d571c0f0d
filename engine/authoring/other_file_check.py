"""Check of one file that is neither a domain nor a problem: a cell, a scene or an arm alone, or a
file that belongs to the domain beside it.
"""

import re
from collections.abc import Callable
from pathlib import Path

from cellwright.engine.ports import GeometryBackend
from cellwright.kb import loader
from cellwright.kb.diagnostics import Diagnostic, InvalidInput
from cellwright.kb.files import first_bytes, is_there
from cellwright.kb.loader import CELL_FILE, CONTACTS_FILE, DOMAIN_FILE
from cellwright.kb.loader.arm_file import load_arm
from cellwright.kb.loader.domain_lookup import HEAD_BYTES
from cellwright.kb.loader.fault_base import FAULTS_FILE
from cellwright.kb.targets import DEVICE_FILE, SCENE_FILE

# files that are read with the domain beside them
OF_DOMAINS = (CELL_FILE, FAULTS_FILE, CONTACTS_FILE)
TOP_KEY = re.compile(r"^(\w+):", re.MULTILINE)
ALONE = ("scene", "arm", "cell")  # the keys of files that may stand alone


def domain_beside(path: Path) -> Path | None:
    """The domain file that a cell, fault base or contact model is read with; None for other files,
    and where none is there.
    """
    beside = path.with_name(DOMAIN_FILE)
    return beside if path.name in OF_DOMAINS and is_there(beside) else None


def kind_alone(path: Path) -> str:
    """Which of `ALONE` a file is; empty if it is none of them, or belongs to a device.

    A file without the key that names its kind is known by its name.
    """
    keys = set(TOP_KEY.findall(first_bytes(path, HEAD_BYTES).decode(errors="replace")))
    if {"domain", "problem", "device"} & keys or is_there(path.with_name(DEVICE_FILE)):
        return ""
    named = {CELL_FILE: "cell", SCENE_FILE: "scene"}.get(path.name, "")
    return next((kind for kind in ALONE if kind in keys), named)


def check_alone(
    path: Path, kind: str, backend: Callable[[], GeometryBackend] | None
) -> tuple[Diagnostic, ...]:
    """What is wrong with a file of a kind that stands alone.

    With a backend, places that no arm of a cell reaches are reported, too.
    """
    if kind == "cell":
        from cellwright.engine.stages.geometry.reach.cell_check import check_cell

        return tuple(check_cell(path, None, backend))
    load: Callable[[Path], object] = load_arm if kind == "arm" else loader.load_scene
    try:
        load(path)
    except InvalidInput as error:
        return tuple(error.diagnostics)
    return ()
