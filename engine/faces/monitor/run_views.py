"""The views of a run: now, plan, world, objects, log, contact states, and a second run beside."""

import asyncio
import time
from itertools import zip_longest
from typing import Any
from xml.sax.saxutils import quoteattr

from nicegui import background_tasks, ui

from cellwright.engine.faces.monitor.background_answers import contact_states
from cellwright.engine.faces.monitor.cell3d import Cell3D
from cellwright.engine.faces.monitor.chosen_item import names_any, related_texts, steps_of
from cellwright.engine.faces.monitor.finding_views import DiagnosisView, ResultsView, SequenceView
from cellwright.engine.faces.monitor.run_charts import MOST_BARS, gantt_chart
from cellwright.engine.faces.monitor.run_follower import WatchedRun, first_difference
from cellwright.engine.faces.monitor.view_base import (
    MAX_TABLE_ROWS,
    RunView,
    dark_picture,
    fill_table,
    make_table,
)
from cellwright.engine.formats.report.drawing import plan_svg
from cellwright.engine.formats.report.runs.run_report import duration_text, narrate_record
from cellwright.engine.model.run_protocol import JournalRecord
from cellwright.engine.pipelines.execution.plan_records import compiled_of
from cellwright.engine.pipelines.planning.decomposition import natural_name_key
from cellwright.kb.diagnostics import InvalidInput

ROWS_AROUND = 200  # rows before the first difference and behind it


class ComparisonView(RunView):
    """This run beside another one of the store, record by record."""

    name = "compare"

    def make(self) -> None:
        """Make what is shown, still empty."""
        others = [
            begun_run.run
            for begun_run in self.look.shared.runs()
            if begun_run.run != self.look.follower.run
        ]
        self._other = ui.select(others, label="the other run", on_change=self.show)
        # the other run, and how many records are known to be the same
        self._same: tuple[str, int] = ("", 0)
        self._other.props('dense options-dense data-testid="other"').classes("w-64")
        self._told = ui.label("").props('data-testid="difference" role="status"')
        self._table = make_table(
            self.look.choose, "record", self.look.follower.run, "the other run"
        )

    def show(self) -> None:
        """Show the run as it stands."""
        if not self._other.value:
            self._told.set_text("Choose a run to compare with.")
            return
        try:
            other_run = self.look.shared.follow(str(self._other.value)).records
        except InvalidInput as refused:
            self._told.set_text(refused.diagnostics[0].message)
            return
        mine = self.look.follower.records
        name, same = (
            str(self._other.value),
            self._same[1] if self._same[0] == self._other.value else 0,
        )
        number = first_difference(mine, other_run, same)
        self._same = name, number - 1 if number else len(mine)
        alike = "the runs are the same; times do not count"
        self._told.set_text(
            f"✗ the first difference is record {number}" if number else f"✓ {alike}"
        )
        first, last = max(0, (number or 1) - ROWS_AROUND), (number or len(mine)) + ROWS_AROUND
        fill_table(
            self._table,
            [
                _record_row(pair, number)
                for pair in zip_longest(mine[first:last], other_run[first:last])
            ],
        )


def _record_row(
    pair: tuple[JournalRecord | None, JournalRecord | None], number: int
) -> tuple[str, str, str]:
    ours, theirs = pair
    at = ours.number if ours is not None else theirs.number if theirs is not None else 0
    return f"{'✗ ' if at == number else ''}{at}", _record_text(ours), _record_text(theirs)


def _record_text(record: JournalRecord | None) -> str:
    if record is None:
        return "it was over"
    content = record.content
    told = " ".join(narrate_record(record)) or str(
        content.get("action") or content.get("text") or ""
    )
    return f"{duration_text(record.at_ms)} {record.kind.value} {told}"


LIT_PLACE = 'style="filter: drop-shadow(0 0 4px #d02090)" data-chosen="yes"'


