"""All errors in a domain, its problems, its cell, its fault base and its contact model, reported in one run."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from cellwright.engine.model.stages import stage_atom
from cellwright.engine.model.task import Task
from cellwright.engine.pipelines import measuring
from cellwright.engine.pipelines.inspection.demands import findings_of
from cellwright.engine.pipelines.plan_files import generated_if_bare
from cellwright.engine.pipelines.task_space import Wanted, space_of
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.stages.grounding import default_instances, ground, reachable_atoms, reachable_operators
from cellwright.kb.check import check_domain, unreachable
from cellwright.kb.check.alike import fewer
from cellwright.kb.check.faults import check_faults
from cellwright.kb.check.start import crowded, hopeless
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, in_order
from cellwright.kb.files import is_there
from cellwright.kb.loader import CELL_FILE, CONTACTS_FILE, DOMAIN_FILE, Loaded, find, load, problem_files
from cellwright.kb.loader.amounts import standing
from cellwright.kb.loader.domain import as_written
from cellwright.kb.loader.faults import FAULTS_FILE, load_faults
from cellwright.kb.model.domain import Domain
from cellwright.kb.model.problem import Problem
from cellwright.kb.targets import BUNDLED, DEVICES
from cellwright.kb.terms import Atom

UNNEEDED = ("K304", "K309", "K310", "K605")


@dataclass(frozen=True, slots=True)
class CheckReport:
    """The files that were checked and everything found in them, the most important first."""

    checked: tuple[str, ...]
    diagnostics: tuple[Diagnostic, ...]


def check(target: str, reach: bool = True) -> CheckReport:
    """All errors in a problem, or in a domain and all its problems, and in the cell, fault base and contact model beside it.

    With `reach`, places of the cell that no arm reaches are reported, too.
    """

    path = find(target)
    found: list[Diagnostic] = []
    loaded = _loaded(path, found)
    paths, problems = [path], []
    if loaded is not None and loaded.problem is not None:
        problems.append(loaded.problem)
    else:
        paths += _problem_files(path, found)
        problems += [each.problem for file in paths[1:] if (each := _loaded(file, found)) and each.problem]
    happening = _happening(loaded.domain) if loaded is not None else frozenset()
    if loaded is not None and loaded.problem is None:
        found += check_domain(loaded.domain, problems, happening)
    small = [fewer(each) for each in problems]
    grounded = [(each, task) for each in small if (task := _grounded(each.problem, found)) is not None]
    tasks = [task for _, task in grounded]
    own = [each.problem for each in small]
    found += [
        each for problem in problems for each in (*findings_of(problem), *measuring.findings_of(problem))
    ]
    lost = [each for each, task in grounded if _starts_badly(each.problem, task, own, found)]
    if loaded is not None and loaded.problem is None and len(tasks) == len(problems) > len(lost):
        reached = frozenset[str]().union(*map(reachable_operators, tasks))
        found += unreachable(loaded.domain, reached, happening)
    if loaded is not None and is_there(cell := Path(loaded.domain.path).with_name(CELL_FILE)):
        paths.append(cell)
        atoms = {atom for each, task in grounded for atom in each.told_of_all(task.atoms)}
        located = {place for each in problems for place in _located(each)}
        found += _checked_cell(cell, loaded.domain, reach, atoms, located)
        found += [each for each in _checked_frame(loaded.domain) if each not in found]
    for name, checked in ((FAULTS_FILE, _checked_faults), (CONTACTS_FILE, _checked_contacts)):
        if loaded is not None and is_there(beside := Path(loaded.domain.path).with_name(name)):
            paths.append(beside)
            found += checked(Path(loaded.domain.path))
    return CheckReport(tuple(map(str, paths)), in_order(each for each in found if not _is_unneeded(each)))


def _is_unneeded(found: Diagnostic) -> bool:
    """Whether a warning says that this cell does not need all that a device of the engine can do, or has two of one kind."""
    if not found.warning or found.where.used is None or found.code not in UNNEEDED:
        return False
    return Path(found.where.path).is_relative_to(BUNDLED / DEVICES)


def _starts_badly(problem: Problem, task: Task, problems: Sequence[Problem], found: list[Diagnostic]) -> bool:
    """Whether no goal can be reached from the initial state of a problem; everything wrong with that state is added."""
    found += crowded(problem, task.names(task.initial), default_instances(problem))
    reached = reachable_atoms(task)
    first = {stage_atom(chain, 1) for chain in problem.chains if chain.stages}
    wrong = list(hopeless(problem, reached, bool(first & reached), problems))
    found += wrong
    return bool(wrong)


def _located(problem: Problem) -> Iterator[str]:
    """The places of measurements whose position is a fact of the problem."""
    words = problem.domain.conventions
    return (words.place(str(fact.arguments[0])) for fact in problem.statics if fact.name == words.position)


def _checked_cell(
    cell: Path, domain: Domain, reach: bool, atoms: Collection[Atom], located: Collection[str]
) -> list[Diagnostic]:
    """The errors in a cell. Geometry is imported only for domains that have a cell."""
    from cellwright.engine.stages.geometry.reach.checking import check_cell

    return check_cell(cell, domain, geometry_backend if reach else None, atoms, located)


def _checked_frame(domain: Domain) -> list[Diagnostic]:
    """The error about the frame of a domain's travel, if the cell has no such frame."""
    if domain.motion is None:
        return []
    try:
        standing(domain)("")
    except InvalidInput as error:
        return [each for each in error.diagnostics if each.where == domain.motion.where]
    return []


def _checked_faults(domain: Path) -> list[Diagnostic]:
    """The errors in the fault base beside a domain."""

    try:
        model, warnings = load_faults(domain)
    except InvalidInput as error:
        return list(error.diagnostics)
    return [*warnings, *check_faults(model)]


def _happening(domain: Domain) -> frozenset[str]:
    """The predicates that causes and repairs of the fault base beside a domain make true; none if it cannot be read."""
    path = Path(domain.path)
    try:
        model = load_faults(path)[0] if is_there(path.with_name(FAULTS_FILE)) else None
    except InvalidInput:
        return frozenset()
    added = [each.adds for told in (model.causes, model.repairs) for each in told.values()] if model else []
    return frozenset(atom.name for atoms in added for atom in atoms)


def _checked_contacts(domain: Path) -> list[Diagnostic]:
    """The errors in the contact model beside a domain, and whether its filters let the start pass."""
    from cellwright.kb.loader.contacts import load_contacts

    try:
        model, warnings = load_contacts(domain)
        space_of(model, Wanted(forms=0))
    except InvalidInput as error:
        return list(error.diagnostics)
    return list(warnings)


def _grounded(problem: Problem, found: list[Diagnostic]) -> Task | None:
    try:
        return ground(problem)
    except InvalidInput as error:
        found += error.diagnostics
        return None


def _problem_files(path: Path, found: list[Diagnostic]) -> list[Path]:
    try:
        return problem_files(path)
    except InvalidInput as error:
        found += error.diagnostics
        return []


def _loaded(path: Path, found: list[Diagnostic]) -> "Loaded | None":

    try:
        loaded = load(path, as_written if path.name == DOMAIN_FILE else generated_if_bare)
    except InvalidInput as error:
        found += error.diagnostics
        return None
    found += loaded.warnings
    return loaded
