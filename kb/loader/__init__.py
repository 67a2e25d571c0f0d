"""Files become domains and problems. Everything wrong with them is collected and raised at once as `InvalidInput`."""

from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path

from kb.diagnostics import Diagnostic, InvalidInput, Source, nearest
from kb.loader.domain import read_domain
from kb.loader.names import Names
from kb.loader.problem import goal_condition, read_problem
from kb.loader.reader import Findings, Reader, require, validate_shape
from kb.loader.tree import File, Node, read_file
from kb.model.conditions import TRUE
from kb.model.domain import Domain
from kb.model.problem import Problem
from kb.schema import ProblemFile

DOMAIN_FILE = "domain.yaml"


@dataclass(frozen=True, slots=True)
class Loaded:
    """A domain, with one problem or none, and the warnings about them."""

    domain: Domain
    problem: Problem | None
    warnings: tuple[Diagnostic, ...] = ()


def bundled() -> dict[str, Path]:
    """The domains that come with the engine, by name."""
    root = Path(str(resources.files("domains")))
    return {path.parent.name: path.parent for path in sorted(root.glob(f"*/{DOMAIN_FILE}"))}


def find(target: str) -> Path:
    """The file that a target names: a path, a bundled domain, or `domain/problem` of one. Raises `InvalidInput`."""
    path = Path(target)
    if path.is_dir() and (path / DOMAIN_FILE).is_file():
        return path / DOMAIN_FILE
    if path.is_file():
        return path
    known = bundled()
    name, _, problem = target.partition("/")
    if name in known and not problem:
        return known[name] / DOMAIN_FILE
    candidates = (
        {f"{name}/{p.stem}": p for p in sorted(known[name].glob("problems/*.yaml"))} if name in known else {}
    )
    if target in candidates:
        return candidates[target]
    if path.is_dir():
        raise InvalidInput([Diagnostic(Source(target), "K401", f"no {DOMAIN_FILE} in this folder")])
    hint = nearest(target, [*known, *candidates]) or f"bundled: {', '.join(known)}"
    raise InvalidInput([Diagnostic(Source(target), "K401", "no such file, bundled domain or problem", hint)])


def problem_files(domain_file: Path) -> list[Path]:
    """The problems beside a domain file."""
    return sorted((domain_file.parent / "problems").glob("*.yaml"))


def load(path: Path) -> Loaded:
    """The domain or problem in a file. Raises `InvalidInput` with everything that is wrong."""
    findings = Findings()
    reader = Reader.of(read_file(path), findings)
    if isinstance(reader.root.value, dict) and "problem" in reader.root.value:
        return _load_problem(reader, findings)
    domain, _ = read_domain(path, findings)
    require(findings)
    return Loaded(domain, None, tuple(findings.diagnostics))


def _load_problem(reader: Reader, findings: Findings) -> Loaded:
    if not validate_shape(reader, ProblemFile):
        require(findings)
    domain_file = _domain_of(reader)
    domain, names = read_domain(domain_file, findings)
    problem = read_problem(reader, domain, names, findings)
    require(findings)
    return Loaded(domain, problem, tuple(findings.diagnostics))


def _domain_of(reader: Reader) -> Path:
    """A problem's domain: the one around it if the name fits, else a path, else a bundled one."""
    node = reader.root.descend(("domain",))
    name, here = str(node.value), Path(reader.root.file.path).parent
    for candidate in (here.parent / DOMAIN_FILE, here / DOMAIN_FILE):
        if candidate.is_file() and f"domain: {name}\n" in candidate.read_text("utf-8", "replace") + "\n":
            return candidate
    for candidate in (here / name / DOMAIN_FILE, here / name):
        if candidate.is_file():
            return candidate
    known = bundled()
    if name in known:
        return known[name] / DOMAIN_FILE
    hint = nearest(name, list(known)) or f"a path, or one of: {', '.join(known)}"
    raise InvalidInput(
        [*reader.findings.diagnostics, Diagnostic(node.where, "K401", f"unknown domain '{name}'", hint)]
    )


def load_problem(target: str) -> Problem:
    """The problem that a target names. Raises `InvalidInput`."""
    loaded = load(find(target))
    if loaded.problem is None:
        raise InvalidInput(
            [Diagnostic(Source(target), "K401", "a domain, not a problem", "give --goals, or a problem file")]
        )
    return loaded.problem


def load_domain(target: str) -> Domain:
    """The domain that a target names. Raises `InvalidInput`."""
    return load(find(target)).domain


def with_goals(domain: Domain, goals: str, problem: Problem | None = None) -> Problem:
    """A problem of `domain` (or `problem` itself) with goals written as in a problem file. Raises `InvalidInput`."""
    findings = Findings()
    node = Node(goals, File("--goals", goals, (0,)), 0, len(goals))
    base = problem or Problem("goals", domain)
    objects = {**domain.objects, **base.objects}
    names = Names(findings, dict(domain.types), dict(domain.functions), objects, dict(domain.predicates))
    expression = Reader(node, findings, domain.time_unit).parse("conditions", node)
    require(findings)
    goal = goal_condition(expression, names) if expression else TRUE
    require(findings)
    return replace(base, goal=goal, chains=())
