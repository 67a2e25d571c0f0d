"""Facts in the way are the reason that is told, with the thing that they concern."""

from pathlib import Path

import pytest

from cellwright.engine.formats.report.plans.explanation_report import explanation_text
from cellwright.engine.model.plan_explanation import Explanation
from cellwright.engine.pipelines.explanation import explain_infeasibility
from cellwright.kb.loader import load_problem

SHOP = """domain: shop
types: {tool: object, drill: tool, saw: tool, part: object, state: [fine, worn]}
objects: {drill: [drill_1], saw: [saw_1]}
statics:
  broken(tool): {}
  takes(part, tool): {}
fluents:
  edge(tool, state): {}
  machined(part): {}
  hung(tool): {}
operators:
  machine(P, T):
    where: takes(P, T), not broken(T)
    preconditions: edge(T, fine)
    adds: machined(P)
  hang(T):
    preconditions: edge(T, fine)
    adds: hung(T)
deductive_operators:
  - when: edge(T, S)
    denies: edge(T, Other), Other != S
defaults: ["edge(drill_1, fine)", "edge(saw_1, fine)"]
"""


def explained(folder: Path, facts: str) -> Explanation:
    (folder / "problems").mkdir()
    (folder / "domain.yaml").write_text(SHOP)
    file = folder / "problems" / "p.yaml"
    file.write_text(
        f"problem: p\ndomain: shop\nobjects: {{part: [plate]}}\n{facts}goals: ['machined(plate)']\n"
    )
    return explain_infeasibility(load_problem(str(file)))


@pytest.mark.parametrize(
    ("facts", "said"),
    [
        (
            "statics: ['takes(plate, drill_1)', 'broken(drill_1)']\n",
            "drill_1 (drill) is not available: the problem says broken(drill_1)",
        ),
        (
            "statics: ['takes(plate, drill_1)']\ninitial: ['edge(drill_1, worn)']\n",
            "drill_1 (drill) is not available: edge(drill_1, worn) holds at the start, and no step "
            "that can be taken ends that",
        ),
    ],
)
def test_the_tool_that_is_missing_is_the_reason(tmp_path: Path, facts: str, said: str) -> None:
    explanation = explained(tmp_path, facts)
    assert explanation.obstacles == (said,)
    text = str(explanation_text(explanation))
    assert text.splitlines()[1:3] == [
        "This goal cannot be reached: machined(plate)",
        f"  because {said}",
    ]


def test_no_change_says_that_the_part_takes_another_tool(tmp_path: Path) -> None:
    explanation = explained(tmp_path, "statics: ['takes(plate, drill_1)', 'broken(drill_1)']\n")
    assert [str(change) for change in explanation.changes] == ["remove static broken(drill_1)"]


def test_a_tool_is_proposed_where_nothing_is_in_the_way(tmp_path: Path) -> None:
    explanation = explained(tmp_path, "")
    assert explanation.obstacles == ()
    facts = {str(fact) for change in explanation.changes for fact in change.facts}
    assert {"takes(plate, drill_1)", "takes(plate, saw_1)"} & facts


def test_a_fact_that_a_step_could_end_is_not_said_to_stay(tmp_path: Path) -> None:
    own = SHOP.replace(
        "deductive_operators:",
        "  grind(T, P):\n    preconditions: edge(T, worn), not machined(P)\n"
        "    adds: edge(T, fine), spoilt(P)\ndeductive_operators:",
    )
    own = own.replace("  hung(tool): {}\n", "  hung(tool): {}\n  spoilt(part): {}\n")
    own = own.replace(
        "preconditions: edge(T, fine)\n    adds: machined",
        "preconditions: edge(T, fine), not spoilt(P)\n    adds: machined",
    )
    (tmp_path / "problems").mkdir()
    (tmp_path / "domain.yaml").write_text(own)
    file = tmp_path / "problems" / "p.yaml"
    file.write_text(
        "problem: p\ndomain: shop\nobjects: {part: [plate]}\n"
        "statics: ['takes(plate, drill_1)']\ninitial: ['edge(drill_1, worn)']\n"
        "goals: ['machined(plate)']\n"
    )
    (said,) = explain_infeasibility(load_problem(str(file))).obstacles
    assert said.endswith("edge(drill_1, worn) holds at the start")
