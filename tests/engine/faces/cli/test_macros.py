"""`macros`, `prepare` and `plan --store`: what people do with a library."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from cellwright.engine.authoring.starter import create_domain
from cellwright.engine.faces.cli import app
from cellwright.engine.pipelines.jobs import DraftedResult
from cellwright.engine.pipelines.jobs.input_digests import content_digest
from cellwright.engine.pipelines.precompute.preparation_results import PreparationJob
from cellwright.engine.pipelines.precompute.problem_preparation import prepare_problem
from tests.places import BUNDLED

BULKHEAD = BUNDLED / "bulkhead"
run = CliRunner().invoke


@pytest.fixture
def store(tmp_path: Path) -> str:
    return str(tmp_path / "library.db")


def answer(*arguments: str) -> tuple[int, dict[str, Any]]:
    """The exit code and the data of a command asked for JSON."""
    result = run(app, [*arguments, "--format", "json"])
    return result.exit_code, json.loads(result.stdout)["data"]


def source(*arguments: str) -> tuple[str, int | None]:
    code, found = answer("plan", *arguments)
    assert code == 0
    return found["source"]["origin"], found["source"]["macrop"]


def test_a_plan_is_learned_and_then_looked_up_for_another_point(store: str) -> None:
    assert source("bulkhead/one_point", "--store", store) == ("planner", 1)
    other = ("--goals", "measured(us_probe, t3_746, meas(m1))", "--store", store)
    assert source(
        "bulkhead/one_point", "--goals", "measured(_, _, meas(m2))", "--store", store
    ) == (
        "library",
        1,
    )
    assert (
        source("bulkhead/one_point", *other)[0] == "planner"
    )  # it is there already: no way over another point
    assert source("bulkhead/one_point", *other) == ("library", 2)


def test_the_text_says_where_a_plan_comes_from(store: str) -> None:
    said = [run(app, ["plan", "bulkhead/one_point", "--store", store]).stdout for _ in range(2)]
    assert "learned as MACROP 1, measured(Id1, Tool1, Arm1, Id2)" in said[0]
    assert "An instance of MACROP 1" in said[1]
    assert said[0].splitlines()[:-1] == said[1].splitlines()[:-1]


def test_without_a_library_nothing_is_said_of_one() -> None:
    _, found = answer("plan", "bulkhead/one_point")
    assert set(found) == {"plan", "makespan"}


def test_a_plan_from_the_library_passes_through_a_file_to_the_checker(
    store: str, tmp_path: Path
) -> None:
    answer("plan", "bulkhead/one_point", "--store", store)
    file = tmp_path / "plan.json"
    file.write_text(
        run(app, ["plan", "bulkhead/one_point", "--store", store, "--format", "json"]).stdout
    )
    assert json.loads(file.read_text())["data"]["source"]["origin"] == "library"
    assert run(app, ["validate", str(file)]).exit_code == 0
    other = str(tmp_path / "other.db")
    code, found = answer("macros", "learn", str(file), "--store", other)
    assert (code, found["plans"][0]["macrop"]) == (0, 1)
    assert source("bulkhead/one_point", "--store", other) == ("library", 1)


def test_a_wrong_plan_is_not_learned(store: str, tmp_path: Path) -> None:
    envelope = json.loads(run(app, ["plan", "bulkhead/one_point", "--format", "json"]).stdout)
    envelope["data"]["plan"]["steps"].pop()
    file = tmp_path / "plan.json"
    file.write_text(json.dumps(envelope))
    code, found = answer("macros", "learn", str(file), "--store", store)
    assert (code, found["plans"][0]["macrop"]) == (1, None)


@pytest.mark.slow
def test_a_library_goes_through_a_file_into_another(store: str, tmp_path: Path) -> None:
    answer("prepare", "bulkhead", "--store", store, "--jobs", "1")
    file, other = str(tmp_path / "macros.json"), str(tmp_path / "other.db")
    _, written = answer("macros", "export", file, "--store", store)
    assert written["macrops"] >= 3
    assert answer("macros", "import", file, "--store", other)[1] == {
        "macrops": written["macrops"],
        "new": written["macrops"],
    }
    assert answer("macros", "import", file, "--store", other)[1]["new"] == 0
    again = tmp_path / "again.json"
    answer("macros", "export", str(again), "--store", other)
    assert again.read_text() == Path(file).read_text()


def test_what_is_no_file_of_macrops_is_refused(store: str, tmp_path: Path) -> None:
    file = tmp_path / "x.json"
    for text in (
        "",
        "{}",
        "[1]",
        '{"version": 7, "macrops": []}',
        '{"version": 1, "macrops": [{}]}',
    ):
        file.write_text(text)
        assert run(app, ["macros", "import", str(file), "--store", store]).exit_code == 2
    assert (
        run(app, ["macros", "import", str(tmp_path / "none.json"), "--store", store]).exit_code == 2
    )


def test_forgetting_by_number(store: str) -> None:
    answer("plan", "bulkhead/one_point", "--store", store)
    assert run(app, ["macros", "forget", "7", "--store", store]).exit_code == 2
    assert run(app, ["macros", "forget", "--store", store]).exit_code == 2
    assert answer("macros", "forget", "1", "--store", store)[1]["forgotten"] == 1
    assert answer("macros", "stats", "--store", store)[1]["macrops"] == 0


def test_an_edited_domain_makes_exactly_its_macrops_stale(store: str, tmp_path: Path) -> None:
    create_domain(tmp_path / "mine")
    domain, other = tmp_path / "mine" / "domain.yaml", str(tmp_path / "mine")
    answer("prepare", other, "--store", store, "--jobs", "1")
    answer("plan", "bulkhead/one_point", "--store", store)
    before = answer("macros", "list", "--domain", other, "--store", store)[1]["macrops"]
    assert before
    assert not any(each["stale"] for each in before)
    text = domain.read_text()
    changed = text.replace("duration: ", "duration: 1", 1)
    assert changed != text
    domain.write_text(changed)
    after = answer("macros", "list", "--domain", other, "--store", store)[1]["macrops"]
    stale = [each["number"] for each in after if each["stale"]]
    assert stale
    code, again = answer("prepare", other, "--store", store, "--jobs", "1")
    assert (code, sorted(map(int, again["stale"]))) == (0, stale)
    assert {each["origin"] for each in again["problems"] if each["status"] == "found"} == {
        "planner"
    }
    assert source("bulkhead/one_point", "--store", store)[0] == "library"


@pytest.mark.slow
def test_what_was_prepared_is_looked_up(store: str, tmp_path: Path) -> None:
    create_domain(tmp_path / "mine")
    origins = [
        {
            each["origin"]
            for each in answer("prepare", str(tmp_path / "mine"), "--store", store, "--jobs", jobs)[
                1
            ]["problems"]
        }
        for jobs in ("2", "1")
    ]
    assert origins == [{"planner"}, {"library"}]


@pytest.mark.slow
def test_a_prepared_problem_set_is_looked_up(store: str) -> None:
    code, first = answer("prepare", "bulkhead", "--store", store, "--jobs", "2")
    assert code == 0
    assert {each["problem"]: each["status"] for each in first["problems"]} == {
        "both_tools": "found",
        "one_point": "found",
        "three_stations": "found",
        "tool_missing": "infeasible",
        "twelve_points": "found",
        "two_contacts": "infeasible",
    }
    code, second = answer("prepare", "bulkhead", "--store", store, "--jobs", "1")
    assert {each["origin"] for each in second["problems"] if each["status"] == "found"} == {
        "library"
    }
    assert source("bulkhead/one_point", "--store", store)[0] == "library"
    assert source("bulkhead/twelve_points", "--store", store)[0] == "sequence"
    assert source("bulkhead/twelve_points", "--store", store, "--order", "free")[0] == "library"


@pytest.mark.slow
def test_measurements_that_are_too_many_to_be_planned_at_once_are_prepared_one_after_another(
    store: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "cellwright.engine.pipelines.precompute.problem_preparation.LARGE_INSTANCES", 100
    )
    problem = BULKHEAD / "problems" / "twelve_points.yaml"
    made = prepare_problem(
        PreparationJob(problem, store, 100_000, 0, content_digest(problem)), lambda: False
    )
    assert isinstance(made, DraftedResult)
    found = made.settled()
    assert (found.status, found.origin) == ("found", "sequence")


@pytest.mark.slow
def test_preparing_keeps_sequences_and_says_which_were_stale(store: str, tmp_path: Path) -> None:
    mine = shutil.copytree(BULKHEAD, tmp_path / "mine")
    first = answer("prepare", str(mine), "--store", store, "--jobs", "1")[1]["problems"]
    sequences = {each["problem"]: each["sequence"] for each in first}
    assert sequences["twelve_points"] == {"way": "made", "left": 12, "changes": {}}
    assert answer("sequence", "bulkhead/twelve_points", "--store", store)[1]["way"] == "kept"
    file = mine / "problems" / "twelve_points.yaml"
    file.write_text(
        file.read_text()
        .replace("[m1..12]", "[m1..13]")
        .replace("needs(m4, profile)", "needs(m4, thickness)\n  - position(m13, 500000, 500000, 0)")
    )
    again = answer("prepare", str(mine), "--store", store, "--jobs", "1")[1]["problems"]
    sequences = {each["problem"]: each["sequence"] for each in again}
    assert sequences["one_point"] == {"way": "kept", "left": 3, "changes": {}}
    assert sequences["twelve_points"]["way"] == "resequenced"
    assert sequences["twelve_points"]["changes"]["moved"] == 1


def test_problems_without_tools_to_choose_have_no_sequence(store: str) -> None:
    assert (
        answer("prepare", "themse/one", "--store", store, "--jobs", "1")[1]["problems"][0][
            "sequence"
        ]
        is None
    )


def test_a_broken_problem_is_told_and_the_others_are_prepared(store: str, tmp_path: Path) -> None:
    create_domain(tmp_path / "mine")
    (tmp_path / "mine" / "problems" / "zz_broken.yaml").write_text("problem: zz\ndomain: nowhere\n")
    code, found = answer("prepare", str(tmp_path / "mine"), "--store", store, "--jobs", "1")
    statuses = [each["status"] for each in found["problems"]]
    assert code == 2
    assert "found" in statuses
    assert statuses[-1] == "bad input"


def test_a_folder_without_problems_is_refused(store: str, tmp_path: Path) -> None:
    assert run(app, ["prepare", str(tmp_path), "--store", store]).exit_code == 2


@pytest.mark.parametrize("place", ["nowhere/at/all.db", "mysql://there/x"])
def test_a_place_for_no_library_is_bad_input(place: str) -> None:
    assert run(app, ["macros", "list", "--store", place]).exit_code == 2
    assert run(app, ["plan", "bulkhead/one_point", "--store", place]).exit_code == 2
