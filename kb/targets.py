"""Finds the file that a target names: a file, a folder, or a bundled domain."""

import os
from pathlib import Path
from typing import TYPE_CHECKING

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, nearest_hint
from cellwright.kb.files import is_file, is_folder, is_there, similar_file_hint

if TYPE_CHECKING:
    from cellwright.kb.model.domain_model import Domain

DOMAIN_FILE = "domain.yaml"
CELL_FILE = "cell.yaml"
CONTACTS_FILE = "contacts.yaml"
DEVICE_FILE = "device.yaml"
SCENE_FILE = "scene.yaml"
# the folder of devices: of those that come with the engine, and beside a domain
DEVICES_FOLDER = "devices"
# beside this package, whatever else has that name
BUNDLED_DOMAINS = Path(__file__).parents[1] / "domains"

# files that are no target, by their endings: what they are, and which command takes them
OTHER_FILES = {
    ".lp": (
        "these are rules, not a problem",
        "name the problem, or the folder of the domain that includes it",
    ),
    ".pddl": (
        "this is PDDL, not a problem in YAML",
        "plan takes it with --pddl: cellwright plan --pddl DOMAIN PROBLEM",
    ),
    ".tsp": (
        "this is a file of TSPLIB, not a problem",
        "sequence takes it: cellwright sequence FILE",
    ),
    ".csv": (
        "this is a table, not a problem",
        "make a problem of its points: cellwright import csv FILE",
    ),
    ".qif": (
        "this is a QIF document, not a problem",
        "make a problem of its features: cellwright import qif FILE",
    ),
}
SLAB_TABLE = "operations.tsv"  # a table of S-LAB


def bundled_domains() -> dict[str, Path]:
    """The domains that come with the engine, by name."""
    return {
        path.parent.name: path.parent for path in sorted(BUNDLED_DOMAINS.glob(f"*/{DOMAIN_FILE}"))
    }


def bundled_devices() -> dict[str, Path]:
    """The devices that come with the engine, by name."""
    return devices_in(BUNDLED_DOMAINS / DEVICES_FOLDER)


def devices_in(folder: Path) -> dict[str, Path]:
    """The devices in a folder, by name."""
    return {path.parent.name: path.parent for path in sorted(folder.glob(f"*/{DEVICE_FILE}"))}


def find_target(target: str) -> Path:
    """The file that a target names: a path, or by name a domain, or `domain/problem`, here or
    bundled. Raises `InvalidInput`.

    A domain in the working folder comes before a bundled one of its name, even if its file cannot
    be read.
    """
    path = Path(target)
    if is_there(path / DOMAIN_FILE):
        return path / DOMAIN_FILE
    if is_file(path) and path.suffix.lower() in OTHER_FILES:
        raise InvalidInput([Diagnostic(Source(target), "K404", *OTHER_FILES[path.suffix.lower()])])
    if is_file(path):
        return path
    known = bundled_domains()
    name, _, problem = target.partition("/")
    if problem and is_there(Path(name, DOMAIN_FILE)):
        return _own_problem(name, target)
    if name in known and not problem:
        return known[name] / DOMAIN_FILE
    candidates = _of_domain(known[name], name) if name in known else {}
    if target in candidates:
        return candidates[target]
    raise InvalidInput([_not_found(target, path, [*known, *candidates])])


def bundled_scenes() -> dict[str, Path]:
    """The scenes that come with the engine, by name."""
    scenes = {path.parent.name: path for path in sorted(BUNDLED_DOMAINS.glob(f"*/{SCENE_FILE}"))}
    more = sorted(
        path for path in BUNDLED_DOMAINS.glob("*/scenes/*.yaml") if not path.stem.endswith("_cell")
    )
    return scenes | {f"{path.parent.parent.name}/{path.stem}": path for path in more}


def find_scene(name: str) -> Path:
    """The file of a scene, by path or bundled name such as `handey` or `handey/five`.

    Raises `InvalidInput`.
    """
    known = bundled_scenes()
    if is_file(Path(name)):
        return Path(name)
    if name in known:
        return known[name]
    hint = nearest_hint(name, list(known)) or f"bundled: {', '.join(known)}"
    raise InvalidInput(
        [Diagnostic(Source(name), "K401", "no file and no bundled scene of this name", hint)]
    )


def _of_domain(folder: Path, name: str) -> dict[str, Path]:
    """The problems of a bundled domain by name; those in `large` take long, and are not part of
    its tests.
    """
    files = [*folder.glob("large/*.yaml"), *folder.glob("problems/*.yaml")]
    return {f"{name}/{file.stem}": file for file in sorted(files)}


def _own_problem(folder: str, target: str) -> Path:
    """The problem of a domain in the working folder. Raises `InvalidInput`."""
    problems = {
        f"{folder}/{problem_file.stem}": problem_file
        for problem_file in problem_files(Path(folder, DOMAIN_FILE))
    }
    if target in problems:
        return problems[target]
    hint = nearest_hint(target, list(problems)) or f"its problems: {', '.join(problems) or 'none'}"
    raise InvalidInput(
        [Diagnostic(Source(target), "K401", f"the domain in ./{folder} has no such problem", hint)]
    )


def problem_files(domain: Path) -> list[Path]:
    """The problem files beside a domain file. Raises `InvalidInput` if they cannot be listed."""
    folder = domain.parent / "problems"
    if not is_there(folder):
        return []
    try:
        return sorted(
            folder / entry.name for entry in os.scandir(folder) if entry.name.endswith(".yaml")
        )
    except OSError as error:
        said = f"the problems cannot be listed: {(error.strerror or str(error)).lower()}"
        raise InvalidInput(
            [Diagnostic(Source(str(folder)), "K001", said, "make it a folder that you may read")]
        ) from None


def _not_found(target: str, path: Path, known: list[str]) -> Diagnostic:
    where = Source(target)
    if is_folder(path):
        hint = "name a problem file, or make a domain here with `cellwright init`"
        if is_file(path / SLAB_TABLE):
            hint = "these are tables of S-LAB: cellwright schedule takes them"
        return Diagnostic(where, "K401", f"there is no {DOMAIN_FILE} in this folder", hint)
    beside = similar_file_hint(path) if path.suffix in (".yaml", ".yml", ".json") else ""
    hint = beside or nearest_hint(target, known) or f"bundled: {', '.join(known)}"
    return Diagnostic(where, "K401", "no file, bundled domain or problem of this name", hint)


def domain_reference(domain: "Domain") -> str:
    """The name of this domain for other files: its name if it is bundled, otherwise its path from
    the root of the file system.

    So it is found from any folder in which a command is typed.
    """
    path = Path(domain.path)
    known = bundled_domains().get(domain.name)
    bundle = known is not None and known.resolve() == path.parent.resolve()
    return domain.name if bundle else Path(os.path.abspath(path)).as_posix()
