"""The pages: the list of runs, and one run with all its views. Each page looks several times a second for what is new."""

import json
from urllib.parse import quote

from nicegui import ui

from engine.faces.monitor.shared import Shared
from engine.faces.monitor.steering import steering
from engine.faces.monitor.views import VIEWS, Choice, View
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

    def overview() -> None:
        _overview(shared)

    def one(name: str) -> None:
        _run(shared, name)

    ui.page("/")(overview)
    ui.page("/run/{name:path}")(one)


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
    """The page of one run; a run that is not there is told."""
    try:
        RunPage(shared, name)
    except InvalidInput as refused:
        ui.label(refused.diagnostics[0].message).classes("text-h6")
        ui.link("all runs", "/")


class RunPage:
    """One run: how it stands, orders, its views, and a slider through its records. Raises `InvalidInput` for an unknown run."""

    def __init__(self, shared: Shared, name: str) -> None:
        self.shared, self.name, self.choice = shared, name, Choice()
        self.follower = shared.follow(name)
        self._shown = -1
        ui.add_head_html(f"<script>const TOKEN = {json.dumps(shared.token)};{SCRIPT}</script>")
        self._head()
        self._views = self._body()
        self._foot()
        ui.on("chosen", lambda event: self._choose(str(event.args)))
        ui.on("told", lambda event: _notice(event.args))
        ui.timer(LOOK_S, self.look)

    def _head(self) -> None:
        with ui.header().classes("items-center q-py-xs"):
            ui.link("runs", "/").classes("text-white")
            ui.label(self.name).classes("text-h6").props('data-testid="title"').tooltip(self.follower.store)
            self._phase = ui.badge("").props('data-testid="phase"')
            self._clock = ui.label("").props('data-testid="clock"')
            if not self.shared.read_only:
                steering(self.name)

    def _body(self) -> list[View]:
        with ui.tabs().props("dense align=left") as tabs:
            for each in VIEWS:
                ui.tab(each.name).props(f'data-testid="tab-{each.name}"')
        views = []
        with ui.tab_panels(tabs, value=VIEWS[0].name).props("keep-alive").classes("w-full"):
            for each in VIEWS:
                with ui.tab_panel(each.name):
                    views.append(each(self.choice))
        return views

    def _foot(self) -> None:
        with ui.footer().classes("items-center q-py-none"):
            ui.label("record")
            self._slider = ui.slider(min=0, max=1, value=1, on_change=lambda: self.look(anew=True))
            self._slider.classes("col").props('label color="white" aria-label="record" data-testid="slider"')
            self._live = ui.switch("live", value=True, on_change=lambda: self.look(anew=True))
            self._live.props('color="green" data-testid="live"')
            ui.button("exception", on_click=self._to_exception).props('dense data-testid="exception"')

    def look(self, anew: bool = False) -> None:
        """Show what is new; with `anew` whatever is to be shown."""
        count = len(self.shared.follow(self.name).records)
        self._slider.props(f"max={count}")
        if self._live.value and self._slider.value != count:
            self._slider.set_value(count)
        number = int(self._slider.value or 0)
        if anew or number != self._shown:
            self._shown = number
            self._show(number)

    def _show(self, number: int) -> None:
        run = self.follower.at(number)
        self._phase.set_text(run.phase)
        so_far, in_all = duration(run.now_ms), duration(max(run.end_ms, run.now_ms))
        self._clock.set_text(f"{so_far} of about {in_all}, {counted(number, 'record')}")
        for view in self._views:
            view.show(run)

    def _choose(self, step: str) -> None:
        self.choice.step = step
        self.look(anew=True)

    def _to_exception(self) -> None:
        """Go to the next exception behind the record that is shown, or to the first one."""
        numbers = self.follower.exceptions()
        if not numbers:
            ui.notify("this run had no exception")
            return
        self._live.set_value(False)
        self._slider.set_value(next((each for each in numbers if each > self._shown), numbers[0]))


def _notice(told: dict[str, object]) -> None:
    ui.notify(str(told.get("said", "")), type="warning" if told.get("refused") else "positive")
