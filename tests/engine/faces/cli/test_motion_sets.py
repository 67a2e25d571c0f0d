"""`cellwright motion`: pictures, problem sets and travel times."""

import base64
import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app

run = CliRunner().invoke
WAY = ["motion", "plan", "bulkhead", "--from", "home", "--to", "meas(m2)"]


def test_a_gltf_file_moves_as_long_as_the_motion_lasts(tmp_path: Path) -> None:
    file = tmp_path / "motion.gltf"
    assert run(app, [*WAY, "--format", "gltf", "-o", str(file)]).exit_code == 0
    lasts = json.loads(run(app, [*WAY, "--format", "json"]).stdout)["data"]["duration_s"]
    said = json.loads(file.read_text("utf-8"))
    (animation,) = said["animations"]
    clock = said["accessors"][animation["samplers"][0]["input"]]
    assert clock["max"][0] == pytest.approx(lasts, rel=1e-5)
    data = base64.b64decode(said["buffers"][0]["uri"].partition(",")[2])
    assert len(data) == said["buffers"][0]["byteLength"]


@pytest.mark.slow
def test_a_picture_is_a_png(tmp_path: Path) -> None:
    file = tmp_path / "motion.png"
    assert run(app, [*WAY, "--format", "png", "-o", str(file)]).exit_code == 0
    assert file.read_bytes().startswith(b"\x89PNG")
    assert run(app, [*WAY, "--format", "png"]).exit_code == 2


def test_a_saved_set_is_replayed_with_the_same_answers_and_a_changed_one_is_told(
    tmp_path: Path,
) -> None:
    drawn, answered = tmp_path / "set.json", tmp_path / "answered.json"
    words = ["motion", "problems", "bulkhead", "--count", "2", "--seed", "3"]
    assert run(app, [*words, "-o", str(drawn)]).exit_code == 0
    assert run(app, words).stdout == drawn.read_text("utf-8")
    plan = ["motion", "plan", "bulkhead", "--budget", "20000", "--problems"]
    assert run(app, [*plan, str(drawn), "-o", str(answered)]).exit_code == 0
    again = run(app, [*plan, str(answered)])
    assert again.exit_code == 0
    assert "2 of 2 as saved" in again.stdout
    said = json.loads(answered.read_text("utf-8"))
    said["problems"][0]["answer"]["path"] = "another"
    answered.write_text(json.dumps(said), encoding="utf-8")
    changed = run(app, [*plan, str(answered)])
    assert changed.exit_code == 10
    assert "1 of 2 as saved" in changed.stdout


@pytest.mark.parametrize(
    "text", ["[]", "{", '{"problems": []}', '{"problems": [{"from": "home"}]}']
)
def test_what_is_no_set_of_problems_is_refused(tmp_path: Path, text: str) -> None:
    file = tmp_path / "set.json"
    file.write_text(text, encoding="utf-8")
    result = run(app, ["motion", "plan", "bulkhead", "--problems", str(file), "--format", "json"])
    assert result.exit_code == 2
    assert [each["code"] for each in json.loads(result.stdout)["diagnostics"]] == ["K413"]


def test_travel_times_are_not_below_the_least_and_become_facts() -> None:
    words = ["motion", "travel", "bulkhead", "--tool", "us_probe"]
    words += ["--place", "meas(m1)", "--place", "meas(m2)", "--place", "meas(m3)"]
    said = json.loads(run(app, [*words, "--format", "json"]).stdout)["data"]
    times, least = said["times_s"], said["least_s"]
    assert all(times[i][j] >= least[i][j] - 1e-9 for i in range(3) for j in range(3) if i != j)
    assert times[0][1] == times[1][0]
    facts = run(app, [*words, "--format", "facts"]).stdout.splitlines()
    assert len(facts) == 6
    assert facts[0].startswith("  - travel(meas(m1), meas(m2), ")


def test_tours_by_the_times_of_free_paths_say_by_how_much_they_may_be_too_long() -> None:
    result = run(app, ["sequence", "bulkhead/one_point", "--cost", "motion", "--format", "json"])
    assert result.exit_code == 0
    for tour in json.loads(result.stdout)["data"]["tours"]:
        assert tour["time_s"] >= tour["least_s"] - 1e-9
        assert len(tour["moves_s"]) == len(tour["visits"])


def test_without_ends_or_problems_nothing_is_planned() -> None:
    assert run(app, ["motion", "plan", "bulkhead"]).exit_code == 2
    words = ["--problems", "set.json", "--from", "home", "--to", "home"]
    assert run(app, ["motion", "plan", "bulkhead", *words]).exit_code == 2


def test_ends_are_shown_with_four_digits() -> None:
    from cellwright.engine.formats.report.cells.motion_tables import _short_end

    assert _short_end("t3: -84.2873195073, 0.1234567, 90") == "t3: -84.29, 0.1235, 90"
    assert _short_end("rack(slra)") == "rack(slra)"
