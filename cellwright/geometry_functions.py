"""Geometry: cells, motions, contact states, placing of parts, measurements, fits and images."""

import math
from collections.abc import Mapping, Sequence
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from cellwright.engine.formats import interop, report
from cellwright.engine.formats.report import rich_parts
from cellwright.engine.pipelines import inspection, manipulation, planning
from cellwright.engine.pipelines import motion as motion_room
from cellwright.engine.plugins import geometry_backend
from cellwright.kb import loader
from cellwright.kb.stopping import is_stop_wanted
from cellwright.kb.targets import find_scene
from cellwright.library_base import Name, Target, Told, load, name_of

if TYPE_CHECKING:
    from cellwright.engine.kernels.arrays import Floats
    from cellwright.engine.model.motion_values import Strategy as Strategies
    from cellwright.engine.model.shape_fits import Aligning, Fitting
    from cellwright.engine.model.task_space import ContactNet
    from cellwright.engine.model.vision import Vague
    from cellwright.engine.pipelines.inspection.tool_tours import ToolPartition
    from cellwright.engine.pipelines.manipulation.assembly_order import AssemblyMade
    from cellwright.engine.pipelines.manipulation.place_answers import PlaceAnswer
    from cellwright.engine.pipelines.manipulation.scene_camera import Seen
    from cellwright.engine.pipelines.motion.arm_motion import ArmMotion
    from cellwright.engine.pipelines.motion.measured_surface import MeasuredSurface
    from cellwright.engine.stages.geometry.pictures.cell_view import CellView
    from cellwright.kb.model.part_scene import Scene


def cell(
    target: Target,
    *,
    configurations: Sequence[str] = (),
    place: str = "",
    azimuth: float = -60.0,
    elevation: float = 28.0,
) -> "Told[CellView]":
    """The cell of a target with its arms at rest, in configurations ("0, 90, 0, 0, 45, 0") or at a
    place; collisions are marked.

    The picture is seen from `azimuth` and `elevation` in degrees. Raises `InvalidInput`.
    """
    from cellwright.engine.stages.geometry.pictures import cell_view

    name = name_of(target)
    view_made = cell_view.cell_view_of(
        loader.cell_of(name),
        geometry_backend(),
        configurations,
        place,
        planning.initial_facts(name),
    )
    seen = math.radians(azimuth), math.radians(elevation)
    return Told(
        view_made,
        "ok",
        cell_view.view_content,
        lambda each: rich_parts.Text(cell_view.view_text(each)),
        lambda each: cell_view.view_as_svg(each, *seen),
    )


def motion(
    target: Target,
    start: str,
    goals: str | Sequence[str],
    *,
    margin: float = 0.0,
    strategy: Literal["connect", "visibility", "reduced"] = "connect",
    refine: int = 0,
    upright: float = 0.0,
    tool: str = "",
    direct: bool = False,
    smooth: bool = True,
    bridges: int = 60,
    budget: int = 1_000_000,
    seed: int = 0,
) -> "Told[ArmMotion]":
    """A motion from `start` to one of `goals` that touches nothing, with its proof; ends are named
    as for `motion plan`.

    `margin` is in metres, `upright` the tilt in degrees that what is in hand may have. Status:
    found, infeasible, gave up. Raises `InvalidInput`.
    """
    from cellwright.engine.model.motion_values import Strategy

    way: Strategies = Strategy(strategy)
    tilt = math.radians(upright)
    wish = motion_room.MotionWish(
        margin, seed, bridges, way, direct, tool, smooth, refine, tilt, budget
    )
    ends = (goals,) if isinstance(goals, str) else tuple(goals)
    moved_path = motion_room.plan_named_motion(
        motion_room.MotionSite.of(name_of(target)), start, ends, wish
    )

    def drawn(each: "ArmMotion") -> str | None:
        return report.motion_svg(each) if each.legs else None

    status = report.motion_status(moved_path.answer)
    return Told(
        moved_path,
        status,
        report.motion_content,
        lambda each: rich_parts.Text(report.motion_text(each)),
        drawn,
    )