class StatesView(RunView):
    """Where each object is in the net: full places have somebody in them.

    What is chosen has a rim there.
    """

    name = "states"

    def make(self) -> None:
        """Make what is shown, still empty."""
        self._told = ui.label("").props('data-testid="marking" role="status"')
        with ui.row().classes("w-full items-start no-wrap"):
            self._table = make_table(self.look.choose, "object", "place", "together with")
            self._table.props('data-testid="inside"')
            self._picture = ui.html("", sanitize=False).props('data-testid="net"').classes("col")
            self._picture.style("overflow: auto; max-height: calc(100vh - 170px); min-width: 0")
        self._found: tuple[str, list[tuple[str, ...]]] = ("", [])
        self._asked = frozenset[str]()
        self._drawn: object = None

    def show(self) -> None:
        """Show the run as it stands. The marking is found in a process of its own."""
        facts = frozenset(self.look.run.holds)
        if facts != self._asked:
            self._asked = facts
            if not self._found[0]:
                self._told.set_text("looking for the contact states of this cell ...")
            background_tasks.create_lazy(self._find(), name=f"states {id(self)}")
        self._draw()

    async def _find(self) -> None:
        shared, run = self.look.shared, self.look.run
        asked = shared.workers.submit(contact_states, shared.target(run.run)[0], self._asked)
        self._found = await asyncio.wrap_future(asked)
        self._told.set_text(f"marked as the run stands after record {run.number}")
        self._draw()

    def _draw(self) -> None:
        drawn, rows = self._found
        if (shown := (drawn, self.look.step)) == self._drawn:
            return
        self._drawn = shown
        chosen = [self.look.step] if self.look.step else []
        for place in sorted({row[1] for row in rows if chosen and names_any(chosen, row[:1])}):
            drawn = drawn.replace(f'data-place="{place}"', f'data-place="{place}" {LIT_PLACE}')
        self._picture.set_content(dark_picture(drawn))
        fill_table(self._table, rows, chosen)


# how a goal stands; whatever else is a reason why it was given up
GOAL_SIGNS = {"open": "○", "reached": "✓"}
MAX_DRAWN_STEPS = 150  # steps of a plan that is drawn
PICTURE_PAUSE_S = 0.5  # between two pictures of very many steps


class NowView(RunView):
    """Devices and their current steps, all steps over time, goals, and what changed last."""

    name = "now"

    def make(self) -> None:
        """Make what is shown, still empty."""
        self._chart = ui.html("", sanitize=False).classes("w-full").style("min-width: 640px")
        with ui.row().classes("w-full items-start"):
            with ui.column().classes("gap-2"):
                self._current = make_table(self.look.choose, "device", "current step", "since")
                self._log = ui.column().classes("gap-0")
            self._goals = make_table(self.look.choose, "goal", "stands")
        self._drawn_s, self._rimmed = 0.0, frozenset[str]()

    def show(self) -> None:
        """Show the run as it stands."""
        run = self.look.run
        chosen = self.look.step
        self._draw(run, steps_of(run, chosen))
        current = [
            (stream, action, duration_text(since))
            for stream, action, since, _ in run.under_way.values()
        ]
        fill_table(self._current, current, related_texts(run, chosen))
        goals = [
            (goal, f"{GOAL_SIGNS.get(run.goals[goal], '✗')} {run.goals[goal]}")
            for goal in sorted(run.goals, key=natural_name_key)
        ]
        fill_table(self._goals, goals, related_texts(run, chosen))
        self._log.clear()
        with self._log:
            for _, line in run.story[-8:]:
                ui.label(line).classes("text-caption")

    def sign(self) -> object:
        """A picture of very many steps is due now and then."""
        return self._due(self.look.run)

    def _due(self, run: WatchedRun) -> bool:
        return len(run.bars) <= MOST_BARS or time.monotonic() - self._drawn_s >= PICTURE_PAUSE_S

    def _draw(self, run: WatchedRun, chosen: frozenset[str]) -> None:
        if self._due(run) or chosen != self._rimmed:
            self._drawn_s, self._rimmed = time.monotonic(), chosen
            self._chart.set_content(gantt_chart(run, round(self.look.clock_ms), chosen))


