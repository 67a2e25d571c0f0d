"""Durations that nobody decides, as operators say them, and what they amount to."""

from pathlib import Path

import pytest

from cellwright.kb import loader
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader.problem_amounts import amounts_of
from cellwright.kb.model.operator_amounts import DurationRange, range_of_step, step_of
from cellwright.kb.model.plan_model import StepId
from cellwright.kb.terms import Function

DOMAIN = """
domain: oven
types: {{item: object}}
objects: {{item: [bread, cake]}}
statics:
  takes(item, time): {{}}
fluents:
  baked(item): {{}}
operators:
  bake(I):
    adds: baked(I)
    duration: {duration}
"""
PROBLEM = """
problem: one
domain: domain.yaml
statics: ['takes(bread, 100)', 'takes(cake, 20)']
goals: ['baked(bread)']
"""


def _range(folder: Path, duration: str, item: str = "bread") -> DurationRange:
    (folder / "domain.yaml").write_text(DOMAIN.format(duration=duration))
    (folder / "problem.yaml").write_text(PROBLEM)
    problem = loader.load_problem(folder / "problem.yaml")
    amounts = amounts_of(problem)
    step = step_of(amounts, StepId(1), Function("bake", (Function(item),)))
    return range_of_step(amounts, step)


@pytest.mark.parametrize(
    ("duration", "expected"),
    [
        ("7 s", DurationRange(7, 7, 7)),
        ("{from: 60 s, to: 90 s}", DurationRange(60, 75, 90)),
        ("{from: 1 min, to: 2 min, usual: 70 s}", DurationRange(60, 70, 120)),
        ("{usual: 70 s, spread: 5 s}", DurationRange(55, 70, 85, 5)),
        ("{usual: 10 s, spread: 5 s}", DurationRange(0, 10, 25, 5)),
        ("{from: 60, to: 90, usual: 70, spread: 4}", DurationRange(60, 70, 90, 4)),
        ("{from: takes(I) - 5, to: takes(I) + 10}", DurationRange(95, 102, 110)),
    ],
)
def test_what_a_duration_amounts_to(tmp_path: Path, duration: str, expected: DurationRange) -> None:
    assert _range(tmp_path, duration) == expected


def test_a_range_of_an_instance_that_is_turned_is_refused_where_its_duration_is(
    tmp_path: Path,
) -> None:
    from cellwright.engine.pipelines.planning.checked_plan import plan_and_ground

    (tmp_path / "domain.yaml").write_text(
        DOMAIN.format(duration="{from: takes(I), to: 50, usual: 50}")
    )
    (tmp_path / "problem.yaml").write_text(PROBLEM)
    problem = loader.load_problem(tmp_path / "problem.yaml")
    with pytest.raises(InvalidInput) as refused:
        plan_and_ground(problem)
    assert [d.code for d in refused.value.diagnostics] == ["K115"]
