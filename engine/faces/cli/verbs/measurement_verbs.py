"""The verbs `measurement`: measurements of a problem, and shapes fitted to measured points."""

from collections.abc import Callable
from math import hypot
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Argument, Option

from cellwright.engine.faces.cli.options.shared_options import Format, Target, number_option
from cellwright.engine.faces.cli.output.answer_output import AnswerForm, VerbAnswer, give_answer
from cellwright.engine.faces.cli.process.exit_codes import FINDINGS
from cellwright.engine.faces.cli.verbs.range_image_verbs import (
    make_range_image,
    measure_dimensions,
    recognise_parts,
)
from cellwright.engine.faces.cli.wrong_options import make_misfit
from cellwright.engine.formats import interop, report
from cellwright.engine.formats.report import rich_parts
from cellwright.engine.model.part_measurements import MeasurementPoint
from cellwright.engine.pipelines import inspection, planning

if TYPE_CHECKING:
    from cellwright.engine.model.shape_fits import Aligning, FitShape, Fitting

ShapeName = Annotated[
    str, Argument(metavar="SHAPE", help="plane, sphere, cylinder, cone or circle")
]
Points = Annotated[
    Path,
    Argument(metavar="POINTS", help="points: CSV with columns x, y, z, or .npy, .pcd, .ply"),
]
Unit = Annotated[
    str,
    Option("--unit", help="in what POINTS count: m, cm, mm or in; whole numbers in a .npy are mm"),
]
Noise = Annotated[
    float,
    Option(
        "--noise",
        min=1e-6,
        max=1e3,
        callback=number_option,
        help="standard deviation of a measured point, in millimetres",
    ),
]
Other = Annotated[
    tuple[str, str] | None,
    Option(
        "--to",
        metavar="SHAPE POINTS",
        help="fit_shape another shape, too; tell the distance and angle to it",
    ),
]
ResultsFile = Annotated[
    Path, Argument(metavar="RESULTS", help="what `results -o` has written: .csv, .json, .qif")
]
Within = Annotated[
    float | None,
    Option(
        "--within",
        min=0.0,
        callback=number_option,
        help="refuse an alignment that leaves a point less sure, in millimetres",
    ),
]
Moved = Annotated[
    Path | None, Option("--output", "-o", help="write the problem there, with its points moved")
]


# points that no shape fits, and that span more, may have been meant in another unit
SPACIOUS_M = 5.0


def fit_shape(
    shape: ShapeName,
    points: Points,
    to: Other = None,
    noise: Noise = 0.05,
    unit: Unit = "m",
    format: Format = AnswerForm.TEXT,
) -> None:
    """Fit SHAPE to measured POINTS, without those that do not belong to it, and tell how sure
    its sizes are.
    """
    asked = (
        [(_shape_named(shape), points)]
        if to is None
        else [(_shape_named(shape), points), (_shape_named(to[0]), Path(to[1]))]
    )
    give_answer(lambda: _fit_shapes(asked, noise * 1e-3, unit), format)


def _shape_named(name: str) -> "FitShape":
    from cellwright.engine.model.shape_fits import FitShape

    shape_names = [shape_kind.value for shape_kind in FitShape]
    if name not in shape_names:
        raise make_misfit(f"no shape '{name}': one of {', '.join(shape_names)}")
    return FitShape(name)


def align_part(
    target: Target,
    results: ResultsFile,
    noise: Noise = 0.05,
    within: Within = None,
    output: Moved = None,
    format: Format = AnswerForm.TEXT,
) -> None:
    """Tell where the part of TARGET lies by the profiles that were measured on it, and which of
    them are wrong.

    The points of the alignment are its datums, or all profiles if it has none. A sure answer needs
    some to spare.
    """
    give_answer(lambda: _align_part(target, results, noise * 1e-3, within, output), format)


def _fit_shapes(asked: "list[tuple[FitShape, Path]]", sigma_m: float, unit: str) -> VerbAnswer:
    import numpy as np

    from cellwright.engine.model.shape_fits import Cloud, Fit
    from cellwright.engine.stages.fitting.shape_fit import fit_measured_shape
    from cellwright.engine.stages.fitting.shape_relations import relate_fits

    metres = interop.unit_m(unit)
    clouds = [(shape, interop.read_cloud(path, metres)) for shape, path in asked]
    fittings: list[Fitting] = [
        fit_measured_shape(shape, Cloud(cloud_points, np.full(len(cloud_points), sigma_m)))
        for shape, cloud_points in clouds
    ]
    sound = [fitting for fitting in fittings if isinstance(fitting, Fit)]
    fine = len(sound) == len(fittings)
    related = relate_fits(*sound) if len(sound) == 2 else ()
    content = {
        "fits": [report.fit_entry(fitting) for fitting in fittings],
        "between": report.related_entries(related),
    }
    wide = max(
        (
            float(np.ptp(cloud_points, axis=0).max())
            for _, cloud_points in clouds
            if len(cloud_points)
        ),
        default=0.0,
    )
    unit_hint = f"\nthe points span {wide:.2g} m: if they do not count metres, say so with --unit"
    hint = unit_hint if not fine and wide > SPACIOUS_M else ""
    return VerbAnswer(
        "ok" if fine else "refused",
        content,
        lambda: report.fits_text(fittings, related).append(hint),
        0 if fine else FINDINGS,
    )


