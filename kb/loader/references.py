"""The domain that a problem or plan file names with `domain:`."""

import re
from pathlib import Path

from kb.diagnostics import Diagnostic, InvalidInput, nearest
from kb.files import is_file
from kb.loader.reader import Reader
from kb.targets import DOMAIN_FILE, bundled

SUFFIXES = (".yaml", ".yml")  # messages show lines: a problem may not have those of any file shown
HEAD_BYTES = 65_536  # where a file that calls itself a domain says so


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
