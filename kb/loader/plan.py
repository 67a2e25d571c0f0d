"""The problem and the plan in a plan file, which is an answer of `cellwright plan --format json`."""

import json
import re
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
    """The problem and the plan in a plan file. Raises `InvalidInput` with all errors in its form."""
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
    """Report an answer without a plan, or another kind of file, with one message. Raises `InvalidInput`."""
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
            StepId(_whole(reader, node.descend(("id",)))),
            _term(reader, node.descend(("operator",))),
            tuple(StepId(_whole(reader, each)) for each in _listed(node, "after")),
            tuple(_term(reader, each) for each in _listed(node, "resources")),
            _number(reader, node, "duration", 0),
            _number(reader, node, "cost", 1),
        )
        for node in reader.items("steps")
    ]


def _links(reader: Reader) -> list[CausalLink]:
    return [
        CausalLink(
            StepId(_whole(reader, node.descend(("producer",)))),
            _term(reader, node.descend(("condition",))),
            StepId(_whole(reader, node.descend(("consumer",)))),
        )
        for node in reader.items("links")
    ]


def _listed(node: Node, key: str) -> list[Node]:
    return node.value[key][1].value if key in node.value else []


def _number(reader: Reader, node: Node, key: str, default: int) -> int:
    return _whole(reader, node.value[key][1]) if key in node.value else default


def _whole(reader: Reader, node: Node) -> int:
    """A whole number in digits. Python also accepts `1.0` and `1_0`; they are refused here."""
    if re.fullmatch(r"-?[0-9]{1,10}", str(node.value)):
        return int(node.value)
    reader.findings.add(
        node.where, "K402", f"'{str(node.value)[:40]}' is not a whole number", "write it in digits"
    )
    return 0


_TERM_HINT = "write it as in ASP, such as move(arm, table)"


def _term(reader: Reader, node: Node) -> Function:
    """A ground term. Clingo reads it, because that is fast and plans hold thousands of terms."""
    try:
        found = ground_term(node.value)
    except AspError as error:
        reader.findings.add(node.where, "K402", f"'{node.value}' is not a ground term: {error}", _TERM_HINT)
        return Function("unreadable")
    if not isinstance(found, Function):
        reader.findings.add(
            node.where, "K402", f"'{node.value}' is neither an atom nor an object", _TERM_HINT
        )
        return Function("unreadable")
    return found


def is_plan(path: Path) -> bool:
    """Whether a file is an answer of the planner."""
    if not path.is_file() or path.suffix != ".json":
        return False
    try:
        content = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(content, dict) and "data" in content
