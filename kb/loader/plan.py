"""Reads plan files: the problem and the plan in an answer of `cellwright plan --format json`."""

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from cellwright.kb.asp import AspError, ground_term
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import read_file
from cellwright.kb.loader.domain_file import Rewrite, as_written, read_domain
from cellwright.kb.loader.domain_lookup import domain_file_of
from cellwright.kb.loader.problem_amounts import amounts_of
from cellwright.kb.loader.problem_file import read_problem
from cellwright.kb.loader.reader import LoadFindings, Reader, require_valid, validate_shape
from cellwright.kb.loader.yaml_tree import YamlNode
from cellwright.kb.model.operator_amounts import Amounts, step_of
from cellwright.kb.model.plan_model import CausalLink, Claims, Happened, Plan, Step, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function

MAX_PLAN_BYTES = 256 * 2**20  # of a plan of half a million steps
MAX_VALUES = 25_000_000

TIMED_KEYS = {"steps", "makespan", "bound"}  # of a plan of a PDDL task with times


def load_plan(path: Path, rewrite: Rewrite = as_written) -> tuple[Problem, Plan]:
    """The problem and the plan in a plan file.

    Raises `InvalidInput` with all errors in its form.
    """
    return load_claimed(path, rewrite)[:2]


def load_claimed(path: Path, rewrite: Rewrite = as_written) -> tuple[Problem, Plan, Claims]:
    """The problem and the plan in a plan file, and what else it claims. `rewrite` may give another
    text for its domain.

    Raises `InvalidInput` with all errors in its form.
    """
    findings = LoadFindings()
    reader = Reader.of(read_file(path, most=MAX_PLAN_BYTES), findings, MAX_VALUES)
    _require_plan(reader)
    if not validate_shape(reader, "plan"):
        require_valid(findings)
    entry = reader.root.descend(("data", "plan"))
    inner = Reader(entry.descend(("problem",)), findings)
    domain, names = read_domain(domain_file_of(inner), findings, rewrite)
    problem = read_problem(inner, domain, names, findings)
    plan_reader = Reader(entry, findings, domain.time_unit)
    plan = Plan(
        tuple(_read_steps(plan_reader, amounts_of(problem))), tuple(_read_links(plan_reader))
    )
    claims = _read_claims(plan_reader, reader.root.descend(("data", "makespan")))
    require_valid(findings)
    return problem, plan, claims


def _require_plan(reader: Reader) -> None:
    """Report an answer without a plan, or another kind of file, with one message.

    Raises `InvalidInput`.
    """
    where = Source(reader.root.file.path)
    data = reader.root.descend(("data",)).value
    if isinstance(data, dict) and "plan" not in data and set(data) >= TIMED_KEYS:
        said = "this is a plan of a PDDL task with times, not of a domain"
        hint = (
            "`cellwright validate --pddl DOMAIN PROBLEM PLAN` checks it; it is not scheduled or run"
        )
        raise InvalidInput([Diagnostic(where, "K402", said, hint)])
    node = reader.root.descend(("data", "plan"))
    if isinstance(node.value, dict) and "steps" in node.value:
        return
    hint = "write one with `cellwright plan TARGET --format json`"
    raise InvalidInput([Diagnostic(where, "K402", "there is no plan in this file", hint)])


def _read_steps(reader: Reader, amounts: Amounts) -> list[Step]:
    """The steps; what an entry leaves out is as the domain says."""
    return [_read_step(reader, node, amounts) for node in reader.items("steps")]


def _read_step(reader: Reader, node: YamlNode, amounts: Amounts) -> Step:
    after = tuple(StepId(_whole_number(reader, item)) for item in _list_items(node, "after"))
    number = StepId(_whole_number(reader, node.descend(("id",))))
    operator = _ground_term_at(reader, node.descend(("operator",)))
    said = {"resources", "duration", "cost"} <= {*node.value}
    plain = Step(number, operator, after) if said else step_of(amounts, number, operator, after)
    held = tuple(_ground_term_at(reader, item) for item in _list_items(node, "resources"))
    return replace(
        plain,
        resources=held if "resources" in node.value else plain.resources,
        duration=_number_at(reader, node, "duration", plain.duration),
        cost=_number_at(reader, node, "cost", plain.cost),
    )


def _read_claims(reader: Reader, answered: YamlNode) -> Claims:
    """The starts of steps, the sums and the histories that a file has, and what is `answered`
    about its makespan.
    """
    starts = {
        StepId(_whole_number(reader, node.descend(("id",)))): _whole_number(
            reader, node.value["start"][1]
        )
        for node in reader.items("steps")
        if "start" in node.value
    }
    cost, makespan = (
        _whole_number(reader, reader.root.value[name][1]) if name in reader.root.value else None
        for name in ("cost", "makespan")
    )
    said = answered.value if isinstance(answered.value, dict) else {}
    told, bound = (
        _whole_number(reader, said[name][1]) if name in said else None
        for name in ("makespan", "lower_bound")
    )
    return Claims(starts, cost, makespan, tuple(_read_history(reader)), told, bound)


def _read_history(reader: Reader) -> Iterator[Happened]:
    """The lines of the histories that have the form in which they are written."""
    for history in reader.items("histories"):
        chain, stages = history.value.get("chain"), history.value.get("stages")
        for node in stages[1].value if chain and stages else ():
            said = {key: value.value for key, (_, value) in node.value.items()}
            yield Happened(
                str(chain[1].value),
                str(said.get("stage", "")),
                StepId(_integer_of(said.get("step"))),
                _integer_of(said.get("start")),
                _integer_of(said.get("duration")),
            )


def _integer_of(said: object) -> int:
    """A number that only a computed key holds; -1 if it is none."""
    return int(str(said)) if re.fullmatch(r"[0-9]{1,10}", str(said)) else -1


def _read_links(reader: Reader) -> list[CausalLink]:
    return [
        CausalLink(
            StepId(_whole_number(reader, node.descend(("producer",)))),
            _ground_term_at(reader, node.descend(("condition",))),
            StepId(_whole_number(reader, node.descend(("consumer",)))),
        )
        for node in reader.items("links")
    ]


def _list_items(node: YamlNode, key: str) -> list[YamlNode]:
    return node.value[key][1].value if key in node.value else []


def _number_at(reader: Reader, node: YamlNode, key: str, default: int) -> int:
    return _whole_number(reader, node.value[key][1]) if key in node.value else default


def _whole_number(reader: Reader, node: YamlNode) -> int:
    """A whole number in digits. Python also accepts `1.0` and `1_0`; they are refused here."""
    if re.fullmatch(r"-?[0-9]{1,10}", str(node.value)):
        return int(node.value)
    reader.findings.add(
        node.where, "K402", f"'{str(node.value)[:40]}' is not a whole number", "write it in digits"
    )
    return 0


_TERM_HINT = "write it as in ASP, such as move(arm, table)"


def _ground_term_at(reader: Reader, node: YamlNode) -> Function:
    """A ground term. Clingo reads it, because that is fast and plans hold thousands of terms."""
    try:
        term = ground_term(node.value)
    except AspError as error:
        reader.findings.add(
            node.where, "K402", f"'{node.value}' is not a ground term: {error}", _TERM_HINT
        )
        return Function("unreadable")
    if not isinstance(term, Function):
        reader.findings.add(
            node.where, "K402", f"'{node.value}' is neither an atom nor an object", _TERM_HINT
        )
        return Function("unreadable")
    return term


def is_plan(path: Path) -> bool:
    """Whether a file is an answer of the planner."""
    if not path.is_file() or path.suffix != ".json":
        return False
    try:
        content = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(content, dict) and "data" in content
