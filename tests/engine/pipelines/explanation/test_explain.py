from collections.abc import Iterator
from dataclasses import replace

import pytest

from cellwright.engine.model.outcome import Found, Infeasible, Outcome
from cellwright.engine.pipelines.explanation import apply_amendment, explain_infeasibility
from cellwright.engine.pipelines.explanation.step_purposes import explain_step
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.grounding import ground
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import bundled_domains, load_problem
from cellwright.kb.model.planning_problem import Problem

QUICK = {"bulkhead/one_point": [], "bulkhead/both_tools": [pytest.mark.slow]}
ALL = [
    f"{name}/{file.stem}"
    for name, path in bundled_domains().items()
    for file in sorted(path.glob("problems/*.yaml"))
]
BUNDLED = [pytest.param(name, marks=QUICK.get(name, [pytest.mark.long])) for name in ALL]


def without_one_fact(problem: Problem) -> Iterator[tuple[str, Problem]]:
    """The problem without one of its static facts, given in the problem or in the domain's
    rules.
    """
    for fact in problem.statics:
        yield str(fact), replace(problem, statics=tuple(f for f in problem.statics if f != fact))
    for part in problem.domain.asp:
        if ":-" not in part.text and not part.text.startswith("#"):
            asp = tuple(other for other in problem.domain.asp if other is not part)
            yield part.text, replace(problem, domain=replace(problem.domain, asp=asp))


def told(problem: Problem) -> Outcome | set[str]:
    """The answer to a problem, or the codes of what is wrong with it."""
    try:
        return checked_plan.plan_problem(problem)
    except InvalidInput as error:
        return {each.code for each in error.diagnostics}


@pytest.mark.long
@pytest.mark.parametrize("target", BUNDLED)
def test_a_missing_static_fact_is_named_or_an_equally_small_change_found(target: str) -> None:
    problem = load_problem(target)
    if not isinstance(checked_plan.plan_problem(problem), Found):
        pytest.skip("only problems that have a plan can lose it")
    for fact, poorer in without_one_fact(problem):
        outcome = told(poorer)
        if isinstance(
            outcome, set
        ):  # the initial state speaks of something that the fact made, or a duration needs it
            assert outcome <= {"K103", "K115"}, fact
        if not isinstance(outcome, Infeasible):
            continue
        explanation = explain_infeasibility(poorer)
        assert explanation.status == "infeasible"
        assert explanation.goals
        sizes = [len(change.facts) for change in explanation.changes if change.kind != "drop goal"]
        assert 1 in sizes, f"without {fact}"
        for change in explanation.changes:
            outcome = checked_plan.plan_problem(apply_amendment(poorer, change))
            assert isinstance(outcome, Found)
            assert len(outcome.plan.steps) == change.proof


@pytest.mark.slow
def test_goals_that_exclude_each_other_are_told_with_the_reason() -> None:
    explanation = explain_infeasibility(load_problem("bulkhead/two_contacts"))
    assert len(explanation.goals) == 2
    assert explanation.exclusions
    assert {change.kind for change in explanation.changes} == {"drop goal"}


@pytest.mark.slow  # docs/first-steps.md shows the same, and what it shows is tried quickly
def test_an_initial_fact_that_is_in_the_way_is_named() -> None:
    change = explain_infeasibility(load_problem("bulkhead/tool_missing")).changes[0]
    assert (change.kind, list(map(str, change.facts))) == (
        "remove initial",
        ["location(slra, t3_746, elsewhere)"],
    )
    assert change.missing[-1].startswith("pick_up(t3_746, slra) is out of reach")


def test_a_feasible_problem_has_nothing_to_explain() -> None:
    assert explain_infeasibility(load_problem("bulkhead/one_point")).status == "feasible"


def test_every_step_leads_to_a_goal_and_every_order_has_a_reason() -> None:
    problem = load_problem("bulkhead/both_tools")
    outcome = checked_plan.plan_problem(problem)
    assert isinstance(outcome, Found)
    task = ground(problem)
    for step in outcome.plan.steps:
        reason = explain_step(task, outcome.plan, step.id)
        assert reason.purposes
        assert all(purpose.consumer is None or purpose.links for purpose in reason.purposes)
        orders = [order for order in reason.orders if order.later.id == step.id]
        assert [order.earlier.id for order in orders] == list(step.after)
        assert all(order.reason for order in reason.orders)


def test_a_step_that_is_not_there_is_bad_input() -> None:
    problem = load_problem("bulkhead/one_point")
    outcome = checked_plan.plan_problem(problem)
    assert isinstance(outcome, Found)
    with pytest.raises(InvalidInput, match="no step 9"):
        explain_step(ground(problem), outcome.plan, 9)


@pytest.mark.parametrize(
    ("operator", "gap"),
    [
        pytest.param(
            "pick",
            "no operator makes at(b1, gripper) true, and put(b1, filler) needs it",
            marks=pytest.mark.slow,
        ),
        ("put", "no operator makes at(b1, filler) true, and fill(b1, 250) needs it"),
        ("weigh", "no operator makes weighed(b1) true, and the goal needs it"),
    ],
)
def test_a_domain_without_an_operator_is_told_what_nothing_makes_true(
    operator: str, gap: str
) -> None:
    problem = load_problem("tests/domains/capping/problems/no_caps.yaml")
    left = tuple(each for each in problem.domain.operators if each.name != operator)
    explanation = explain_infeasibility(
        replace(problem, domain=replace(problem.domain, operators=left))
    )
    assert explanation.gaps == (gap,)
    assert all(change.kind == "drop goal" for change in explanation.changes)
