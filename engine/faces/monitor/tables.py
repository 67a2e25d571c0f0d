"""Tables of a page. Their texts are shown as they are, never as HTML; a row that is clicked is chosen."""

import re
from collections.abc import Callable, Collection, Iterable
from typing import Any

from nicegui import ui

from cellwright.engine.faces.monitor.choosing import mentions

SHOWN = 400  # rows of a table at most; a search looks in all
TERM = re.compile(r"[a-z]\w*(\(.*\))?")


def made(choose: Callable[[str], None], *columns: str) -> ui.table:
    """An empty table. A click on a row chooses the first of its texts that is a term."""
    named = [
        {"name": str(n), "label": each, "field": str(n), "align": "left"} for n, each in enumerate(columns)
    ]
    table = ui.table(columns=named, rows=[], row_key="key").props("dense flat hide-no-data")
    table.on("rowClick", lambda event: choose(_term(event.args[1])))
    return table


def _term(row: dict[str, Any]) -> str:
    texts = [str(value) for key, value in row.items() if key != "key"]
    plain = [each.removeprefix("▸ ") for each in texts]
    return max((each for each in plain if TERM.fullmatch(each)), key=lambda each: "(" in each, default="")


def fill(table: ui.table, rows: Iterable[Collection[object]], chosen: Collection[str] = ()) -> None:
    """Show rows; those that belong to what is chosen are marked."""
    shown = []
    for key, row in enumerate(list(rows)[:SHOWN]):
        texts = [str(value) for value in row]
        if chosen and mentions(chosen, texts):
            texts[0] = f"▸ {texts[0]}"
        shown.append({"key": key, **{str(n): text for n, text in enumerate(texts)}})
    if table.rows != shown:
        table.rows = shown
