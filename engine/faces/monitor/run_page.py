"""The page of one run: its views, orders, the way through its records, and the chosen item."""

import asyncio
import time
from collections.abc import Callable
from typing import Any

from nicegui import background_tasks, ui

from cellwright.engine.faces.monitor.background_answers import step_reasons
from cellwright.engine.faces.monitor.chosen_item import step_about, told_of
from cellwright.engine.faces.monitor.page_frame import BAR_STYLE, dark_switch, page_head
from cellwright.engine.faces.monitor.run_follower import PLAYER_SPEEDS, RunPlayer
from cellwright.engine.faces.monitor.run_steering import MOVING_PHASES, RunSteering
from cellwright.engine.faces.monitor.run_views import RUN_VIEWS
from cellwright.engine.faces.monitor.shared_state import SharedState
from cellwright.engine.faces.monitor.view_base import PageLook, RunView
from cellwright.engine.formats.report.runs.run_report import duration_text
from cellwright.engine.model.noun_wording import count_noun


class ChosenPanel:
    """A panel, shown while something is chosen: beside the views, or above them where the
    screen is narrow.
    """

    def __init__(self, look: PageLook) -> None:
        self.look = look
        self._told: tuple[object, ...] = ()
        with ui.column().classes("chosen gap-1").props('data-testid="panel"') as self._panel:
            with ui.row().classes("w-full items-center no-wrap"):
                self._name = ui.label("").classes("text-bold col")
                close = ui.button(icon="close", on_click=lambda: self.look.choose(""))
                close.props('dense flat round aria-label="choose nothing" data-testid="unchoose"')
            self._lines = ui.column().classes("gap-1 w-full")
            self._lines.props('data-testid="chosen" role="status"')

    def show(self) -> None:
        """Tell of what is chosen now. Why a step is in the plan takes a moment."""
        look = self.look
        self._panel.set_visibility(bool(look.step))
        lines = [*told_of(look.run, look.step), *self._brought()]
        told = (look.step, *lines, len(look.run.plan.get("steps", ())))
        if told == self._told:
            return
        self._told = told
        self._name.set_text(look.step)
        self._lines.clear()
        with self._lines:
            for line in lines:
                ui.label(line)
        if (step := step_about(look.run, look.step)) is not None:
            background_tasks.create(self._explain(dict(look.run.plan), step, told))

    def _brought(self) -> list[str]:
        """What brought a fact that holds."""
        number = self.look.run.holds.get(self.look.step, 0)
        if not number:
            return []
        content = self.look.follower.records[number - 1].content
        return [f"brought by {content.get('action') or content.get('why') or 'an order'}"]

    async def _explain(self, plan: dict[str, Any], number: int, told: tuple[object, ...]) -> None:
        shared, steps = self.look.shared, {step["id"]: step for step in plan["steps"]}
        asked = (
            shared.target(self.look.run.run),
            [steps[step_id] for step_id in plan["order"]],
            number,
        )
        lines = await asyncio.wrap_future(shared.workers.submit(step_reasons, *asked))
        if told == self._told:
            with self._lines:
                ui.label(f"why {steps[number]['step']} is there:").classes("text-bold")
                for line in lines or ["it brings nothing that a later step needs"]:
                    ui.label(line).props('data-testid="because"')


PAGE_TICK_S = 0.1  # between two looks
PHASE_LOOKS = {  # phase or end of a run: its sign, its colour, and what it means
    "ready": ("○", "blue-grey", "planned; it waits until it is approved"),
    "running": ("▶", "green-9", "the plan is carried out"),
    "interrupting": ("⏸", "deep-orange-9", "ends the current goal, then pauses"),
    "quiescing": (
        "⚠",
        "deep-orange-9",
        "something failed: nothing more begins, what is under way ends",
    ),
    "handling": ("⚠", "deep-orange-9", "finds out what went wrong, and puts it right"),
    "paused": ("⏸", "deep-orange-9", "waits for an order; nothing moves"),
    "reached": ("✓", "green-9", "all goals are reached"),
    "partly": ("◐", "deep-orange-9", "some goals are reached, others were given up"),
    "stopped": ("■", "red-9", "a safe stop: nothing moves"),
    "aborted": ("✗", "red-9", "ended for good"),
}
KEY_HELP = """k plays or stands · , . one record · Home End · x next exception · l live ·
1 to 9, 0 and - views · f choose by name · Esc choose nothing · p pause · c go on · s stop ·
r retry · y approve · m more orders"""


