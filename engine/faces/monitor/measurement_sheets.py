"""Measurements as a page edits them in problem files of one folder; each change can be undone."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from cellwright.engine.faces.monitor.cell_bodies import CellBodies, solids_of
from cellwright.engine.formats.interop.inspection_files import edit_measurements, import_file
from cellwright.engine.formats.interop.measurement_edits import point_atoms
from cellwright.engine.kernels.linear import matmul
from cellwright.engine.model.part_measurements import MeasurementPoint, is_shared, measurements_of
from cellwright.engine.pipelines.inspection.arm_capabilities import (
    TOOL_SEPARATOR,
    partition_for_arms,
)
from cellwright.engine.pipelines.inspection.measurement_points import points_of_problem
from cellwright.engine.pipelines.motion.measurement_poses import known_poses
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.shapes.snapping import SnappedPoint, SnapTo, snap_point
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.loader import load
from cellwright.kb.loader.cell import cell_of
from cellwright.kb.model.conditions import ALWAYS_TRUE
from cellwright.kb.model.planning_problem import Problem

MOST_FILES, DEEPEST = 200, 3
POINT_NAME = re.compile(r"[a-z][A-Za-z0-9_]*")
MM_IN_M = 1e-3


@dataclass
class Sheets:
    """The problem files of a folder whose measurements can be edited; texts before each change
    are kept.
    """

    folder: Path
    _before: dict[str, list[tuple[str, str]]] = field(default_factory=dict)

    def files(self, *endings: str) -> list[str]:
        """The files of the folder with these endings, as paths within it; of `.yaml`, the
        problems.
        """
        names = []
        for path in sorted(self.folder.rglob("*")):
            inside = path.relative_to(self.folder)
            if len(inside.parts) > DEEPEST or any(part.startswith(".") for part in inside.parts):
                continue
            wanted = path.suffix.lower() in endings and path.is_file() and not path.is_symlink()
            wanted = wanted and path.resolve().is_relative_to(self.folder.resolve())
            if wanted and (path.suffix != ".yaml" or _says_problem(path)):
                names.append(inside.as_posix())
            if len(names) >= MOST_FILES:
                break
        return names

    def path(self, name: str, *endings: str) -> Path:
        """The path of one of these files. Raises `InvalidInput` for any other name."""
        if name not in self.files(*(endings or (".yaml",))):
            raise _refusal(
                name, "there is no such file in the folder in which the monitor was started"
            )
        return self.folder / name

    def change(self, asked: Mapping[str, Any]) -> str:
        """Make the change that a page asks for; what was done. Raises `InvalidInput`."""
        how, name = str(asked.get("how", "")), str(asked.get("file", ""))
        if how == "new":
            return self._new(name, str(asked.get("domain", "")))
        if how == "import":
            return self._imported(name, str(asked.get("domain", "")))
        if how == "undo":
            return self._undone(name)
        if how not in ("added", "replaced", "removed"):
            raise _refusal(how, "there is no such change")
        path, given = self.path(name), asked.get("points") or []
        if not isinstance(given, list) or not given:
            raise _refusal(name, "choose a measurement first")
        text = path.read_text("utf-8")
        edit_measurements(
            path, how, [str(point) if how == "removed" else read_point(point) for point in given]
        )
        self._before.setdefault(name, []).append((text, path.read_text("utf-8")))
        names = ", ".join(
            point if isinstance(point, str) else str(point["name"]) for point in given
        )
        return f"{how}: {names}"

    def _undone(self, name: str) -> str:
        path, kept = self.path(name), self._before.get(name, [])
        if not kept:
            raise _refusal(name, "there is nothing to undo")
        before, after = kept[-1]
        if path.read_text("utf-8") != after:
            raise _refusal(name, "the file was changed elsewhere since: undo it there")
        _replace_file(path, before)
        kept.pop()
        return "undone"

    def _new(self, name: str, domain: str) -> str:
        if not POINT_NAME.fullmatch(name):
            raise _refusal(name, "a name begins with a small letter and has letters, digits and _")
        path = self.folder / f"{name}.yaml"
        if path.exists():
            raise _refusal(path.name, "there is such a file already")
        path.write_text(f"problem: {name}\ndomain: {domain}\ngoals: []\n", "utf-8")
        try:
            load(path)
        except InvalidInput:
            path.unlink()
            raise
        return f"made: {path.name}"

    def _imported(self, name: str, domain: str) -> str:
        source = self.path(name, ".qif", ".csv")
        path = source.with_suffix(".yaml")
        if path.exists():
            raise _refusal(path.name, "there is such a file already")
        inspection, _, text = import_file(source, domain)
        path.write_text(text, "utf-8")
        return (
            f"made: {path.relative_to(self.folder).as_posix()}, with {len(inspection.points)} "
            "points"
        )


def _replace_file(path: Path, text: str) -> None:
    """Replace a file by another text at once: nobody reads half of it."""
    trial = path.with_name(f".{path.stem}.trial{path.suffix}")
    trial.write_text(text, "utf-8")
    trial.replace(path)


def _says_problem(path: Path) -> bool:
    with path.open(encoding="utf-8", errors="replace") as lines:
        return any(
            re.match(r"problem\s*:", line) for line, _ in zip(lines, range(40), strict=False)
        )


def _refusal(what: str, why: str) -> InvalidInput:
    return InvalidInput([Diagnostic(Source(what or "measurements"), "K807", why, "")])


def read_point(given: Mapping[str, Any]) -> MeasurementPoint:
    """A point as a page sends it: lengths in millimetres. Raises `InvalidInput`."""
    try:
        name, kind = str(given["name"]), str(given["kind"])
        x, y, z = (float(coordinate) * MM_IN_M for coordinate in given["at"])
        nx, ny, nz = (float(component) for component in given["normal"])
        length = math.hypot(nx, ny, nz)
        tool = str(given.get("tool") or "")
        sizes = [_length_m(given.get(key)) for key in ("tolerance", "bore", "nominal")]
        if not all(map(POINT_NAME.fullmatch, (name, kind, tool or name))) or not length:
            raise ValueError
        if not all(map(math.isfinite, (x, y, z, length))):
            raise ValueError
    except (KeyError, TypeError, ValueError) as wrong:
        said = "a point has a name, a kind, three coordinates, and a normal that is not 0"
        raise _refusal(str(given.get("name", "")), said) from wrong
    unit = (nx / length, ny / length, nz / length)
    return MeasurementPoint(
        name, name, kind, (x, y, z), unit, sizes[0], sizes[1], nominal_m=sizes[2], tool=tool
    )


def _length_m(given: object) -> float | None:
    if given in (None, ""):
        return None
    metres = float(str(given)) * MM_IN_M
    if not math.isfinite(metres):
        raise ValueError
    return metres


def written_point(point: MeasurementPoint) -> dict[str, Any]:
    """The same point as a page has it."""
    sizes = {"tolerance": point.tolerance_m, "bore": point.bore_m, "nominal": point.nominal_m}
    return {
        "name": point.name,
        "kind": point.kind,
        "at": [round(coordinate / MM_IN_M, 6) for coordinate in point.position],
        "normal": [round(component, 6) for component in point.normal],
        **({"tool": point.tool} if point.tool else {}),
        **{key: round(value / MM_IN_M, 6) for key, value in sizes.items() if value is not None},
    }


class MeasuredPart:
    """The part whose points a problem file measures, as a page shows it.

    Raises `InvalidInput` for a file that cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        problem = load(path).problem
        if problem is None:
            raise _refusal(str(path), "this is a domain, not a problem")
        self.problem: Problem = problem
        motion = problem.domain.motion
        self.frame = motion.frame if motion is not None else "world"
        self.solids: CellBodies = solids_of(str(path))

    @property
    def points(self) -> list[MeasurementPoint]:
        """The measurements with a position."""
        return points_of_problem(self.problem)

    @property
    def kinds(self) -> list[str]:
        """What can be asked of a measurement."""
        words = self.problem.domain.conventions
        needed = self.problem.domain.predicates[words.needs].arguments[1]
        listed = self.problem.domain.types.get(needed)
        return list(listed.constants if listed is not None else ()) or [words.kind("profile")]

    @property
    def tools(self) -> list[str]:
        """The tools that a measurement may prefer; none if the domain knows of no preferences."""
        domain = self.problem.domain
        declared = domain.predicates.get(domain.conventions.prefers)
        objects = {**domain.objects, **self.problem.objects}
        if declared is None:
            return []
        wanted = declared.arguments[1]
        return sorted(name for name, kind in objects.items() if domain.is_subtype(kind, wanted))

    @property
    def bodies(self) -> frozenset[str]:
        """The bodies that belong to the part: those that stand in its frame."""
        world = self.solids.resting.home
        return frozenset(
            name for name in world.cell.bodies if self.frame in world.supports(name)[1:]
        )

    def free_name(self) -> str:
        """A name for one more measurement."""
        taken = {
            *measurements_of(self.problem),
            *self.problem.objects,
            *self.problem.domain.objects,
        }
        return next(name for n in count(1) if (name := f"p{n}") not in taken)

    def picked(self, body: str, at: Sequence[float], to: SnapTo) -> SnappedPoint | None:
        """Where a point (3,) of the world on a body belongs, in the frame of the part; None if
        nothing of the kind is near.
        """
        world = self.solids.resting.home
        T_world_body = world.pose("world", body)
        own = transforms.apply(transforms.inverse(T_world_body), np.array(at, dtype=float))[0]
        spot = snap_point(self.solids.corners[body], self.solids.cell.bodies[body].shapes, own, to)
        if spot is None:
            return None
        T = matmul(world.pose(self.frame, "world"), T_world_body)
        return replace(
            spot, point=transforms.apply(T, spot.point)[0], normal=matmul(T[:3, :3], spot.normal)
        )

    def in_world(self, position: Sequence[float]) -> list[float]:
        """A point (3,) of the part in the world."""
        T = self.solids.resting.home.pose("world", self.frame)
        place: list[float] = transforms.apply(T, np.array(position, dtype=float))[0].tolist()
        return place


