"""`cellwright measurement fit` and `align`: shapes through measured points, and where a part lies by what was measured on it."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cellwright.engine.faces.cli.answers import Answer, Form, give
from cellwright.engine.faces.cli.declared import Argument, Option, misfit
from cellwright.engine.faces.cli.exits import FINDINGS
from cellwright.engine.faces.cli.options import Format, Target, number

if TYPE_CHECKING:
    from cellwright.engine.model.fits import Aligning, Fitting, Shape

ShapeName = Annotated[str, Argument(metavar="SHAPE", help="plane, sphere, cylinder, cone or circle")]
Points = Annotated[
    Path,
    Argument(metavar="POINTS", help="points: CSV with columns x, y, z, or .npy, .pcd, .ply"),
]
Unit = Annotated[
    str, Option("--unit", help="in what POINTS count: m, cm, mm or in; whole numbers in a .npy are mm")
]
Noise = Annotated[
    float,
    Option(
        "--noise",
        min=1e-6,
        max=1e3,
        callback=number,
        help="standard deviation of a measured point, in millimetres",
    ),
]
Other = Annotated[
    tuple[str, str] | None,
    Option("--to", metavar="SHAPE POINTS", help="fit another shape, too; tell the distance and angle to it"),
]
ResultsFile = Annotated[
    Path, Argument(metavar="RESULTS", help="what `results -o` has written: .csv, .json, .qif")
]
Within = Annotated[
    float | None,
    Option(
        "--within",
        min=0.0,
        callback=number,
        help="refuse an alignment that leaves a point less sure, in millimetres",
    ),
]
Moved = Annotated[
    Path | None, Option("--output", "-o", help="write the problem there, with its points moved")
]


SPACIOUS_M = 5.0  # points that no shape fits, and that span more, may have been meant in another unit


def fit(
    shape: ShapeName,
    points: Points,
    to: Other = None,
    noise: Noise = 0.05,
    unit: Unit = "m",
    format: Format = Form.TEXT,
) -> None:
    """Fit SHAPE to measured POINTS, without those that do not belong to it, and tell how sure its sizes are."""
    asked = (
        [(_shape(shape), points)] if to is None else [(_shape(shape), points), (_shape(to[0]), Path(to[1]))]
    )
    give(lambda: _fit(asked, noise * 1e-3, unit), format)


def _shape(name: str) -> "Shape":
    from cellwright.engine.model.fits import Shape

    known = [each.value for each in Shape]
    if name not in known:
        raise misfit(f"no shape '{name}': one of {', '.join(known)}")
    return Shape(name)


def align(
    target: Target,
    results: ResultsFile,
    noise: Noise = 0.05,
    within: Within = None,
    output: Moved = None,
    format: Format = Form.TEXT,
) -> None:
    """Tell where the part of TARGET lies by the profiles that were measured on it, and which of them are wrong.

    The points of the alignment are its datums, or all profiles if it has none. A sure answer needs some to spare.
    """
    give(lambda: _align(target, results, noise * 1e-3, within, output), format)


def _fit(asked: "list[tuple[Shape, Path]]", sigma_m: float, unit: str) -> Answer:
    import numpy as np

    from cellwright.engine.formats.interop.depth_files import read_cloud
    from cellwright.engine.formats.interop.tables import unit_m
    from cellwright.engine.formats.report import fits
    from cellwright.engine.model.fits import Cloud, Fit
    from cellwright.engine.stages.fitting.between import between
    from cellwright.engine.stages.fitting.surfaces import fitted

    metres = unit_m(unit)
    clouds = [(shape, read_cloud(path, metres)) for shape, path in asked]
    found: list[Fitting] = [fitted(shape, Cloud(each, np.full(len(each), sigma_m))) for shape, each in clouds]
    sound = [each for each in found if isinstance(each, Fit)]
    fine = len(sound) == len(found)
    related = between(*sound) if len(sound) == 2 else ()
    content = {"fits": [fits.entry(each) for each in found], "between": fits.related(related)}
    wide = max((float(np.ptp(each, axis=0).max()) for _, each in clouds if len(each)), default=0.0)
    told = f"\nthe points span {wide:.2g} m: if they do not count metres, say so with --unit"
    hint = told if not fine and wide > SPACIOUS_M else ""
    return Answer(
        "ok" if fine else "refused",
        content,
        lambda: fits.text(found, related).append(hint),
        0 if fine else FINDINGS,
    )


def _align(target: str, path: Path, sigma_m: float, within: float | None, output: Path | None) -> Answer:
    from cellwright.engine.formats.interop.alignments import datums_of, read_results, write_moved
    from cellwright.engine.formats.report import alignments
    from cellwright.engine.model.fits import Alignment
    from cellwright.engine.pipelines import planning
    from cellwright.engine.pipelines.points import points
    from cellwright.engine.stages.fitting.alignment import aligned, sure_enough

    problem = planning.problem_of(target)
    datums = datums_of(problem, read_results(path), sigma_m)
    places = [each.position for each in points(problem)]
    found: Aligning = sure_enough(aligned(datums), places, None if within is None else within * 1e-3)
    fine = isinstance(found, Alignment)
    moved = (
        write_moved(problem, found.T_measured_nominal, output)
        if isinstance(found, Alignment) and output
        else 0
    )
    content = alignments.entry(found, datums.names, places)
    if moved:
        content |= {"file": str(output), "moved": moved}
    return Answer(
        "ok" if fine else "refused",
        content,
        lambda: alignments.text(found, datums.names, places, str(output) if moved else ""),
        0 if fine else FINDINGS,
    )
