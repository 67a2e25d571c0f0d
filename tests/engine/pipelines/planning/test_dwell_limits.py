"""What stays too long in a place is told by all commands that tell times, in the same words,
with what to do about it.
"""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app

DOMAIN = """domain: ovens
types: {place: object, tray: object}
objects: {place: [oven, table], tray: [one, two]}
statics: {"longest_stay(place, time)": {}}
fluents: {"at(tray, place)": {}, "free(place)": {}}
events: {"baked(tray, time)": {}}
operators:
  carry(Tray, From, To):
    where: From != To
    preconditions: at(Tray, From), free(To)
    adds: at(Tray, To)
    resources: hand, Tray
    duration: 5 s
  bake(Tray, Time):
    preconditions: at(Tray, oven)
    adds: baked(Tray, Time)
    resources: oven, Tray
    duration: Time
deductive_operators:
  - {when: "at(Tray, Place)", denies: "at(Tray, Other), Other != Place"}
  - {when: "at(Tray, oven)", denies: free(oven)}
  - {when: "not at(Tray, Place)", implies: free(Place)}
defaults: ["at(Tray, table)", free(Place)]
"""
PROBLEM = """problem: PROBLEM
domain: ovens
statics: ["longest_stay(oven, MOST)"]
workflow:
  - for: {T: [one, two]}
    stages: "baked(T, 60), at(T, table)"
"""
SAID = (
    "Longer than longest_stay allows: one in oven for 60 s, at most 59; two in oven for 60 s, "
    "at most 59."
)
ADVICE = "Allow more time there"


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    home = tmp_path_factory.mktemp("ovens")
    (home / "domain.yaml").write_text(DOMAIN, "utf-8")
    for name, most in (("tight", "59"), ("wide", "60")):
        (home / f"{name}.yaml").write_text(
            PROBLEM.replace("PROBLEM", name).replace("MOST", most), "utf-8"
        )
    return home


def said(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, arguments, env={"COLUMNS": "200"})
    return result.exit_code, result.stdout


@pytest.mark.parametrize(
    "verb", [["plan"], ["schedule"], ["plan", "--objective", "cost"]], ids=" ".join
)
def test_plan_and_schedule_say_the_same_of_stays(cell: Path, verb: list[str]) -> None:
    code, told = said(*verb, str(cell / "tight.yaml"))
    assert code == 0
    assert SAID in told
    assert ADVICE in told
    code, told = said(*verb, str(cell / "wide.yaml"))
    assert code == 0
    assert "longest_stay" not in told
    assert "longest stays" not in told


def test_that_no_order_keeps_to_them_is_told_by_both(cell: Path) -> None:
    for verb in ("plan", "schedule"):
        assert (
            "in no order of the steps is everything taken away in time (longest_stay)"
            in said(verb, str(cell / "tight.yaml"))[1]
        )


def test_a_plan_in_a_file_is_told_the_same(cell: Path) -> None:
    file = cell / "plan.json"
    assert said("plan", str(cell / "tight.yaml"), "-o", str(file))[0] == 0
    stays = [
        {"thing": each, "place": "oven", "lasts": 60, "longest_stay": 59} for each in ("one", "two")
    ]
    assert json.loads(file.read_text())["data"]["overstays"] == stays
    for verb in ("schedule", "validate"):
        code, told = said(verb, str(file))
        assert (code, SAID in told, ADVICE in told) == (0, True, True)


def test_a_run_tells_what_stayed_too_long(cell: Path) -> None:
    code, told = said("run", str(cell / "tight.yaml"), "--store", str(cell / "runs.db"))
    assert code == 0
    assert "one was at least 1 s too long in oven" in told
    assert (
        "too long" not in said("run", str(cell / "wide.yaml"), "--store", str(cell / "runs.db"))[1]
    )


def test_what_is_left_of_a_quantity_stays_in_no_place(tmp_path: Path) -> None:
    text = DOMAIN.replace("events:", 'quantities: {"gas(place)": 0..9}\nevents:').replace(
        "resources: oven", "decrease: {gas(oven): 1}\n    resources: oven"
    )
    slowly = text.replace("duration: 5 s", "duration: 40 s")  # gas(oven, 8) lasts 80 s
    (tmp_path / "domain.yaml").write_text(slowly, "utf-8")
    problem = PROBLEM.replace("PROBLEM", "gas").replace("MOST", "60")
    file = tmp_path / "gas.yaml"
    gas = 'initial: ["gas(oven, 9)"]\nstatics:'
    file.write_text(problem.replace("statics:", gas), "utf-8")
    code, told = said("plan", str(file))
    assert (code, "longest_stay" in told) == (0, False)
