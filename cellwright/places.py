"""Geometry: cells, motions, contact states, and parts put where relations say."""

import math
from collections.abc import Sequence
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from cellwright.answers import Told
from cellwright.requests import Name, Target, name_of

if TYPE_CHECKING:
    from cellwright.engine.model.geometry import Floats
    from cellwright.engine.model.motion import Strategy as Strategies
    from cellwright.engine.model.task_space import Net
    from cellwright.engine.pipelines.motion.moving import Motion
    from cellwright.engine.pipelines.placing.answers import PlaceAnswer
    from cellwright.engine.pipelines.placing.assembling import AssemblyMade
    from cellwright.engine.stages.geometry.pictures.view import View
    from cellwright.kb.model.scene import Scene


def cell(
    target: Target,
    *,
    configurations: Sequence[str] = (),
    place: str = "",
    azimuth: float = -60.0,
    elevation: float = 28.0,
) -> "Told[View]":
    """The cell of a target with its arms at rest, in configurations ("0, 90, 0, 0, 45, 0") or at a place; collisions are marked.

    The picture is seen from `azimuth` and `elevation` in degrees. Raises `InvalidInput`.
    """
    from rich.text import Text

    from cellwright.engine.pipelines.files import initial_facts
    from cellwright.engine.plugins import geometry_backend
    from cellwright.engine.stages.geometry.pictures import view
    from cellwright.kb.loader.cell import cell_of

    name = name_of(target)
    made = view.view_of(cell_of(name), geometry_backend(), configurations, place, initial_facts(name))
    seen = math.radians(azimuth), math.radians(elevation)
    return Told(
        made, "ok", view.content, lambda each: Text(view.text(each)), lambda each: view.as_svg(each, *seen)
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
) -> "Told[Motion]":
    """A motion from `start` to one of `goals` that touches nothing, with its proof; ends are named as for `motion plan`.

    `margin` is in metres, `upright` the tilt in degrees that what is in hand may have. Status: found, infeasible, gave up.
    Raises `InvalidInput`.
    """
    from rich.text import Text

    from cellwright.engine.formats.report import motion as report
    from cellwright.engine.formats.report import motion_pictures
    from cellwright.engine.model.motion import Strategy
    from cellwright.engine.pipelines.motion.moving import Site, Wish, move

    way: Strategies = Strategy(strategy)
    tilt = math.radians(upright)
    wish = Wish(margin, seed, bridges, way, direct, tool, smooth, refine, tilt, budget)
    ends = (goals,) if isinstance(goals, str) else tuple(goals)
    found = move(Site.of(name_of(target)), start, ends, wish)

    def drawn(each: "Motion") -> str | None:
        return motion_pictures.as_svg(each) if each.legs else None

    status = report.status(found.answer)
    return Told(found, status, report.content, lambda each: Text(report.text(each)), drawn)


def travel(target: Target, *, tool: str = "", places: Sequence[str] = (), jobs: int = 1) -> "Told[Any]":
    """How long free motions between places of a cell take, in seconds. Raises `InvalidInput`."""
    from cellwright.engine.formats.report import motion_tables as report
    from cellwright.engine.pipelines.motion.sets import table_by
    from cellwright.engine.pipelines.units import crew_of
    from cellwright.kb.loader import find, load
    from cellwright.kb.stopping import wanted
    from cellwright.kb.syntax import SECONDS

    name = name_of(target)
    unit_s = float(SECONDS[load(find(name)).domain.time_unit])
    found = table_by(name, tool, tuple(places), crew_of(jobs), "", wanted)
    return Told(found, "found", lambda each: report.travel_entry(each, unit_s), report.travel)


def states(target: Target, *, full: bool = False, parts: Sequence[str] = ()) -> "Told[Net]":
    """The contact states of a cell as a net of places and transitions, made from its contact model.

    With `full` every object and anchor point counts by itself; `parts` keeps only these objects or classes. Status: ok, or
    gave up if the net is not complete. Raises `InvalidInput`.
    """
    from cellwright.engine.formats.report import states as report
    from cellwright.engine.formats.report import states_svg
    from cellwright.engine.pipelines import task_space

    model, warnings = task_space.model_of(name_of(target))
    found = task_space.net(model, task_space.Wanted(tuple(parts), full))
    status = "ok" if found.complete else "gave up"
    return Told(found, status, report.content, report.text, states_svg.net, warnings)


def place(
    part: str, base: str, *, scene: Name, image: "str | PathLike[str] | None" = None, seed: int = 0
) -> "Told[PlaceAnswer]":
    """Find a part in a depth image, grasp it and put it on another one, as the relations of a scene say; all motions are planned.

    Without an image one is made from the scene. Raises `InvalidInput`.
    """
    from rich.text import Text

    from cellwright.engine.formats.report import placing as report
    from cellwright.engine.pipelines.placing import placing

    read, seen = _scene(scene, image)
    found, _ = placing.place(read, part, base, seed, seen)
    return Told(found, report.status(found), report.content, lambda each: Text(report.text(each, part, base)))


def assemble(
    base: str, *, scene: Name, image: "str | PathLike[str] | None" = None, seed: int = 0
) -> "Told[AssemblyMade]":
    """Put all parts of a scene where its relations say, in an order that is planned and proved. Raises `InvalidInput`."""
    from rich.text import Text

    from cellwright.engine.formats.report import assembling as report
    from cellwright.engine.pipelines.placing import assembling
    from cellwright.kb.loader import load_domain

    read, seen = _scene(scene, image)
    made, _ = assembling.assemble(read, load_domain("handey"), base, seed, seen)
    return Told(made, report.status(made), report.content, lambda each: Text(report.text(each, base)))


def _scene(scene: Name, image: "str | PathLike[str] | None") -> "tuple[Scene, Floats | None]":
    from cellwright.engine.formats.interop.depth_files import read_depth
    from cellwright.engine.pipelines.placing import looking
    from cellwright.kb.loader.scene import load_scene
    from cellwright.kb.targets import find_scene

    read = load_scene(find_scene(fspath(scene)))
    return read, read_depth(Path(image), looking.camera_of(read)) if image else None
