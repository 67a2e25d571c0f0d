"""Check of a whole domain: errors in it, its problems, cell, faults and contacts in one report."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from cellwright.engine.model.ground_task import GroundTask
from cellwright.engine.model.workflow_replay import stage_atom
from cellwright.engine.pipelines.contact_states import NetRequest, net_space
from cellwright.engine.pipelines.inspection import nominal_values
from cellwright.engine.pipelines.inspection.tour_demands import demand_findings
from cellwright.engine.pipelines.planning.missed_windows import find_missed_windows
from cellwright.engine.pipelines.planning.target_files import generated_if_bare
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.stages.grounding import (
    default_instances,
    ground,
    reachable_atoms,
    reachable_operators,
)
from cellwright.kb import loader
from cellwright.kb.asp.static_facts import evaluate_statics
from cellwright.kb.check import check_domain, unreachable_operators
from cellwright.kb.check.fault_base_check import check_faults
from cellwright.kb.check.initial_states import warn_of_crowding, warn_of_unreachable_goals
from cellwright.kb.check.object_reduction import reduce_objects
from cellwright.kb.check.physics import check_facts, check_physics
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, order_diagnostics
from cellwright.kb.files import is_there
from cellwright.kb.loader import (
    CELL_FILE,
    CONTACTS_FILE,
    DOMAIN_FILE,
    Loaded,
    find_target,
    load,
    problem_files,
)
from cellwright.kb.loader.domain_file import as_written
from cellwright.kb.loader.fault_base import FAULTS_FILE, load_faults
from cellwright.kb.loader.problem_amounts import cell_points
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.targets import BUNDLED_DOMAINS, DEVICES_FOLDER
from cellwright.kb.terms import Atom

UNNEEDED = ("K304", "K309", "K310", "K605")


@dataclass(frozen=True, slots=True)
class CheckReport:
    """The files that were checked and everything found in them, the most important first."""

    checked: tuple[str, ...]
    diagnostics: tuple[Diagnostic, ...]


def check_domain_files(target: str, reach: bool = True) -> CheckReport:
    """All errors in a problem, or in a domain and all its problems, and in the cell, fault base and
    contact model beside it.

    With `reach`, places of the cell that no arm reaches are reported, too.
    """

    path = find_target(target)
    findings: list[Diagnostic] = []
    loaded = _load_file(path, findings)
    paths, problems = [path], []
    if loaded is not None and loaded.problem is not None:
        problems.append(loaded.problem)
    else:
        paths += _problem_files(path, findings)
        problems += [
            loaded_file.problem
            for file in paths[1:]
            if (loaded_file := _load_file(file, findings)) and loaded_file.problem
        ]
    happening = _fault_effects(loaded.domain) if loaded is not None else frozenset()
    if loaded is not None and loaded.problem is None:
        findings += check_domain(loaded.domain, problems, happening)
    if loaded is not None:
        findings += check_physics(loaded.domain)
    small = [reduce_objects(problem) for problem in problems]
    grounded = [
        (reduced, task)
        for reduced in small
        if (task := _ground_problem(reduced.problem, findings)) is not None
    ]
    tasks = [task for _, task in grounded]
    own = [reduced.problem for reduced in small]
    findings += [
        finding
        for problem in problems
        for finding in (*demand_findings(problem), *nominal_values.nominal_findings(problem))
    ]
    lost = [
        reduced for reduced, task in grounded if _starts_badly(reduced.problem, task, own, findings)
    ]
    if loaded is not None and loaded.problem is None and len(tasks) == len(problems) > len(lost):
        reached = frozenset[str]().union(*map(reachable_operators, tasks))
        findings += unreachable_operators(loaded.domain, reached, happening)
    if loaded is not None and is_there(cell := Path(loaded.domain.path).with_name(CELL_FILE)):
        paths.append(cell)
        atoms = {atom for reduced, task in grounded for atom in reduced.told_of_all(task.atoms)}
        located = {place for problem in problems for place in _located_places(problem)}
        findings += _checked_cell(cell, loaded.domain, reach, atoms, located)
        findings += [
            finding for finding in _checked_frame(loaded.domain) if finding not in findings
        ]
    for name, checked in ((FAULTS_FILE, _checked_faults), (CONTACTS_FILE, _checked_contacts)):
        if loaded is not None and is_there(beside := Path(loaded.domain.path).with_name(name)):
            paths.append(beside)
            findings += checked(Path(loaded.domain.path))
    return CheckReport(
        tuple(map(str, paths)),
        order_diagnostics(finding for finding in findings if not _is_unneeded(finding)),
    )


def _is_unneeded(finding: Diagnostic) -> bool:
    """Whether a warning says that this cell does not need all that a device of the engine can
    do, or has two of one kind.
    """
    if not finding.warning or finding.where.used is None or finding.code not in UNNEEDED:
        return False
    return Path(finding.where.path).is_relative_to(BUNDLED_DOMAINS / DEVICES_FOLDER)


def _starts_badly(
    problem: Problem, task: GroundTask, problems: Sequence[Problem], findings: list[Diagnostic]
) -> bool:
    """Whether no goal can be reached from the initial state of a problem; everything wrong with
    that state is added.
    """
    start = task.names(task.initial)
    findings += warn_of_crowding(problem, start, default_instances(problem))
    told = {(each.code, each.where.line) for each in findings if each.code == "K314"}
    more = check_facts(problem, start, tuple(evaluate_statics(problem).everything()))
    findings += [each for each in more if each.code != "K314" or not told]
    findings += find_missed_windows(problem, task)
    reached = reachable_atoms(task)
    first = {stage_atom(chain, 1) for chain in problem.chains if chain.stages}
    wrong = list(warn_of_unreachable_goals(problem, reached, bool(first & reached), problems))
    findings += wrong
    return bool(wrong)


def _located_places(problem: Problem) -> Iterator[str]:
    """The places of measurements whose position is a fact of the problem."""
    words = problem.domain.conventions
    return (
        words.place(str(fact.arguments[0]))
        for fact in problem.statics
        if fact.name == words.position
    )


def _checked_cell(
    cell: Path, domain: Domain, reach: bool, atoms: Collection[Atom], located: Collection[str]
) -> list[Diagnostic]:
    """The errors in a cell. Geometry is imported only for domains that have a cell."""
    from cellwright.engine.stages.geometry.reach.cell_check import check_cell

    return check_cell(cell, domain, geometry_backend if reach else None, atoms, located)


def _checked_frame(domain: Domain) -> list[Diagnostic]:
    """The error about the frame of a domain's travel, if the cell has no such frame."""
    if domain.motion is None:
        return []
    try:
        cell_points(domain)("")
    except InvalidInput as error:
        return [
            diagnostic
            for diagnostic in error.diagnostics
            if diagnostic.where == domain.motion.where
        ]
    return []


