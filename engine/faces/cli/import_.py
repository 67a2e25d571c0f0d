"""`cellwright import`: make problems from files of other systems."""

from pathlib import Path
from typing import Annotated

import typer

from engine.faces.cli.answers import Answer, Form, give
from engine.faces.cli.options import Format, refuse_idle

app = typer.Typer(add_completion=False, no_args_is_help=True)


@app.callback()
def import_() -> None:
    """Make problems from files of other systems."""


@app.command()
def qif(
    file: Annotated[Path, typer.Argument(help="a QIF 3.0 document, or a CSV table of points")],
    output: Annotated[
        Path | None, typer.Option(help="the problem file to write; FILE.yaml if not given")
    ] = None,
    domain: Annotated[
        str, typer.Option(help="a domain that chooses tools, by path or bundled name")
    ] = "bulkhead",
    unit: Annotated[str, typer.Option(help="the unit of a CSV table: mm (if not given), m or in")] = "",
    format: Format = Form.TEXT,
) -> None:
    """Write a problem with the points at which the features of FILE are measured."""
    if file.suffix.lower() != ".csv":
        refuse_idle({"--unit": unit}, "on a QIF document, which states its own units")
    give(lambda: _qif(file, output, domain, unit or "mm"), format)


def _qif(file: Path, output: Path | None, domain: str, unit: str) -> Answer:
    from engine.formats.interop.inspections import import_file
    from engine.formats.report.inspection import entry, parts

    inspection, partition, text = import_file(file, domain, unit)
    target = output or Path(f"{file.stem}.yaml")
    _write(target, text)
    content = {"file": str(target), "features": inspection.features, "points": len(inspection.points)}
    return Answer(
        "ok",
        {**content, **entry(partition)},
        lambda: parts(partition, f"{target}: {inspection.features} features"),
    )


def _write(target: Path, text: str) -> None:
    from kb.diagnostics import Diagnostic, InvalidInput, Source

    try:
        target.write_text(text, "utf-8")
    except OSError as error:
        said = f"cannot be written: {(error.strerror or str(error)).lower()}"
        raise InvalidInput([Diagnostic(Source(str(target)), "K415", said)]) from None
