"""The views of a run. Each is made once for a page, and shows the run as it stands when it is told to."""

import time
from typing import Any
from xml.sax.saxutils import quoteattr

from nicegui import ui

from cellwright.engine.faces.monitor.cell3d import Cell3D
from cellwright.engine.faces.monitor.charts import MOST_BARS, gantt
from cellwright.engine.faces.monitor.choosing import related, steps_of
from cellwright.engine.faces.monitor.comparing import Compared
from cellwright.engine.faces.monitor.findings import Diagnosis, Results, Sequence
from cellwright.engine.faces.monitor.following import Watched
from cellwright.engine.faces.monitor.states import States
from cellwright.engine.faces.monitor.tables import SHOWN, fill, made
from cellwright.engine.faces.monitor.viewing import View, picture
from cellwright.engine.formats.report import svg
from cellwright.engine.formats.report.execution import duration
from cellwright.engine.pipelines.execution.records import compiled_of
from cellwright.engine.pipelines.parts import natural

SIGNS = {"open": "○", "reached": "✓"}  # how a goal stands; whatever else is a reason why it was given up
LARGEST = 150  # steps of a plan that is drawn
PAUSE_S = 0.5  # between two pictures of very many steps


class Now(View):
    """Devices and their current steps, all steps over time, goals, and what changed last."""

    name = "now"

    def make(self) -> None:
        """Make what is shown, still empty."""
        self._chart = ui.html("", sanitize=False).classes("w-full").style("min-width: 640px")
        with ui.row().classes("w-full items-start"):
            with ui.column().classes("gap-2"):
                self._current = made(self.look.choose, "device", "current step", "since")
                self._log = ui.column().classes("gap-0")
            self._goals = made(self.look.choose, "goal", "stands")
        self._drawn_s, self._rimmed = 0.0, frozenset[str]()

    def show(self) -> None:
        """Show the run as it stands."""
        run = self.look.run
        chosen = self.look.step
        self._draw(run, steps_of(run, chosen))
        current = [(stream, action, duration(since)) for stream, action, since, _ in run.under_way.values()]
        fill(self._current, current, related(run, chosen))
        goals = [
            (goal, f"{SIGNS.get(run.goals[goal], '✗')} {run.goals[goal]}")
            for goal in sorted(run.goals, key=natural)
        ]
        fill(self._goals, goals, related(run, chosen))
        self._log.clear()
        with self._log:
            for _, line in run.story[-8:]:
                ui.label(line).classes("text-caption")

    def sign(self) -> object:
        """A picture of very many steps is due now and then."""
        return self._due(self.look.run)

    def _due(self, run: Watched) -> bool:
        return len(run.bars) <= MOST_BARS or time.monotonic() - self._drawn_s >= PAUSE_S

    def _draw(self, run: Watched, chosen: frozenset[str]) -> None:
        if self._due(run) or chosen != self._rimmed:
            self._drawn_s, self._rimmed = time.monotonic(), chosen
            self._chart.set_content(gantt(run, round(self.look.clock_ms), chosen))


class Partial(View):
    """The plan as a partial order, as the command line draws it, each step in the colour of how it stands."""

    name = "plan"

    def make(self) -> None:
        """Make what is shown, still empty."""
        self._picture = ui.html("", sanitize=False)
        self._drawn: tuple[Any, ...] = ()

    def show(self) -> None:
        """Show the run as it stands."""
        run = self.look.run
        standing = {number: bar.standing for number, bar in run.bars.items()}
        chosen = steps_of(run, self.look.step)
        drawn = (id(run.plan), tuple(standing.items()), chosen)
        if drawn == self._drawn or not run.plan:
            return
        self._drawn = drawn
        if len(run.bars) > LARGEST:
            said = f"The plan has {len(run.bars)} steps: too many for a picture. See the steps over time."
            self._picture.set_content(said)
            return
        plan = svg.plan(compiled_of(run.plan).plan, standing=standing)
        self._picture.set_content(picture(_rimmed(plan, chosen)))


STANDING = """<style>.body--dark .done .box { fill: #1d4a2c; } .body--dark .running .box { fill: #5a4400; }
.body--dark .failed .box { fill: #5e1d14; }</style></svg>"""


def _rimmed(plan: str, chosen: frozenset[str]) -> str:
    """The picture of a plan with a rim around the steps that are chosen, and colours for dark pages."""
    for step in sorted(chosen):
        name = f"data-step={quoteattr(step)}"
        plan = plan.replace(name, f'{name} style="filter: drop-shadow(0 0 3px #d02090)" data-chosen="yes"')
    return plan.replace("</svg>", STANDING)


class World(View):
    """The facts that hold, what changed last first, with a search."""

    name = "world"

    def make(self) -> None:
        """Make what is shown, still empty."""
        self._search = ui.input("search").props('clearable dense data-testid="search"')
        self._table = made(self.look.choose, "fact", "since record")
        self._search.on_value_change(self.show)

    def show(self) -> None:
        """Show the run as it stands."""
        run = self.look.run
        asked = self._search.value or ""
        rows = sorted(run.holds.items(), key=lambda each: (-each[1], each[0]))
        fill(self._table, [row for row in rows if asked in row[0]], related(run, self.look.step))


class Objects(View):
    """What was done to each object."""

    name = "objects"

    def make(self) -> None:
        """Make what is shown, still empty."""
        self._search = ui.input("object").props('clearable dense data-testid="object"')
        self._table = made(self.look.choose, "from", "to", "step", "brought")
        self._found, self._asked, self._until = list[dict[str, Any]](), "", 0
        self._search.on_value_change(self.show)

    def show(self) -> None:
        """Show the run as it stands."""
        run = self.look.run
        asked = self._search.value or ""
        found = self._all(asked, run.number) if asked else run.histories
        fill(self._table, [_done(each) for each in found[-SHOWN:]], related(run, self.look.step))

    def _all(self, asked: str, number: int) -> list[dict[str, Any]]:
        """The steps up to a record in which a name occurs; what was found before is not looked for again."""
        if asked != self._asked:
            self._found, self._asked, self._until = [], asked, 0
        if number > self._until:
            fresh = self.look.follower.done(self._until, number)
            self._found += [each for each in fresh if any(asked in text for text in _texts(each))]
            self._until = number
        return [each for each in self._found if each["number"] <= number]


def _texts(done: dict[str, Any]) -> list[str]:
    return [str(done["action"]), *done["adds"]]


def _done(each: dict[str, Any]) -> tuple[str, ...]:
    times = duration(each["started_ms"]), duration(each["ended_ms"])
    return (*times, each["action"], ", ".join(each["adds"]))


class Log(View):
    """What the run tells, line by line."""

    name = "log"

    def make(self) -> None:
        """Make what is shown, still empty."""
        self._table = made(self.look.choose, "record", "what")

    def show(self) -> None:
        """Show the run as it stands."""
        run = self.look.run
        fill(self._table, run.story[::-1], related(run, self.look.step))


VIEWS: tuple[type[View], ...] = (
    Now,
    Cell3D,
    Partial,
    World,
    States,
    Sequence,
    Diagnosis,
    Results,
    Objects,
    Log,
    Compared,
)
