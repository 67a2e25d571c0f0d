"""`cellwright measurement`: list and change the measurements of a problem."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cellwright.engine.faces.cli.answers import Answer, Form, give
from cellwright.engine.faces.cli.declared import Argument, Option, misfit
from cellwright.engine.faces.cli.dimensions import dimensions
from cellwright.engine.faces.cli.fitting import align, fit
from cellwright.engine.faces.cli.imaging import image, recognise
from cellwright.engine.faces.cli.options import Format, Target

if TYPE_CHECKING:
    from cellwright.engine.model.measurement import MeasurementPoint

app = typer.Typer(add_completion=False, no_args_is_help=True)
File = Annotated[Path, Argument(help="a problem file")]
Name = Annotated[str, Argument(help="the name of the measurement")]
At = Annotated[tuple[float, float, float], Option("--at", help="the position: x y z in millimetres")]
Normal = Annotated[
    tuple[float, float, float], Option("--normal", help="the direction away from the material: x y z")
]
Kind = Annotated[str, Option("--kind", help="what is measured there: profile, thickness")]
Tolerance = Annotated[float | None, Option("--tolerance", help="width of the tolerance zone in millimetres")]
Nominal = Annotated[
    float | None, Option("--nominal", help="what the measurement should give, in millimetres")
]
Bore = Annotated[float | None, Option("--bore", help="width of the hole around the point, in millimetres")]

Tool = Annotated[str, Option("--tool", help="the tool that is to take it, if it can")]


@app.callback()
def measurement() -> None:
    """List and change the measurements of a problem, and see what was measured: shapes through points, and where the part lies."""


@app.command("list")
def list_(target: Target, format: Format = Form.TEXT) -> None:
    """List the measurements of TARGET: by tool, those that are done, and those that are impossible, with the reason."""
    give(lambda: _list(target), format)


def _writing(how: str, says: str) -> Callable[..., None]:
    """A command that writes a measurement with all its details into a file."""

    def write(
        file: File,
        name: Name,
        at: At,
        normal: Normal = (0.0, 0.0, 1.0),
        kind: Kind = "profile",
        tolerance: Tolerance = None,
        bore: Bore = None,
        nominal: Nominal = None,
        tool: Tool = "",
        format: Format = Form.TEXT,
    ) -> None:
        point = _point(name, at, normal, kind, (tolerance, bore, nominal), tool)
        give(lambda: _change(file, how, point), format)

    write.__doc__ = says
    return write


app.command("add")(_writing("added", "Add the measurement NAME, and a goal for it, to the problem FILE."))
app.command("edit")(
    _writing(
        "replaced",
        "Change the position, kind, nominal value, tolerance, bore and tool of the measurement NAME in the problem FILE.",
    )
)


app.command("fit")(fit)
app.command("align")(align)
app.command("image")(image)
app.command("dimensions")(dimensions)
app.command("recognise")(recognise)


@app.command()
def remove(file: File, name: Name, format: Format = Form.TEXT) -> None:
    """Remove the measurement NAME and everything about it from the problem FILE."""
    give(lambda: _change(file, "removed", name), format)


def _list(target: str) -> Answer:
    from rich.console import Group

    from cellwright.engine.formats.report.inspection import entry, parts
    from cellwright.engine.formats.report.rows import TextTable
    from cellwright.engine.pipelines.inspection.arms import divided
    from cellwright.engine.pipelines.planning import problem_of
    from cellwright.engine.pipelines.points import with_places

    found = divided(with_places(problem_of(target)))
    rows = [(name, tool, "") for tool, names in found.groups.items() for name in names]
    rows += [(name, "done", "") for name in found.done]
    rows += [(name, "-", reason) for name, reason in found.impossible.items()]
    width = 3 if found.impossible else 2  # a column of reasons, if there are any
    table = TextTable(("measurement", "by", "reason")[:width], [row[:width] for row in rows])
    return Answer("ok", entry(found), lambda: Group(table, parts(found)))


def _point(
    name: str,
    at: tuple[float, float, float],
    normal: tuple[float, float, float],
    kind: str,
    sizes: tuple[float | None, float | None, float | None],
    tool: str,
) -> "MeasurementPoint":
    from math import hypot

    from cellwright.engine.model.measurement import MeasurementPoint

    length = hypot(*normal)
    if not length:
        raise misfit("the normal has no length")
    tolerance, bore, wanted = (None if each is None else each * 1e-3 for each in sizes)
    place = (at[0] * 1e-3, at[1] * 1e-3, at[2] * 1e-3)
    unit = (normal[0] / length, normal[1] / length, normal[2] / length)
    return MeasurementPoint(name, name, kind, place, unit, tolerance, bore, nominal_m=wanted, tool=tool)


def _change(file: Path, how: str, what: "MeasurementPoint | str") -> Answer:
    """Change the lines of a file, and write them if the changed file can still be read."""
    from rich.text import Text

    from cellwright.engine.formats.interop.inspections import rewrite
    from cellwright.engine.model.measurement import MeasurementPoint

    rewrite(file, how, [what])
    name = what.name if isinstance(what, MeasurementPoint) else what
    return Answer("ok", {"file": str(file), how: name}, lambda: Text(f"{name} {how} in {file}"))
