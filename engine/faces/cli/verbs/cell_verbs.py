"""The verbs `cell`: pictures of the geometry of a cell."""

from enum import StrEnum
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Option

from cellwright.engine.faces.cli.options.shared_options import Target, number_option
from cellwright.engine.faces.cli.output.answer_output import AnswerForm, VerbAnswer, give_answer
from cellwright.engine.faces.cli.wrong_options import refuse_idle
from cellwright.engine.formats.report import rich_parts
from cellwright.engine.pipelines import planning
from cellwright.engine.plugins import geometry_backend
from cellwright.kb import loader
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, escape_controls

if TYPE_CHECKING:
    from cellwright.engine.stages.geometry.pictures.cell_view import CellView

app = typer.Typer(add_completion=False, no_args_is_help=True)


class PictureForm(StrEnum):
    """The forms in which a cell is shown."""

    TEXT = "text"
    JSON = "json"
    PNG = "png"
    SVG = "svg"
    GLTF = "gltf"


Configurations = Annotated[
    list[str] | None,
    Option(
        "--configuration",
        help='joint values in degrees and metres: "0, 90, 0, 0, 45, 0" or "ARM: ..."',
    ),
]
AtPlace = Annotated[str, Option("--place", help="show the arm at this place")]
Output = Annotated[Path | None, Option("--output", "-o", help="the file to write; a PNG needs one")]
AZIMUTH, ELEVATION = -60.0, 28.0
Azimuth = Annotated[
    float | None,
    Option(
        min=-360,
        max=360,
        callback=number_option,
        help="the direction of view: degrees about z, counted from the x axis; -60 if not given",
    ),
]
Elevation = Annotated[
    float | None,
    Option(
        min=-90,
        max=90,
        callback=number_option,
        help="the height of the viewpoint, in degrees above the horizon; 28 if not given",
    ),
]


@app.callback()
def cell_group() -> None:
    """Look at the geometry of a cell."""


@app.command()
def show(
    target: Target,
    configuration: Configurations = None,
    place: AtPlace = "",
    format: Annotated[
        PictureForm | None,
        Option("--format", help="how it is shown; else as the name of the output ends"),
    ] = None,
    output: Output = None,
    azimuth: Azimuth = None,
    elevation: Elevation = None,
) -> None:
    """Show the cell of TARGET at the start of its problem, with the arms in a configuration;
    mark collisions.
    """
    kind = format or _kind_of(output)
    form = AnswerForm.JSON if kind is PictureForm.JSON else AnswerForm.TEXT
    if kind in (PictureForm.JSON, PictureForm.TEXT):
        refuse_idle(
            {"--output": output}, "without a picture: let its name end in .png, .svg or .gltf"
        )
    if kind not in (PictureForm.PNG, PictureForm.SVG):
        turned = {"--azimuth": azimuth is not None, "--elevation": elevation is not None}
        refuse_idle(turned, "without an image: give --format png or svg")
    seen = (AZIMUTH if azimuth is None else azimuth, ELEVATION if elevation is None else elevation)
    give_answer(lambda: _show_cell(target, configuration or [], place, kind, output, seen), form)


def _kind_of(output: Path | None) -> PictureForm:
    """The kind of picture that the name of a file asks for."""
    ending = output.suffix.lower().removeprefix(".") if output else ""
    return PictureForm(ending) if ending in ("png", "svg", "gltf") else PictureForm.TEXT


def _show_cell(
    target: str,
    configurations: list[str],
    place: str,
    kind: PictureForm,
    output: Path | None,
    seen: tuple[float, float],
) -> VerbAnswer:
    from cellwright.engine.stages.geometry.pictures import cell_view

    facts = planning.initial_facts(target)
    shown = cell_view.cell_view_of(
        loader.cell_of(target), geometry_backend(), configurations, place, facts
    )
    content, shown_text = cell_view.view_content(shown), cell_view.view_text(shown)
    drawn = _draw_cell(shown, kind, seen)
    if drawn is None:
        return VerbAnswer("ok", content, lambda: rich_parts.Text(shown_text))
    if output is None:
        return VerbAnswer("ok", raw=_as_text(drawn))
    output.write_bytes(
        drawn if isinstance(drawn, bytes) else escape_controls(drawn).encode("utf-8")
    )
    return VerbAnswer("ok", content, lambda: rich_parts.Text(f"{shown_text}\n{output}"))


def _draw_cell(
    shown: "CellView", kind: PictureForm, seen: tuple[float, float]
) -> str | bytes | None:
    from cellwright.engine.stages.geometry.pictures import cell_view

    azimuth, elevation = map(radians, seen)
    match kind:
        case PictureForm.PNG:
            return cell_view.view_as_png(shown, azimuth, elevation)
        case PictureForm.SVG:
            return cell_view.view_as_svg(shown, azimuth, elevation)
        case PictureForm.GLTF:
            return cell_view.view_as_gltf(shown)
        case _:
            return None


def _as_text(drawn: str | bytes) -> str:
    """A picture for standard output. Raises `InvalidInput` for a picture that is not text."""
    if isinstance(drawn, bytes):
        hint = "give --output FILE, or --format svg"
        raise InvalidInput([Diagnostic(Source("--format"), "K403", "a PNG is not text", hint)])
    return drawn
