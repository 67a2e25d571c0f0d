"""Arithmetic in `duration`, `cost` and `resources` means what clingo's would."""

from pathlib import Path

import pytest

from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import load_problem

DOMAIN = """domain: tanks
include: [rules.lp]
units: {time: s}
types:
  place: object
  valve: term
functions:
  valve(int): valve
objects:
  place: [a]
statics:
  amount(int): {}
fluents:
  level(place, int): {}
operators:
  fill(Place, Before, After):
    where: amount(After), After = Before + 1
    preconditions: level(Place, Before)
    adds: level(Place, After)
    duration: DURATION
    cost: COST
    resources: RESOURCE
deductive_operators:
  - when: level(Place, Now)
    denies: level(Place, Other), Other != Now
"""
PROBLEM = "problem: p\ndomain: domain.yaml\ninitial: ['level(a, 0)']\ngoals: ['level(a, 3)']\n"


def outcome_of(
    folder: Path, duration: str = "1", cost: str = "1", resource: str = "pump"
) -> Found | Infeasible | object:
    text = DOMAIN.replace("DURATION", duration).replace("COST", cost).replace("RESOURCE", resource)
    (folder / "domain.yaml").write_text(text)
    (folder / "rules.lp").write_text("amount(0..4).")
    (folder / "p.yaml").write_text(PROBLEM)
    return checked_plan.plan_problem(load_problem(str(folder / "p.yaml")))


@pytest.mark.parametrize(
    ("duration", "cost", "lasts", "costs"),
    [
        ("2 * After", "After", [2, 4, 6], [1, 2, 3]),
        ("2 * After + 1", "After * After", [3, 5, 7], [1, 4, 9]),
        ("5 min * After", "7 - After", [300, 600, 900], [6, 5, 4]),
        ("10 / After", "10 \\ After", [10, 5, 3], [0, 0, 1]),
        ("(After + Before) * 2 s", "2", [2, 6, 10], [2, 2, 2]),
        ("After", "Before", [1, 2, 3], [0, 1, 2]),
    ],
)
def test_arithmetic_is_computed(
    tmp_path: Path, duration: str, cost: str, lasts: list[int], costs: list[int]
) -> None:
    found = outcome_of(tmp_path, duration, cost)
    assert isinstance(found, Found)
    assert [step.duration for step in found.plan.steps] == lasts
    assert [step.cost for step in found.plan.steps] == costs


def test_an_amount_without_a_value_is_reported_with_its_instance(tmp_path: Path) -> None:
    for duration, cost in (("10 / (After - 1)", "1"), ("1", "10 \\ (After - 1)")):
        with pytest.raises(
            InvalidInput, match=r"K115: \(10[/\\]\(1-1\)\) has no value, .* fill\(a, 0, 1\)"
        ):
            outcome_of(tmp_path, duration, cost)


@pytest.mark.parametrize("product", ["65536 * 65536 * After", "2000000000 * (After + 1)"])
def test_an_amount_that_wraps_around_is_reported(tmp_path: Path, product: str) -> None:
    for duration, cost in ((product, "1"), ("1", product)):
        with pytest.raises(InvalidInput, match=r"K115.*too large a number"):
            outcome_of(tmp_path, duration, cost)


@pytest.mark.parametrize(("duration", "cost"), [("2 - After", "1"), ("1", "1 - After")])
def test_a_negative_amount_is_reported_with_its_instance(
    tmp_path: Path, duration: str, cost: str
) -> None:
    with pytest.raises(InvalidInput, match=r"K113.*of fill\(a, [1-3], [2-4]\) is -"):
        outcome_of(tmp_path, duration, cost)


def test_a_resource_may_be_computed(tmp_path: Path) -> None:
    found = outcome_of(tmp_path, resource="valve(After + 1)")
    assert isinstance(found, Found)
    assert [str(step.resources[0]) for step in found.plan.steps] == [
        "valve(2)",
        "valve(3)",
        "valve(4)",
    ]
