"""The views of a run. Each is made once for a page, and shows the run as it stands when it is told to."""

from collections import defaultdict
from typing import Any

from nicegui import ui

from engine.faces.monitor.cell3d import Cell3D
from engine.faces.monitor.charts import gantt, run_chart
from engine.faces.monitor.following import Watched
from engine.faces.monitor.viewing import View
from engine.formats.report import svg
from engine.formats.report.execution import duration
from engine.pipelines.execution.records import compiled_of

SHOWN = 400  # rows of a table at most; a search looks in all
LARGEST = 150  # steps of a plan that is drawn


class Now(View):
    """Devices and their current steps, all steps over time, the step that is chosen, goals, and what changed last."""

    name = "now"

    def make(self) -> None:
        """Make what is shown, still empty."""
        self._chart = ui.html("", sanitize=False).classes("w-full")
        with ui.row().classes("w-full items-start"):
            self._current = _table("device", "current step", "since")
            self._goals = _table("goal", "stands")
            self._chosen = ui.column().props('data-testid="chosen"')
        self._log = ui.column().classes("w-full gap-0")

    def show(self) -> None:
        """Show the run as it stands."""
        run = self.look.run
        self._chart.set_content(gantt(run, run.now_ms, self.look.step))
        current = [(stream, action, duration(since)) for stream, action, since, _ in run.under_way.values()]
        _fill(self._current, current)
        _fill(self._goals, sorted(run.goals.items()))
        self._chosen.clear()
        with self._chosen:
            for line in told_of(run, self.look.step):
                ui.label(line)
        self._log.clear()
        with self._log:
            for _, line in run.story[-8:]:
                ui.label(line).classes("text-caption")


def told_of(run: Watched, step: str) -> list[str]:
    """What a page tells of a step: what it waits for, what it is needed for, and what it brings."""
    steps = {each["id"]: each for each in run.plan.get("steps", ())}
    found = next((each for each in steps.values() if each["step"] == step), None)
    if found is None:
        return []
    after = [steps[each]["step"] for each in found.get("after", ()) if each in steps]
    before = [each["step"] for each in steps.values() if found["id"] in each.get("after", ())]
    lines = [f"step {found['id']}: {step}", f"device: {found['stream']}, says: {found.get('says', '')}"]
    lines += [f"waits for: {', '.join(after) or 'nothing'}", f"goes before: {', '.join(before) or 'nothing'}"]
    lines += [f"brings: {', '.join(found.get('adds', ())) or 'nothing'}"]
    return [*lines, f"holds: {', '.join(found.get('resources', ())) or 'nothing'}"]


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
        drawn = (id(run.plan), tuple(standing.items()))
        if drawn == self._drawn or not run.plan:
            return
        self._drawn = drawn
        if len(run.bars) > LARGEST:
            said = f"The plan has {len(run.bars)} steps: too many for a picture. See the steps over time."
            self._picture.set_content(said)
            return
        self._picture.set_content(svg.plan(compiled_of(run.plan).plan, standing=standing))


class World(View):
    """The facts that hold, what changed last first, with a search."""

    name = "world"

    def make(self) -> None:
        """Make what is shown, still empty."""
        self._search = ui.input("search").props('clearable dense data-testid="search"')
        self._table = _table("fact", "since record")
        self._search.on_value_change(self.show)

    def show(self) -> None:
        """Show the run as it stands."""
        run = self.look.run
        asked = self._search.value or ""
        rows = sorted(run.holds.items(), key=lambda each: (-each[1], each[0]))
        _fill(self._table, [row for row in rows if asked in row[0]])


class Diagnosis(View):
    """Each exception with its tests, the beliefs before each, and what was found."""

    name = "diagnosis"

    def make(self) -> None:
        """Make what is shown, still empty."""
        self._table = _table("at", "what", "of", "outcome", "belief")

    def show(self) -> None:
        """Show the run as it stands."""
        run = self.look.run
        _fill(self._table, [_found(each) for each in run.findings])


