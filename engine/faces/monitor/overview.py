"""The pages of a monitor, and the first one: all runs of a store."""

import asyncio
import json
import shlex
from collections.abc import Callable
from urllib.parse import quote

from nicegui import ui

from cellwright.engine.faces.monitor.frame import head, heading
from cellwright.engine.faces.monitor.jobs import LONG
from cellwright.engine.faces.monitor.measuring import ChoosingPage, MeasuringPage
from cellwright.engine.faces.monitor.page import STANDS, RunPage
from cellwright.engine.faces.monitor.shared import Shared
from cellwright.engine.faces.monitor.steering import starting
from cellwright.kb.diagnostics import InvalidInput


def build(shared: Shared) -> None:
    """Make the pages of a monitor."""

    def overview() -> None:
        _overview(shared)

    def one(name: str) -> None:
        _told(lambda: RunPage(shared, name), "/")

    def work() -> None:
        _work(shared)

    def choosing() -> None:
        ChoosingPage(shared)

    def measuring(name: str) -> None:
        _told(lambda: MeasuringPage(shared, name), "/measure")

    ui.page("/")(overview)
    ui.page("/work")(work)
    ui.page("/measure")(choosing)
    ui.page("/measure/{name:path}")(measuring)
    ui.page("/run/{name:path}")(one)


LINK = '<q-td :props="props"><a :href="props.row.link">{{ props.row.run }}</a></q-td>'
COLUMNS = ("run", "target", "begun", "stands")
LISTED = 300  # runs, the newest
LOOK_S = 2.0


def _overview(shared: Shared) -> None:
    """All runs of the store, the newest first, with those that go on."""
    head(shared)
    heading("Runs", "runs")
    if not shared.read_only:
        starting()
    columns = [{"name": each, "label": each, "field": each, "align": "left"} for each in COLUMNS]
    table = ui.table(columns=columns, rows=[], row_key="run").classes("w-full").props("dense flat")
    table.props('hide-no-data data-testid="runs"').add_slot("body-cell-run", LINK)
    said = f"The store {shared.store} has no run yet. Begin one: cellwright run TARGET --store {shared.store}"
    none = ui.label(said)

    async def show() -> None:
        rows = await asyncio.to_thread(_listed, shared)
        none.set_visibility(not rows)
        if rows != table.rows:
            table.rows = rows

    ui.timer(LOOK_S, show)


def _listed(shared: Shared) -> list[dict[str, str]]:
    going, runs, rows = shared.going_on(), shared.runs()[:LISTED], []
    ends = shared.outcomes([each.run for each in runs if each.run not in going])
    for each in runs:
        end = ends.get(each.run, "")
        sign = STANDS[end][0] if end in STANDS else "■"
        stands = (
            "▶ goes on" if each.run in going else f"{sign} {end or 'ended without a word; it can be resumed'}"
        )
        begun = each.begun[:16].replace("T", " ")
        address = f"/run/{quote(each.run, safe='')}"
        rows.append({"run": each.run, "target": str(each.document.get("target", "")), "begun": f"{begun} UTC", "stands": stands, "link": address})  # fmt: skip
    return rows


def _work(shared: Shared) -> None:
    """Commands that take long, with what they tell of their progress."""
    head(shared)
    heading("Preparation and long work", "long work")
    if not shared.read_only:
        with ui.row().classes("items-center"):
            words = ui.input("command", value="prepare bulkhead --store prepared.db").classes("w-96")
            words.props('dense data-testid="words"')

            async def begin() -> None:
                asked = json.dumps({"order": "work", "text": str(words.value or "")})
                await ui.run_javascript(f"return send('/orders', {asked})", timeout=90.0)

            ui.button("Begin", on_click=begin).props('dense no-caps data-testid="begin"')
        ui.label(f"What can be begun: {', '.join(LONG)}; it works in {shared.sheets.folder}")
    shown = ui.column().classes("w-full")

    def show() -> None:
        shown.clear()
        with shown:
            for job in shared.jobs[::-1]:
                stands = (
                    "works" if job.code is None else "✓ done" if job.code == 0 else f"✗ ended with {job.code}"
                )
                ui.label(f"{shlex.join(job.words)}: {stands}, {job.seconds:.0f} s").props('data-testid="job"')
                text = ui.label(job.text[-4000:]).classes("text-caption").props('data-testid="job-text"')
                text.style("white-space: pre; font-family: monospace; overflow-x: auto")

    ui.timer(0.5, show)


def _told(make: Callable[[], object], back: str) -> None:
    """A page, or why there is none."""
    try:
        make()
    except InvalidInput as refused:
        ui.label(refused.diagnostics[0].message).classes("text-h6")
        ui.link("back", back)
