"""Preparation of one problem: it is planned, and its arm poses are found in units."""

import contextlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from cellwright.engine.kernels.cancellation import Interrupted
from cellwright.engine.model.outcome import Found, GaveUp
from cellwright.engine.model.part_measurements import chooses_tools, measurements_of
from cellwright.engine.pipelines import motion, planning
from cellwright.engine.pipelines.jobs import (
    DraftedResult,
    ResultLedger,
    WorkCrew,
    WorkKind,
    WorkUnit,
    carried_out,
)
from cellwright.engine.pipelines.jobs.input_digests import require_same
from cellwright.engine.pipelines.jobs.unit_scheduler import UNIT_INTERRUPTED
from cellwright.engine.pipelines.planning.checked_plan import LARGE_INSTANCES
from cellwright.engine.pipelines.planning.macros.library_planner import (
    LibraryAnswer,
    LibraryPlanner,
)
from cellwright.engine.pipelines.planning.plan_objective import plan_sequence
from cellwright.engine.pipelines.planning.target_files import load_target
from cellwright.engine.pipelines.precompute.preparation_results import (
    KeptPoses,
    KeptSequence,
    PreparationJob,
    PreparedProblem,
)
from cellwright.engine.stages.grounding.instance_bounds import bound_instances
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb import loader
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.cell_model import Cell
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.stopping import StoppedByCaller
from cellwright.kb.store.macrop_library import LibraryDraft
from cellwright.kb.targets import CELL_FILE

MEASUREMENTS_PER_UNIT = 128  # measurements of one unit
FEW_PROBLEMS = 16  # problems; with more of them all workers have something to do anyway


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


def find_poses(
    jobs: Sequence[PreparationJob], crew: WorkCrew, interrupted: Interrupted
) -> Counter[Path]:
    """Find the poses of large problems, if there are few problems, and keep them in the store; how
    many for each file.

    Raises `InvalidInput`.
    """
    counts = Counter[Path]()
    if len(jobs) > FEW_PROBLEMS:
        return counts
    units = [unit for job in jobs for unit in _pose_units(job)]
    if not units:
        return counts
    ledger = ResultLedger(jobs[0].store, _is_finished, asdict, _read_unit)
    kind = WorkKind("poses", _find_unit, _lost_unit, ledger)
    with contextlib.closing(carried_out(kind, units, crew, interrupted)) as answers:
        for unit, answer in answers:
            counts[unit.job.job.path] += answer.made
    return counts


def with_found(prepared: PreparedProblem, count: int) -> PreparedProblem:
    """The result for a problem, for which so many poses had been found before: they count as
    found, not as kept.
    """
    poses = prepared.poses
    if poses is None or not count:
        return prepared
    return replace(prepared, poses=replace(poses, made=poses.made + count, kept=poses.kept - count))


def cell_of_measurements(problem: Problem) -> Cell | None:
    """The cell that says what arms do where the problem measures; None if there is none. Raises
    `InvalidInput`.
    """
    path = Path(problem.domain.path).with_name(CELL_FILE)
    if not chooses_tools(problem.domain) or not problem.domain.path or not path.is_file():
        return None
    cell = loader.load_cell(path)
    return cell if cell.operations else None


def _pose_units(job: PreparationJob) -> Iterator[WorkUnit[PosesJob]]:
    """The measurements of a problem in units, if it is a large one that can be read."""
    with contextlib.suppress(InvalidInput):
        problem = load_target(job.path).problem
        if (
            problem is None
            or len(names := measurements_of(problem)) <= MEASUREMENTS_PER_UNIT
            or not cell_of_measurements(problem)
        ):
            return
        for n in range(0, len(names), MEASUREMENTS_PER_UNIT):
            yield WorkUnit(
                f"{job.path} {n}",
                job.content,
                PosesJob(job, tuple(names[n : n + MEASUREMENTS_PER_UNIT])),
            )


def _find_unit(asked: PosesJob, interrupted: Interrupted) -> PosesFound:
    # geometry is slow to load
    from cellwright.engine.plugins import geometry_backend

    job = asked.job
    try:
        require_same(job.path, job.content)
        problem = load_target(job.path).problem
        cell = None if problem is None else cell_of_measurements(problem)
        if problem is None or cell is None or interrupted():
            return PosesFound(why="the files have changed")
        return PosesFound(
            motion.kept_poses(job.store, problem, cell, geometry_backend(), asked.names).made
        )
    # who prepares the problem meets it again, and tells it
    except (InvalidInput, StoppedByCaller) as error:
        return PosesFound(why=str(error))


