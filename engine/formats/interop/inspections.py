"""Problems made from files of measurements, and changes of single measurements in problem files."""

from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from engine.formats.interop import editing
from engine.formats.interop.measurements import all_facts, names, problem_text
from engine.formats.interop.tables import read_table, unit_m
from engine.model.measurement import Inspection, MeasurementPoint
from engine.model.measurements import measurements_of
from engine.pipelines.inspection import Partition, partition
from kb.diagnostics import Diagnostic, InvalidInput, Source, nearest
from kb.files import read_file
from kb.loader import find, load
from kb.model.domain import Domain
from kb.model.problem import Problem
from kb.targets import reference
from kb.terms import Function

NEARER = "give a smaller --edge-distance if that is too near"
HINT = "measure it otherwise, or add points with `cellwright measurement add`"


def import_file(
    path: Path, domain: str, unit: str = "mm", edge: float | None = None, table: bool = False
) -> tuple[Inspection, Partition, str]:
    """The points to measure in a QIF document or a CSV table, their division among the tools, and the text of a problem.

    The goals are the measurements that some tool can make. `unit` is that of a table, of `edge`, and of a document that names
    none. Points on faces are at least `edge` away from their edges.
    With `table`, the file is a table, whatever its name. Raises `InvalidInput`.
    """
    cell = load(find(domain)).domain
    inspection = read_table(path, unit) if table else _read(path, unit, edge)
    _require_free_names(inspection, cell, path)
    told = tuple(all_facts(inspection, cell.conventions))
    facts = tuple(fact for fact in told if fact.name in cell.predicates)
    inspection = replace(
        inspection, left_out=tuple(sorted({fact.name for fact in told} - {*cell.predicates}))
    )
    parts = partition(_problem(inspection, cell, facts))
    possible = {name for names in parts.groups.values() for name in names}
    kept = _attainable(facts, possible, cell)
    wanted = [name for name in names(inspection) if name in possible]
    return inspection, parts, problem_text(inspection, reference(cell), cell.conventions, kept, wanted)


def _attainable(facts: Iterable[Function], possible: Collection[str], domain: Domain) -> Iterator[Function]:
    """The facts without steps of the alignment that no tool can measure: nothing should wait for these."""
    step = domain.conventions.alignment
    return (fact for fact in facts if fact.name != step or str(fact.arguments[0]) in possible)


def _read(path: Path, unit: str, edge: float | None) -> Inspection:
    if path.suffix.lower() == ".csv":
        return read_table(path, unit)
    from engine.formats.interop.qif import inspection_of  # geometry: slow to import, and no table needs it

    metres = unit_m(unit)
    return inspection_of(path, metres, None if edge is None else edge * metres)


def _require_free_names(inspection: Inspection, domain: Domain, path: Path) -> None:
    """Refuse points that have the name of an object of the domain."""
    taken = sorted({*names(inspection)} & {*domain.objects})
    if taken:
        said = [f"the domain already has an object '{name}'" for name in taken]
        raise InvalidInput(
            [Diagnostic(Source(str(path)), "K104", each, "give the point another name") for each in said]
        )


def remarks(inspection: Inspection, path: Path) -> tuple[Diagnostic, ...]:
    """A warning for each feature that has no points, or others than were asked for."""
    told = [(each.feature, f"has no points: {each.reason}", HINT) for each in inspection.excluded]
    told += [(each.feature, each.reason, NEARER) for each in inspection.remarks]
    where = Source(str(path))
    undeclared = (
        Diagnostic(
            where,
            "K807",
            f"the domain declares no '{name}': such facts are left out",
            "declare it",
            warning=True,
        )
        for name in inspection.left_out
    )
    return (
        *undeclared,
        *(Diagnostic(where, "K807", f"{name} {what}", hint, warning=True) for name, what, hint in told),
    )


def _problem(inspection: Inspection, domain: Domain, facts: tuple[Function, ...]) -> Problem:
    objects = dict.fromkeys(names(inspection), domain.conventions.measurement)
    return Problem(inspection.name, domain, objects, facts)


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
