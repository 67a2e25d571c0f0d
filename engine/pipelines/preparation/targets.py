"""The problems that are to be prepared."""

from pathlib import Path

from cellwright.engine.pipelines.files import loaded
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.loader import find, problem_files


def problems_of(target: str) -> list[Path]:
    """The problem files that a target names. Raises `InvalidInput` if there are none."""
    folder = Path(target)
    if folder.is_dir() and not (folder / "domain.yaml").exists():
        found = sorted(folder.glob("*.yaml"))
    else:
        path = find(target)
        found = [path] if loaded(path).problem is not None else problem_files(path)
    if not found:
        hint = "problems are .yaml files in the folder `problems` beside a domain"
        raise InvalidInput([Diagnostic(Source(target), "K405", "there are no problems here", hint)])
    return found