def point_verdict(path: str, given: Mapping[str, Any]) -> tuple[bool, str]:
    """Whether a point can be measured, and with which tool from where, or why not; with which tools
    of several arms.

    Raises `InvalidInput`.
    """
    problem, point = _problem_at(path, Path(path).stat().st_mtime_ns), read_point(given)
    words = problem.domain.conventions
    others = {*measurements_of(problem)}
    facts = [f for f in problem.statics if not (f.arguments and str(f.arguments[0]) in others)]
    facts += [fact for fact in point_atoms(point, words) if fact.name in problem.domain.predicates]
    objects = {n: t for n, t in problem.objects.items() if n not in others}
    alone = replace(
        problem,
        objects={**objects, point.name: words.measurement},
        statics=tuple(facts),
        goal=ALWAYS_TRUE,
    )
    parts = partition_for_arms(alone)
    if point.name in parts.impossible:
        return False, parts.impossible[point.name]
    tool = next((tool for tool, names in parts.groups.items() if point.name in names), "")
    instead = (
        f", not by {point.tool}, which cannot"
        if point.tool not in ("", *tool.split(TOOL_SEPARATOR))
        else ""
    )
    if is_shared(alone):  # whether some arm reaches it has been found out already
        return True, f"by {tool}{instead}"
    poses = known_poses(alone, cell_of(path), geometry_backend())
    if (reason := poses.unreached().get(point.name)) is not None:
        return False, f"by {tool}: {reason}"
    stations = poses.stations().get(point.name, ())
    return True, f"by {tool}" + (f" from {', '.join(stations)}" if stations else "") + instead


@lru_cache(4)
def _problem_at(path: str, _changed_ns: int) -> Problem:
    problem = load(Path(path)).problem
    assert problem is not None
    return problem
