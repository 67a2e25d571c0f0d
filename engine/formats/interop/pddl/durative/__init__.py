"""PDDL with times in: a domain with durative actions and a problem with timed literals (PDDL 2.1
level 3, PDDL 2.2).

The reader accepts what the reader without times accepts, but derived predicates that depend on
themselves. It refuses continuous effects, preferences and constraints by name, with their place.
"""

from dataclasses import dataclass
from pathlib import Path

from cellwright.engine.formats.interop.pddl.declared_names import NameMapping
from cellwright.engine.formats.interop.pddl.durative.actions import ActionReader
from cellwright.engine.formats.interop.pddl.durative.initial import ProblemReader, is_timed_fact
from cellwright.engine.formats.interop.pddl.expressions import Document, Group, read_document
from cellwright.engine.formats.interop.pddl.task_files import DOMAIN, PROBLEM
from cellwright.kb.diagnostics import Diagnostic, InvalidInput
from cellwright.kb.model.durative import TemporalProblem


@dataclass(frozen=True, slots=True)
class TemporalTask:
    """A problem in time, and the PDDL name for each of its names; `warnings` say what is not
    followed.
    """

    problem: TemporalProblem
    names: NameMapping
    warnings: tuple[Diagnostic, ...] = ()


def has_times(domain_path: Path, problem_path: Path) -> bool:
    """Whether a task has durative actions or timed literals.

    Raises `InvalidInput` for what is no PDDL.
    """
    domain = read_document(domain_path, DOMAIN)
    problem = read_document(problem_path, PROBLEM)
    if any(group.head == ":durative-action" for group in _groups(domain)):
        return True
    return any(
        is_timed_fact(part)
        for group in _groups(problem)
        if group.head == ":init"
        for part in group.rest
    )


def read_temporal(domain_path: Path, problem_path: Path) -> TemporalTask:
    """The problem in two files. Raises `InvalidInput` with all errors in them."""
    reader = ActionReader(read_document(domain_path, DOMAIN))
    reader.declare()
    document = read_document(problem_path, PROBLEM)
    problems = ProblemReader(document, reader)
    problem = problems.read()
    if reader.document.found or document.found:
        raise InvalidInput([*reader.document.found, *document.found])
    return TemporalTask(problem, reader.scope.names, tuple(problems.warnings))


def _groups(document: Document) -> list[Group]:
    return [part for part in document.root.rest if isinstance(part, Group)]


__all__ = ["TemporalTask", "has_times", "read_temporal"]
