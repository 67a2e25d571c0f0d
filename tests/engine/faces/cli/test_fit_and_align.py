"""Shapes and alignments from the command line: what is typed, what is printed, what is written."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app
from cellwright.engine.formats.interop.results import ResultForm, write_results
from cellwright.engine.kernels.rigid import rotation_by_vector, transform
from cellwright.engine.model.part_measurements import MeasurementPoint
from cellwright.engine.pipelines.inspection.measurement_points import points_of_problem
from cellwright.kb.loader import load
from cellwright.kb.model.measured_results import Measured, Results
from tests.places import BUNDLED

SHIFT = np.array([0.004, -0.007, 0.012])
TURN = np.radians([0.4, -0.2, 0.9])


def run(*command: str | Path) -> tuple[int, str]:
    found = CliRunner().invoke(app, ["measurement", *map(str, command)])
    return found.exit_code, found.output


@pytest.fixture
def job(tmp_path: Path) -> Path:
    """A problem with profiles on three sides of a block, and results of a part that lies
    elsewhere; m5 is wrong.
    """
    text = [
        "problem: job",
        f"domain: {BUNDLED / 'bulkhead'}",
        "objects: {measurement: [m0..m17]}",
        "statics:",
    ]
    random, T, measured = np.random.default_rng(3), transform(rotation_by_vector(TURN), SHIFT), []
    for number in range(18):
        axis = number % 3
        place = np.round(random.uniform(-0.8, 0.8, 3), 3)
        text += [f"  - needs(m{number}, profile)"]
        text += [f"  - position(m{number}, {', '.join(str(round(1e6 * each)) for each in place)})"]
        text += [
            f"  - normal(m{number}, {', '.join(str(1000 * (each == axis)) for each in range(3))})"
        ]
        n = np.eye(3)[axis]
        now = T[:3, :3] @ n  # where the beam along the nominal normal meets the displaced surface
        off = (now @ (T[:3, :3] @ place + T[:3, 3] - place)) / (now @ n)
        off += random.normal(0.0, 2e-5) + (0.003 if number == 5 else 0.0)
        measured.append(Measured(f"m{number}", "profile", round(1e6 * off), "um"))
    (tmp_path / "job.yaml").write_text("\n".join([*text, "goals: []  # none yet", ""]))
    (tmp_path / "results.json").write_text(
        write_results(Results("r", "", tuple(measured)), ResultForm.JSON)
    )
    return tmp_path


def test_a_part_is_found_and_its_points_are_moved(job: Path) -> None:
    code, said = run(
        "align", job / "job.yaml", job / "results.json", "--noise", "0.02", "-o", job / "moved.yaml"
    )
    assert code == 0
    assert "17 of 18 datums agree" in said
    assert "m5 is wrong" in said
    before, after = (_points(job / name) for name in ("job.yaml", "moved.yaml"))
    R = rotation_by_vector(TURN)
    for one, other in zip(before, after, strict=True):
        assert other.position == pytest.approx(R @ np.array(one.position) + SHIFT, abs=1e-4)
        assert other.normal == pytest.approx(R @ np.array(one.normal), abs=2e-3)
    assert "# none yet" in (job / "moved.yaml").read_text()


@pytest.mark.parametrize("named", ["cell", "cell # ours", "'cell/domain.yaml'"])
def test_the_moved_problem_finds_its_domain_from_another_folder(job: Path, named: str) -> None:
    shutil.copytree(BUNDLED / "bulkhead", job / "cell")
    text = (job / "job.yaml").read_text().replace(str(BUNDLED / "bulkhead"), named)
    (job / "job.yaml").write_text(text)
    there = job / "other" / "deeper" / "moved.yaml"
    there.parent.mkdir(parents=True)
    code, said = run("align", job / "job.yaml", job / "results.json", "-o", there)
    assert code == 0, said
    problem = load(there).problem
    assert problem is not None
    assert Path(problem.domain.path).resolve() == (job / "cell" / "domain.yaml").resolve()
    assert len(points_of_problem(problem)) == 18
    assert [each.name for each in there.parent.iterdir()] == ["moved.yaml"]


def test_a_file_that_is_there_is_kept_if_the_moved_problem_cannot_be_written(job: Path) -> None:
    shutil.copytree(BUNDLED / "bulkhead", job / "cell")
    text = (
        (job / "job.yaml").read_text().replace(f"domain: {BUNDLED / 'bulkhead'}", '"domain": cell')
    )
    (job / "job.yaml").write_text(text)
    (job / "deeper").mkdir()
    there = job / "deeper" / "moved.yaml"
    there.write_text("of somebody else\n")
    code, _ = run("align", job / "job.yaml", job / "results.json", "-o", there)
    assert code == 2
    assert [each.read_text() for each in there.parent.iterdir()] == ["of somebody else\n"]


def test_a_value_beyond_all_measure_is_refused(job: Path) -> None:
    measured = (Measured("m0", "profile", 1e300, "um"),)
    (job / "results.json").write_text(write_results(Results("r", "", measured), ResultForm.JSON))
    code, said = run("align", job / "job.yaml", job / "results.json")
    assert code == 2
    assert "m0 is farther than" in said


def test_the_problem_that_was_run_is_not_replaced_by_the_moved_one(job: Path) -> None:
    before = (job / "job.yaml").read_text()
    code, said = run("align", job / "job.yaml", job / "results.json", "-o", job / "job.yaml")
    assert code == 2
    assert "the problem that was run" in said
    assert (job / "job.yaml").read_text() == before


def _points(file: Path) -> list[MeasurementPoint]:
    problem = load(file).problem
    assert problem is not None
    return points_of_problem(problem)


def test_an_alignment_that_is_not_sure_enough_is_refused(job: Path) -> None:
    code, said = run(
        "align",
        job / "job.yaml",
        job / "results.json",
        "--within",
        "0.001",
        "-o",
        job / "moved.yaml",
    )
    assert code == 1
    assert "is known to" in said
    assert not (job / "moved.yaml").exists()


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("results.txt", "", "no form of results"),
        ("results.json", "{", "not results"),
        ("results.csv", "a,b\n", "no profile of a point"),
    ],
)
def test_other_files_are_refused(job: Path, name: str, text: str, said: str) -> None:
    (job / name).write_text(text)
    code, told = run("align", job / "job.yaml", job / name)
    assert code == 2
    assert said in told


def test_a_shape_goes_through_points(tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    angle = random.uniform(0, 2 * np.pi, 200)
    place = np.stack(
        [0.02 * np.cos(angle), 0.02 * np.sin(angle), random.uniform(0, 0.05, 200)], axis=1
    )
    np.save(tmp_path / "bore.npy", place + random.normal(0.0, 5e-5, place.shape))
    code, said = run("fit", "cylinder", tmp_path / "bore.npy")
    assert code == 0
    assert "diameter 40.0" in said
    assert "as far as --noise says" in said
    code, said = run("fit", "plane", tmp_path / "bore.npy")
    assert code == 1
    assert "no fit: only" in said
    code, said = run("fit", "ball", tmp_path / "bore.npy")
    assert code == 2
    assert "one of plane, sphere" in said


@pytest.mark.parametrize("text", ["", "x,y\n1,2\n", "x,y,z\n1,2\n", "x,y,z\na,b,c\n"])
def test_a_table_without_points_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "p.csv").write_text(text)
    code, said = run("fit", "plane", tmp_path / "p.csv")
    assert code == 2
    assert "cannot be read" in said


def test_points_count_what_their_unit_says(tmp_path: Path) -> None:
    turns, heights = (
        each.ravel() for each in np.meshgrid(np.linspace(0.0, 6.0, 30), [0.0, 10.0, 20.0])
    )
    points = np.stack([20 * np.cos(turns), 20 * np.sin(turns), heights], axis=1)
    rows = "\n".join(",".join(f"{each:.6f}" for each in row) for row in points)
    (tmp_path / "bore.csv").write_text(f"x,y,z\n{rows}\n")
    np.save(tmp_path / "bore.npy", points)
    np.save(tmp_path / "whole.npy", np.rint(points).astype(int))
    for name in ("bore.csv", "bore.npy"):
        code, said = run("fit", "cylinder", tmp_path / name, "--unit", "mm")
        assert (code, "diameter 40.0000 mm" in said) == (0, True), said
    code, said = run("fit", "plane", tmp_path / "bore.csv")
    assert code == 1
    assert "the points span 40 m: if they do not count metres, say so with --unit" in said
    code, said = run("fit", "cylinder", tmp_path / "whole.npy", "--noise", "0.5")
    assert (code, "diameter 40." in said or "diameter 39." in said) == (0, True), said
    code, said = run("fit", "cylinder", tmp_path / "bore.csv", "--unit", "ft")
    assert (code, "one of mm, cm, m, in" in said) == (2, True)