def _lost_unit(_asked: PosesJob, why: str) -> PosesFound:
    return PosesFound(why=why)


def _is_finished(poses_found: PosesFound) -> bool:
    return not poses_found.why


def _read_unit(noted: Mapping[str, Any]) -> PosesFound:
    return PosesFound(**noted)


UNUSABLE_LIBRARY = "K416"  # of a library: another time it may be there


def prepare_problem(
    job: PreparationJob, interrupted: Interrupted
) -> PreparedProblem | DraftedResult[PreparedProblem]:
    """Plan one problem with the library in the store, and bring its kept sequence up to date.

    What is learned waits in a draft. Poses and the sequence are written at once: they replace older
    ones, so finding them twice does no harm.
    """
    if interrupted():
        return lost_problem(job, UNIT_INTERRUPTED)
    try:
        require_same(job.path, job.content)
        problem = load_target(job.path).problem
        if problem is None:
            return PreparedProblem(
                str(job.path), "bad input", reason="this is a domain, not a problem"
            )
        measures = chooses_tools(problem.domain)
        poses = _update_poses(job.store, problem) if measures else None
        sequence = _update_sequence(job.store, problem) if measures else None
        limits = SearchLimits(job.expansions, seed=job.seed, interrupted=interrupted)
        draft, answered = _answer_problem(job.store, problem, limits)
    except InvalidInput as error:
        finished = all(diagnostic.code != UNUSABLE_LIBRARY for diagnostic in error.diagnostics)
        return PreparedProblem(
            str(job.path), "bad input", diagnostics=tuple(error.diagnostics), finished=finished
        )
    except StoppedByCaller:
        return lost_problem(job, UNIT_INTERRUPTED)
    outcome = answered.outcome
    prepared = PreparedProblem(
        problem.name,
        "found"
        if isinstance(outcome, Found)
        else "gave up"
        if isinstance(outcome, GaveUp)
        else "infeasible",
        answered.origin,
        answered.macrop,
        answered.name,
        answered.reason if isinstance(outcome, Found) else outcome.reason,
        sum(outcome.statistics.seconds.values()),
        sequence=sequence,
        poses=poses,
        finished=not interrupted(),
    )
    return DraftedResult(draft, lambda: replace(prepared, macrop=draft.settled(prepared.macrop)))


def _answer_problem(
    store: str, problem: Problem, limits: SearchLimits
) -> tuple[LibraryDraft, LibraryAnswer]:
    """The answer for a problem, which the library keeps. Of measurements that are too many to be
    planned at once, as `plan` does: they follow their sequence. What was learned is in the draft.
    """
    with LibraryDraft(store) as library, LibraryPlanner(library, limits) as practice:
        if bound_instances(problem) > LARGE_INSTANCES:
            memory = practice.repertoire(problem.domain) if practice.learns else None
            followed = plan_sequence(problem, limits, memory, store)
            if followed is not None:
                return library, LibraryAnswer(followed.outcome, "sequence")
        answered = practice.plan(problem)
    return library, answered


def lost_problem(job: PreparationJob, why: str) -> PreparedProblem:
    """The result for a problem whose planning did not end."""
    return PreparedProblem(job.path.stem, "gave up", reason=why, finished=False)


def _update_poses(store: str, problem: Problem) -> KeptPoses | None:
    """Bring the poses of a problem's measurements up to date in the store; None without a cell
    that says what arms do.
    """
    cell = cell_of_measurements(problem)
    if cell is None:
        return None
    # geometry is slow to load
    from cellwright.engine.plugins import geometry_backend

    kept = motion.kept_poses(store, problem, cell, geometry_backend())
    reached = {pose.measurement for pose in kept.poses.values() if pose.reached}
    return KeptPoses(len(reached), kept.made, kept.kept, kept.unreached())


def _update_sequence(store: str, problem: Problem) -> KeptSequence:
    """Bring the kept sequence of a problem's measurements up to date in the store, and report
    on it.
    """
    carried_on = planning.carry_on(store, problem)
    counts = {
        "reordered": len(carried_on.reordered),
        "moved": len(carried_on.moved),
        "added": len(carried_on.added),
        "dropped": len(carried_on.dropped),
        "outdated": len(carried_on.outdated),
    }
    changes = (
        {change: count for change, count in counts.items() if count}
        if carried_on.way != "made"
        else {}
    )
    return KeptSequence(carried_on.way, len(carried_on.plan.rest), changes)
