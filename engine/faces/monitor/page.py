"""The page of one run: how it stands, its views, orders, and the way through its records. It looks ten times a second for what is new."""

import time
from collections.abc import Callable

from nicegui import ui

from cellwright.engine.faces.monitor.chosen import Chosen
from cellwright.engine.faces.monitor.frame import BAR, dark_switch, head
from cellwright.engine.faces.monitor.playing import SPEEDS, Player
from cellwright.engine.faces.monitor.shared import Shared
from cellwright.engine.faces.monitor.steering import MOVING, Steering
from cellwright.engine.faces.monitor.viewing import Look, View
from cellwright.engine.faces.monitor.views import VIEWS
from cellwright.engine.formats.report.execution import duration
from cellwright.engine.model.wording import counted

LOOK_S = 0.1  # between two looks
STANDS = {  # phase or end of a run: its sign, its colour, and what it means
    "ready": ("○", "blue-grey", "planned; it waits until it is approved"),
    "running": ("▶", "green-9", "the plan is carried out"),
    "interrupting": ("⏸", "deep-orange-9", "ends the current goal, then pauses"),
    "quiescing": ("⚠", "deep-orange-9", "something failed: nothing more begins, what is under way ends"),
    "handling": ("⚠", "deep-orange-9", "finds out what went wrong, and puts it right"),
    "paused": ("⏸", "deep-orange-9", "waits for an order; nothing moves"),
    "reached": ("✓", "green-9", "all goals are reached"),
    "partly": ("◐", "deep-orange-9", "some goals are reached, others were given up"),
    "stopped": ("■", "red-9", "a safe stop: nothing moves"),
    "aborted": ("✗", "red-9", "ended for good"),
}
KEYS = """k plays or stands · , . one record · Home End · x next exception · l live · 1 to 9, 0 and - views ·
f choose by name · Esc choose nothing · p pause · c go on · s stop · r retry · y approve · m more orders"""


class RunPage:
    """One run. Raises `InvalidInput` for an unknown one."""

    def __init__(self, shared: Shared, name: str) -> None:
        self.shared, self.name = shared, name
        follower = shared.follow(name)
        self.player = Player(follower)
        self.look = Look(shared, follower, follower.latest, choose=self._choose)
        self._seen: tuple[object, ...] = ()
        head(shared)
        self._head()
        if self._steering is not None:
            self._steering.banner()
        self._views = self._body()
        self._foot()
        ui.on("go", lambda event: self._go(int(event.args)))
        ui.on("chosen", lambda event: self._choose(str(event.args)))
        ui.keyboard(on_key=self._key, ignore=["input", "select", "textarea"])
        ui.timer(LOOK_S, self.tick)

    def _head(self) -> None:
        with ui.header().classes("items-center gap-2").style(BAR):
            ui.link("runs", "/").classes("text-white")
            ui.label(self.name).classes("text-h6").props('data-testid="title"').tooltip(
                self.look.follower.store
            )
            with ui.badge("").props('data-testid="phase" role="status"').classes("text-body2") as self._phase:
                self._meaning = ui.tooltip("")
            self._clock = ui.label("").props('data-testid="clock"')
            ui.space()
            self._steering = None if self.shared.read_only else Steering(self.shared, self.name)
            dark_switch()

    def _body(self) -> dict[str, View]:
        with ui.row().classes("w-full items-center no-wrap gap-2 q-px-sm"):
            with ui.tabs().classes("col").style("min-width: 0") as self._tabs:
                self._tabs.props("dense align=left no-caps outside-arrows mobile-arrows")
                for each in VIEWS:
                    ui.tab(each.name).props(f'data-testid="tab-{each.name}"')
            self._field = ui.input("choose by name").classes("w-40")
            self._field.props('dense clearable data-testid="choose"')
            self._field.on("keydown.enter", lambda: self._choose(str(self._field.value or "")))
        views = {}
        with ui.element("div").classes("split"):
            with (
                ui.tab_panels(self._tabs, value=VIEWS[0].name, animated=False)
                .props("keep-alive")
                .classes("views")
            ):
                for each in VIEWS:
                    with ui.tab_panel(each.name).classes("q-pa-xs").props(f'data-testid="shows-{each.name}"'):
                        views[each.name] = each(self.look)
            self._chosen = Chosen(self.look)
        self._tabs.on_value_change(lambda: self.tick(anew=True))
        return views

    def _foot(self) -> None:
        with ui.footer().classes("items-center no-wrap gap-2").style(BAR):
            self._play = ui.button(icon="play_arrow", on_click=self._play_or_stand).props(
                'dense flat color="white" aria-label="play" data-testid="play"'
            )
            speeds = {each: f"{each} ×".replace("-", "−") for each in SPEEDS}
            self._speed = ui.select(speeds, value=10, on_change=self._change_speed)
            self._speed.props('dense dark options-dense aria-label="speed" data-testid="speed"')
            self._slider = ui.slider(min=0, max=1, value=1, on_change=self._slid)
            self._slider.classes("col").props('label color="white" aria-label="record" data-testid="slider"')
            self._live = ui.switch("live", value=True, on_change=self._switched)
            self._live.props('color="green" data-testid="live"')
            ui.button("exception", on_click=self._to_exception).props('dense no-caps data-testid="exception"')
            ui.icon("keyboard").tooltip(KEYS).props('tabindex="0"')

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
        so_far, in_all = duration(round(look.clock_ms)), duration(max(look.run.end_ms, look.run.now_ms))
        self._clock.set_text(f"{so_far} of about {in_all}, {counted(player.number, 'record')}")
        self._views[str(self._tabs.value)].show()
        self._chosen.show()

    def _say_phase(self, phase: str) -> None:
        sign, colour, said = STANDS.get(phase, ("", "grey-8", phase))
        lost = self.player.live and phase in MOVING and not self.shared.goes_on(self.name)
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
            ui.run_javascript(f"document.querySelector('[data-testid={ORDERS_BY_KEY[name]}]')?.click()")
        self.tick(anew=True)


VIEW_KEYS = "1234567890-"
ORDERS_BY_KEY = {"p": "interrupt", "c": "continue", "s": "stop", "r": "retry", "y": "approve", "m": "more"}
