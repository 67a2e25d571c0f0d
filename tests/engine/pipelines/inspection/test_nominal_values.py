"""What steps measure: nominal values and limits from the domain, values from replies, and the
verdict.
"""

from pathlib import Path

import pytest

from cellwright.engine.formats.interop.measurement_tables import read_table
from cellwright.engine.pipelines.inspection.nominal_values import (
    ExpectedValue,
    MeasurementJudge,
    nominal_findings,
)
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.pipelines.simulators.true_part import PartTruth
from cellwright.engine.pipelines.simulators.true_state import GoodPart
from cellwright.kb.loader import load
from cellwright.kb.model.measured_results import Measured
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.syntax import parse_expression
from cellwright.kb.terms import Function, Number, Text

DOMAIN = """domain: scales
types: {tray: object, pan: object}
objects: {tray: [t1, t2], pan: [left]}
statics:
  target(tray, int): {}
  slack(tray, int): {}
fluents:
  dry(tray): {}
events:
  weighed(tray): {}
  seen(tray): {}
operators:
  weigh(Tray, Pan):
    types: {Pan: pan}
    adds: weighed(Tray)
    resources: Pan
    command:
      stream: scales(Tray)
      reply: value(Grams)
      measures: {of: Tray, by: Pan, quantity: mass, value: Grams, unit: g, nominal: 2 * target(Tray), tolerance: slack(Tray)}
  see(Tray):
    adds: seen(Tray)
    command:
      stream: eye
      reply: value(Light)
      measures: {of: spot(Tray), value: Light, unit: lx, lower: -5}
  dry(Tray):
    adds: dry(Tray)
"""
PROBLEM = """problem: weigh
domain: scales
statics: ["target(t1, 400), slack(t1, 5)"]
goals: [dry(t1)]
"""


@pytest.fixture
def problem(tmp_path: Path) -> Problem:
    (tmp_path / "domain.yaml").write_text(DOMAIN)
    (tmp_path / "problem.yaml").write_text(PROBLEM)
    found = load(tmp_path / "problem.yaml").problem
    assert found is not None
    return found


def term(text: str) -> Function:
    found = parse_expression("term", text, "s").value
    assert isinstance(found, Function)
    return found


def test_a_nominal_value_and_its_zone_come_from_facts(problem: Problem) -> None:
    expected = MeasurementJudge(problem).expected(term("weigh(t1, left)"))
    assert expected == ExpectedValue("t1", "mass", "g", "left", 800, 797.5, 802.5)


def test_what_no_fact_tells_is_kept_and_not_judged(problem: Problem) -> None:
    found = MeasurementJudge(problem).measured(term("weigh(t2, left)"), term("value(7)"), 5)
    assert found == Measured("t2", "mass", 7, "g", None, None, None, "left", "weigh(t2, left)", 5)
    assert found.passed is None


@pytest.mark.parametrize(
    ("value", "passed"),
    [(Number(797), False), (Text("797.5"), True), (Number(802), True), (Text("802.6"), False)],
)
def test_a_value_passes_between_its_limits(
    problem: Problem, value: Number | Text, passed: bool
) -> None:
    found = MeasurementJudge(problem).measured(
        term("weigh(t1, left)"), Function("value", (value,)), 0
    )
    assert found is not None
    assert found.passed is passed


def test_one_limit_is_enough(problem: Problem) -> None:
    measuring = MeasurementJudge(problem)
    assert [
        each.passed
        for value in (-6, -5)
        if (each := measuring.measured(term("see(t1)"), Function("value", (Number(value),)), 0))
    ] == [False, True]
    assert measuring.expected(term("see(t1)")) == ExpectedValue(
        "spot(t1)", "see", "lx", "", None, -5, None
    )


@pytest.mark.parametrize(
    "reply", ["done", "value(gone)", 'value("nan")', 'value("1e999")', 'value("")', "value(1, 2)"]
)
def test_a_reply_without_a_number_measures_nothing(problem: Problem, reply: str) -> None:
    assert MeasurementJudge(problem).measured(term("weigh(t1, left)"), term(reply), 0) is None


def test_a_step_that_measures_nothing_has_no_result(problem: Problem) -> None:
    assert MeasurementJudge(problem).expected(term("dry(t1)")) is None
    assert MeasurementJudge(problem).measured(term("dry(t1)"), term("done"), 0) is None
    assert nominal_findings(problem) == []


def test_a_table_brings_nominal_values(tmp_path: Path) -> None:
    (tmp_path / "points.csv").write_text(
        "name,x,y,z,nx,ny,nz,nominal\na,0,0,0,0,0,1,6.35\nb,1,0,0,0,0,1,\n"
    )
    assert [each.nominal_m for each in read_table(tmp_path / "points.csv").points] == [
        pytest.approx(0.00635),
        None,
    ]


def test_a_simulated_part_of_which_nothing_is_known_gives_what_is_usual() -> None:
    problem = problem_of("bulkhead/twelve_points")
    good, truth = GoodPart(problem, 1), PartTruth(problem)
    wall, surface = (
        term("us_measure(us_probe, t3_746, m1)"),
        term("laser_measure(slra, t3_746, m4)"),
    )
    assert abs(int(good.value(wall, 1)) - 5000) < 200
    assert abs(int(good.value(surface, 1))) < 200
    assert truth.value(wall) == "5000"
    measured = MeasurementJudge(problem).heard(wall, "value(4993)", 0)
    assert measured is not None
    assert (measured.nominal, measured.passed) == (None, None)