def _checked_faults(domain: Path) -> list[Diagnostic]:
    """The errors in the fault base beside a domain."""

    try:
        model, warnings = load_faults(domain)
    except InvalidInput as error:
        return list(error.diagnostics)
    return [*warnings, *check_faults(model)]


def _fault_effects(domain: Domain) -> frozenset[str]:
    """The predicates that causes and repairs of the fault base beside a domain make true; none
    if it cannot be read.
    """
    path = Path(domain.path)
    try:
        model = load_faults(path)[0] if is_there(path.with_name(FAULTS_FILE)) else None
    except InvalidInput:
        return frozenset()
    added = (
        [entry.adds for entries in (model.causes, model.repairs) for entry in entries.values()]
        if model
        else []
    )
    return frozenset(atom.name for atoms in added for atom in atoms)


def _checked_contacts(domain: Path) -> list[Diagnostic]:
    """The errors in the contact model beside a domain, and whether its filters let the start
    pass.
    """
    try:
        model, warnings = loader.load_contacts(domain)
        net_space(model, NetRequest(forms=0))
    except InvalidInput as error:
        return list(error.diagnostics)
    return list(warnings)


def _ground_problem(problem: Problem, findings: list[Diagnostic]) -> GroundTask | None:
    try:
        return ground(problem)
    except InvalidInput as error:
        findings += error.diagnostics
        return None


def _problem_files(path: Path, findings: list[Diagnostic]) -> list[Path]:
    try:
        return problem_files(path)
    except InvalidInput as error:
        findings += error.diagnostics
        return []


def _load_file(path: Path, findings: list[Diagnostic]) -> "Loaded | None":

    try:
        loaded = load(path, as_written if path.name == DOMAIN_FILE else generated_if_bare)
    except InvalidInput as error:
        findings += error.diagnostics
        return None
    findings += loaded.warnings
    return loaded
