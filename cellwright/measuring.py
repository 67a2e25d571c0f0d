"""Inspection: measurements of a problem, shapes through points, where a part lies, and which parts an image shows."""

from collections.abc import Mapping, Sequence
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from cellwright.answers import Told
from cellwright.requests import Name, Target, load

if TYPE_CHECKING:
    from cellwright.engine.model.fits import Aligning, Fitting
    from cellwright.engine.model.ranging import Vague
    from cellwright.engine.pipelines.dimensions.surfaces import MeasuredSurface
    from cellwright.engine.pipelines.inspection import Partition
    from cellwright.engine.pipelines.placing.recognising import Seen

Shape = Literal["plane", "sphere", "cylinder", "cone", "circle"]


def measurements(target: Target) -> "Told[Partition]":
    """The measurements of a problem: by tool, those that are done, and those that are impossible, each with its reason."""
    from cellwright.engine.formats.report.inspection import entry, parts
    from cellwright.engine.pipelines.inspection.arms import divided
    from cellwright.engine.pipelines.points import with_places

    return Told(divided(with_places(load(target))), "ok", entry, parts)


def fit(shape: Shape, points: Name, *, noise_mm: float = 0.05, unit: str = "m") -> "Told[Fitting]":
    """A shape through measured points (a .csv with x, y, z, .npy, .pcd or .ply), and how sure its sizes are.

    The points count `unit`s: m, cm, mm or in; whole numbers in a .npy are millimetres. `noise_mm` is the standard deviation of a point. Status: ok, or refused with the reason. Raises `InvalidInput`.
    """
    import numpy as np

    from cellwright.engine.formats.interop.depth_files import read_cloud
    from cellwright.engine.formats.interop.tables import unit_m
    from cellwright.engine.formats.report import fits
    from cellwright.engine.model.fits import Cloud, Fit
    from cellwright.engine.model.fits import Shape as Shapes
    from cellwright.engine.stages.fitting.surfaces import fitted

    cloud = read_cloud(Path(points), unit_m(unit))
    found = fitted(Shapes(shape), Cloud(cloud, np.full(len(cloud), noise_mm * 1e-3)))
    status = "ok" if isinstance(found, Fit) else "refused"
    return Told(found, status, lambda each: {"fits": [fits.entry(each)]}, lambda each: fits.text([each], ()))


def align(
    target: Target, results: Name, *, noise_mm: float = 0.05, within_mm: float | None = None
) -> "Told[Aligning]":
    """Where the part of a problem lies, by the profiles in a file of results (.csv, .json, .qif), and which of them are wrong.

    An alignment that leaves a point less sure than `within_mm` is refused. Raises `InvalidInput`.
    """
    from cellwright.engine.formats.interop.alignments import datums_of, read_results
    from cellwright.engine.formats.report import alignments
    from cellwright.engine.model.fits import Alignment
    from cellwright.engine.pipelines.points import points
    from cellwright.engine.stages.fitting.alignment import aligned, sure_enough

    problem = load(target)
    datums = datums_of(problem, read_results(Path(results)), noise_mm * 1e-3)
    places = [each.position for each in points(problem)]
    found = sure_enough(aligned(datums), places, None if within_mm is None else within_mm * 1e-3)
    status = "ok" if isinstance(found, Alignment) else "refused"

    def content(each: "Aligning") -> Mapping[str, Any]:
        return alignments.entry(each, datums.names, places)

    return Told(found, status, content, lambda each: alignments.text(each, datums.names, places, ""))


def image(
    target: Target,
    measurement: str,
    *,
    given: "str | PathLike[str] | None" = None,
    expected_mm: float = 1.0,
    seed: int = 0,
) -> "Told[MeasuredSurface | Vague]":
    """The range image that a measurement is taken from, and what is measured in its patch; without a `given` file it is made from the cell.

    `expected_mm` is the standard deviation of the place of the part. Status: found, or refused. Raises `InvalidInput`.
    """
    from rich.text import Text

    from cellwright.engine.formats.interop.range_files import read_ranges
    from cellwright.engine.formats.report import ranges
    from cellwright.engine.model.ranging import Vague
    from cellwright.engine.pipelines.dimensions.surfaces import Seeing, measured_surface
    from cellwright.engine.plugins import geometry_backend
    from cellwright.kb.loader.cell import cell_of

    problem = load(target)
    where = cell_of(problem.path)
    read = None if given is None else lambda tool: read_ranges(Path(given), tool)
    seeing = Seeing(expected_mm * 1e-3, seed, read=read)
    found = measured_surface(problem, where, geometry_backend(), measurement, seeing)
    if isinstance(found, Vague):
        return Told(found, "refused", lambda _: {"reason": found.reason}, lambda _: Text(found.reason))
    return Told(
        found,
        "found" if found.sure else "refused",
        lambda _: ranges.surface_content(found),
        lambda _: ranges.surface_text(found),
    )


def recognise(
    scene: Name, *, parts: Sequence[str] = (), image: "str | PathLike[str] | None" = None, seed: int = 0
) -> "Told[Seen]":
    """Which parts of a scene an image shows, and where they are. Without an image one is made. Raises `InvalidInput`."""
    from cellwright.engine.formats.interop.depth_files import read_depth
    from cellwright.engine.formats.report import recognition
    from cellwright.engine.pipelines.placing import looking
    from cellwright.engine.pipelines.placing.recognising import recognised_in
    from cellwright.kb.loader.scene import load_scene
    from cellwright.kb.targets import find_scene

    read = load_scene(find_scene(fspath(scene)))
    given = read_depth(Path(image), looking.camera_of(read)) if image else None
    found = recognised_in(read, parts, seed, given)
    status = "found" if found.answer.named else "refused"
    return Told(
        found,
        status,
        lambda each: recognition.content(each.answer),
        lambda each: recognition.text(each.answer),
    )
