"""Large problems are checked with a few of the objects that are alike."""

from pathlib import Path

import pytest

from cellwright.engine.authoring.domain_check import check_domain_files
from cellwright.engine.formats.interop.inspection_files import import_file
from cellwright.engine.stages.grounding import ground, reachable_atoms
from cellwright.kb.check.object_reduction import KEPT_PER_CLASS, reduce_objects
from cellwright.kb.loader import load_problem

HEAD = "name,x,y,z,nx,ny,nz,kind,tolerance,bore\n"


def imported(folder: Path, rows: list[str]) -> Path:
    table, file = folder / "points.csv", folder / "points.yaml"
    table.write_text(HEAD + "\n".join(rows) + "\n")
    file.write_text(import_file(table, "bulkhead")[2])
    return file


def rows(count: int) -> list[str]:
    kinds = ("profile,0.5,", "thickness,,", "profile,0.001,", "profile,,1")
    return [f"p{n},{n},{n % 7},0,0,0,1,{kinds[n % 4]}" for n in range(count)]


def test_of_measurements_that_are_alike_a_few_are_left(tmp_path: Path) -> None:
    problem = load_problem(str(imported(tmp_path, rows(400))))
    small = reduce_objects(problem)
    assert len(small.problem.objects) == 4 * KEPT_PER_CLASS
    assert len(small.problem.objects) + len(small.stands_for) == 400
    assert reduce_objects(small.problem).problem == small.problem


@pytest.mark.slow
def test_what_is_reached_with_a_few_is_told_of_all(tmp_path: Path) -> None:
    problem = load_problem(str(imported(tmp_path, rows(160))))
    small = reduce_objects(problem)
    assert small.stands_for
    of_all = small.told_of_all(reachable_atoms(ground(small.problem)))
    assert of_all == reachable_atoms(ground(problem))


def test_a_large_problem_with_positions_is_checked_and_nothing_is_wrong(tmp_path: Path) -> None:
    assert check_domain_files(str(imported(tmp_path, rows(500))), reach=False).diagnostics == ()


def test_points_that_differ_in_what_is_known_about_them_are_not_alike(tmp_path: Path) -> None:
    file = imported(tmp_path, rows(400))
    file.write_text(file.read_text() + "initial:\n  - couplant_applied(goal_point(meas(p399)))\n")
    assert "p399" in reduce_objects(load_problem(str(file))).problem.objects
