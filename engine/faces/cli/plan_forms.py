"""How a plan is shown: as text, as data, as a picture of its partial order, or in the format of PDDL planners."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import RenderableType

    from engine.formats.interop.pddl import PddlProblem
    from engine.model.windows import Unmet
    from engine.pipelines.moves.planning import Moving
    from engine.pipelines.objective import Run
    from kb.model.problem import Problem


class PlanForm(StrEnum):
    """How a plan is written: as a table, as data, as a picture of its partial order, or in the format of PDDL planners."""

    TEXT = "text"
    JSON = "json"
    DOT = "dot"
    SVG = "svg"
    IPC = "ipc"


@dataclass(frozen=True, slots=True)
class Made:
    """What planning made: the run for a problem.

    `origin` says where the plan comes from, `moving` holds the motions of its steps; `task` is the PDDL problem that was
    given. Each is empty where nobody asked for it.
    """

    run: "Run"
    problem: "Problem"
    origin: Mapping[str, Any] = field(default_factory=dict)
    moving: "Moving | None" = None
    task: "PddlProblem | None" = None


def document(made: Made, stats: bool) -> dict[str, Any]:
    """The outcome as data, with its statistics if they were asked for."""
    from engine.formats.report import json
    from engine.formats.report.gantt import proof_entry

    run = made.run
    content = {**json.outcome(run.outcome, made.problem, starts=run.starts), **made.origin}
    if run.itinerary:
        from engine.formats.report import itinerary

        content |= itinerary.entry(run)
    content |= _unmet(made).entry()
    if run.timetable:
        content["makespan"] = proof_entry(run.timetable.schedule, run.timetable.scope)
    if stats:
        content["statistics"] = json.statistics(run.outcome.statistics)
    if made.moving is None:
        return content
    from engine.formats.report import moves

    return {**content, **moves.entry(made.moving)}


def text(made: Made, stats: bool, folded: bool) -> "RenderableType":
    """The outcome as people read it; `folded`: the MACROPs in the plan stand for its steps."""
    from rich.console import Group
    from rich.text import Text

    from engine.faces.cli.origin import origin_text
    from engine.formats.report import text as report

    run = made.run
    parts = [report.outcome(run.outcome, made.problem, run.timetable), *origin_text(made.origin)]
    if folded and made.origin.get("source", {}).get("parts"):
        parts = parts[1:]
    if run.itinerary:
        from engine.formats.report import itinerary

        parts.append(itinerary.text(run, made.problem.domain.time_unit))
    parts += [Text(line) for line in _unmet(made).lines(made.problem.domain.time_unit)]
    if made.moving is not None:
        from engine.formats.report import moves

        parts += moves.text(made.moving)
    return Group(*parts, *([report.statistics(run.outcome.statistics)] if stats else []))


def _unmet(made: Made) -> "Unmet":
    """What the problem asks of the times of measurements, and the plan does not keep."""
    from engine.model.outcome import Found
    from engine.model.windows import Unmet
    from engine.pipelines.plan_files import unmet
    from kb.model.plan import Claims

    outcome, starts = made.run.outcome, made.run.starts
    if not isinstance(outcome, Found) or starts is None:
        return Unmet()
    return unmet(made.problem, outcome.plan, Claims(dict(starts)))


def raw(made: Made, form: PlanForm) -> str | None:
    """The plan as a file of its own: DOT, SVG or IPC. None without a plan, and for the other forms."""
    from engine.model.outcome import Found

    if form is PlanForm.IPC:
        return _ipc(made)
    outcome = made.run.outcome
    if not isinstance(outcome, Found):
        return None
    if form is PlanForm.DOT:
        from engine.formats.report import dot

        return dot.plan(outcome.plan, made.problem)
    if form is PlanForm.SVG:
        from engine.formats.report import svg

        return svg.plan(outcome.plan, made.problem)
    return None


def _ipc(made: Made) -> str | None:
    """The plan in the format of the planning competitions."""
    from engine.formats.interop.pddl.plans import write_plan
    from engine.model.outcome import Found
    from kb.diagnostics import Diagnostic, InvalidInput, Source

    if made.task is None:
        hint = "give --pddl"
        raise InvalidInput([Diagnostic(Source("--format"), "K409", "ipc is a format for PDDL tasks", hint)])
    outcome = made.run.outcome
    return write_plan(made.task, outcome.plan) if isinstance(outcome, Found) else None
