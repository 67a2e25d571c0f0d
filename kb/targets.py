"""The file that a target names: a file, a folder, or a domain that comes with the engine, by path or by name."""

import os
from pathlib import Path

from kb.diagnostics import Diagnostic, InvalidInput, Source, nearest
from kb.files import is_file, is_folder
from kb.model.domain import Domain

DOMAIN_FILE = "domain.yaml"
CELL_FILE = "cell.yaml"
CONTACTS_FILE = "contacts.yaml"
BUNDLED = Path(__file__).parents[1] / "domains"  # beside this package, whatever else has that name


def bundled() -> dict[str, Path]:
    """The domains that come with the engine, by name."""
    return {path.parent.name: path.parent for path in sorted(BUNDLED.glob(f"*/{DOMAIN_FILE}"))}


def find(target: str) -> Path:
    """The file that a target names: a path, a bundled domain, or `domain/problem` of one. Raises `InvalidInput`."""
    path = Path(target)
    if is_file(path / DOMAIN_FILE):
        return path / DOMAIN_FILE
    if is_file(path):
        return path
    known = bundled()
    name, _, problem = target.partition("/")
    if name in known and not problem:
        return known[name] / DOMAIN_FILE
    candidates = (
        {f"{name}/{p.stem}": p for p in sorted(known[name].glob("problems/*.yaml"))} if name in known else {}
    )
    if target in candidates:
        return candidates[target]
    raise InvalidInput([_not_found(target, path, [*known, *candidates])])


def _not_found(target: str, path: Path, known: list[str]) -> Diagnostic:
    where = Source(target)
    if is_folder(path):
        hint = "name a problem file, or make a domain here with `cellwright init`"
        return Diagnostic(where, "K401", f"there is no {DOMAIN_FILE} in this folder", hint)
    hint = nearest(target, known) or f"bundled: {', '.join(known)}"
    return Diagnostic(where, "K401", "no file, bundled domain or problem of this name", hint)


def reference(domain: Domain) -> str:
    """The name of this domain for other files: its name if it is bundled, otherwise its path from the root of the file system.

    So it is found from any folder in which a command is typed.
    """
    path = Path(domain.path)
    known = bundled().get(domain.name)
    bundle = known is not None and known.resolve() == path.parent.resolve()
    return domain.name if bundle else Path(os.path.abspath(path)).as_posix()
