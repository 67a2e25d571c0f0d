"""`cellwright results`: what a run has measured, and what it did to each object."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cellwright.engine.faces.cli import completion
from cellwright.engine.faces.cli.answers import Answer, Form, give
from cellwright.engine.faces.cli.declared import Argument, Option, misfit
from cellwright.engine.faces.cli.options import Format
from cellwright.engine.faces.cli.run import Store
from cellwright.kb.store.own import default_store

if TYPE_CHECKING:
    from cellwright.engine.formats.interop.results import ResultForm

RunName = Annotated[
    str,
    Argument(
        metavar="[RUN]",
        help="the name of a run; without it, all runs are listed",
        autocompletion=completion.runs,
    ),
]
Output = Annotated[
    Path | None,
    Option(
        "--output",
        "-o",
        metavar="FILE",
        help="write them there: FILE.csv, FILE.json, FILE.qif, or a report FILE.html",
    ),
]


History = Annotated[
    bool,
    Option("--history", help="show the histories of all objects, not those alone that are processed"),
]


def results(
    run: RunName = "",
    store: Store = "",
    output: Output = None,
    history: History = False,
    format: Format = Form.TEXT,
) -> None:
    """Show what RUN has measured, and the history of each object; or write it as CSV, JSON, QIF Results or a report in HTML."""
    if output is not None and not run:
        raise misfit("--output needs the name of a run")
    give(lambda: _told(run, store or default_store(), output, history), format)


def _told(run: str, store: str, output: Path | None, history: bool) -> Answer:
    return _results(run, store, output, history) if run else _runs(store)


def _results(run: str, store: str, output: Path | None, history: bool) -> Answer:
    from rich.text import Text

    from cellwright.engine.formats.interop.results import written
    from cellwright.engine.pipelines.results import results_of

    if output is None:
        return _shown(run, store, history)
    if output.suffix.lower() == ".html":
        return _report(run, store, output)
    form = _form(output)
    found = results_of(store, run)
    output.write_bytes(written(found, form).encode("utf-8"))
    content = {"file": str(output), "measured": len(found.measured)}
    said = str(output) if found.measured else f"{output}: nothing was measured"
    return Answer("ok", content, lambda: Text(said))


def _shown(run: str, store: str, history: bool) -> Answer:
    """The results, and what they show of the part."""
    from rich.console import Group

    from cellwright.engine.formats.interop.results.notation import entry
    from cellwright.engine.formats.report import results as report
    from cellwright.engine.formats.report import survey as surveys
    from cellwright.engine.pipelines.results import survey_of

    told = survey_of(store, run)
    found, survey = told.results, told.survey
    content = entry(found) | ({} if survey is None else {"survey": surveys.entry(survey)})
    more = [] if survey is None else ["", surveys.text(survey)]
    subjects = None if history else told.subjects
    return Answer("ok", content, lambda: Group(report.text(found, subjects), *more))


def _report(run: str, store: str, output: Path) -> Answer:
    """The report of an inspection in HTML."""
    from rich.text import Text

    from cellwright.engine.formats.report.survey_html import document
    from cellwright.engine.pipelines.results import survey_of
    from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source

    told = survey_of(store, run)
    if told.survey is None:
        hint = "write FILE.json: it has the history of each object"
        raise InvalidInput([Diagnostic(Source(run), "K406", "the run has measured nothing to report", hint)])
    output.write_text(document(told.results, told.survey), "utf-8")
    content = {"file": str(output), "features": len(told.survey.features)}
    return Answer("ok", content, lambda: Text(str(output)))


def _form(output: Path) -> "ResultForm":
    from cellwright.engine.formats.interop.results import ResultForm as Forms
    from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source

    known = [each.value for each in Forms]
    if output.suffix[1:].lower() not in known:
        hint = f"one of {', '.join(f'{output.stem}.{each}' for each in (*known, 'html'))}"
        raise InvalidInput([Diagnostic(Source(str(output)), "K406", "results have no such form", hint)])
    return Forms(output.suffix[1:].lower())


def _runs(store: str) -> Answer:
    from rich.text import Text

    from cellwright.engine.formats.report.rows import TextTable
    from cellwright.engine.pipelines.results import runs_in

    found = runs_in(store)
    content = {"runs": [{"run": each.run, "begun": each.begun, **each.document} for each in found]}
    rows = [(each.run, each.begun, str(each.document.get("target", ""))) for each in found]
    table = TextTable(("run", "begun", "target"), rows)
    return Answer("ok", content, lambda: table if rows else Text(f"no runs in {store}"))
