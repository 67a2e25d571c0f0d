"""The verbs `import`: problems made from files of other systems."""

from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from cellwright.engine.faces.cli.options.shared_options import Format, number_option
from cellwright.engine.faces.cli.output.answer_output import AnswerForm, VerbAnswer, give_answer
from cellwright.engine.faces.cli.wrong_options import refuse_idle
from cellwright.engine.formats import interop, report
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source

app = typer.Typer(add_completion=False, no_args_is_help=True)


@app.callback()
def import_group() -> None:
    """Make problems from files of other systems."""


Output = Annotated[
    Path | None, Option("--output", "-o", help="the problem file to write; FILE.yaml if not given")
]
Domain = Annotated[str, Option(help="a domain that chooses tools, by path or bundled name")]


@app.command()
def qif(
    file: Annotated[Path, Argument(help="a QIF document, or a CSV table of points")],
    output: Output = None,
    domain: Domain = "bulkhead",
    unit: Annotated[
        str,
        Option(
            help="mm, cm, m or in: the unit of --edge-distance, and of a file that names no unit"
        ),
    ] = "mm",
    edge_distance: Annotated[
        float | None,
        Option(
            min=0, callback=number_option, help="how far points on faces stay away from their edges"
        ),
    ] = None,
    format: Format = AnswerForm.TEXT,
) -> None:
    """Write a problem with the points at which the features of FILE are measured."""
    if file.suffix.lower() == ".csv":
        refuse_idle(
            {"--edge-distance": edge_distance is not None},
            "on a table, which says where its points are",
        )
    give_answer(lambda: _import_points(file, output, domain, unit, edge_distance), format)


@app.command()
def csv(
    file: Annotated[Path, Argument(help="a CSV table of points")],
    output: Output = None,
    domain: Domain = "bulkhead",
    unit: Annotated[
        str, Option(help="the unit of the lengths in the table: mm, cm, m or in")
    ] = "mm",
    format: Format = AnswerForm.TEXT,
) -> None:
    """Write a problem with the points of a table."""
    give_answer(lambda: _import_points(file, output, domain, unit, None, table=True), format)


def _import_points(
    file: Path, output: Path | None, domain: str, unit: str, edge: float | None, table: bool = False
) -> VerbAnswer:
    inspection, partition, text = interop.import_file(file, domain, unit, edge, table)
    target = output or Path(f"{file.stem}.yaml")
    _write_problem(target, text)
    content = {
        "file": str(target),
        "features": inspection.features,
        "points": len(inspection.points),
    }
    return VerbAnswer(
        "ok",
        {**content, **report.tool_groups_entry(partition)},
        lambda: report.tool_groups_text(
            partition, f"{target}: {inspection.features} features, {len(inspection.points)} points"
        ),
        diagnostics=interop.inspection_remarks(inspection, file),
    )


def _write_problem(target: Path, text: str) -> None:
    try:
        target.write_text(text, "utf-8")
    except OSError as error:
        message = f"cannot be written: {(error.strerror or str(error)).lower()}"
        raise InvalidInput([Diagnostic(Source(str(target)), "K415", message)]) from None
