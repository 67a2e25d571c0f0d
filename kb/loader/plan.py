"""Plan files: the answer of `cellwright plan --format json` becomes a problem and a plan again."""

from pathlib import Path

from kb.asp import AspError, ground_term
from kb.diagnostics import Diagnostic, InvalidInput, Source
from kb.loader.domain import read_domain
from kb.loader.problem import read_problem
from kb.loader.reader import Findings, Reader, require, validate_shape
from kb.loader.references import domain_file
from kb.loader.tree import Node, read_file
from kb.model.plan import CausalLink, Plan, Step, StepId
from kb.model.problem import Problem
from kb.terms import Function


def load_plan(path: Path) -> tuple[Problem, Plan]:
    """The problem and the plan in a plan file. Raises `InvalidInput` with everything that is wrong with its form."""
    findings = Findings()
    reader = Reader.of(read_file(path), findings)
    _require_plan(reader)
    if not validate_shape(reader, "plan"):
        require(findings)
    entry = reader.root.descend(("data", "plan"))
    inner = Reader(entry.descend(("problem",)), findings)
    domain, names = read_domain(domain_file(inner), findings)
    problem = read_problem(inner, domain, names, findings)
    plan_reader = Reader(entry, findings, domain.time_unit)
    plan = Plan(tuple(_steps(plan_reader)), tuple(_links(plan_reader)))
    require(findings)
    return problem, plan


def _require_plan(reader: Reader) -> None:
    """An answer without a plan, or another file altogether, is told apart from a plan with mistakes."""
    node = reader.root.descend(("data", "plan"))
    if isinstance(node.value, dict) and "steps" in node.value:
        return
    hint = "write one with `cellwright plan TARGET --format json`"
    raise InvalidInput(
        [Diagnostic(Source(reader.root.file.path), "K402", "there is no plan in this file", hint)]
    )


def _steps(reader: Reader) -> list[Step]:
    return [
        Step(
            StepId(int(node.descend(("id",)).value)),
            _term(reader, node.descend(("operator",))),
            tuple(StepId(int(each.value)) for each in _listed(node, "after")),
            tuple(_term(reader, each) for each in _listed(node, "resources")),
            _number(node, "duration", 0),
            _number(node, "cost", 1),
        )
        for node in reader.items("steps")
    ]


def _links(reader: Reader) -> list[CausalLink]:
    return [
        CausalLink(
            StepId(int(node.descend(("producer",)).value)),
            _term(reader, node.descend(("condition",))),
            StepId(int(node.descend(("consumer",)).value)),
        )
        for node in reader.items("links")
    ]


def _listed(node: Node, key: str) -> list[Node]:
    return node.value[key][1].value if key in node.value else []


def _number(node: Node, key: str, default: int) -> int:
    return int(node.value[key][1].value) if key in node.value else default


_TERM_HINT = "write it as in ASP, such as move(arm, table)"


def _term(reader: Reader, node: Node) -> Function:
    """A ground term, read by clingo: plans hold thousands of them."""
    try:
        found = ground_term(node.value)
    except AspError as error:
        reader.findings.add(node.where, "K402", f"'{node.value}' is no ground term: {error}", _TERM_HINT)
        return Function("unreadable")
    if not isinstance(found, Function):
        reader.findings.add(
            node.where, "K402", f"'{node.value}' is neither an atom nor an object", _TERM_HINT
        )
        return Function("unreadable")
    return found
