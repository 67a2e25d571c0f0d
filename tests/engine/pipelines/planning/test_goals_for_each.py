"""A goal about all objects is one goal for each of them where not all can be reached."""

from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app
from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.execution.run_goals import RunScope
from cellwright.engine.pipelines.planning.goal_selection import select_goals
from cellwright.engine.pipelines.planning.quantifiers import expand_forall
from cellwright.engine.pipelines.planning.restrictions import forbid_steps
from cellwright.kb.loader import load_problem
from cellwright.kb.model.conditions import And, goal_parts
from cellwright.kb.model.planning_problem import Problem

DOMAIN = """domain: sorting
types: {item: object, colour: object}
objects: {item: [a, b, c], colour: [red, blue]}
statics: {"heavy(item)": {}, "asked(item, colour)": {}}
fluents: {"sorted(item)": {}, "shown(item, colour)": {}}
operators:
  sort(Item): {adds: sorted(Item), resources: "belt, Item", command: {stream: belt(sort), reply: done}}
  show(Item, Colour): {adds: "shown(Item, Colour)", resources: "belt, Item"}
"""


def problem(folder: Path, goal: str) -> Problem:
    (folder / "domain.yaml").write_text(DOMAIN, "utf-8")
    (folder / "all.yaml").write_text(
        'problem: all\ndomain: sorting\nstatics: ["heavy(b), heavy(c), asked(c, blue), '
        f'asked(a, red)"]\ngoals: ["{goal}"]\n',
        "utf-8",
    )
    return load_problem(folder / "all.yaml")


def goals(folder: Path, goal: str) -> list[str]:
    return [str(each) for each in goal_parts(expand_forall(problem(folder, goal)).goal)]


@pytest.mark.parametrize(
    ("goal", "parts"),
    [
        ("sorted(I) : item(I)", ["sorted(a)", "sorted(b)", "sorted(c)"]),
        ("sorted(I) : heavy(I)", ["sorted(b)", "sorted(c)"]),
        ("sorted(a)", ["sorted(a)"]),
    ],
)
def test_what_statics_decide_is_decided(tmp_path: Path, goal: str, parts: list[str]) -> None:
    assert goals(tmp_path, goal) == parts


def test_pairs_that_statics_name_are_meant(tmp_path: Path) -> None:
    assert goals(tmp_path, "shown(I, C) : asked(I, C)") == ["shown(a, red)", "shown(c, blue)"]


def test_one_lost_object_does_not_take_the_others_with_it(tmp_path: Path) -> None:
    found = select_goals(forbid_steps(problem(tmp_path, "sorted(I) : item(I)"), ["b"]))
    assert isinstance(found.outcome, Found)
    assert sorted(str(step.operator) for step in found.outcome.plan.steps) == ["sort(a)", "sort(c)"]
    assert [each.goal for each in found.given_up] == ["sorted(b)"]


def test_a_scope_keeps_whole_what_is_kept_whole_and_the_rest_in_parts(tmp_path: Path) -> None:
    given = problem(tmp_path, "sorted(I) : item(I)")
    pairs = problem(tmp_path, "shown(I, C) : asked(I, C)")
    both = replace(given, goal=And((given.goal, pairs.goal)))
    whole, *_ = goal_parts(given.goal)
    narrowed = RunScope(both).cut({}, {str(whole), "shown(a, red)"})
    assert [str(each) for each in goal_parts(narrowed.problem.goal)] == [
        str(whole),
        "shown(a, red)",
    ]


FAULTS = """faults: sorting
exceptions:
  gone: {of: sort(Item), reply: gone, causes: {lost: 1}}
causes:
  lost: {say: it fell off, loses: [Item]}
repairs:
  write_off: {cost: 1, loses: [Item], cures: [lost]}
"""


def test_a_run_goes_on_with_the_other_objects(tmp_path: Path) -> None:
    problem(tmp_path, "sorted(I) : item(I)")
    (tmp_path / "faults.yaml").write_text(FAULTS, "utf-8")
    line = [
        "run",
        str(tmp_path / "all.yaml"),
        "--fault",
        "sort(b)=lost",
        "--store",
        str(tmp_path / "runs.db"),
    ]
    told = CliRunner().invoke(app, line, env={"COLUMNS": "200"}).stdout
    assert "1 of the goals could not be reached" in told
    assert "given up: sorted(b): b is lost" in told
    assert "2 steps, 1 exception" in told
