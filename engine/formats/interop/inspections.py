"""Problems made from files of measurements, and changes of single measurements in problem files."""

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from cellwright.engine.formats.interop import editing
from cellwright.engine.formats.interop.measurements import all_facts, names, problem_text
from cellwright.engine.formats.interop.tables import read_table, unit_m
from cellwright.engine.model.measurement import Inspection, MeasurementPoint
from cellwright.engine.model.measurements import measurements_of
from cellwright.engine.model.wording import counted
from cellwright.engine.pipelines.inspection import Partition, require_choice
from cellwright.engine.pipelines.inspection.arms import divided
from cellwright.engine.pipelines.points import points, with_places
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, nearest
from cellwright.kb.files import read_file
from cellwright.kb.loader import find, load
from cellwright.kb.model.conventions import Conventions
from cellwright.kb.model.domain import Domain
from cellwright.kb.model.problem import Problem
from cellwright.kb.targets import reference
from cellwright.kb.terms import Function

NEARER = "give a smaller --edge-distance if that is too near"
UNKNOWN = "such points are listed as impossible; declare the kind, and a tool for it"
NO_POSITION = "give its position in micrometres, or a frame in cell.yaml"
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
    strange = _strange(inspection, cell)
    facts = tuple(fact for fact in told if fact.name in cell.predicates and not _names(fact, strange, cell))
    left_out = sorted({fact.name for fact in told} - {*cell.predicates})
    inspection = replace(inspection, left_out=tuple(left_out), strange=strange)
    problem = _problem(inspection, cell, facts)
    inspection = replace(inspection, unsure=_unsure(problem))
    parts = divided(problem)
    possible = {name for names in parts.groups.values() for name in names}
    kept = _attainable(facts, possible, cell)
    wanted = [name for name in names(inspection) if name in possible]
    return inspection, parts, problem_text(inspection, reference(cell), cell.conventions, kept, wanted)


def _attainable(facts: Iterable[Function], possible: Collection[str], domain: Domain) -> Iterator[Function]:
    """The facts without steps of the alignment that no tool can measure: nothing should wait for these."""
    step = domain.conventions.alignment
    return (fact for fact in facts if fact.name != step or str(fact.arguments[0]) in possible)


def _strange(inspection: Inspection, domain: Domain) -> tuple[str, ...]:
    """The kinds of measurements, in the words of the domain, that are no values of what its measurements can need."""
    words = domain.conventions
    declared = domain.predicates.get(words.needs)
    if declared is None:
        return ()
    kinds = {words.kind(point.kind) for point in inspection.points}
    known = {
        name for name, type_ in domain.objects.items() if domain.is_subtype(type_, declared.arguments[1])
    }
    return tuple(sorted(kinds - known))


def _unsure(problem: Problem) -> tuple[str, ...]:
    """The predicates, with their arguments, that would say how uncertain measured values are, and of which there are no facts."""
    domain, told = problem.domain, {fact.name for fact in problem.statics}
    measures = (each.command.measures for each in domain.operators if each.command)
    terms = (each.uncertainty for each in measures if each)
    asked = {term.name for term in terms if isinstance(term, Function) and term.name in domain.predicates}
    return tuple(f"{name}({', '.join(domain.predicates[name].arguments)})" for name in sorted(asked - told))


def _names(fact: Function, kinds: Collection[str], domain: Domain) -> bool:
    """Whether a fact says that a measurement needs one of some kinds."""
    return fact.name == domain.conventions.needs and str(fact.arguments[1]) in kinds


def _read(path: Path, unit: str, edge: float | None) -> Inspection:
    if path.suffix.lower() == ".csv":
        return read_table(path, unit)
    # geometry is slow to import, and no table needs it
    from cellwright.engine.formats.interop.qif.points import inspection_of

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
    """A warning for each feature that has no points, or others than were asked for, and for datums that no run would use."""
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
    unknown = (
        Diagnostic(
            where, "K807", f"the domain knows no measurement of the kind '{kind}'", UNKNOWN, warning=True
        )
        for kind in inspection.strange
    )
    return (
        *undeclared,
        *unknown,
        *_unaligned(inspection, where),
        *(Diagnostic(where, "K807", f"{name} {what}", hint, warning=True) for name, what, hint in told),
    )


def _unaligned(inspection: Inspection, where: Source) -> Iterator[Diagnostic]:
    """A warning if points are datums, and facts that are not there would say how uncertain their values are."""
    count = sum(1 for point in inspection.points if point.step)
    if count and inspection.unsure:
        datums = f"{counted(count, 'point')} of datums"
        said = f"a run cannot find the part by its {datums} before it knows how uncertain their values are"
        hint = f"add to `statics` what the domain declares for that: {', '.join(inspection.unsure)}"
        yield Diagnostic(where, "K807", said, hint, warning=True)


def as_qif(problem: Problem) -> tuple[str, int, tuple[Diagnostic, ...]]:
    """The measurements of a problem as a QIF document, how many they are, and a warning for each that is nowhere.

    Raises `InvalidInput` for a domain without measurements.
    """
    require_choice(problem)
    from cellwright.engine.formats.interop.qif.points_written import written_points

    found = points(with_places(problem))
    nowhere = sorted({*measurements_of(problem)} - {point.name for point in found})
    told = (
        Diagnostic(
            Source(problem.path), "K807", f"{name} is left out: it has no position", NO_POSITION, warning=True
        )
        for name in nowhere
    )
    return written_points(found), len(found), tuple(told)


def _problem(inspection: Inspection, domain: Domain, facts: tuple[Function, ...]) -> Problem:
    objects = dict.fromkeys(names(inspection), domain.conventions.measurement)
    return Problem(inspection.name, domain, objects, facts)


def rewrite(path: Path, how: str, measurements: Sequence[MeasurementPoint | str]) -> None:
    """Add (`added`), change (`replaced`) or remove (`removed`, by name) measurements in a problem file, all or none.

    The new text is read as a trial before it replaces the old one. Raises `InvalidInput`.
    """
    problem = load(path).problem
    _require_there(path, problem, [_name(each) for each in measurements], how)
    words = problem.domain.conventions if problem else Conventions()
    lines = read_file(path).text.splitlines()
    for each in measurements:
        if isinstance(each, str):
            lines = editing.removed(lines, each, str(path), words)
        else:
            lines = (editing.added if how == "added" else editing.replaced)(lines, each, str(path), words)
    trial = path.with_name(f".{path.stem}.trial{path.suffix}")
    try:
        trial.write_text("\n".join(lines) + "\n", "utf-8")
        load(trial)
        trial.replace(path)
    finally:
        trial.unlink(missing_ok=True)


def _name(measurement: MeasurementPoint | str) -> str:
    return measurement if isinstance(measurement, str) else measurement.name


def _require_there(path: Path, problem: Problem | None, names: Sequence[str], how: str) -> None:
    """Refuse to add a name that is there, and to change or remove one that is not. Each is named once."""
    there = set(measurements_of(problem)) if problem else set()
    for name in names:
        if problem is None or (name in there) == (how == "added"):
            raise InvalidInput([_misnamed(name, there, Source(str(path)))])
        there ^= {name} if how != "replaced" else set()


def _misnamed(name: str, known: Collection[str], where: Source) -> Diagnostic:
    """The diagnostic for a new measurement whose name is taken, or for a name that is not a measurement."""
    if name in known:
        return Diagnostic(
            where,
            "K104",
            f"the problem already has a measurement '{name}'",
            "choose another name, or change it with `edit`",
        )
    return Diagnostic(where, "K101", f"'{name}' is not a measurement of this problem", nearest(name, known))
