"""What a target or a problem's `domain:` names: a file, a folder, or a domain that comes with the engine."""

import re
from importlib import resources
from pathlib import Path

from kb.diagnostics import Diagnostic, InvalidInput, Source, nearest
from kb.loader.files import is_file, is_folder
from kb.loader.reader import Reader
from kb.model.domain import Domain

DOMAIN_FILE = "domain.yaml"
CELL_FILE = "cell.yaml"
SUFFIXES = (".yaml", ".yml")  # messages show lines: a problem may not have those of any file shown
HEAD_BYTES = 65_536  # where a file that calls itself a domain says so


def bundled() -> dict[str, Path]:
    """The domains that come with the engine, by name."""
    root = Path(str(resources.files("domains")))
    return {path.parent.name: path.parent for path in sorted(root.glob(f"*/{DOMAIN_FILE}"))}


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


def domain_file(reader: Reader) -> Path:
    """A problem's domain: the one around it if the name fits, else a path, else a bundled one. Raises `InvalidInput`."""
    node = reader.root.descend(("domain",))
    name, here = str(node.value), Path(reader.root.file.path).parent
    for candidate in (here.parent / DOMAIN_FILE, here / DOMAIN_FILE):
        if _is_called(candidate, name):
            return candidate
    for candidate in (here / name / DOMAIN_FILE, here / name, Path(name) / DOMAIN_FILE, Path(name)):
        if is_file(candidate) and candidate.suffix in SUFFIXES:
            return candidate
    known = bundled()
    if name in known:
        return known[name] / DOMAIN_FILE
    hint = nearest(name, list(known)) or f"a path, or one of: {', '.join(known)}"
    found = Diagnostic(node.where, "K401", f"unknown domain '{name[:60]}'", hint)
    raise InvalidInput([*reader.findings.diagnostics, found])


def _is_called(path: Path, name: str) -> bool:
    """Whether a file says, as a domain of this name would, `domain: name`."""
    if not is_file(path):
        return False
    try:
        with path.open("rb") as file:
            text = file.read(HEAD_BYTES).decode("utf-8-sig", "replace").replace("\r", "\n")
    except OSError:
        return False
    return re.search(rf"""^domain:\s*(['"]?){re.escape(name)}\1\s*(#.*)?$""", text, re.MULTILINE) is not None


def reference(domain: Domain) -> str:
    """How another file names this domain: a bundled one by its name, any other by its path."""
    path = Path(domain.path)
    known = bundled().get(domain.name)
    return domain.name if known and known.resolve() == path.parent.resolve() else path.as_posix()
