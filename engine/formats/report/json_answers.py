"""JSON answers: one envelope `{version, status, data, diagnostics}` for every command.

That function writes indented text piece by piece in Python, and a plan of thousands of steps has
hundreds of thousands of pieces.
"""

import json
from collections.abc import Iterable, Mapping
from decimal import Decimal
from json.encoder import encode_basestring
from typing import Any

from cellwright.engine.model.outcome import Found, GaveUp, Infeasible, Outcome, Statistics
from cellwright.engine.model.plan_times import earliest_starts, object_histories, plan_makespan
from cellwright.engine.model.task_costs import cost_number
from cellwright.kb.diagnostics import Diagnostic
from cellwright.kb.model.conditions import And
from cellwright.kb.model.plan_model import Plan, StepId
from cellwright.kb.model.planning_problem import Chain, Problem


def json_text(value: Any, blank: str = "\n") -> str:
    """The text of a value; `blank` is a new line with the indent of the value."""
    if type(value) is str:
        return encode_basestring(value)
    if type(value) is int:
        return str(value)
    if isinstance(value, Decimal):
        return f"{value:f}"
    inner = blank + " "
    if isinstance(value, dict) and value and all(type(key) is str for key in value):
        pairs = [
            f"{encode_basestring(key)}: {json_text(member, inner)}" for key, member in value.items()
        ]
        return f"{{{inner}{f',{inner}'.join(pairs)}{blank}}}"
    if isinstance(value, list | tuple) and value:
        return f"[{inner}{f',{inner}'.join([json_text(member, inner) for member in value])}{blank}]"
    return json.dumps(value, indent=1, ensure_ascii=False).replace("\n", blank)


ENVELOPE_VERSION = 1
Starts = Mapping[StepId, int] | None


def json_envelope(
    status: str, content: Mapping[str, Any], diagnostics: Iterable[Diagnostic] = ()
) -> str:
    """The answer of a command as JSON text. The same answer gives the same bytes."""

    whole = {
        "version": ENVELOPE_VERSION,
        "status": status,
        "data": content,
        "diagnostics": [diagnostic_entry(diagnostic) for diagnostic in diagnostics],
    }
    return json_text(whole)


def diagnostic_entry(diagnostic: Diagnostic) -> dict[str, Any]:
    """One diagnostic. Line and column count from 1; 0 means that there is none. `used` is where
    a device is used.
    """
    where = diagnostic.where
    used = {} if where.used is None else {"used": str(where.used)}
    return {
        "code": diagnostic.code,
        "severity": "warning" if diagnostic.warning else "error",
        "file": where.path,
        "line": where.line,
        "column": where.column,
        "message": diagnostic.message,
        "try": diagnostic.hint,
        **used,
    }


def outcome_status(outcome: Outcome) -> str:
    """The status word for an outcome."""
    match outcome:
        case Found(optimal=optimal):
            return "optimal" if optimal else "found"
        case Infeasible():
            return "infeasible"
        case GaveUp(limit="expansions"):
            return "gave up"
        case GaveUp():
            return "stopped"


def outcome_entry(
    result: Outcome, problem: Problem, domain: str = "", starts: Starts = None
) -> dict[str, Any]:
    """The data of an outcome: the plan, or why there is none. `domain` is the name of the domain in
    the file.

    `starts` says when each step starts; None: as early as it can.
    """
    from cellwright.kb.targets import domain_reference

    entry = problem_entry(problem, domain or domain_reference(problem.domain))
    match result:
        case Found(plan):
            return {
                "plan": {
                    "problem": entry,
                    **plan_data(plan, problem, starts),
                    **history_entry(plan, problem, starts),
                }
            }
        case Infeasible(reason):
            return {"problem": entry, "reason": reason}
        case GaveUp(reason, limit):
            return {"problem": entry, "reason": reason, "limit": limit}


def statistics_entry(figures: Statistics) -> dict[str, Any]:
    """Counts, and times in seconds."""
    return {
        "counts": dict(figures.counts),
        "seconds": {name: round(s, 4) for name, s in figures.seconds.items()},
    }


def plan_data(plan: Plan, problem: Problem, starts: Starts = None) -> dict[str, Any]:
    """A plan as `cellwright validate` reads it, without its problem."""
    starts = earliest_starts(plan) if starts is None else starts
    return {
        "cost": cost_number(plan.cost, problem.domain),
        "makespan": plan_makespan(plan, starts),
        "steps": [
            {
                "id": step.id,
                "operator": str(step.operator),
                "after": list(step.after),
                "resources": [str(resource) for resource in step.resources],
                "start": starts[step.id],
                "duration": step.duration,
                "cost": cost_number(step.cost, problem.domain),
            }
            for step in plan.steps
        ],
        "links": [
            {"producer": link.producer, "condition": str(link.condition), "consumer": link.consumer}
            for link in plan.links
        ],
    }


def history_entry(plan: Plan, problem: Problem, starts: Starts = None) -> dict[str, Any]:
    """The history of each object of a workflow, in order; empty without a workflow."""
    history_entries = [
        {
            "subject": str(history.subject or history.chain),
            "chain": history.chain,
            "names": dict(history.names),
            "stages": [
                {
                    "stage": str(happening.stage),
                    "step": happening.step,
                    "start": happening.start,
                    "duration": happening.duration,
                }
                for happening in history.happenings
            ],
        }
        for history in object_histories(problem, plan, starts)
    ]
    return {"histories": history_entries} if history_entries else {}


def problem_entry(problem: Problem, domain: str) -> dict[str, Any]:
    """A problem in the form of a problem file, with the whole workflow and all goals."""
    objects: dict[str, list[str]] = {}
    for name, type_ in problem.objects.items():
        objects.setdefault(type_, []).append(name)
    entry: dict[str, Any] = {
        "problem": problem.name,
        "domain": domain,
        "objects": objects,
        "statics": list(map(str, problem.statics)),
        "durations": {str(step): lasts for step, lasts in problem.durations.items()},
        "initial": list(map(str, problem.initial)),
        "complete": problem.complete,
        "goals": list(
            map(str, problem.goal.parts if isinstance(problem.goal, And) else (problem.goal,))
        ),
        "workflow": [chain_entry(chain) for chain in problem.chains],
        "windows": [window.entry() for window in problem.windows],
        "calendars": [calendar.entry() for calendar in problem.calendars],
    }
    return {key: value for key, value in entry.items() if value}


def chain_entry(chain: Chain) -> dict[str, Any]:
    """One chain of a workflow."""
    entry = {
        "name": chain.name,
        "subject": str(chain.subject) if chain.subject else None,
        "stages": ", ".join(map(str, chain.stages)),
        "after": list(chain.after),
    }
    return {key: value for key, value in entry.items() if value}
