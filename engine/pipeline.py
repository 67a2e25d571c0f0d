"""The stages in order. What the command line does is one call of a function here.

What reads files of our own language is imported by the functions that read them: tasks in PDDL go without it.
"""

import time
from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from engine.grounding import ground, reachable_operators
from engine.grounding.limits import require_affordable_statics
from engine.interop.pddl import PddlProblem, read_pddl
from engine.model.outcome import Found, Outcome, Statistics
from engine.model.task import Task
from engine.planning import NO_MACROS, Limits, Macros
from engine.planning import plan as plan_task
from engine.validation import validate
from kb.diagnostics import Diagnostic, InvalidInput, Source
from kb.model.domain import Domain
from kb.model.plan import Plan, in_sequence
from kb.model.problem import Problem
from kb.terms import Atom

if TYPE_CHECKING:
    from kb.loader import Loaded


class InternalError(Exception):
    """The engine made a plan that its own checker refuses: a bug. Carries the checker's findings."""

    def __init__(self, diagnostics: list[Diagnostic]) -> None:
        super().__init__("the checker refuses the plan:\n" + "\n".join(map(str, diagnostics)))


def problem_of(target: str, goals: str = "", command: str = "") -> Problem:
    """The problem that a target names, with other goals if some are given, or with those of a command in words.

    Raises `InvalidInput`.
    """
    from kb.commands import understand
    from kb.loader import find, load, problem_files, with_goals

    loaded = load(find(target))
    if goals and command:
        raise InvalidInput(
            [Diagnostic(Source("--command"), "K401", "goals are given already", "give one of the two")]
        )
    if goals:
        return with_goals(loaded.domain, goals, loaded.problem)
    if command:
        return understand(loaded.problem or loaded.domain, command)
    if loaded.problem is None:
        problems = sorted(path.stem for path in problem_files(find(target)))
        ways = "give --goals or --command"
        hint = f"{ways}, or one of its problems: {', '.join(problems)}" if problems else ways
        raise InvalidInput([Diagnostic(Source(target), "K401", "this is a domain, not a problem", hint)])
    return loaded.problem


def pddl_task(domain: str, problem: Path) -> PddlProblem:
    """The task in a PDDL domain and a PDDL problem file. Raises `InvalidInput`."""
    return read_pddl(Path(domain), problem)


def plan(problem: Problem, limits: Limits = Limits()) -> Outcome:
    """A checked plan for a problem, the proof that there is none, or where the search stopped. Raises `InvalidInput`."""
    return planned(problem, limits)[0]


def planned(problem: Problem, limits: Limits = Limits(), macros: Macros = NO_MACROS) -> tuple[Outcome, Task]:
    """`plan` with MACROPs that serve searches as operators; the ground task, too. Raises `InvalidInput`."""
    started = time.perf_counter()
    task = ground(problem)
    grounded = time.perf_counter()
    outcome = plan_task(task, limits, macros)
    finished = time.perf_counter()
    if isinstance(outcome, Found):
        outcome = replace(outcome, plan=accepted(problem, outcome.plan))
    checked = time.perf_counter()
    counts = {
        "operators": len(task.operators),
        "atoms": len(task.atoms),
        "mutex groups": len(task.mutex_groups),
        **outcome.statistics.counts,
    }
    seconds = {"grounding": grounded - started, "search": finished - grounded, "check": checked - finished}
    statistics = Statistics(counts, seconds, outcome.statistics.offer)
    return replace(outcome, statistics=statistics), task


def accepted(problem: Problem, made: Plan) -> Plan:
    """The plan, if the checker accepts it; as a sequence, if all that it cannot show is that some steps need no order.

    Such steps may interfere, or reach the stages of a chain in another order than the plan means.
    """
    wrong = validate(problem, made)
    if wrong and all(each.code in ("K503", "K506") for each in wrong):
        made = in_sequence(made)
        wrong = validate(problem, made)
    if wrong:
        raise InternalError(wrong)
    return made


def check_plan(problem: Problem, made: Plan, name: str = "plan") -> list[Diagnostic]:
    """Everything that the independent checker has against a plan; empty if it is valid. Raises `InvalidInput`."""
    require_affordable_statics(problem)
    return validate(problem, made, name)


@dataclass(frozen=True, slots=True)
class CheckReport:
    """The files that were checked and everything found in them, in order of place."""

    checked: tuple[str, ...]
    diagnostics: tuple[Diagnostic, ...]


def check(target: str, reach: bool = True) -> CheckReport:
    """Everything that is wrong with a problem, or with a domain and all its problems, and with the cell beside it.

    With `reach`, places of the cell that no arm reaches are told, too.
    """
    from kb.check import check_domain, unreachable
    from kb.loader import CELL_FILE, find, problem_files
    from kb.loader.faults import FAULTS_FILE

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
    """What is wrong with a cell; geometry is imported for domains that have one."""
    from engine.geometry.checking import check_cell
    from engine.plugins import geometry_backend

    return check_cell(cell, domain, geometry_backend if reach else None, atoms)


def initial_facts(target: str) -> frozenset[Atom]:
    """What is true at the start of the problem that a target names; nothing for a domain. Raises `InvalidInput`."""
    from engine.validation.semantics import Semantics
    from kb.loader import find, load

    problem = load(find(target)).problem
    return frozenset() if problem is None else Semantics(problem).initial()


def _checked_faults(domain: Path) -> list[Diagnostic]:
    """What is wrong with the fault base beside a domain."""
    from kb.check.faults import check_faults
    from kb.loader.faults import load_faults

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
    from kb.loader import load

    try:
        loaded = load(path)
    except InvalidInput as error:
        found += error.diagnostics
        return None
    found += loaded.warnings
    return loaded
