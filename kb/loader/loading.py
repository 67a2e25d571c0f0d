"""Loads domains and problems from files, and raises all errors together as `InvalidInput`."""

from dataclasses import dataclass, replace
from pathlib import Path

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import File, read_file
from cellwright.kb.loader.domain_file import Rewrite, as_written, read_domain
from cellwright.kb.loader.domain_lookup import domain_file_of, domain_of, require_no_other
from cellwright.kb.loader.problem_file import goal_condition, read_problem
from cellwright.kb.loader.reader import LoadFindings, Reader, require_valid, validate_shape
from cellwright.kb.loader.symbol_table import SymbolTable
from cellwright.kb.loader.yaml_tree import YamlNode
from cellwright.kb.model.conditions import ALWAYS_TRUE
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.targets import find_target

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
    findings = LoadFindings()
    reader = Reader.of(read_file(path), findings)
    if isinstance(reader.root.value, dict):
        if "problem" in reader.root.value:
            return _load_problem(reader, findings, rewrite)
        require_no_other(path, reader.root.value)
    domain, _ = read_domain(path, findings, rewrite)
    require_valid(findings)
    return Loaded(domain, None, findings.warnings())


def _load_problem(reader: Reader, findings: LoadFindings, rewrite: Rewrite) -> Loaded:
    if not validate_shape(reader, "problem"):
        require_valid(findings)
    path = domain_file_of(reader)
    domain, names = read_domain(path, findings, rewrite)
    problem = read_problem(reader, domain, names, findings)
    require_valid(findings)
    return Loaded(domain, problem, findings.warnings())


def load_problem(target: str) -> Problem:
    """The problem that a target names. Raises `InvalidInput`."""
    loaded = load(find_target(target))
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
    return load(find_target(target)).domain


def with_goals(domain: Domain, goals: str, problem: Problem | None = None) -> Problem:
    """A problem of `domain` (or `problem` itself) with goals written as in a problem file.

    Raises `InvalidInput`.
    """
    findings = LoadFindings()
    node = YamlNode(goals, File.of("--goals", goals), 0, len(goals))
    base = problem or Problem("goals", domain)
    objects = {**domain.objects, **base.objects}
    names = SymbolTable(
        findings,
        dict(domain.types),
        dict(domain.functions),
        objects,
        dict(domain.predicates),
        quantities=dict(domain.quantities),
    )
    expression = Reader(node, findings, domain.time_unit).parse("conditions", node)
    require_valid(findings)
    goal = goal_condition(expression, names) if expression else ALWAYS_TRUE
    require_valid(findings)
    return replace(base, goal=goal, chains=())
