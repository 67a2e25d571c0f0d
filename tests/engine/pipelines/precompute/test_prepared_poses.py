"""Poses of many measurements are found in units by several processes, and are those that one
process finds.
"""

import json
from pathlib import Path

import pytest

from cellwright.engine.pipelines import precompute
from cellwright.engine.pipelines.jobs import crew_of
from cellwright.engine.pipelines.jobs.input_digests import content_digest
from cellwright.engine.pipelines.motion.measurement_poses import kept_poses
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.pipelines.precompute import problem_preparation
from cellwright.engine.pipelines.precompute.preparation_results import PreparationJob
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.loader import find_target
from cellwright.kb.loader.cell import cell_of
from cellwright.kb.store.inspection_store import PoseStore

TARGET = "halves/six"


def job(store: Path) -> PreparationJob:
    path = find_target("halves/six")
    return PreparationJob(path, str(store), 1_000, 0, content_digest(path))


def documents(store: Path) -> dict[tuple[str, str, str], object]:
    with PoseStore(str(store)) as kept:
        return {key: json.loads(text) for key, text in kept.of("halves", "six").items()}


@pytest.mark.parametrize("processes", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_units_find_the_poses_that_one_call_finds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, processes: int
) -> None:
    monkeypatch.setattr(problem_preparation, "MEASUREMENTS_PER_UNIT", 4)
    found = problem_preparation.find_poses(
        [job(tmp_path / "units.db")], crew_of(processes), lambda: False
    )
    problem = problem_of(TARGET)
    alone = kept_poses(str(tmp_path / "alone.db"), problem, cell_of(TARGET), geometry_backend())
    assert alone.made == len(documents(tmp_path / "alone.db")) == found.total() > 0
    assert documents(tmp_path / "units.db") == documents(tmp_path / "alone.db")
    again = kept_poses(str(tmp_path / "units.db"), problem, cell_of(TARGET), geometry_backend())
    assert (again.made, again.kept) == (0, alone.made)


def test_poses_of_some_measurements_leave_those_of_others(tmp_path: Path) -> None:
    store, problem, cell = str(tmp_path / "cell.db"), problem_of(TARGET), cell_of(TARGET)
    for names in (["m1", "m2"], ["m2", "m3"]):
        kept_poses(store, problem, cell, geometry_backend(), names)
    assert {key[0] for key in documents(tmp_path / "cell.db")} == {"m1", "m2", "m3"}


def test_small_problems_many_problems_and_bad_files_have_no_such_units(tmp_path: Path) -> None:
    bad = tmp_path / "bad.yaml"
    bad.write_text("problem: [")
    jobs = [job(tmp_path / "cell.db"), PreparationJob(bad, str(tmp_path / "cell.db"), 1, 0, "")]
    for asked in (jobs, jobs * problem_preparation.FEW_PROBLEMS):
        problem_preparation.find_poses(asked, crew_of(1), lambda: False)
    assert not (tmp_path / "cell.db").exists()


@pytest.mark.slow
def test_a_preparation_by_processes_keeps_shares_and_finds_what_the_units_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(problem_preparation, "MEASUREMENTS_PER_UNIT", 4)
    paths = [find_target("halves/six")]
    made = precompute.prepare_problems(
        paths, str(tmp_path / "cell.db"), SearchLimits(100_000), crew_of(2)
    )
    (six,) = made.problems
    assert six.status == "found"
    assert six.poses is not None
    assert (six.poses.made, six.poses.kept, six.poses.reached) == (
        len(documents(tmp_path / "cell.db")),
        0,
        6,
    )
    assert six.sequence is not None
    assert six.sequence.way == "made"
    (again,) = precompute.prepare_problems(
        paths, str(tmp_path / "cell.db"), SearchLimits(100_000), crew_of(2)
    ).problems
    assert again.poses is not None
    assert (again.poses.made, again.poses.kept) == (0, six.poses.made)
