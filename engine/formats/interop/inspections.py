"""Problems made from files of measurements, and changes of single measurements in problem files."""

from pathlib import Path

from engine.formats.interop import editing
from engine.formats.interop.measurements import all_facts, names, problem_text, read_table
from engine.formats.interop.qif import inspection_of
from engine.model.measurement import Inspection, MeasurementPoint
from engine.pipelines.inspection import Partition, measurements_of, partition
from kb.asp import ground_term
from kb.diagnostics import Diagnostic, InvalidInput, Source, nearest
from kb.files import read_file
from kb.loader import find, load
from kb.model.domain import Domain
from kb.model.problem import Problem
from kb.targets import reference
from kb.terms import Function


def import_file(path: Path, domain: str, unit: str = "mm") -> tuple[Inspection, Partition, str]:
    """The points to measure in a QIF document or a CSV table, their division among the tools, and the text of a problem.

    The goals are the measurements that some tool can make. Raises `InvalidInput`.
    """
    inspection = read_table(path, unit) if path.suffix.lower() == ".csv" else inspection_of(path)
    cell = load(find(domain)).domain
    parts = partition(_problem(inspection, cell))
    possible = (name for names in parts.groups.values() for name in names)
    return inspection, parts, problem_text(inspection, reference(cell), cell.conventions, sorted(possible))


def _problem(inspection: Inspection, domain: Domain) -> Problem:
    words = domain.conventions
    facts = (ground_term(fact) for fact in all_facts(inspection, words))
    return Problem(
        inspection.name,
        domain,
        dict.fromkeys(names(inspection), words.measurement),
        tuple(fact for fact in facts if isinstance(fact, Function)),
    )


def rewrite(path: Path, how: str, what: MeasurementPoint | str) -> None:
    """Add (`added`), change (`replaced`) or remove (`removed`) a measurement in a problem file.

    The new text is read as a trial before it replaces the old one. Raises `InvalidInput`.
    """
    name = what if isinstance(what, str) else what.name
    problem = load(path).problem
    there = problem is not None and problem.objects.get(name) == problem.domain.conventions.measurement
    if problem is None or there == (how == "added"):
        raise InvalidInput([_misnamed(name, problem, Source(str(path)))])
    lines, words = read_file(path).text.splitlines(), problem.domain.conventions
    if isinstance(what, str):
        lines = editing.removed(lines, what, str(path), words)
    else:
        lines = (editing.added if how == "added" else editing.replaced)(lines, what, str(path), words)
    trial = path.with_name(f".{path.stem}.trial{path.suffix}")
    try:
        trial.write_text("\n".join(lines) + "\n", "utf-8")
        load(trial)
        trial.replace(path)
    finally:
        trial.unlink(missing_ok=True)


def _misnamed(name: str, problem: Problem | None, where: Source) -> Diagnostic:
    """The diagnostic for a new measurement whose name is taken, or for a name that is not a measurement."""
    known = measurements_of(problem) if problem else []
    if name in known:
        return Diagnostic(
            where,
            "K104",
            f"the problem already has a measurement '{name}'",
            "choose another name, or change it with `edit`",
        )
    return Diagnostic(where, "K101", f"'{name}' is not a measurement of this problem", nearest(name, known))
