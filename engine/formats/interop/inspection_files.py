"""Problems made from files of measurements, and changes of single measurements in problems."""

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from cellwright.engine.formats.interop import measurement_edits
from cellwright.engine.formats.interop.measurement_edits import (
    all_facts,
    measurement_names,
    problem_text,
)
from cellwright.engine.formats.interop.measurement_tables import read_table, unit_m
from cellwright.engine.model.noun_wording import count_noun
from cellwright.engine.model.part_measurements import Inspection, MeasurementPoint, measurements_of
from cellwright.engine.pipelines.inspection.arm_capabilities import partition_for_arms
from cellwright.engine.pipelines.inspection.measurement_points import points_of_problem, with_places
from cellwright.engine.pipelines.inspection.tool_tours import ToolPartition, require_choice
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, nearest_hint
from cellwright.kb.files import read_file
from cellwright.kb.loader import find_target, load
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.model.name_conventions import Conventions
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.targets import domain_reference
from cellwright.kb.terms import Function

EDGE_DISTANCE_HINT = "give a smaller --edge-distance if that is too near"
UNKNOWN_KIND_HINT = "such points are listed as impossible; declare the kind, and a tool for it"
NO_POSITION_HINT = "give its position in micrometres, or a frame in cell.yaml"
NO_POINTS_HINT = "measure it otherwise, or add points with `cellwright measurement add`"


def import_file(
    path: Path, domain: str, unit: str = "mm", edge: float | None = None, table: bool = False
) -> tuple[Inspection, ToolPartition, str]:
    """The points to measure in a QIF document or a CSV table, their division among the tools, and
    the text of a problem.

    The goals are the measurements that some tool can make. `unit` is that of a table, of `edge`,
    and of a document that names none. Points on faces are at least `edge` away from their edges.
    With `table`, the file is a table, whatever its name. Raises `InvalidInput`.
    """
    cell = load(find_target(domain)).domain
    inspection = read_table(path, unit) if table else _read_inspection(path, unit, edge)
    _require_free_names(inspection, cell, path)
    told = tuple(all_facts(inspection, cell.conventions))
    strange = _unknown_kinds(inspection, cell)
    facts = tuple(
        fact
        for fact in told
        if fact.name in cell.predicates and not _needs_kind(fact, strange, cell)
    )
    left_out = sorted({fact.name for fact in told} - {*cell.predicates})
    inspection = replace(inspection, left_out=tuple(left_out), strange=strange)
    problem = _inspection_problem(inspection, cell, facts)
    inspection = replace(inspection, unsure=_missing_uncertainties(problem))
    parts = partition_for_arms(problem)
    possible = {name for names in parts.groups.values() for name in names}
    kept = _attainable_facts(facts, possible, cell)
    wanted = [name for name in measurement_names(inspection) if name in possible]
    return (
        inspection,
        parts,
        problem_text(inspection, domain_reference(cell), cell.conventions, kept, wanted),
    )


def _attainable_facts(
    facts: Iterable[Function], possible: Collection[str], domain: Domain
) -> Iterator[Function]:
    """The facts without steps of the alignment that no tool can measure: nothing should wait
    for these.
    """
    step = domain.conventions.alignment
    return (fact for fact in facts if fact.name != step or str(fact.arguments[0]) in possible)


def _unknown_kinds(inspection: Inspection, domain: Domain) -> tuple[str, ...]:
    """The kinds of measurements, in the words of the domain, that are no values of what its
    measurements can need.
    """
    words = domain.conventions
    declared = domain.predicates.get(words.needs)
    if declared is None:
        return ()
    kinds = {words.kind(point.kind) for point in inspection.points}
    known = {
        name
        for name, type_ in domain.objects.items()
        if domain.is_subtype(type_, declared.arguments[1])
    }
    return tuple(sorted(kinds - known))


def _missing_uncertainties(problem: Problem) -> tuple[str, ...]:
    """The predicates, with their arguments, that would say how uncertain measured values are,
    and of which there are no facts.
    """
    domain, told = problem.domain, {fact.name for fact in problem.statics}
    measures = (operator.command.measures for operator in domain.operators if operator.command)
    terms = (measure.uncertainty for measure in measures if measure)
    asked = {
        term.name for term in terms if isinstance(term, Function) and term.name in domain.predicates
    }
    return tuple(
        f"{name}({', '.join(domain.predicates[name].arguments)})" for name in sorted(asked - told)
    )


def _needs_kind(fact: Function, kinds: Collection[str], domain: Domain) -> bool:
    """Whether a fact says that a measurement needs one of some kinds."""
    return fact.name == domain.conventions.needs and str(fact.arguments[1]) in kinds


def _read_inspection(path: Path, unit: str, edge: float | None) -> Inspection:
    if path.suffix.lower() == ".csv":
        return read_table(path, unit)
    # geometry is slow to import, and no table needs it
    from cellwright.engine.formats.interop.qif.feature_points import inspection_of

    metres = unit_m(unit)
    return inspection_of(path, metres, None if edge is None else edge * metres)


