"""Domains and problems from files. All errors are collected and raised together as `InvalidInput`."""

from dataclasses import dataclass, replace
from pathlib import Path

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import File, read_file
from cellwright.kb.loader.domain import Rewrite, as_written, read_domain
from cellwright.kb.loader.names import Names
from cellwright.kb.loader.problem import goal_condition, read_problem
from cellwright.kb.loader.reader import Findings, Reader, require, validate_shape
from cellwright.kb.loader.references import domain_file, domain_of, require_no_other
from cellwright.kb.loader.tree import Node
from cellwright.kb.model.conditions import TRUE
from cellwright.kb.model.domain import Domain
from cellwright.kb.model.problem import Problem
from cellwright.kb.targets import find

__all__ = ["Loaded", "domain_of", "load", "load_domain", "load_problem", "with_goals"]


@dataclass(frozen=True, slots=True)
class Loaded:
    """A domain, with one problem or none, and the warnings about them."""

    domain: Domain
    problem: Problem | None
    warnings: tuple[Diagnostic, ...] = ()


def load(path: Path, rewrite: Rewrite = as_written) -> Loaded:
    """The domain or problem in a file. `rewrite` may give another text for the file of the domain.

    Raises `InvalidInput` with all errors.
    """
    findings = Findings()
    reader = Reader.of(read_file(path), findings)
    if isinstance(reader.root.value, dict):
        if "problem" in reader.root.value:
            return _load_problem(reader, findings, rewrite)
        require_no_other(path, reader.root.value)
    domain, _ = read_domain(path, findings, rewrite)
    require(findings)
    return Loaded(domain, None, findings.warnings())


def _load_problem(reader: Reader, findings: Findings, rewrite: Rewrite) -> Loaded:
    if not validate_shape(reader, "problem"):
        require(findings)
    path = domain_file(reader)
    domain, names = read_domain(path, findings, rewrite)
    problem = read_problem(reader, domain, names, findings)
    require(findings)
    return Loaded(domain, problem, findings.warnings())


def load_problem(target: str) -> Problem:
    """The problem that a target names. Raises `InvalidInput`."""
    loaded = load(find(target))
    if loaded.problem is None:
        raise InvalidInput(
            [
                Diagnostic(
                    Source(target),
                    "K404",
                    "this is a domain, not a problem",
                    "give --goals, or a problem file",
                )
            ]
        )
    return loaded.problem


def load_domain(target: str) -> Domain:
    """The domain that a target names. Raises `InvalidInput`."""
    return load(find(target)).domain


def with_goals(domain: Domain, goals: str, problem: Problem | None = None) -> Problem:
    """A problem of `domain` (or `problem` itself) with goals written as in a problem file. Raises `InvalidInput`."""
    findings = Findings()
    node = Node(goals, File.of("--goals", goals), 0, len(goals))
    base = problem or Problem("goals", domain)
    objects = {**domain.objects, **base.objects}
    names = Names(
        findings,
        dict(domain.types),
        dict(domain.functions),
        objects,
        dict(domain.predicates),
        quantities=dict(domain.quantities),
    )
    expression = Reader(node, findings, domain.time_unit).parse("conditions", node)
    require(findings)
    goal = goal_condition(expression, names) if expression else TRUE
    require(findings)
    return replace(base, goal=goal, chains=())