def travel(
    target: Target, *, tool: str = "", places: Sequence[str] = (), jobs: int = 1
) -> "Told[Any]":
    """How long free motions between places of a cell take, in seconds. Raises `InvalidInput`."""
    from cellwright.engine.pipelines.jobs import crew_of
    from cellwright.kb.syntax import SECONDS_PER_UNIT

    name = name_of(target)
    unit_s = float(SECONDS_PER_UNIT[loader.load(loader.find_target(name)).domain.time_unit])
    travel_table = motion_room.table_by(
        name, tool, tuple(places), crew_of(jobs), "", is_stop_wanted
    )
    return Told(
        travel_table, "found", lambda each: report.travel_entry(each, unit_s), report.travel_table
    )


def states(target: Target, *, full: bool = False, parts: Sequence[str] = ()) -> "Told[ContactNet]":
    """The contact states of a cell as a net of places and transitions, made from its contact model.

    With `full` every object and anchor point counts by itself; `parts` keeps only these objects or
    classes. Status: ok, or gave up if the net is not complete. Raises `InvalidInput`.
    """
    from cellwright.engine.pipelines import contact_states

    model, warnings = contact_states.contact_model_of(name_of(target))
    contact_net = contact_states.build_net(model, contact_states.NetRequest(tuple(parts), full))
    status = "ok" if contact_net.complete else "gave up"
    return Told(contact_net, status, report.net_content, report.net_text, report.draw_net, warnings)


def place(
    part: str, base: str, *, scene: Name, image: "str | PathLike[str] | None" = None, seed: int = 0
) -> "Told[PlaceAnswer]":
    """Find a part in a depth image, grasp it and put it on another one, as the relations of a scene
    say; all motions are planned.

    Without an image one is made from the scene. Raises `InvalidInput`.
    """
    read, seen = _scene_and_depths(scene, image)
    placed, _ = manipulation.place_part(read, part, base, seed, seen)
    return Told(
        placed,
        report.placing_status(placed),
        report.placing_content,
        lambda each: rich_parts.Text(report.placing_text(each, part, base)),
    )


def assemble(
    base: str, *, scene: Name, image: "str | PathLike[str] | None" = None, seed: int = 0
) -> "Told[AssemblyMade]":
    """Put all parts of a scene where its relations say, in an order that is planned and proved.

    Raises `InvalidInput`.
    """
    read, seen = _scene_and_depths(scene, image)
    assembled, _ = manipulation.assemble_scene(read, loader.load_domain("handey"), base, seed, seen)
    return Told(
        assembled,
        report.assembly_status(assembled),
        report.assembly_content,
        lambda each: rich_parts.Text(report.assembly_text(each, base)),
    )


def _scene_and_depths(
    scene: Name, image: "str | PathLike[str] | None"
) -> "tuple[Scene, Floats | None]":
    read = loader.load_scene(find_scene(fspath(scene)))
    return read, interop.read_depth(Path(image), manipulation.camera_of(read)) if image else None


Shape = Literal["plane", "sphere", "cylinder", "cone", "circle"]


def measurements(target: Target) -> "Told[ToolPartition]":
    """The measurements of a problem: by tool, those that are done, and those that are
    impossible, each with its reason.
    """
    return Told(
        inspection.partition_for_arms(inspection.with_places(load(target))),
        "ok",
        report.tool_groups_entry,
        report.tool_groups_text,
    )


