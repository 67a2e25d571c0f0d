"""What planning made, whole: the outcome with its times, measurements, motions and where it comes from."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import RenderableType

    from cellwright.engine.model.windows import Unmet
    from cellwright.engine.pipelines.moves.planning import Moving
    from cellwright.engine.pipelines.objective import Run
    from cellwright.kb.diagnostics import Diagnostic
    from cellwright.kb.model.problem import Problem


@dataclass(frozen=True, slots=True)
class Made:
    """What planning made: the run for a problem.

    `origin` says where the plan comes from, `moving` holds the motions of its steps. Each is empty where nobody asked for it.
    """

    run: "Run"
    problem: "Problem"
    origin: Mapping[str, Any] = field(default_factory=dict)
    moving: "Moving | None" = None


def document(made: Made, stats: bool) -> dict[str, Any]:
    """The outcome as data, with its statistics if they were asked for."""
    from cellwright.engine.formats.report import json
    from cellwright.engine.formats.report.gantt import proof_entry

    run = made.run
    content = {**json.outcome(run.outcome, made.problem, starts=run.starts), **made.origin}
    if run.itinerary:
        from cellwright.engine.formats.report import itinerary

        content |= itinerary.entry(run)
    content |= _unmet(made).entry()
    if run.timetable:
        content["makespan"] = proof_entry(run.timetable.schedule, run.timetable.scope)
    if stats:
        content["statistics"] = json.statistics(run.outcome.statistics)
    if made.moving is None:
        return content
    from cellwright.engine.formats.report import moves

    return {**content, **moves.entry(made.moving)}


def text(made: Made, stats: bool, folded: bool) -> "RenderableType":
    """The outcome as people read it; `folded`: the MACROPs in the plan stand for its steps."""
    from rich.console import Group
    from rich.text import Text

    from cellwright.engine.formats.report import text as report

    run = made.run
    by_geometry = made.moving is not None and bool(made.moving.given_up or made.moving.refused)
    shown = report.outcome(run.outcome, made.problem, run.timetable, by_geometry)
    parts = [shown, *origin_text(made.origin)]
    if folded and made.origin.get("source", {}).get("parts"):
        parts = parts[1:]
    if run.itinerary:
        from cellwright.engine.formats.report import itinerary

        parts.append(itinerary.text(run, made.problem.domain.time_unit))
    parts += [Text(line) for line in _unmet(made).lines(made.problem.domain.time_unit)]
    if made.moving is not None:
        from cellwright.engine.formats.report import moves

        parts += moves.text(made.moving)
    return Group(*parts, *([report.statistics(run.outcome.statistics)] if stats else []))


def _unmet(made: Made) -> "Unmet":
    """What the problem asks of the times of measurements, and the plan does not keep."""
    from cellwright.engine.model.outcome import Found
    from cellwright.engine.model.windows import Unmet
    from cellwright.engine.pipelines.plan_files import unmet
    from cellwright.kb.model.plan import Claims

    outcome, starts = made.run.outcome, made.run.starts
    if not isinstance(outcome, Found) or starts is None:
        return Unmet()
    return unmet(made.problem, outcome.plan, Claims(dict(starts)))


def losses(content: Mapping[str, Any], store: str) -> "tuple[Diagnostic, ...]":
    """A warning if the library could not keep what was learned. The plan is no worse for it."""
    from cellwright.kb.diagnostics import Diagnostic, Source

    said = content.get("source", {}).get("lost")
    message, hint = (
        f"nothing was kept: {said}",
        "make room on the disk, start the server, or name another library",
    )
    return (Diagnostic(Source(store), "K416", message, hint, warning=True),) if said else ()


def origin_text(content: Mapping[str, Any]) -> "list[RenderableType]":
    """A line about where a plan comes from, if a library was used, and the parts of the plan."""
    found = content.get("source")
    if not found:
        return []
    from cellwright.engine.formats.report.macros import folded, origin

    parts = folded(found.get("parts", ()))
    said = origin(found["origin"], found["macrop"], found["name"], found["reason"], listed=parts is not None)
    return [each for each in (parts, said) if each]
