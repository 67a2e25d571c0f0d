"""The verb `results`: what a run has measured, and what it did to each object."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from cellwright.engine.faces.cli.options import shared_options
from cellwright.engine.faces.cli.options.shared_options import Format
from cellwright.engine.faces.cli.output.answer_output import AnswerForm, VerbAnswer, give_answer
from cellwright.engine.faces.cli.verbs.run_verbs import Store
from cellwright.engine.faces.cli.wrong_options import make_misfit
from cellwright.engine.formats import interop, report
from cellwright.engine.formats.report import rich_parts
from cellwright.engine.pipelines import execution
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.store.default_path import default_store

if TYPE_CHECKING:
    from cellwright.engine.formats.interop.results import ResultForm

RunName = Annotated[
    str,
    Argument(
        metavar="[RUN]",
        help="the name of a run; without it, all runs are listed",
        autocompletion=shared_options.complete_runs,
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
    Option(
        "--history", help="show the histories of all objects, not those alone that are processed"
    ),
]


def show_results(
    run: RunName = "",
    store: Store = "",
    output: Output = None,
    history: History = False,
    format: Format = AnswerForm.TEXT,
) -> None:
    """Show what RUN has measured, and the history of each object; or write it as CSV, JSON, QIF
    Results or a report in HTML.
    """
    if output is not None and not run:
        raise make_misfit("--output needs the name of a run")
    give_answer(lambda: _results_answer(run, store or default_store(), output, history), format)


def _results_answer(run: str, store: str, output: Path | None, history: bool) -> VerbAnswer:
    return _write_results(run, store, output, history) if run else _list_runs(store)


def _write_results(run: str, store: str, output: Path | None, history: bool) -> VerbAnswer:
    if output is None:
        return _show_results(run, store, history)
    if output.suffix.lower() == ".html":
        return _write_report(run, store, output)
    form = _result_form(output)
    run_results = execution.results_of(store, run)
    output.write_bytes(interop.write_results(run_results, form).encode("utf-8"))
    content = {"file": str(output), "measured": len(run_results.measured)}
    written_text = str(output) if run_results.measured else f"{output}: nothing was measured"
    return VerbAnswer("ok", content, lambda: rich_parts.Text(written_text))


def _show_results(run: str, store: str, history: bool) -> VerbAnswer:
    """The results, and what they show of the part."""
    survey_answer = execution.survey_of(store, run)
    run_results, survey = survey_answer.results, survey_answer.survey
    content = interop.results_entry(run_results) | (
        {} if survey is None else {"survey": report.survey_entry(survey)}
    )
    more = [] if survey is None else ["", report.survey_text(survey)]
    subjects = None if history else survey_answer.subjects
    return VerbAnswer(
        "ok", content, lambda: rich_parts.Group(report.results_text(run_results, subjects), *more)
    )


def _write_report(run: str, store: str, output: Path) -> VerbAnswer:
    """The report of an inspection in HTML."""
    survey_answer = execution.survey_of(store, run)
    if survey_answer.survey is None:
        hint = "write FILE.json: it has the history of each object"
        raise InvalidInput(
            [Diagnostic(Source(run), "K406", "the run has measured nothing to report", hint)]
        )
    output.write_text(report.survey_html(survey_answer.results, survey_answer.survey), "utf-8")
    content = {"file": str(output), "features": len(survey_answer.survey.features)}
    return VerbAnswer("ok", content, lambda: rich_parts.Text(str(output)))


def _result_form(output: Path) -> "ResultForm":
    form_names = [form.value for form in interop.ResultForm]
    if output.suffix[1:].lower() not in form_names:
        hint = (
            "one of "
            f"{', '.join(f'{output.stem}.{form_name}' for form_name in (*form_names, 'html'))}"
        )
        raise InvalidInput(
            [Diagnostic(Source(str(output)), "K406", "results have no such form", hint)]
        )
    return interop.ResultForm(output.suffix[1:].lower())


def _list_runs(store: str) -> VerbAnswer:
    journal_runs = execution.runs_in(store)
    content = {
        "runs": [
            {"run": journal_run.run, "begun": journal_run.begun, **journal_run.document}
            for journal_run in journal_runs
        ]
    }
    rows = [
        (journal_run.run, journal_run.begun, str(journal_run.document.get("target", "")))
        for journal_run in journal_runs
    ]
    table = report.TextTable(("run", "begun", "target"), rows)
    return VerbAnswer(
        "ok", content, lambda: table if rows else rich_parts.Text(f"no runs in {store}")
    )
