"""The pages of a monitor, and the first one: all runs of a store."""

from collections.abc import Callable
from urllib.parse import quote

from nicegui import ui

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

    def choosing() -> None:
        ChoosingPage(shared)

    def measuring(name: str) -> None:
        _told(lambda: MeasuringPage(shared, name), "/measure")

    ui.page("/")(overview)
    ui.page("/measure")(choosing)
    ui.page("/measure/{name:path}")(measuring)
    ui.page("/run/{name:path}")(one)


def _overview(shared: Shared) -> None:
    """All runs of the store, the newest first, with those that go on."""
    head(shared)
    ui.label("Runs").classes("text-h5")
    ui.link("measurements", "/measure")
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


def _told(make: Callable[[], object], back: str) -> None:
    """A page, or why there is none."""
    try:
        make()
    except InvalidInput as refused:
        ui.label(refused.diagnostics[0].message).classes("text-h6")
        ui.link("back", back)
