"""How a plan is written where it is no table: as a picture of its partial order, or in the format of PDDL planners."""

from enum import StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cellwright.engine.formats.interop.pddl import PddlProblem
    from cellwright.engine.formats.report.planned import Made


class PlanForm(StrEnum):
    """How a plan is written: as a table, as data, as a picture of its partial order, or in the format of PDDL planners."""

    TEXT = "text"
    JSON = "json"
    DOT = "dot"
    SVG = "svg"
    IPC = "ipc"


def raw(made: "Made", form: PlanForm, task: "PddlProblem | None") -> str | None:
    """The plan as a file of its own: DOT, SVG, or IPC for a PDDL `task`. None without a plan, and for the other forms."""
    from cellwright.engine.model.outcome import Found

    if form is PlanForm.IPC:
        return _ipc(made, task)
    outcome = made.run.outcome
    if not isinstance(outcome, Found):
        return None
    if form is PlanForm.DOT:
        from cellwright.engine.formats.report import dot

        return dot.plan(outcome.plan, made.problem)
    if form is PlanForm.SVG:
        from cellwright.engine.formats.report import svg

        return svg.plan(outcome.plan, made.problem)
    return None


def _ipc(made: "Made", task: "PddlProblem | None") -> str | None:
    """The plan in the format of the planning competitions."""
    from cellwright.engine.formats.interop.pddl.plans import write_plan
    from cellwright.engine.model.outcome import Found
    from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source

    if task is None:
        hint = "give --pddl"
        raise InvalidInput([Diagnostic(Source("--format"), "K409", "ipc is a format for PDDL tasks", hint)])
    outcome = made.run.outcome
    return write_plan(task, outcome.plan) if isinstance(outcome, Found) else None
