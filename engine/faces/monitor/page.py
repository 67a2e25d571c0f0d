"""The pages: the list of runs, and one run with all its views. Each page looks several times a second for what is new."""

import json
from urllib.parse import quote

from nicegui import ui

from engine.faces.monitor.shared import Shared
from engine.faces.monitor.steering import steering
from engine.faces.monitor.views import VIEWS, Choice
from engine.formats.report.execution import duration
from engine.model.wording import counted
from kb.diagnostics import InvalidInput

LOOK_S = 0.25  # between two looks
SCRIPT = """
async function order(run, name, text) {
  const answer = await fetch("/orders", {
    method: "POST",
    headers: {
      "content-type": "application/json",
      "x-cellwright-token": TOKEN,
      "idempotency-key": crypto.randomUUID(),
    },
    body: JSON.stringify({ run: run, order: name, text: text || "" }),
  });
  const told = await answer.json();
  emitEvent("told", { said: told.said, refused: !answer.ok });
}
document.addEventListener("click", (event) => {
  const step = event.target.closest && event.target.closest(".step");
  if (step) emitEvent("chosen", step.dataset.step);
});
"""


def build(shared: Shared) -> None:
    """Make the pages of a monitor."""

    @ui.page("/")
    def overview() -> None:
        _overview(shared)

    @ui.page("/run/{name:path}")
    def one(name: str) -> None:
        _run(shared, name)


def _overview(shared: Shared) -> None:
    """All runs of the store, the newest first, with those that go on."""
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
    """One run: how it stands, orders, its views, and a slider through its records."""
    try:
        follower = shared.follow(name)
    except InvalidInput as refused:
        ui.label(refused.diagnostics[0].message).classes("text-h6")
        ui.link("all runs", "/")
        return
    ui.add_head_html(f"<script>const TOKEN = {json.dumps(shared.token)};{SCRIPT}</script>")
    choice = Choice()
    with ui.header().classes("items-center q-py-xs"):
        ui.link("runs", "/").classes("text-white")
        title = ui.label(name).classes("text-h6").props('data-testid="title"')
        phase = ui.badge("").props('data-testid="phase"')
        clock = ui.label("").props('data-testid="clock"')
        if not shared.read_only:
            steering(name)
    with ui.tabs().props("dense align=left") as tabs:
        for each in VIEWS:
            ui.tab(each.name)
    views = []
    with ui.tab_panels(tabs, value=VIEWS[0].name, keep_alive=True).classes("w-full"):
        for each in VIEWS:
            with ui.tab_panel(each.name):
                views.append(each(follower, choice))
    with ui.footer().classes("items-center q-py-none"):
        ui.label("record")
        slider = ui.slider(min=0, max=1, value=1, on_change=lambda: look(True)).classes("col")
        slider.props('label aria-label="record" data-testid="slider"')
        live = ui.switch("live", value=True, on_change=lambda: look(True)).props('color="green"')
        ui.button("exception", on_click=lambda: _to_exception(follower.exceptions(), slider, live)).props(
            "dense"
        )
    shown = {"number": -1, "at": -1}

    def look(anew: bool = False) -> None:
        shared.follow(name)
        count = len(follower.records)
        slider.props(f"max={count}")
        if live.value:
            slider.set_value(count)
        number = int(slider.value)
        run = follower.at(number)
        if not anew and shown["number"] == number == count:
            return
        shown["number"] = number
        phase.set_text(run.phase)
        clock.set_text(
            f"{duration(run.now_ms)} of about {duration(max(run.end_ms, run.now_ms))}, {counted(number, 'record')}"
        )
        for view in views:
            view.show(run)

    def chosen(step: str) -> None:
        choice.step = step
        look(True)

    title.tooltip(follower.store)
    ui.on("chosen", lambda event: chosen(str(event.args)))
    ui.on("told", lambda event: _notice(event.args))
    ui.timer(LOOK_S, look)


def _notice(told: dict[str, object]) -> None:
    ui.notify(str(told.get("said", "")), type="warning" if told.get("refused") else "positive")


def _to_exception(numbers: list[int], slider: ui.slider, live: ui.switch) -> None:
    """Go to the next exception behind the record that is shown, or to the first one."""
    if not numbers:
        ui.notify("this run had no exception")
        return
    live.set_value(False)
    slider.set_value(next((each for each in numbers if each > slider.value), numbers[0]))
