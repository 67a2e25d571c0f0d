"""A new domain to start from: a small commented cell with a problem, a fault base, a golden plan and schemas."""

import json
import re
from collections.abc import Sequence
from pathlib import Path

from cellwright.engine.authoring.starter.assembled import texts
from cellwright.engine.authoring.testing.golden import compare_all, update
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.schema import json_schema

SCHEMAS = ("domain", "problem", "faults")
CELL = Path(__file__).with_name("cell")


def create(folder: Path) -> list[Path]:
    """Write a new domain into a new or empty folder and return the files written. Raises `InvalidInput`, `OSError`."""
    _require_empty(folder)
    return sorted([*_copy(CELL, folder, _name(folder)), *_completed(folder)])


def create_with(folder: Path, devices: Sequence[str]) -> tuple[list[Path], list[str]]:
    """Write a domain made of these devices into a new or empty folder. Returns its files, and faults to try.

    Raises `InvalidInput`, `OSError`.
    """
    _require_empty(folder)
    files, faults = texts(folder, _name(folder), devices)
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, "utf-8")
    return sorted([*(folder / name for name in files), *_completed(folder)]), faults


def _require_empty(folder: Path) -> None:
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        message = "the folder is not empty, and existing files are not overwritten"
        raise InvalidInput([Diagnostic(Source(str(folder)), "K403", message, "name a new folder")])


def _completed(folder: Path) -> list[Path]:
    """Write the schemas and the golden plans of a new domain."""
    written = []
    for kind in SCHEMAS:
        written.append(folder / "schema" / f"{kind}.schema.json")
        written[-1].parent.mkdir(exist_ok=True)
        written[-1].write_text(json.dumps(json_schema(kind), indent=1) + "\n", "utf-8")
    for comparison in list(compare_all(str(folder))):
        update(comparison)
        written.append(comparison.file)
    return written


def _name(folder: Path) -> str:
    """The name of the domain, made from the name of the folder."""
    name = re.sub(r"[^a-z0-9_]+", "_", folder.resolve().name.lower()).strip("_")
    return name if re.match(r"[a-z]", name) else f"cell_{name}".rstrip("_")


def _copy(source: Path, target: Path, name: str) -> list[Path]:
    target.mkdir(parents=True, exist_ok=True)
    written = []
    for each in sorted(source.iterdir()):
        if each.is_dir():
            written += _copy(each, target / each.name, name)
        else:
            text = re.sub(
                r"^((?:domain|faults): )CELL$", rf"\g<1>{name}", each.read_text("utf-8"), flags=re.MULTILINE
            )
            (target / each.name).write_text(text, "utf-8")
            written.append(target / each.name)
    return written
