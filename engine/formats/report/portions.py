"""Portions of motions, and what is said while an operator is followed, as text and as content for JSON."""

from collections.abc import Sequence
from typing import Any

from cellwright.engine.formats.report import placing
from cellwright.engine.pipelines.placing.aligning import Brought, Portion
from cellwright.engine.pipelines.placing.answers import NotPlaced
from cellwright.engine.pipelines.placing.watching import Forecast, Outlook, Watched
from cellwright.kb.model.scene import SaidRelation

SAID = {
    Outlook.DONE: "the part is at its goal",
    Outlook.OPEN: "the goal can be reached",
    Outlook.HARD: "the goal is hard to reach",
    Outlook.IMPOSSIBLE: "the goal cannot be reached",
}


def status(portion: Portion) -> str:
    """The status word of a portion."""
    return placing.status(portion) if isinstance(portion, NotPlaced) else "found"


def content(portion: Portion) -> dict[str, Any]:
    """A portion for JSON: poses as rows of matrices, metres and radians."""
    if isinstance(portion, NotPlaced):
        return {"step": portion.step, "reason": portion.reason, "hint": portion.hint}
    return {
        "T_world_part": portion.T_world_part.tolist(),
        "facets": list(portion.grasp.facets),
        "legs": [placing.leg(each) for each in portion.legs],
    }


def text(portion: Portion, said: SaidRelation) -> str:
    """A portion for people."""
    if not isinstance(portion, Brought):
        return f"'{said}' is not reached: {portion.reason}\n  try: {portion.hint}"
    part = said.first[0]
    lines = [
        f"{part} lies at {placing.pose(portion.T_world_from)}",
        f"'{said}' holds at {placing.pose(portion.T_world_part)}, {placing.free(portion.goal)}",
        f"taken at {placing.at_facets(portion.grasp)}, and held there",
        *(placing.told(each) for each in portion.legs),
    ]
    return "\n".join(lines)


def followed(state: Watched, told: Sequence[tuple[Watched, Forecast | None]]) -> str:
    """What is said after each event, for people."""
    before = state.forecast
    lines = [f"at first: {_outlook(before)}"]
    for n, (after, warning) in enumerate(told, 1):
        mark = "WARNING: " if warning is not None else ""
        held = " (in the hand)" if after.T_part_hand is not None else ""
        same = after.forecast == before
        lines.append(f"act {n}{held}: {mark}{'as before' if same else _outlook(after.forecast)}")
        before = after.forecast
    return "\n".join(lines)


def _outlook(forecast: Forecast) -> str:
    return SAID[forecast.outlook] + (f": {forecast.reason}" if forecast.reason else "")


def events(state: Watched, told: Sequence[tuple[Watched, Forecast | None]]) -> dict[str, Any]:
    """The same for JSON."""
    return {
        "at_first": _entry(state, state.forecast, False),
        "acts": [_entry(after, after.forecast, warning is not None) for after, warning in told],
    }


def _entry(state: Watched, forecast: Forecast, warned: bool) -> dict[str, Any]:
    return {
        "outlook": forecast.outlook.name.lower(),
        "reason": forecast.reason,
        "warned": warned,
        "held": state.T_part_hand is not None,
        "T_world_part": state.T_world_part.tolist(),
    }
