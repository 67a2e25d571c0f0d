"""What a plan file says is checked: durations, costs, resources, starts, sums, links; and it
finds its domain.
"""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from cellwright.engine.authoring.starter import create_domain
from cellwright.engine.faces.cli import app
from cellwright.kb.loader import bundled_domains

Falsify = Callable[[dict[str, Any]], None]


def run(*words: str) -> tuple[int, str]:
    found = CliRunner().invoke(app, words, env={"COLUMNS": "200"})
    return found.exit_code, found.output


def _named(plan: dict[str, Any], name: str) -> dict[str, Any]:
    return next(step for step in plan["steps"] if step["operator"].startswith(name))


def _set(name: str, key: str, value: object) -> Falsify:
    return lambda plan: _named(plan, name).update({key: value})


def _link(**changes: object) -> Falsify:
    return lambda plan: plan["links"].append(
        {"producer": 0, "condition": "free(rim)", "consumer": 1} | changes
    )


FALSE: dict[str, tuple[Falsify, str]] = {
    "duration": (_set("heat", "duration", 5), "has the duration 600, not 5"),
    "cost": (_set("heat", "cost", 0), "has the cost 1, not 0"),
    "held": (_set("heat", "resources", ["probe_1"]), "must hold"),
    "held more": (
        _set("heat", "resources", ["slot(furnace, 1)", "probe_1", "rack"]),
        "holds no rack",
    ),
    "start": (_set("put", "start", 0), "starts at 0, but step"),
    "negative start": (lambda plan: plan["steps"][0].update(start=-1), "starts at -1, before 0"),
    "sum": (lambda plan: plan.update(cost=4), "the cost is 5, not 4"),
    "makespan": (lambda plan: plan.update(makespan=5), "the makespan is 619, not 5"),
    "history": (
        lambda plan: plan["histories"][0]["stages"][0].update(start=1),
        "has no heated(probe_1, 600) by step",
    ),
    "idle link": (_link(condition="free(stand)"), "the consumer does not need it"),
    "no stage": (_link(condition='_stage("nobody", 1)'), "there is no such stage"),
}


@pytest.fixture(scope="module")
def answer() -> str:
    code, text = run("plan", "themse/in_furnace", "--format", "json")
    assert code == 0
    return text


@pytest.mark.parametrize("claim", FALSE)
def test_a_false_claim_is_found(claim: str, answer: str, tmp_path: Path) -> None:
    falsify, said = FALSE[claim]
    document = json.loads(answer)
    falsify(document["data"]["plan"])
    file = tmp_path / "plan.json"
    file.write_text(json.dumps(document))
    code, text = run("validate", str(file))
    assert code == 1
    assert said in text


def test_a_stage_is_reached_by_the_step_that_the_link_names(answer: str, tmp_path: Path) -> None:
    document = json.loads(answer)
    link = next(
        each
        for each in document["data"]["plan"]["links"]
        if each["condition"].startswith("_stage") and each["producer"] > 0
    )
    link["producer"] = 1
    (tmp_path / "plan.json").write_text(json.dumps(document))
    assert "the producer does not reach it" in run("validate", str(tmp_path / "plan.json"))[1]


@pytest.mark.parametrize("verb", ["plan", "schedule"])
@pytest.mark.parametrize("target", ["themse/two", "bulkhead/both_tools"])
def test_what_is_given_out_claims_nothing_false(verb: str, target: str, tmp_path: Path) -> None:
    (tmp_path / "plan.json").write_text(run(verb, target, "--format", "json")[1])
    code, text = run("validate", str(tmp_path / "plan.json"))
    assert (code, text[:6]) == (0, "valid:")


def test_what_is_left_out_is_as_the_domain_says(answer: str, tmp_path: Path) -> None:
    document = json.loads(answer)
    plan = document["data"]["plan"]
    for key in ("makespan", "cost", "histories"):
        del plan[key]
    for step in plan["steps"]:
        for key in ("duration", "cost", "resources", "start"):
            del step[key]
    (tmp_path / "plan.json").write_text(json.dumps(document))
    assert "5 steps, cost 5, makespan 619 s" in run("validate", str(tmp_path / "plan.json"))[1]


def test_a_plan_finds_its_domain_from_any_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "here").mkdir()
    create_domain(tmp_path / "here" / "mine")
    monkeypatch.chdir(tmp_path / "here")
    text = run("plan", "mine/problems/two_items.yaml", "--format", "json")[1]
    (tmp_path / "plans").mkdir()
    (tmp_path / "plans" / "plan.json").write_text(text)
    for folder in (tmp_path, tmp_path / "plans", Path("/")):
        monkeypatch.chdir(folder)
        assert run("validate", str(tmp_path / "plans" / "plan.json"))[0] == 0


def test_a_plan_that_moves_with_its_domain_finds_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "old" / "plans").mkdir(parents=True)
    create_domain(tmp_path / "old" / "mine")
    monkeypatch.chdir(tmp_path / "old")
    text = run("plan", "mine/problems/two_items.yaml", "--format", "json")[1]
    (tmp_path / "old" / "plans" / "plan.json").write_text(text)
    monkeypatch.chdir("/")
    (tmp_path / "old").rename(tmp_path / "new")
    assert run("validate", str(tmp_path / "new" / "plans" / "plan.json"))[0] == 0


def test_a_folder_of_the_name_of_a_bundled_domain_does_not_hide_it(
    answer: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "plan.json").write_text(answer)
    work = tmp_path / "work"
    shutil.copytree(bundled_domains()["bulkhead"], work / "themse")
    monkeypatch.chdir(work)
    assert run("validate", str(tmp_path / "plan.json"))[0] == 0