def _found(each: dict[str, Any]) -> tuple[str, ...]:
    belief = each.get("belief") or each.get("causes") or ()
    said = ", ".join(f"{cause} {round(100 * p)} %" for cause, p in belief[:4])
    outcome = each.get("outcome") or each.get("reply") or each.get("cured") or ""
    return (
        duration(each["at_ms"]),
        each["kind"],
        str(each.get("action") or each["exception"]),
        str(outcome),
        said,
    )


class Results(View):
    """What was measured beside its limits, and a run chart for each feature that was measured more than once."""

    name = "results"

    def make(self) -> None:
        """Make what is shown, still empty."""
        self._table = _table("of", "quantity", "value", "nominal", "from", "to", "", "at")
        self._charts = ui.row()
        self._drawn = -1

    def show(self) -> None:
        """Show the run as it stands."""
        run = self.look.run
        if len(run.results) == self._drawn:
            return
        self._drawn = len(run.results)
        _fill(self._table, [_measured(each) for each in run.results])
        features: dict[str, list[dict[str, Any]]] = defaultdict(list)
        for each in run.results:
            if "value" in each:
                features[f"{each.get('of', '')} {each.get('quantity', '')}"].append(each)
        self._charts.clear()
        with self._charts:
            for name, values in list(features.items())[:24]:
                with ui.column():
                    ui.label(name)
                    ui.html(run_chart(values), sanitize=False)


def _measured(each: dict[str, Any]) -> tuple[str, ...]:
    numbers = [each.get(key) for key in ("nominal", "lower", "upper")]
    said = ["" if value is None else f"{value:g}" for value in numbers]
    verdict = {True: "✓ passed", False: "✗ FAILED"}.get(each.get("passed"), "not judged")  # type: ignore[arg-type]
    value = f"{each['value']:g} {each.get('unit', '')}" if "value" in each else str(each.get("result", ""))
    return (
        each.get("of", each["action"]),
        each.get("quantity", ""),
        value,
        *said,
        verdict,
        duration(each["at_ms"]),
    )


class Objects(View):
    """What was done to each object."""

    name = "objects"

    def make(self) -> None:
        """Make what is shown, still empty."""
        self._search = ui.input("object").props('clearable dense data-testid="object"')
        self._table = _table("from", "to", "step", "brought")
        self._search.on_value_change(self.show)

    def show(self) -> None:
        """Show the run as it stands."""
        run = self.look.run
        asked = self._search.value or ""
        rows = [
            (
                duration(each["started_ms"]),
                duration(each["ended_ms"]),
                each["action"],
                ", ".join(each["adds"]),
            )
            for each in run.histories
            if asked in each["action"] or any(asked in fact for fact in each["adds"])
        ]
        _fill(self._table, rows)


class Log(View):
    """What the run tells, line by line."""

    name = "log"

    def make(self) -> None:
        """Make what is shown, still empty."""
        self._table = _table("record", "what")

    def show(self) -> None:
        """Show the run as it stands."""
        run = self.look.run
        _fill(self._table, run.story[::-1])


VIEWS: tuple[type[View], ...] = (Now, Cell3D, Partial, World, Diagnosis, Results, Objects, Log)


def _table(*columns: str) -> ui.table:
    """An empty table; its texts are shown as they are, never as HTML."""
    named = [
        {"name": str(n), "label": each, "field": str(n), "align": "left"} for n, each in enumerate(columns)
    ]
    return ui.table(columns=named, rows=[], row_key="key").props('dense flat no-data-label="none"')


def _fill(table: ui.table, rows: Any) -> None:
    made = [
        {"key": key, **{str(n): str(value) for n, value in enumerate(row)}}
        for key, row in enumerate(list(rows)[:SHOWN])
    ]
    if table.rows != made:
        table.rows = made
