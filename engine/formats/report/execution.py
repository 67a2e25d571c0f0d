"""How a run ended, for people and as data."""

from typing import TYPE_CHECKING, Any

from rich.console import Group, RenderableType
from rich.text import Text

from cellwright.engine.formats.report.recovery import given_up_lines
from cellwright.engine.model.wording import counted

if TYPE_CHECKING:
    from cellwright.engine.model.execution import Finish

SAID = {
    "reached": "all goals are reached",
    "partly": "not all goals could be reached",
    "stopped": "stopped safely",
    "aborted": "ended before its goals were reached",
    "paused": "paused",
}
SHOWN = 12  # goals that are listed


def entry(ending: "Finish") -> dict[str, Any]:
    """The ending as JSON."""
    return {
        "run": ending.run,
        "why": ending.why,
        "goals": list(ending.goals),
        "open_goals": list(ending.open_goals),
        "given_up": [{"goal": goal, "why": why} for goal, why in ending.given_up],
        "makespan_ms": ending.makespan_ms,
        "forecast_ms": ending.forecast_ms,
        "exceptions": ending.exceptions,
        "steps": ending.steps,
        "story": list(ending.story),
    }


def text(ending: "Finish", store: str) -> RenderableType:
    """The ending in a few lines."""
    why = f": {ending.why}" if ending.why else ""
    lines = [Text(f"Run {ending.run}: {SAID[ending.outcome]}{why}.")]
    took = f"{duration(ending.makespan_ms)} on the run's clock; the first plan was forecast to take {duration(ending.forecast_ms)}"
    lines.append(Text(f"{counted(ending.steps, 'step')}, {counted(ending.exceptions, 'exception')}, {took}."))
    lines += [Text(f"  {each}") for each in ending.story]
    lines += [Text(f"  {each}") for each in given_up_lines(ending.given_up)]
    told = {goal for goal, _ in ending.given_up}
    still = [goal for goal in ending.open_goals if goal not in told]
    lines += [Text(f"  open: {goal}") for goal in still[:SHOWN]]
    if len(still) > SHOWN:
        lines.append(Text(f"  ... and {len(still) - SHOWN} more: --format json names all"))
    if ending.outcome in ("stopped", "paused"):
        lines.append(Text(f"Go on with: cellwright resume {ending.run} --store {store}"))
    return Group(*lines)


def clock(ms: int) -> str:
    """A moment of a run as hours, minutes and seconds: 0:28:27."""
    minutes, seconds = divmod(round(ms / 1000), 60)
    return f"{minutes // 60}:{minutes % 60:02}:{seconds:02}"


def duration(ms: int) -> str:
    """A time in the units that people use, to the second above two minutes."""
    if ms < 120_000:
        return f"{ms / 1000:g} s"
    minutes, seconds = divmod(round(ms / 1000), 60)
    return f"{minutes} min {seconds} s" if minutes < 120 else f"{minutes // 60} h {minutes % 60} min"