def _require_free_names(inspection: Inspection, domain: Domain, path: Path) -> None:
    """Refuse points that have the name of an object of the domain."""
    taken = sorted({*measurement_names(inspection)} & {*domain.objects})
    if taken:
        said = [f"the domain already has an object '{name}'" for name in taken]
        raise InvalidInput(
            [
                Diagnostic(Source(str(path)), "K104", sentence, "give the point another name")
                for sentence in said
            ]
        )


def inspection_remarks(inspection: Inspection, path: Path) -> tuple[Diagnostic, ...]:
    """A warning for each feature that has no points, or others than were asked for, and for
    datums that no run would use.
    """
    told = [
        (exclusion.feature, f"has no points: {exclusion.reason}", NO_POINTS_HINT)
        for exclusion in inspection.excluded
    ]
    told += [(remark.feature, remark.reason, EDGE_DISTANCE_HINT) for remark in inspection.remarks]
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
            where,
            "K807",
            f"the domain knows no measurement of the kind '{kind}'",
            UNKNOWN_KIND_HINT,
            warning=True,
        )
        for kind in inspection.strange
    )
    return (
        *undeclared,
        *unknown,
        *_alignment_warnings(inspection, where),
        *(
            Diagnostic(where, "K807", f"{name} {what}", hint, warning=True)
            for name, what, hint in told
        ),
    )


def _alignment_warnings(inspection: Inspection, where: Source) -> Iterator[Diagnostic]:
    """A warning if points are datums, and facts that are not there would say how uncertain
    their values are.
    """
    count = sum(1 for point in inspection.points if point.step)
    if count and inspection.unsure:
        datums = f"{count_noun(count, 'point')} of datums"
        said = (
            f"a run cannot find the part by its {datums} before it knows how uncertain their "
            "values are"
        )
        hint = f"add to `statics` what the domain declares for that: {', '.join(inspection.unsure)}"
        yield Diagnostic(where, "K807", said, hint, warning=True)


def as_qif(problem: Problem) -> tuple[str, int, tuple[Diagnostic, ...]]:
    """The measurements of a problem as a QIF document, how many they are, and a warning for each
    that is nowhere.

    Raises `InvalidInput` for a domain without measurements.
    """
    require_choice(problem)
    from cellwright.engine.formats.interop.qif.single_points import written_points

    measured_points = points_of_problem(with_places(problem))
    nowhere = sorted({*measurements_of(problem)} - {point.name for point in measured_points})
    told = (
        Diagnostic(
            Source(problem.path),
            "K807",
            f"{name} is left out: it has no position",
            NO_POSITION_HINT,
            warning=True,
        )
        for name in nowhere
    )
    return written_points(measured_points), len(measured_points), tuple(told)


def _inspection_problem(
    inspection: Inspection, domain: Domain, facts: tuple[Function, ...]
) -> Problem:
    objects = dict.fromkeys(measurement_names(inspection), domain.conventions.measurement)
    return Problem(inspection.name, domain, objects, facts)


def edit_measurements(path: Path, how: str, measurements: Sequence[MeasurementPoint | str]) -> None:
    """Add (`added`), change (`replaced`) or remove (`removed`, by name) measurements in a problem
    file, all or none.

    The new text is read as a trial before it replaces the old one. Raises `InvalidInput`.
    """
    problem = load(path).problem
    _require_there(
        path, problem, [_measurement_name(measurement) for measurement in measurements], how
    )
    words = problem.domain.conventions if problem else Conventions()
    lines = read_file(path).text.splitlines()
    for measurement_entry in measurements:
        if isinstance(measurement_entry, str):
            lines = measurement_edits.remove_measurement_lines(
                lines, measurement_entry, str(path), words
            )
        else:
            lines = (
                measurement_edits.add_measurement_lines
                if how == "added"
                else measurement_edits.replace_measurement_lines
            )(lines, measurement_entry, str(path), words)
    trial = path.with_name(f".{path.stem}.trial{path.suffix}")
    try:
        trial.write_text("\n".join(lines) + "\n", "utf-8")
        load(trial)
        trial.replace(path)
    finally:
        trial.unlink(missing_ok=True)


def _measurement_name(measurement: MeasurementPoint | str) -> str:
    return measurement if isinstance(measurement, str) else measurement.name


def _require_there(path: Path, problem: Problem | None, names: Sequence[str], how: str) -> None:
    """Refuse to add a name that is there, and to change or remove one that is not.

    Each is named once.
    """
    there = set(measurements_of(problem)) if problem else set()
    for name in names:
        if problem is None or (name in there) == (how == "added"):
            raise InvalidInput([_name_diagnostic(name, there, Source(str(path)))])
        there ^= {name} if how != "replaced" else set()


def _name_diagnostic(name: str, known: Collection[str], where: Source) -> Diagnostic:
    """The diagnostic for a new measurement whose name is taken, or for a name that is not a
    measurement.
    """
    if name in known:
        return Diagnostic(
            where,
            "K104",
            f"the problem already has a measurement '{name}'",
            "choose another name, or change it with `edit`",
        )
    return Diagnostic(
        where, "K101", f"'{name}' is not a measurement of this problem", nearest_hint(name, known)
    )
