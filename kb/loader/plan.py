"""The problem and the plan in a plan file, which is an answer of `cellwright plan --format json`."""

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from cellwright.kb.asp import AspError, ground_term
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.loader.amounts import amounts_of
from cellwright.kb.loader.domain import Rewrite, as_written, read_domain
from cellwright.kb.loader.problem import read_problem
from cellwright.kb.loader.reader import Findings, Reader, require, validate_shape
from cellwright.kb.loader.references import domain_file
from cellwright.kb.loader.tree import Node, read_file
from cellwright.kb.model.amounts import Amounts
from cellwright.kb.model.plan import CausalLink, Claims, Happened, Plan, Step, StepId
from cellwright.kb.model.problem import Problem
from cellwright.kb.model.traits import step_of
from cellwright.kb.terms import Function

MAX_BYTES = 256 * 2**20  # of a plan of half a million steps
MAX_VALUES = 25_000_000


def load_plan(path: Path, rewrite: Rewrite = as_written) -> tuple[Problem, Plan]:
    """The problem and the plan in a plan file. Raises `InvalidInput` with all errors in its form."""
    return load_claimed(path, rewrite)[:2]


def load_claimed(path: Path, rewrite: Rewrite = as_written) -> tuple[Problem, Plan, Claims]:
    """The problem and the plan in a plan file, and what else it claims. `rewrite` may give another text for its domain.

    Raises `InvalidInput` with all errors in its form.
    """
    findings = Findings()
    reader = Reader.of(read_file(path, most=MAX_BYTES), findings, MAX_VALUES)
    _require_plan(reader)
    if not validate_shape(reader, "plan"):
        require(findings)
    entry = reader.root.descend(("data", "plan"))
    inner = Reader(entry.descend(("problem",)), findings)
    domain, names = read_domain(domain_file(inner), findings, rewrite)
    problem = read_problem(inner, domain, names, findings)
    plan_reader = Reader(entry, findings, domain.time_unit)
    plan = Plan(tuple(_steps(plan_reader, amounts_of(problem))), tuple(_links(plan_reader)))
    claims = _claims(plan_reader, reader.root.descend(("data", "makespan")))
    require(findings)
    return problem, plan, claims


def _require_plan(reader: Reader) -> None:
    """Report an answer without a plan, or another kind of file, with one message. Raises `InvalidInput`."""
    node = reader.root.descend(("data", "plan"))
    if isinstance(node.value, dict) and "steps" in node.value:
        return
    hint = "write one with `cellwright plan TARGET --format json`"
    raise InvalidInput(
        [Diagnostic(Source(reader.root.file.path), "K402", "there is no plan in this file", hint)]
    )


def _steps(reader: Reader, amounts: Amounts) -> list[Step]:
    """The steps; what an entry leaves out is as the domain says."""
    return [_step(reader, node, amounts) for node in reader.items("steps")]


def _step(reader: Reader, node: Node, amounts: Amounts) -> Step:
    after = tuple(StepId(_whole(reader, each)) for each in _listed(node, "after"))
    number = StepId(_whole(reader, node.descend(("id",))))
    operator = _term(reader, node.descend(("operator",)))
    said = {"resources", "duration", "cost"} <= {*node.value}
    plain = Step(number, operator, after) if said else step_of(amounts, number, operator, after)
    held = tuple(_term(reader, each) for each in _listed(node, "resources"))
    return replace(
        plain,
        resources=held if "resources" in node.value else plain.resources,
        duration=_number(reader, node, "duration", plain.duration),
        cost=_number(reader, node, "cost", plain.cost),
    )


def _claims(reader: Reader, answered: Node) -> Claims:
    """The starts of steps, the sums and the histories that a file has, and what is `answered` about its makespan."""
    starts = {
        StepId(_whole(reader, node.descend(("id",)))): _whole(reader, node.value["start"][1])
        for node in reader.items("steps")
        if "start" in node.value
    }
    cost, makespan = (
        _whole(reader, reader.root.value[name][1]) if name in reader.root.value else None
        for name in ("cost", "makespan")
    )
    said = answered.value if isinstance(answered.value, dict) else {}
    told, bound = (
        _whole(reader, said[name][1]) if name in said else None for name in ("makespan", "lower_bound")
    )
    return Claims(starts, cost, makespan, tuple(_happened(reader)), told, bound)


def _happened(reader: Reader) -> Iterator[Happened]:
    """The lines of the histories that have the form in which they are written."""
    for history in reader.items("histories"):
        chain, stages = history.value.get("chain"), history.value.get("stages")
        for node in stages[1].value if chain and stages else ():
            said = {key: value.value for key, (_, value) in node.value.items()}
            yield Happened(
                str(chain[1].value),
                str(said.get("stage", "")),
                StepId(_integer(said.get("step"))),
                _integer(said.get("start")),
                _integer(said.get("duration")),
            )


def _integer(said: object) -> int:
    """A number that only a computed key holds; -1 if it is none."""
    return int(str(said)) if re.fullmatch(r"[0-9]{1,10}", str(said)) else -1


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
