"""The poses of many measurements in units: several processes or a cluster find where the arm can stand for them.

Who prepares a problem finds its poses himself. But a few problems with very many measurements would leave most workers idle, so that
theirs are found before, some at a time.
"""

import contextlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from cellwright.engine.kernels.cancellation import Interrupted
from cellwright.engine.model.measurements import chooses_tools, measurements_of
from cellwright.engine.pipelines.planning import loaded
from cellwright.engine.pipelines.preparation.results import PreparationJob, Prepared
from cellwright.engine.pipelines.units import Crew, Kind, Ledger, Unit, carried_out
from cellwright.engine.pipelines.units.content import require_same
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.cell import Cell
from cellwright.kb.model.problem import Problem
from cellwright.kb.stopping import Stopped
from cellwright.kb.targets import CELL_FILE

MANY = 128  # measurements of one unit
FEW = 16  # problems; with more of them all workers have something to do anyway


@dataclass(frozen=True, slots=True)
class PosesJob:
    """Some measurements of a problem."""

    job: PreparationJob
    names: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class PosesFound:
    """How many poses were found; or why they were not."""

    made: int = 0
    why: str = ""


def find_poses(jobs: Sequence[PreparationJob], crew: Crew, interrupted: Interrupted) -> Counter[Path]:
    """Find the poses of large problems, if there are few problems, and keep them in the store; how many for each file.

    Raises `InvalidInput`.
    """
    found = Counter[Path]()
    if len(jobs) > FEW:
        return found
    units = [unit for job in jobs for unit in _units(job)]
    if not units:
        return found
    ledger = Ledger(jobs[0].store, _is_finished, asdict, _read)
    kind = Kind("poses", _find, _lost, ledger)
    with contextlib.closing(carried_out(kind, units, crew, interrupted)) as answers:
        for unit, answer in answers:
            found[unit.job.job.path] += answer.made
    return found


def with_found(prepared: Prepared, made: int) -> Prepared:
    """The result for a problem, for which so many poses had been found before: they count as found, not as kept."""
    poses = prepared.poses
    if poses is None or not made:
        return prepared
    return replace(prepared, poses=replace(poses, made=poses.made + made, kept=poses.kept - made))


def cell_of_measurements(problem: Problem) -> Cell | None:
    """The cell that says what arms do where the problem measures; None if there is none. Raises `InvalidInput`."""
    path = Path(problem.domain.path).with_name(CELL_FILE)
    if not chooses_tools(problem.domain) or not problem.domain.path or not path.is_file():
        return None
    from cellwright.kb.loader.cell import load_cell

    cell = load_cell(path)
    return cell if cell.operations else None


def _units(job: PreparationJob) -> Iterator[Unit[PosesJob]]:
    """The measurements of a problem in units, if it is a large one that can be read."""
    with contextlib.suppress(InvalidInput):
        problem = loaded(job.path).problem
        if (
            problem is None
            or len(names := measurements_of(problem)) <= MANY
            or not cell_of_measurements(problem)
        ):
            return
        for n in range(0, len(names), MANY):
            yield Unit(f"{job.path} {n}", job.content, PosesJob(job, tuple(names[n : n + MANY])))


def _find(asked: PosesJob, interrupted: Interrupted) -> PosesFound:
    from cellwright.engine.pipelines.poses.keeping import kept_poses  # geometry is slow to load
    from cellwright.engine.plugins import geometry_backend

    job = asked.job
    try:
        require_same(job.path, job.content)
        problem = loaded(job.path).problem
        cell = None if problem is None else cell_of_measurements(problem)
        if problem is None or cell is None or interrupted():
            return PosesFound(why="the files have changed")
        return PosesFound(kept_poses(job.store, problem, cell, geometry_backend(), asked.names).made)
    except (InvalidInput, Stopped) as error:  # who prepares the problem meets it again, and tells it
        return PosesFound(why=str(error))


def _lost(_asked: PosesJob, why: str) -> PosesFound:
    return PosesFound(why=why)


def _is_finished(found: PosesFound) -> bool:
    return not found.why


def _read(noted: Mapping[str, Any]) -> PosesFound:
    return PosesFound(**noted)
