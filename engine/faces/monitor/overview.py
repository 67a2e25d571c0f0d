"""The pages of a monitor, and the first one: all runs of a store."""

from urllib.parse import quote

from nicegui import ui

from engine.faces.monitor.page import RunPage, head
from engine.faces.monitor.shared import Shared
from kb.diagnostics import InvalidInput


def build(shared: Shared) -> None:
    """Make the pages of a monitor."""

    def overview() -> None:
        _overview(shared)

    def one(name: str) -> None:
        _run(shared, name)

    ui.page("/")(overview)
    ui.page("/run/{name:path}")(one)


def _overview(shared: Shared) -> None:
    """All runs of the store, the newest first, with those that go on."""
    head(shared)
    ui.label("Runs").classes("text-h5")
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


def _run(shared: Shared, name: str) -> None:
    """The page of one run; a run that is not there is told."""
    try:
        RunPage(shared, name)
    except InvalidInput as refused:
        ui.label(refused.diagnostics[0].message).classes("text-h6")
        ui.link("all runs", "/")
