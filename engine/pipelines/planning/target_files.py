"""Reads what a target names before anything is planned: domain, problem, and initial state.

Nothing here needs a planner, so that commands which only look at a cell start quickly.
"""

import re
from pathlib import Path
from typing import TYPE_CHECKING

from cellwright.kb import commands, loader
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import File, read_file
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.targets import CONTACTS_FILE, find_target
from cellwright.kb.terms import Atom

if TYPE_CHECKING:
    from cellwright.kb.loader import Loaded

# its own, or those of devices
OPERATORS_KEY = re.compile(r"^['\"]?(operators|use)['\"]?\s*:", re.MULTILINE)


def generated_if_bare(domain: Path) -> File | None:
    """The generated domain for a domain file without operators that has a contact model beside
    it, else None.
    """
    if not domain.with_name(CONTACTS_FILE).is_file() or OPERATORS_KEY.search(
        read_file(domain).text
    ):
        return None
    from cellwright.engine.pipelines.contact_states import generate_domain  # slow to import

    return generate_domain(domain)


def load_target(path: Path) -> "Loaded":
    """What is in the file of a domain or problem; the domain may be one that is generated.

    Raises `InvalidInput`.
    """
    return loader.load(path, generated_if_bare)


def problem_of(target: str, goals: str = "", command: str = "") -> Problem:
    """The problem that a target names. `goals`, or else a `command` in words, replaces its goals.

    A domain without operators that has a contact model beside it gets those that are generated.
    Raises `InvalidInput`.
    """
    loaded_target = load_target(find_target(target))
    if goals and command:
        raise InvalidInput(
            [
                Diagnostic(
                    Source("--command"),
                    "K409",
                    "goals are given already",
                    "give --goals or --command, not both",
                )
            ]
        )
    if goals:
        return loader.with_goals(loaded_target.domain, goals, loaded_target.problem)
    if command:
        return commands.understand_command(loaded_target.problem or loaded_target.domain, command)
    if loaded_target.problem is None:
        problems = sorted(path.stem for path in loader.problem_files(find_target(target)))
        ways = "give --goals or --command"
        hint = f"{ways}, or one of its problems: {', '.join(problems)}" if problems else ways
        raise InvalidInput(
            [Diagnostic(Source(target), "K404", "this is a domain, not a problem", hint)]
        )
    return loaded_target.problem


def initial_facts(target: str) -> frozenset[Atom]:
    """The initial state of the problem that a target names; empty for a domain, which is not read.

    Raises `InvalidInput`.
    """
    path = find_target(target)
    if loader.domain_of(target) == path:
        return frozenset()
    from cellwright.engine.stages.validation.operator_semantics import Semantics

    problem = load_target(path).problem
    return frozenset() if problem is None else Semantics(problem).initial()
