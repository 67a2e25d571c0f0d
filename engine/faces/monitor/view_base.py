"""The base of all views: what a page looks at, pictures, and tables whose rows are chosen."""

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from typing import Any
from xml.sax.saxutils import escape

from nicegui import ui

from cellwright.engine.faces.monitor.chosen_item import names_any
from cellwright.engine.faces.monitor.run_follower import RunFollower, WatchedRun
from cellwright.engine.faces.monitor.shared_state import SharedState
from cellwright.engine.pipelines.execution.journal_motions import TakenStep


def dark_picture(text: str) -> str:
    """A picture, dark where the page is; a sentence in its place as text, because names in it
    may look like HTML.
    """
    drawn = text.startswith(("<svg", "<?xml"))
    return (
        text.replace("@media (prefers-color-scheme: dark)", ".body--dark")
        if drawn
        else escape(text)
    )


@dataclass
class PageLook:
    """What a page looks at: a run as it stood after a record, at a time on its clock; `step` is
    what is chosen: a step as the plan writes it, a fact, or an object; `choose` chooses."""

    shared: SharedState
    follower: RunFollower
    run: WatchedRun
    clock_ms: float = 0.0
    step: str = ""
    choose: Callable[[str], None] = print

    def share(self, taken: TakenStep) -> float:
        """The share of a step's time that is over, from 0 to 1."""
        record = self.follower.records[taken.number - 1]
        ends = self.follower.ends_ms(taken.command)
        ends = record.at_ms + record.content["lasts_ms"] if ends is None else ends
        if self.clock_ms >= ends:
            return 1.0
        return max(0.0, (self.clock_ms - record.at_ms) / max(1, ends - record.at_ms))


class RunView(ABC):
    """A view of a run on a page; `name` is what its tab says."""

    name = ""

    def __init__(self, look: PageLook) -> None:
        self.look = look
        self.make()

    @abstractmethod
    def make(self) -> None:
        """Make what is shown, still empty."""

    def sign(self) -> object:
        """What else the view shows than the run at the time that is looked at: if it changes,
        the view is shown again.
        """
        return None

    @abstractmethod
    def show(self) -> None:
        """Show the run as it stands."""


MAX_TABLE_ROWS = 400  # rows of a table at most; a search looks in all
TERM_TEXT = re.compile(r"[a-z]\w*(\(.*\))?")


def make_table(choose: Callable[[str], None], *columns: str) -> ui.table:
    """An empty table. A click on a row chooses the first of its texts that is a term."""
    named = [
        {"name": str(n), "label": column, "field": str(n), "align": "left"}
        for n, column in enumerate(columns)
    ]
    table = ui.table(columns=named, rows=[], row_key="key").props("dense flat hide-no-data")
    table.on("rowClick", lambda event: choose(_row_term(event.args[1])))
    return table


def _row_term(row: dict[str, Any]) -> str:
    texts = [str(value) for key, value in row.items() if key != "key"]
    plain = [cell.removeprefix("▸ ") for cell in texts]
    return max(
        (plain_text for plain_text in plain if TERM_TEXT.fullmatch(plain_text)),
        key=lambda each: "(" in each,
        default="",
    )


def fill_table(
    table: ui.table, rows: Iterable[Collection[object]], chosen: Collection[str] = ()
) -> None:
    """Show rows; those that belong to what is chosen are marked."""
    shown = []
    for key, row in enumerate(list(rows)[:MAX_TABLE_ROWS]):
        texts = [str(value) for value in row]
        if chosen and names_any(chosen, texts):
            texts[0] = f"▸ {texts[0]}"
        shown.append({"key": key, **{str(n): text for n, text in enumerate(texts)}})
    if table.rows != shown:
        table.rows = shown
