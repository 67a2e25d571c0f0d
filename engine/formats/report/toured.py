"""A tour, whole: its order and length, the tools that take measurements, and the time that their steps take."""

from typing import TYPE_CHECKING, Any

from cellwright.engine.model.tour import Tour
from cellwright.engine.pipelines.inspection.visits import Visits

if TYPE_CHECKING:
    from rich.console import RenderableType


def content(answer: Tour, found: Visits) -> dict[str, Any]:
    """The tour through these visits as data."""
    from cellwright.engine.formats.report import inspection, tour

    made = tour.entry(answer, found.tours)
    if found.parts is not None:
        made["partition"] = inspection.entry(found.parts)
    if found.problem is not None:
        made |= tour.time_entry(_time(answer, found), found.problem.domain.time_unit)
    return made


def text(answer: Tour, found: Visits) -> "RenderableType":
    """The tour through these visits as people read it."""
    from rich.console import Group

    from cellwright.engine.formats.report import inspection, tour

    shown = [tour.text(answer, found.tours)]
    if found.parts is not None:
        shown.insert(0, inspection.parts(found.parts))
    if found.problem is not None:
        shown += tour.time_text(_time(answer, found), found.problem.domain.time_unit)
    return Group(*shown)


def _time(answer: Tour, found: Visits) -> int | None:
    from cellwright.engine.pipelines.inspection.ways import time_between

    return None if found.problem is None else time_between(found.problem, found.tours, answer.order)
