"""The pages of a monitor, and the first one: all runs of a store."""

import json
import shlex
from collections.abc import Callable
from urllib.parse import quote

from nicegui import ui

from engine.faces.monitor.jobs import LONG
from engine.faces.monitor.measuring import ChoosingPage, MeasuringPage
from engine.faces.monitor.page import RunPage, head
from engine.faces.monitor.shared import Shared
from engine.faces.monitor.steering import starting
from kb.diagnostics import InvalidInput


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


def _overview(shared: Shared) -> None:
    """All runs of the store, the newest first, with those that go on."""
    head(shared)
    ui.label("Runs").classes("text-h5")
    ui.link("measurements", "/measure")
    ui.link("preparation and long work", "/work")
    if not shared.read_only:
        starting()
    going = shared.going_on()
    runs = shared.runs()
    if not runs:
        ui.label(
            f"The store {shared.store} has no run yet. Begin one: cellwright run TARGET --store {shared.store}"
        )
    for each in runs:
        with ui.row().classes("items-center"):
            ui.link(each.run, f"/run/{quote(each.run, safe='')}")
            ui.label(f"{each.document.get('target', '')}, begun {each.begun}")
            if each.run in going:
                ui.badge("goes on", color="green")


def _work(shared: Shared) -> None:
    """Commands that take long, with what they tell of their progress."""
    head(shared)
    with ui.header().classes("items-center q-py-xs q-px-sm gap-2"):
        ui.link("runs", "/").classes("text-white")
        ui.label("Preparation and long work").classes("text-h6")
    if not shared.read_only:
        with ui.row().classes("items-center"):
            words = ui.input("command", value="prepare bulkhead --store prepared.db").classes("w-96")
            words.props('dense data-testid="words"')

            async def begin() -> None:
                asked = json.dumps({"order": "work", "text": str(words.value or "")})
                await ui.run_javascript(f"return send('/orders', {asked})", timeout=20.0)

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
