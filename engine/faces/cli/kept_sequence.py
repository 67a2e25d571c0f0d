"""`cellwright sequence --store`: a stored sequence, updated as visits are done and the world changes."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from cellwright.engine.faces.cli.answers import Answer
from cellwright.engine.faces.cli.exits import INTERRUPTED

if TYPE_CHECKING:
    from cellwright.engine.pipelines.inspection.progress import News


def carried_on(
    target: str,
    store: str,
    said: tuple[list[str], list[str], list[str], list[str]],
    effort: tuple[float | None, int, int],
    next_alone: bool,
    anew: bool,
) -> Answer:
    """The visits that are left. `said` holds the texts of --done, --lost, --bad and --restored."""
    from cellwright.engine.faces.cli.interruption import Interruption
    from cellwright.engine.formats.report import progress as report
    from cellwright.engine.pipelines.parts.keeping import carry_on
    from cellwright.engine.pipelines.planning import problem_of
    from cellwright.engine.stages.sequencing import Limits

    with Interruption(effort[0]) as interrupted:
        limits = Limits(effort[1], effort[2], interrupted)
        found = carry_on(store, problem_of(target), _news(*said), limits, anew)
    return Answer(
        "found" if found.plan.rest else "done",
        report.next_entry(found) if next_alone else report.entry(found),
        lambda: report.next_text(found) if next_alone else report.text(found),
        INTERRUPTED if interrupted.heard else 0,
    )


def _news(done: list[str], lost: list[str], bad: list[str], restored: list[str]) -> "News":
    from cellwright.engine.pipelines.inspection.progress import FOUND_BAD, News

    parted = [each.partition("=") for each in bad]
    reasons = {name: why.strip() or FOUND_BAD for names, _, why in parted for name in _names([names])}
    return News(_names(done), _names(lost), reasons, _names(restored))


def _names(texts: Iterable[str]) -> tuple[str, ...]:
    return tuple(name.strip() for text in texts for name in text.split(",") if name.strip())
