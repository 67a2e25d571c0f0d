"""Quantities at the end of the numbers of the language: sums of them are exact, and none gets
larger than a number can be.
"""

from pathlib import Path

import pytest

from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.kb.loader import load_problem

DOMAIN = """domain: tanks
types: {tank: object}
objects: {tank: [t1, t2, t3]}
quantities:
  level(tank): RANGE
operators:
  fill(T):
    types: {T: tank}
    increase: {level(T): 1000000000}
"""
PROBLEM = """problem: one
domain: ..
initial: ['level(t1, 0)', 'level(t2, 0)', 'level(t3, 1000000000)']
goals: ['GOAL']
"""


@pytest.mark.parametrize(
    ("range_", "goal", "steps"),
    [
        ("0..2000000000", "2*level(t1) + 2*level(t2) >= 2147483647", 2),
        ("0..2000000000", "level(t1) + level(t2) + level(t3) >= 2147483647", 2),
        ("..", "level(t1) + level(t2) >= level(t3) + 2000000000", 3),
        ("0..", "level(t1) >= 2000000000", 2),
        ("0..", "level(t1) >= 2147483647", None),
        ("..", "level(t1) - level(t2) > 2000000000", None),
    ],
)
def test_large_quantities(tmp_path: Path, range_: str, goal: str, steps: int | None) -> None:
    (tmp_path / "problems").mkdir()
    (tmp_path / "domain.yaml").write_text(DOMAIN.replace("RANGE", range_))
    file = tmp_path / "problems" / "one.yaml"
    file.write_text(PROBLEM.replace("GOAL", goal))
    outcome = checked_plan.plan_problem(load_problem(str(file)))
    if steps is None:
        assert isinstance(outcome, Infeasible)
    else:
        assert isinstance(outcome, Found)
        assert len(outcome.plan.steps) == steps
