"""What a target or a problem's `domain:` names: a file, a folder, or a domain that comes with the engine."""

from importlib import resources
from pathlib import Path

from kb.diagnostics import Diagnostic, InvalidInput, Source, nearest
from kb.loader.reader import Reader
from kb.model.domain import Domain

DOMAIN_FILE = "domain.yaml"


def bundled() -> dict[str, Path]:
    """The domains that come with the engine, by name."""
    root = Path(str(resources.files("domains")))
    return {path.parent.name: path.parent for path in sorted(root.glob(f"*/{DOMAIN_FILE}"))}


def find(target: str) -> Path:
    """The file that a target names: a path, a bundled domain, or `domain/problem` of one. Raises `InvalidInput`."""
    path = Path(target)
    if path.is_dir() and (path / DOMAIN_FILE).is_file():
        return path / DOMAIN_FILE
    if path.is_file():
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
    if path.is_dir():
        raise InvalidInput([Diagnostic(Source(target), "K401", f"no {DOMAIN_FILE} in this folder")])
    hint = nearest(target, [*known, *candidates]) or f"bundled: {', '.join(known)}"
    raise InvalidInput([Diagnostic(Source(target), "K401", "no such file, bundled domain or problem", hint)])


def domain_file(reader: Reader) -> Path:
    """A problem's domain: the one around it if the name fits, else a path, else a bundled one."""
    node = reader.root.descend(("domain",))
    name, here = str(node.value), Path(reader.root.file.path).parent
    for candidate in (here.parent / DOMAIN_FILE, here / DOMAIN_FILE):
        if candidate.is_file() and f"domain: {name}\n" in candidate.read_text("utf-8", "replace") + "\n":
            return candidate
    for candidate in (here / name / DOMAIN_FILE, here / name, Path(name) / DOMAIN_FILE, Path(name)):
        if candidate.is_file():
            return candidate
    known = bundled()
    if name in known:
        return known[name] / DOMAIN_FILE
    hint = nearest(name, list(known)) or f"a path, or one of: {', '.join(known)}"
    raise InvalidInput(
        [*reader.findings.diagnostics, Diagnostic(node.where, "K401", f"unknown domain '{name}'", hint)]
    )


def reference(domain: Domain) -> str:
    """How another file names this domain: a bundled one by its name, any other by its path."""
    path = Path(domain.path)
    known = bundled().get(domain.name)
    return domain.name if known and known.resolve() == path.parent.resolve() else path.as_posix()