def fit(shape: Shape, points: Name, *, noise_mm: float = 0.05, unit: str = "m") -> "Told[Fitting]":
    """A shape through measured points (a .csv with x, y, z, .npy, .pcd or .ply), and how sure its
    sizes are.

    The points count `unit`s: m, cm, mm or in; whole numbers in a .npy are millimetres. `noise_mm`
    is the standard deviation of a point. Status: ok, or refused with the reason. Raises
    `InvalidInput`.
    """
    import numpy as np

    from cellwright.engine.model.shape_fits import Cloud, Fit
    from cellwright.engine.model.shape_fits import FitShape as Shapes
    from cellwright.engine.stages.fitting.shape_fit import fit_measured_shape

    cloud = interop.read_cloud(Path(points), interop.unit_m(unit))
    fitted_shape = fit_measured_shape(
        Shapes(shape), Cloud(cloud, np.full(len(cloud), noise_mm * 1e-3))
    )
    status = "ok" if isinstance(fitted_shape, Fit) else "refused"
    return Told(
        fitted_shape,
        status,
        lambda each: {"fits": [report.fit_entry(each)]},
        lambda each: report.fits_text([each], ()),
    )


def align(
    target: Target, results: Name, *, noise_mm: float = 0.05, within_mm: float | None = None
) -> "Told[Aligning]":
    """Where the part of a problem lies, by the profiles in a file of results (.csv, .json, .qif),
    and which of them are wrong.

    An alignment that leaves a point less sure than `within_mm` is refused. Raises `InvalidInput`.
    """
    from cellwright.engine.model.shape_fits import Alignment
    from cellwright.engine.stages.fitting.datum_alignment import align_by_datums, require_precision

    problem = load(target)
    datums = interop.datums_of(problem, interop.read_results(Path(results)), noise_mm * 1e-3)
    places = [point.position for point in inspection.points_of_problem(problem)]
    alignment = require_precision(
        align_by_datums(datums), places, None if within_mm is None else within_mm * 1e-3
    )
    status = "ok" if isinstance(alignment, Alignment) else "refused"

    def content(each: "Aligning") -> Mapping[str, Any]:
        return report.alignment_entry(each, datums.names, places)

    return Told(
        alignment,
        status,
        content,
        lambda each: report.alignment_text(each, datums.names, places, ""),
    )


def image(
    target: Target,
    measurement: str,
    *,
    given: "str | PathLike[str] | None" = None,
    expected_mm: float = 1.0,
    seed: int = 0,
) -> "Told[MeasuredSurface | Vague]":
    """The range image that a measurement is taken from, and what is measured in its patch; without
    a `given` file it is made from the cell.

    `expected_mm` is the standard deviation of the place of the part. Status: found, or refused.
    Raises `InvalidInput`.
    """
    from cellwright.engine.model.vision import Vague
    from cellwright.engine.pipelines.motion.measured_surface import measured_surface

    problem = load(target)
    where = loader.cell_of_problem(problem)
    read = None if given is None else lambda tool: interop.read_ranges(Path(given), tool)
    seeing = motion_room.ImageRequest(expected_mm * 1e-3, seed, read=read)
    surface = measured_surface(problem, where, geometry_backend(), measurement, seeing)
    if isinstance(surface, Vague):
        return Told(
            surface,
            "refused",
            lambda _: {"reason": surface.reason},
            lambda _: rich_parts.Text(surface.reason),
        )
    return Told(
        surface,
        "found" if surface.sure else "refused",
        lambda _: report.surface_content(surface),
        lambda _: report.surface_text(surface),
    )


def recognise(
    scene: Name,
    *,
    parts: Sequence[str] = (),
    image: "str | PathLike[str] | None" = None,
    seed: int = 0,
) -> "Told[Seen]":
    """Which parts of a scene an image shows, and where they are.

    Without an image one is made. Raises `InvalidInput`.
    """
    read = loader.load_scene(find_scene(fspath(scene)))
    depths = interop.read_depth(Path(image), manipulation.camera_of(read)) if image else None
    recognition_run = manipulation.recognised_in(read, parts, seed, depths)
    status = "found" if recognition_run.answer.named else "refused"
    return Told(
        recognition_run,
        status,
        lambda each: report.recognition_content(each.answer),
        lambda each: report.recognition_text(each.answer),
    )