class RunPage:
    """One run. Raises `InvalidInput` for an unknown one."""

    def __init__(self, shared: SharedState, name: str) -> None:
        self.shared, self.name = shared, name
        follower = shared.follow(name)
        self.player = RunPlayer(follower)
        self.look = PageLook(shared, follower, follower.latest, choose=self._choose)
        self._seen: tuple[object, ...] = ()
        page_head(shared)
        self._head()
        if self._steering is not None:
            self._steering.banner()
        self._views = self._body()
        self._foot()
        ui.on("go", lambda event: self._go(int(event.args)))
        ui.on("chosen", lambda event: self._choose(str(event.args)))
        ui.keyboard(on_key=self._key, ignore=["input", "select", "textarea"])
        ui.timer(PAGE_TICK_S, self.tick)

    def _head(self) -> None:
        with ui.header().classes("items-center gap-2").style(BAR_STYLE):
            ui.link("runs", "/").classes("text-white")
            ui.label(self.name).classes("text-h6").props('data-testid="title"').tooltip(
                self.look.follower.store
            )
            with (
                ui.badge("")
                .props('data-testid="phase" role="status"')
                .classes("text-body2") as self._phase
            ):
                self._meaning = ui.tooltip("")
            self._clock = ui.label("").props('data-testid="clock"')
            ui.space()
            self._steering = None if self.shared.read_only else RunSteering(self.shared, self.name)
            dark_switch()

    def _body(self) -> dict[str, RunView]:
        with ui.row().classes("w-full items-center no-wrap gap-2 q-px-sm"):
            with ui.tabs().classes("col").style("min-width: 0") as self._tabs:
                self._tabs.props("dense align=left no-caps outside-arrows mobile-arrows")
                for view_type in RUN_VIEWS:
                    ui.tab(view_type.name).props(f'data-testid="tab-{view_type.name}"')
            self._field = ui.input("choose by name").classes("w-40")
            self._field.props('dense clearable data-testid="choose"')
            self._field.on("keydown.enter", lambda: self._choose(str(self._field.value or "")))
        views = {}
        with ui.element("div").classes("split"):
            with (
                ui.tab_panels(self._tabs, value=RUN_VIEWS[0].name, animated=False)
                .props("keep-alive")
                .classes("views")
            ):
                for view_type in RUN_VIEWS:
                    with (
                        ui.tab_panel(view_type.name)
                        .classes("q-pa-xs")
                        .props(f'data-testid="shows-{view_type.name}"')
                    ):
                        views[view_type.name] = view_type(self.look)
            self._chosen = ChosenPanel(self.look)
        self._tabs.on_value_change(lambda: self.tick(anew=True))
        return views

    def _foot(self) -> None:
        with ui.footer().classes("items-center no-wrap gap-2").style(BAR_STYLE):
            self._play = ui.button(icon="play_arrow", on_click=self._play_or_stand).props(
                'dense flat color="white" aria-label="play" data-testid="play"'
            )
            speeds = {speed: f"{speed} ×".replace("-", "−") for speed in PLAYER_SPEEDS}
            self._speed = ui.select(speeds, value=10, on_change=self._change_speed)
            self._speed.props('dense dark options-dense aria-label="speed" data-testid="speed"')
            self._slider = ui.slider(min=0, max=1, value=1, on_change=self._slid)
            self._slider.classes("col").props(
                'label color="white" aria-label="record" data-testid="slider"'
            )
            self._live = ui.switch("live", value=True, on_change=self._switched)
            self._live.props('color="green" data-testid="live"')
            ui.button("exception", on_click=self._to_exception).props(
                'dense no-caps data-testid="exception"'
            )
            ui.icon("keyboard").tooltip(KEY_HELP).props('tabindex="0"')

    def tick(self, anew: bool = False) -> None:
        """Show what is new; with `anew` whatever is to be shown."""
        now = time.monotonic()
        going = self.shared.goes_on(self.name)
        self.shared.follow(self.name)
        self.player.tick(now, going)
        if self._steering is not None:
            self._steering.show(self.player.follower.latest, going)
        seen: tuple[object, ...] = (
            self.player.number,
            round(self.player.clock_ms),
            self._tabs.value,
            self.look.step,
        )
        seen = (*seen, self._views[str(self._tabs.value)].sign())
        if anew or seen != self._seen:
            self._seen = seen
            self._show()

    def _show(self) -> None:
        player, look = self.player, self.look
        look.run = player.follower.at(player.number, look.run)
        look.clock_ms = player.clock_ms
        self._slider.props(f"max={len(player.follower.records)}")
        self._slider.set_value(player.number)
        self._live.set_value(player.live)
        self._play.props(f"icon={'pause' if player.speed else 'play_arrow'}")
        self._say_phase(look.run.phase)
        so_far, in_all = (
            duration_text(round(look.clock_ms)),
            duration_text(max(look.run.end_ms, look.run.now_ms)),
        )
        self._clock.set_text(f"{so_far} of about {in_all}, {count_noun(player.number, 'record')}")
        self._views[str(self._tabs.value)].show()
        self._chosen.show()

    def _say_phase(self, phase: str) -> None:
        sign, colour, said = PHASE_LOOKS.get(phase, ("", "grey-8", phase))
        lost = self.player.live and phase in MOVING_PHASES and not self.shared.goes_on(self.name)
        self._phase.set_text(f"{sign} {phase}{', but nobody carries it out' if lost else ''}")
        self._phase.props(f"color={colour}")
        self._meaning.set_text(said)

    def _slid(self) -> None:
        if (number := int(self._slider.value or 0)) != self.player.number:
            self.player.go_to(number)
            self.tick()

    def _switched(self) -> None:
        if self._live.value != self.player.live:
            self.player.live, self.player.speed = bool(self._live.value), 0.0
            self.tick()

    def _play_or_stand(self) -> None:
        if self.player.speed:
            self.player.speed = 0.0
        else:
            self.player.play(float(self._speed.value or 1))
        self.tick(anew=True)

    def _change_speed(self) -> None:
        if self.player.speed:
            self.player.speed = float(self._speed.value or 1)

    def _go(self, number: int) -> None:
        self.player.go_to(number)
        self.tick(anew=True)

    def _choose(self, step: str) -> None:
        self.look.step = step.strip()
        self.tick(anew=True)

    def _to_exception(self) -> None:
        if not self.player.to_exception():
            ui.notify("this run had no exception")
        self.tick(anew=True)

    def _key(self, event: object) -> None:
        """Whatever a button of the page does, a key does."""
        key, action = getattr(event, "key", None), getattr(event, "action", None)
        if key is None or action is None or not action.keydown:
            return
        name = str(key.name)
        count, number = len(self.player.follower.records), self.player.number
        plain: dict[str, Callable[[], object]] = {
            "k": self._play_or_stand,
            "x": self._to_exception,
            "l": self.player.to_the_end,
            "Escape": lambda: self._choose(""),
            "f": lambda: self._field.run_method("focus"),
        }
        jumps = {",": number - 1, ".": number + 1, "Home": 0, "End": count}
        if name in jumps:
            self.player.go_to(jumps[name])
        elif name in VIEW_KEYS:
            self._tabs.set_value(list(self._views)[VIEW_KEYS.index(name)])
        elif name in plain:
            plain[name]()
        elif not self.shared.read_only and name in ORDERS_BY_KEY:
            ui.run_javascript(
                f"document.querySelector('[data-testid={ORDERS_BY_KEY[name]}]')?.click()"
            )
        self.tick(anew=True)


VIEW_KEYS = "1234567890-"
ORDERS_BY_KEY = {
    "p": "interrupt",
    "c": "continue",
    "s": "stop",
    "r": "retry",
    "y": "approve",
    "m": "more",
}
