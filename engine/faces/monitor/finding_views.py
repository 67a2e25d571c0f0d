"""Views of a run's findings: measurement order, exceptions with diagnosis, and results."""

import asyncio
from collections import defaultdict
from typing import Any

from nicegui import ui

from cellwright.engine.faces.monitor.background_answers import (
    exception_tree_svg,
    pickable_picture,
    sequence_picture,
)
from cellwright.engine.faces.monitor.chosen_item import related_texts
from cellwright.engine.faces.monitor.run_charts import belief_chart, run_chart
from cellwright.engine.faces.monitor.view_base import RunView, dark_picture, fill_table, make_table
from cellwright.engine.formats.interop.results import ResultForm, write_results
from cellwright.engine.formats.report.runs.run_report import duration_text
from cellwright.engine.pipelines.execution.run_results import results_of


class SequenceView(RunView):
    """The order of the measurements on the part."""

    name = "sequence"

    def make(self) -> None:
        """Make what is shown, still empty."""
        self._picture = ui.html("", sanitize=False).props('data-testid="sequence"')
        self._drawn: object = None

    def show(self) -> None:
        """Show the run as it stands."""
        plan, chosen = self.look.run.plan, self.look.step
        if (id(plan), chosen) == self._drawn:
            return
        self._drawn = id(plan), chosen
        made_ = sequence_picture(self.look.shared.target(self.look.run.run), plan) if plan else None
        said = "This plan measures nothing whose place is known."
        self._picture.set_content(dark_picture(pickable_picture(made_, chosen) if made_ else said))


class DiagnosisView(RunView):
    """Each exception with its tests, the beliefs before each, and what was found."""

    name = "diagnosis"

    def make(self) -> None:
        """Make what is shown, still empty."""
        self._table = make_table(
            self.look.choose, "at", "what", "of", "outcome", "belief before it"
        )
        button = ui.button("Decision tree of the last exception", on_click=self._tree)
        button.props('dense no-caps outline data-testid="tree"')
        self._picture = ui.html("", sanitize=False).props('data-testid="decision-tree"')
        self._beliefs = ui.row()
        self._drawn = -1

    def show(self) -> None:
        """Show the run as it stands."""
        run = self.look.run
        fill_table(
            self._table,
            [_finding_row(finding) for finding in run.findings],
            related_texts(run, self.look.step),
        )
        if len(run.findings) == self._drawn:
            return
        self._drawn = len(run.findings)
        self._beliefs.clear()
        with self._beliefs:
            for name, findings in list(_by_exception(run.findings))[-4:]:
                with ui.column().classes("gap-0"):
                    ui.label(f"{name}: beliefs, test by test")
                    ui.html(belief_chart(findings), sanitize=False).props('data-testid="beliefs"')

    async def _tree(self) -> None:
        """Show the tree of the last exception."""
        cases = [finding for finding in self.look.run.findings if finding["kind"] == "exception"]
        if not cases:
            self._picture.set_content("There was no exception.")
            return
        last = cases[-1]
        target = self.look.shared.target(self.look.run.run)[0]
        asked = self.look.shared.workers.submit(
            exception_tree_svg, target, last["exception"], last["action"]
        )
        self._picture.set_content("Looking for the cheapest tests ...")
        self._picture.set_content(dark_picture(await asyncio.wrap_future(asked)))


def _by_exception(findings: list[dict[str, Any]]) -> list[tuple[str, list[dict[str, Any]]]]:
    """The findings of each exception, one after the other; only what has beliefs."""
    cases: list[tuple[str, list[dict[str, Any]]]] = []
    for case_finding in findings:
        if case_finding["kind"] == "exception":
            cases.append((str(case_finding["exception"]), []))
        elif cases and (case_finding.get("belief") or case_finding.get("causes")):
            cases[-1][1].append(case_finding)
    return [case for case in cases if case[1]]


def _finding_row(each: dict[str, Any]) -> tuple[str, ...]:
    belief = each.get("belief") or each.get("causes") or ()
    said = ", ".join(f"{cause} {round(100 * p)} %" for cause, p in belief[:4])
    outcome = each.get("outcome") or each.get("reply") or each.get("cured") or ""
    return (
        duration_text(each["at_ms"]),
        each["kind"],
        str(each.get("action") or each["exception"]),
        str(outcome),
        said,
    )


class ResultsView(RunView):
    """What was measured beside its limits, and a run chart for each feature that was measured
    more than once.
    """

    name = "results"

    def make(self) -> None:
        """Make what is shown, still empty."""
        with ui.row():
            for form in ResultForm:
                button = ui.button(
                    f"Save as {form.value}", on_click=lambda _, form=form: self._save(form)
                )
                button.props(f'dense no-caps outline data-testid="save-{form.value}"')
        self._table = make_table(
            self.look.choose, "of", "quantity", "value", "nominal", "from", "to", "", "at"
        )
        self._none = ui.label(
            "nothing was measured yet; what was done to each object is told by `objects`"
        )
        self._charts = ui.row()
        self._drawn: tuple[object, ...] = ()

    def show(self) -> None:
        """Show the run as it stands."""
        run = self.look.run
        drawn = (len(run.results), self.look.step)
        if drawn == self._drawn:
            return
        self._drawn = drawn
        fill_table(
            self._table,
            [_result_row(measured) for measured in run.results],
            related_texts(run, self.look.step),
        )
        self._none.set_visibility(not run.results)
        features: dict[str, list[dict[str, Any]]] = defaultdict(list)
        for measured in run.results:
            if "value" in measured:
                features[f"{measured.get('of', '')} {measured.get('quantity', '')}"].append(
                    measured
                )
        self._charts.clear()
        with self._charts:
            for name, values in list(features.items())[:24]:
                with ui.column():
                    ui.label(name)
                    ui.html(run_chart(values), sanitize=False)

    async def _save(self, form: ResultForm) -> None:
        """Give the results of the whole run to the browser as a file."""
        run = self.look.run.run
        results = await asyncio.to_thread(results_of, self.look.shared.store, run)
        ui.download.content(write_results(results, form), f"{run}.{form.value}")


def _result_row(each: dict[str, Any]) -> tuple[str, ...]:
    numbers = [each.get(key) for key in ("nominal", "lower", "upper")]
    said = ["" if value is None else f"{value:g}" for value in numbers]
    verdict = {True: "✓ passed", False: "✗ FAILED"}.get(each.get("passed"), "not judged")  # type: ignore[arg-type]
    value = (
        f"{each['value']:g} {each.get('unit', '')}"
        if "value" in each
        else str(each.get("result", ""))
    )
    return (
        each.get("of", each["action"]),
        each.get("quantity", ""),
        value,
        *said,
        verdict,
        duration_text(each["at_ms"]),
    )