def _align_part(
    target: str, path: Path, sigma_m: float, within: float | None, output: Path | None
) -> VerbAnswer:
    from cellwright.engine.model.shape_fits import Alignment
    from cellwright.engine.stages.fitting.datum_alignment import align_by_datums, require_precision

    problem = planning.problem_of(target)
    datums = interop.datums_of(problem, interop.read_results(path), sigma_m)
    places = [point.position for point in inspection.points_of_problem(problem)]
    alignment: Aligning = require_precision(
        align_by_datums(datums), places, None if within is None else within * 1e-3
    )
    fine = isinstance(alignment, Alignment)
    moved = (
        interop.write_moved(problem, alignment.T_measured_nominal, output)
        if isinstance(alignment, Alignment) and output
        else 0
    )
    content = report.alignment_entry(alignment, datums.names, places)
    if moved:
        content |= {"file": str(output), "moved": moved}
    return VerbAnswer(
        "ok" if fine else "refused",
        content,
        lambda: report.alignment_text(
            alignment, datums.names, places, str(output) if moved else ""
        ),
        0 if fine else FINDINGS,
    )


app = typer.Typer(add_completion=False, no_args_is_help=True)
File = Annotated[Path, Argument(help="a problem file")]
Name = Annotated[str, Argument(help="the name of the measurement_group")]
At = Annotated[
    tuple[float, float, float], Option("--at", help="the position: x y z in millimetres")
]
Normal = Annotated[
    tuple[float, float, float],
    Option("--normal", help="the direction away from the material: x y z"),
]
Kind = Annotated[str, Option("--kind", help="what is measured there: profile, thickness")]
Tolerance = Annotated[
    float | None, Option("--tolerance", help="width of the tolerance zone in millimetres")
]
Nominal = Annotated[
    float | None,
    Option("--nominal", help="what the measurement_group should give_answer, in millimetres"),
]
Bore = Annotated[
    float | None, Option("--bore", help="width of the hole around the point, in millimetres")
]

Tool = Annotated[str, Option("--tool", help="the tool that is to take it, if it can")]


@app.callback()
def measurement_group() -> None:
    """List and change the measurements of a problem, and see what was measured: shapes through
    points, and where the part lies.
    """


@app.command("list")
def list_measurements(target: Target, format: Format = AnswerForm.TEXT) -> None:
    """List the measurements of TARGET: by tool, those that are done, and those that are
    impossible, with the reason.
    """
    give_answer(lambda: _list_measurements(target), format)


def _writing_command(how: str, says: str) -> Callable[..., None]:
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
        format: Format = AnswerForm.TEXT,
    ) -> None:
        point = _measurement_point(name, at, normal, kind, (tolerance, bore, nominal), tool)
        give_answer(lambda: _change_measurements(file, how, point), format)

    write.__doc__ = says
    return write


app.command("add")(
    _writing_command("added", "Add the measurement NAME, and a goal for it, to the problem FILE.")
)
app.command("edit")(
    _writing_command(
        "replaced",
        "Change the position, kind, nominal value, tolerance, bore and tool of the measurement "
        "NAME in the problem FILE.",
    )
)


app.command("fit")(fit_shape)
app.command("align")(align_part)
app.command("image")(make_range_image)
app.command("dimensions")(measure_dimensions)
app.command("recognise")(recognise_parts)


@app.command()
def remove(file: File, name: Name, format: Format = AnswerForm.TEXT) -> None:
    """Remove the measurement NAME and everything about it from the problem FILE."""
    give_answer(lambda: _change_measurements(file, "removed", name), format)


def _list_measurements(target: str) -> VerbAnswer:
    divided_points = inspection.partition_for_arms(
        inspection.with_places(planning.problem_of(target))
    )
    rows = [(name, tool, "") for tool, names in divided_points.groups.items() for name in names]
    rows += [(name, "done", "") for name in divided_points.done]
    rows += [(name, "-", reason) for name, reason in divided_points.impossible.items()]
    width = 3 if divided_points.impossible else 2  # a column of reasons, if there are any
    table = report.TextTable(("measurement", "by", "reason")[:width], [row[:width] for row in rows])
    return VerbAnswer(
        "ok",
        report.tool_groups_entry(divided_points),
        lambda: rich_parts.Group(table, report.tool_groups_text(divided_points)),
    )


def _measurement_point(
    name: str,
    at: tuple[float, float, float],
    normal: tuple[float, float, float],
    kind: str,
    sizes: tuple[float | None, float | None, float | None],
    tool: str,
) -> "MeasurementPoint":
    length = hypot(*normal)
    if not length:
        raise make_misfit("the normal has no length")
    tolerance, bore, wanted = (None if size is None else size * 1e-3 for size in sizes)
    place = (at[0] * 1e-3, at[1] * 1e-3, at[2] * 1e-3)
    unit = (normal[0] / length, normal[1] / length, normal[2] / length)
    return MeasurementPoint(
        name, name, kind, place, unit, tolerance, bore, nominal_m=wanted, tool=tool
    )


def _change_measurements(file: Path, how: str, what: "MeasurementPoint | str") -> VerbAnswer:
    """Change the lines of a file, and write them if the changed file can still be read."""
    interop.edit_measurements(file, how, [what])
    name = what.name if isinstance(what, MeasurementPoint) else what
    return VerbAnswer(
        "ok", {"file": str(file), how: name}, lambda: rich_parts.Text(f"{name} {how} in {file}")
    )
