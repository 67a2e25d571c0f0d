"""After how long a command is given up, the domain says; tests go to the device of their step."""

import json
from fractions import Fraction
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app
from cellwright.engine.model.run_protocol import RecordKind
from cellwright.engine.pipelines.execution.compiled_program import device_of
from cellwright.engine.pipelines.execution.executable_plan import ReadyPlan, first_plan
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.pipelines.simulators import Injection
from cellwright.kb.asp import ground_term
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.domain_model import ReplyTimes
from tests.engine.pipelines.execution.executed_cells import executed

DOMAIN = """\
domain: bakery
types: {{loaf: object}}
objects: {{loaf: [rye]}}
statics:
  patience(loaf, time): {{}}
fluents:
  baked(loaf): {{}}
  cooled(loaf): {{}}
facts: []
operators:
  bake(Loaf):
    preconditions: not baked(Loaf)
    adds: baked(Loaf)
    duration: 10 min
{bake}
  cool(Loaf):
    preconditions: baked(Loaf)
    adds: cooled(Loaf)
    duration: 100 s
{timeouts}
"""
PROBLEM = "problem: one\ndomain: bakery\nstatics: ['patience(rye, 900)']\ngoals: ['cooled(rye)']\n"


def written(folder: Path, bake: str = "", timeouts: str = "") -> str:
    (folder / "problems").mkdir()
    bake = f"    timeout: {bake}" if bake else ""
    text = DOMAIN.format(bake=bake, timeouts=timeouts).replace("facts: []\n", "")
    (folder / "domain.yaml").write_text(text, encoding="utf-8")
    problem = folder / "problems" / "one.yaml"
    problem.write_text(PROBLEM, encoding="utf-8")
    return str(problem)


def limits_s(target: str) -> dict[str, float]:
    ready = first_plan(problem_of(target))
    assert isinstance(ready, ReadyPlan)
    return {
        activity.action: (activity.timeout_ms or 0) / 1000
        for activity in ready.compiled.program.activities.values()
    }


@pytest.mark.parametrize(
    ("bake", "timeouts", "limits"),
    [
        ("", "", [1230.0, 230.0]),
        ("15 min", "", [900.0, 230.0]),
        ("patience(Loaf)", "", [900.0, 230.0]),
        ("2 * patience(Loaf)", "timeouts: {factor: 1.5, floor: 4 min}", [1800.0, 240.0]),
        ("", "timeouts: {factor: 1.5, floor: 4 min}", [900.0, 240.0]),
        ("", "timeouts: {factor: 1}", [600.0, 100.0]),
        ("", "timeouts: {floor: 20 min}", [1200.0, 1200.0]),
    ],
)
def test_an_operator_says_it_else_the_cell_else_it_is_twice_the_forecast_and_half_a_minute(
    bake: str, timeouts: str, limits: list[float], tmp_path: Path
) -> None:
    assert list(limits_s(written(tmp_path, bake, timeouts)).values()) == limits


@pytest.mark.parametrize(
    ("bake", "timeouts", "said"),
    [
        ("9 min", "", "K113"),
        ("0 s", "", "K113"),
        ("Nobody", "", "K105"),
        ("", "timeouts: {factor: 0.5}", "not a factor"),
        ("", "timeouts: {factor: fast}", "not a factor"),
        ("", "timeouts: {floor: soon}", "not a time"),
        ("", "timeouts: {roof: 3 s}", "roof"),
    ],
)
def test_a_limit_that_no_step_can_keep_is_told_at_its_place(
    bake: str, timeouts: str, said: str, tmp_path: Path
) -> None:
    target = written(tmp_path, bake, timeouts)
    with pytest.raises(InvalidInput, match=said):
        problem_of(target)


def test_a_limit_that_facts_make_too_short_is_told_before_anything_moves(tmp_path: Path) -> None:
    target = written(tmp_path, "patience(Loaf) - 400")
    with pytest.raises(InvalidInput, match=r"bake\(rye\) is given up before it can end"):
        limits_s(target)


def test_a_plan_shows_the_limits_that_the_domain_says(tmp_path: Path) -> None:
    target = written(tmp_path, "15 min", "timeouts: {factor: 3}")
    shown = {
        form: CliRunner().invoke(app, ["plan", target, "--format", form]).stdout
        for form in ("text", "json")
    }
    assert "Given up without a reply: step 2 after 300 s; 1 after 900 s." in shown["text"]
    assert json.loads(shown["json"])["data"]["timeouts_ms"] == {"1": 900_000, "2": 300_000}


@given(
    lasts=st.fractions(0, 10**6),
    factor=st.fractions(1, 1000),
    floor=st.none() | st.fractions(0, 10**6),
)
def test_no_limit_is_less_than_the_forecast(
    lasts: Fraction, factor: Fraction, floor: Fraction | None
) -> None:
    limit = ReplyTimes(factor, floor).limit_s(lasts)
    assert limit >= lasts
    assert floor is None or limit >= floor


def test_a_test_goes_to_the_device_of_the_step_that_carries_it_out() -> None:
    _, records, _ = executed("themse/one", (Injection("pick", "not_gripped", 1),))
    tests = [
        (record.content["action"], record.content["stream"])
        for record in records
        if record.kind is RecordKind.COMMAND and record.content["command_kind"] == "test"
    ]
    assert tests
    assert all(stream.startswith("sensor(") for _, stream in tests), tests


def test_a_step_that_is_none_of_the_domain_has_no_device() -> None:
    problem = problem_of("themse/one")
    assert device_of(problem, ground_term("sense(slippage)")) == "sensor(slippage)"
    assert device_of(problem, ground_term("nosuch(slippage)")) == ""
    assert device_of(problem, None) == ""
