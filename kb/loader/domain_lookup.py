"""Finds the domain file that a target, a problem or a plan file names."""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, nearest_hint
from cellwright.kb.files import first_bytes, is_file, is_there, read_file
from cellwright.kb.loader.reader import LoadFindings, Reader, require_valid, validate_shape
from cellwright.kb.targets import DOMAIN_FILE, bundled_domains, find_target

DOMAIN_SUFFIXES = (
    ".yaml",
    ".yml",
    # messages show lines of the domain, so only files of this kind may be named: no other file is
    # ever shown
)
PDDL_SUFFIX = ".pddl"
HEAD_BYTES = 65_536  # the part of a file that is searched for its `domain:` line
_WITH_ITS_DOMAIN = "name the folder of this file: the file is checked with its domain"
_OTHER_KINDS = {
    "cell": ("a cell", _WITH_ITS_DOMAIN),
    "faults": ("a fault base", _WITH_ITS_DOMAIN),
    "contacts": ("a contact model", _WITH_ITS_DOMAIN),
    "arm": ("an arm", "name the domain whose cell uses it"),
    "device": ("a device", "name a domain that uses it"),
    "data": (
        "an answer",
        "a plan can be explained (with the number of a step), validated, revised and scheduled",
    ),
}


def domain_of(target: str) -> Path:
    """The domain file of a target, which may be one of its problems.

    The domain itself is not read. Raises `InvalidInput`.
    """
    path, findings = find_target(target), LoadFindings()
    reader = Reader.of(read_file(path), findings)
    if not isinstance(reader.root.value, dict) or "problem" not in reader.root.value:
        if isinstance(reader.root.value, dict):
            require_no_other(path, reader.root.value)
        return path
    if not validate_shape(reader, "problem"):
        require_valid(findings)
    return domain_file_of(reader)


def require_no_other(path: Path, root: Mapping[str, object]) -> None:
    """Refuse a file of another kind with one message, not with one for each of its keys.

    Raises `InvalidInput`.
    """
    for key, (kind, hint) in _OTHER_KINDS.items():
        if key in root and "domain" not in root:
            message = f"this is {kind}, not a domain or a problem"
            raise InvalidInput([Diagnostic(Source(str(path)), "K404", message, hint)])


def domain_file_of(reader: Reader) -> Path:
    """The domain of a problem: the one near it if the name fits, else a path, else a bundled one.
    Raises `InvalidInput`.

    A domain near it whose name cannot be read is the one, so that its reader says what is wrong.
    """
    node = reader.root.descend(("domain",))
    name, folder = str(node.value), Path(reader.root.file.path).parent
    if (path := domain_called(name, folder)) is not None:
        return path
    if Path(name).suffix == PDDL_SUFFIX:
        message = f"'{name[-60:]}' is PDDL: here a domain in YAML is wanted"
        hint = (
            "plan --pddl DOMAIN PROBLEM --format ipc writes a plan that validate --pddl DOMAIN "
            "PROBLEM PLAN checks"
        )
        raise InvalidInput(
            [*reader.findings.diagnostics, Diagnostic(node.where, "K401", message, hint)]
        )
    known = bundled_domains()
    beside = [
        called for place in (folder.parent, folder) if (called := _name_in(place / DOMAIN_FILE))
    ]
    hint = nearest_hint(name, [*beside, *known]) or _suggest_domains(beside, list(known))
    unknown = Diagnostic(node.where, "K401", f"unknown domain '{name[:60]}'", hint)
    raise InvalidInput([*reader.findings.diagnostics, unknown])


def domain_called(name: str, here: Path) -> Path | None:
    """The domain that a problem in the folder `here` means by a name or path; None if there is
    none.
    """
    for candidate in (here.parent / DOMAIN_FILE, here / DOMAIN_FILE):
        if _is_called(candidate, name) or (is_there(candidate) and not _name_in(candidate)):
            return candidate
    known = bundled_domains()
    own = [known[name] / DOMAIN_FILE] if name in known else []
    near, typed = (here / name / DOMAIN_FILE, here / name), (Path(name) / DOMAIN_FILE, Path(name))
    for candidate in (*near, *own, *typed, *_moved_paths(Path(name), here)):
        if is_file(candidate) and candidate.suffix in DOMAIN_SUFFIXES:
            return candidate
    return None


def _moved_paths(path: Path, here: Path) -> Iterator[Path]:
    """Where a file may be that is not at `path`: in a folder around `here` or around the working
    folder, whose files were moved together or which were named from there."""
    tails = [Path(*path.parts[-n:]) for n in range(2, len(path.parts) + 1)]
    for folder in (*here.absolute().parents, *Path.cwd().parents):
        yield from (folder / tail for tail in tails if not tail.is_absolute())


def _suggest_domains(beside: Sequence[str], known: Sequence[str]) -> str:
    if beside:
        return (
            f"the domain beside this file is '{beside[0]}'; or a path, or one of: "
            f"{', '.join(known)}"
        )
    return f"a path, or one of: {', '.join(known)}"


def _is_called(path: Path, name: str) -> bool:
    """Whether a file contains the line `domain: name`, as a domain of this name does."""
    return (
        re.search(
            rf"""^domain:\s*(['"]?){re.escape(name)}\1\s*(#.*)?$""", _file_head(path), re.MULTILINE
        )
        is not None
    )


def _name_in(path: Path) -> str:
    """The name of the domain in a file; empty if there is none."""
    match = re.search(r"""^domain:\s*['"]?([a-z]\w*)""", _file_head(path), re.MULTILINE)
    return match[1] if match else ""


def _file_head(path: Path) -> str:
    """The part of a file in which its name stands; empty if it cannot be read."""
    return first_bytes(path, HEAD_BYTES).decode("utf-8-sig", "replace").replace("\r", "\n")