class PlanView(RunView):
    """The plan as a partial order, as the command line draws it, each step in the colour of how
    it stands.
    """

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
        if len(run.bars) > MAX_DRAWN_STEPS:
            said = (
                f"The plan has {len(run.bars)} steps: too many for a picture. See the steps "
                "over time."
            )
            self._picture.set_content(said)
            return
        plan = plan_svg.draw_plan(compiled_of(run.plan).plan, standing=standing)
        self._picture.set_content(dark_picture(_rim_steps(plan, chosen)))


DARK_STEP_STYLE = """<style>.body--dark .done .box { fill: #1d4a2c; } .body--dark .running .box { fill: #5a4400; }
.body--dark .failed .box { fill: #5e1d14; }</style></svg>"""


def _rim_steps(plan: str, chosen: frozenset[str]) -> str:
    """The picture of a plan with a rim around the steps that are chosen, and colours for dark
    pages.
    """
    for step in sorted(chosen):
        name = f"data-step={quoteattr(step)}"
        plan = plan.replace(
            name, f'{name} style="filter: drop-shadow(0 0 3px #d02090)" data-chosen="yes"'
        )
    return plan.replace("</svg>", DARK_STEP_STYLE)


class WorldView(RunView):
    """The facts that hold, what changed last first, with a search."""

    name = "world"

    def make(self) -> None:
        """Make what is shown, still empty."""
        self._search = ui.input("search").props('clearable dense data-testid="search"')
        self._table = make_table(self.look.choose, "fact", "since record")
        self._search.on_value_change(self.show)

    def show(self) -> None:
        """Show the run as it stands."""
        run = self.look.run
        asked = self._search.value or ""
        rows = sorted(run.holds.items(), key=lambda each: (-each[1], each[0]))
        fill_table(
            self._table,
            [row for row in rows if asked in row[0]],
            related_texts(run, self.look.step),
        )


class ObjectsView(RunView):
    """What was done to each object."""

    name = "objects"

    def make(self) -> None:
        """Make what is shown, still empty."""
        self._search = ui.input("object").props('clearable dense data-testid="object"')
        self._table = make_table(self.look.choose, "from", "to", "step", "brought")
        self._found, self._asked, self._until = list[dict[str, Any]](), "", 0
        self._search.on_value_change(self.show)

    def show(self) -> None:
        """Show the run as it stands."""
        run = self.look.run
        asked = self._search.value or ""
        histories = self._all(asked, run.number) if asked else run.histories
        fill_table(
            self._table,
            [_history_row(history) for history in histories[-MAX_TABLE_ROWS:]],
            related_texts(run, self.look.step),
        )

    def _all(self, asked: str, number: int) -> list[dict[str, Any]]:
        """The steps up to a record in which a name occurs; what was found before is not looked
        for again.
        """
        if asked != self._asked:
            self._found, self._asked, self._until = [], asked, 0
        if number > self._until:
            fresh = self.look.follower.done(self._until, number)
            self._found += [
                history for history in fresh if any(asked in text for text in _step_texts(history))
            ]
            self._until = number
        return [history for history in self._found if history["number"] <= number]


def _step_texts(done: dict[str, Any]) -> list[str]:
    return [str(done["action"]), *done["adds"]]


def _history_row(each: dict[str, Any]) -> tuple[str, ...]:
    times = duration_text(each["started_ms"]), duration_text(each["ended_ms"])
    return (*times, each["action"], ", ".join(each["adds"]))


class LogView(RunView):
    """What the run tells, line by line."""

    name = "log"

    def make(self) -> None:
        """Make what is shown, still empty."""
        self._table = make_table(self.look.choose, "record", "what")

    def show(self) -> None:
        """Show the run as it stands."""
        run = self.look.run
        fill_table(self._table, run.story[::-1], related_texts(run, self.look.step))


RUN_VIEWS: tuple[type[RunView], ...] = (
    NowView,
    Cell3D,
    PlanView,
    WorldView,
    StatesView,
    SequenceView,
    DiagnosisView,
    ResultsView,
    ObjectsView,
    LogView,
    ComparisonView,
)
