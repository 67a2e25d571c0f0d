"""Problems written as PDDL, and the plans that PDDL planners find for them."""

from pathlib import Path

from cellwright.engine.formats.interop.pddl.export import PddlText, export, import_plan
from cellwright.engine.stages.grounding import ground
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import read_file
from cellwright.kb.model.plan import Plan
from cellwright.kb.model.problem import Problem

DOMAIN, PROBLEM = "domain.pddl", "problem.pddl"
SIGNATURE = "; written by cellwright export pddl"


def exported(problem: Problem, lifted: bool = True) -> PddlText:
    """A problem as PDDL, lifted if lifted PDDL can express it. Raises `InvalidInput`."""
    return export(problem, ground(problem), lifted)


def write(text: PddlText, folder: Path) -> tuple[Path, Path]:
    """Write both files into a folder, which is made if necessary. Only earlier exports are overwritten.

    Raises `InvalidInput`.
    """
    files = (folder / DOMAIN, folder / PROBLEM)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if foreign := [file for file in files if not _ours(file)]:
            raise InvalidInput([Diagnostic(Source(str(file)), "K403", _REFUSED, _HINT) for file in foreign])
        for file, content in zip(files, (text.domain, text.problem), strict=True):
            file.write_text(f"{SIGNATURE}\n{content}", "utf-8")
    except OSError as error:
        message = f"cannot be written: {error.strerror}"
        raise InvalidInput([Diagnostic(Source(str(folder)), "K415", message, _HINT)]) from None
    return files


_REFUSED = "this file was not written by `export`, so it is not overwritten"
_HINT = "name another folder with --output"


def _ours(file: Path) -> bool:
    return not file.exists() or file.read_bytes().startswith(SIGNATURE.encode())


def read_exported_plan(problem: Problem, file: Path, lifted: bool = True) -> Plan:
    """The plan that a planner found for the export of a problem, as a sequence of our operators. Raises `InvalidInput`."""
    return import_plan(exported(problem, lifted), read_file(file).text, str(file))
