"""All errors in a domain, its problems, its cell and its fault base, reported in one run."""

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from engine.model.task import Task
from engine.plugins import geometry_backend
from engine.stages.grounding import ground, reachable_operators
from kb.check import check_domain, unreachable
from kb.check.faults import check_faults
from kb.diagnostics import Diagnostic, InvalidInput
from kb.loader import CELL_FILE, Loaded, find, load, problem_files
from kb.loader.faults import FAULTS_FILE, load_faults
from kb.model.domain import Domain
from kb.model.problem import Problem
from kb.terms import Atom


@dataclass(frozen=True, slots=True)
class CheckReport:
    """The files that were checked, and everything that was found in them, sorted by place."""

    checked: tuple[str, ...]
    diagnostics: tuple[Diagnostic, ...]


def check(target: str, reach: bool = True) -> CheckReport:
    """All errors in a problem, or in a domain and all its problems, and in the cell and the fault base beside it.

    With `reach`, places of the cell that no arm reaches are reported, too.
    """

    path = find(target)
    found: list[Diagnostic] = []
    loaded = _loaded(path, found)
    paths, problems = [path], []
    if loaded is not None and loaded.problem is not None:
        problems.append(loaded.problem)
    else:
        paths += problem_files(path)
        problems += [each.problem for file in paths[1:] if (each := _loaded(file, found)) and each.problem]
    if loaded is not None and loaded.problem is None:
        found += check_domain(loaded.domain, problems)
    tasks = [task for problem in problems if (task := _grounded(problem, found)) is not None]
    if loaded is not None and loaded.problem is None and len(tasks) == len(problems) > 0:
        reached = frozenset[str]().union(*map(reachable_operators, tasks))
        found += unreachable(loaded.domain, reached)
    if loaded is not None and (cell := Path(loaded.domain.path).with_name(CELL_FILE)).is_file():
        paths.append(cell)
        atoms = {atom for task in tasks for atom in task.atoms}
        found += _checked_cell(cell, loaded.domain, reach, atoms)
    if loaded is not None and (faults := Path(loaded.domain.path).with_name(FAULTS_FILE)).is_file():
        paths.append(faults)
        found += _checked_faults(Path(loaded.domain.path))
    return CheckReport(tuple(map(str, paths)), tuple(sorted(set(found))))


def _checked_cell(cell: Path, domain: Domain, reach: bool, atoms: Collection[Atom]) -> list[Diagnostic]:
    """The errors in a cell. Geometry is imported only for domains that have a cell."""
    from engine.stages.geometry.reach.checking import check_cell

    return check_cell(cell, domain, geometry_backend if reach else None, atoms)


def _checked_faults(domain: Path) -> list[Diagnostic]:
    """The errors in the fault base beside a domain."""

    try:
        model, warnings = load_faults(domain)
    except InvalidInput as error:
        return list(error.diagnostics)
    return [*warnings, *check_faults(model)]


def _grounded(problem: Problem, found: list[Diagnostic]) -> Task | None:
    try:
        return ground(problem)
    except InvalidInput as error:
        found += error.diagnostics
        return None


def _loaded(path: Path, found: list[Diagnostic]) -> "Loaded | None":

    try:
        loaded = load(path)
    except InvalidInput as error:
        found += error.diagnostics
        return None
    found += loaded.warnings
    return loaded
