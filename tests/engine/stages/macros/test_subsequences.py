"""Sub-sequences are found, all and only those that can run on their own, and those of one shape
together.
"""

import itertools

import pytest

from cellwright.engine.stages.lifted.cell_domain import CellDomain, Situation
from cellwright.engine.stages.lifted.lifted_execution import final_situation
from cellwright.engine.stages.macros.learning.plan_subsequences import (
    MAX_SUBSEQUENCE_STEPS,
    PlanOrder,
    matches_pattern,
    matching_sequences,
    recurring_sequences,
    sequence_shape,
)
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.loader import load_plan
from cellwright.kb.model.plan_model import Plan, Step
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function, Variable
from tests.places import BUNDLED as GOLDEN

PLANS = [GOLDEN / "themse/golden/one.json", GOLDEN / "bulkhead/golden/one_point.json"]


@pytest.fixture(params=PLANS, ids=lambda path: path.stem)
def made(request: pytest.FixtureRequest) -> tuple[Problem, Plan]:
    return load_plan(request.param)


def connected(steps: tuple[Step, ...], plan: Plan) -> bool:
    ids = {step.id for step in steps}
    links = [(link.producer, link.consumer) for link in plan.links]
    reached = {steps[0].id}
    for _ in steps:
        reached |= {b for a, b in links if a in reached} & ids | {
            a for a, b in links if b in reached
        } & ids
    return reached == ids


def slow(plan: Plan) -> list[tuple[Step, ...]]:
    """All connected sets of steps between which no other step must come, by looking at every
    set.
    """
    before = plan.predecessors()
    found = []
    for size in range(2, MAX_SUBSEQUENCE_STEPS + 1):
        for steps in itertools.combinations(plan.steps, size):
            ids = {step.id for step in steps}
            after = {step.id for step in plan.steps if before[step.id] & ids}
            between = after & set().union(*(before[each] for each in ids)) - ids
            if not between and connected(steps, plan):
                found.append(steps)
    return found


def test_all_and_only_connected_runs_are_found(made: tuple[Problem, Plan]) -> None:
    _, plan = made
    counts: dict[str, int] = {}
    for steps in slow(plan):
        key = sequence_shape([step.operator for step in steps])
        counts[key] = counts.get(key, 0) + 1
    assert counts
    assert {
        sequence_shape(each.operators): each.count for each in recurring_sequences(plan)
    } == counts


def test_what_comes_before_a_subsequence_leads_to_where_it_can_run(
    made: tuple[Problem, Plan],
) -> None:
    problem, plan = made
    start = Situation.of(CellDomain(problem), Semantics(problem).initial())
    for each in recurring_sequences(plan):
        assert final_situation(Plan((*each.before, *each.steps)), start) is not None


def test_a_shape_forgets_names_and_keeps_what_is_equal() -> None:
    def moved(*pairs: tuple[str, str]) -> list[Function]:
        return [Function("move", (Function(a), Function("slot", (Function(b),)))) for a, b in pairs]

    assert sequence_shape(moved(("a", "b"), ("a", "c"))) == sequence_shape(
        moved(("c", "a"), ("c", "b"))
    )
    assert sequence_shape(moved(("a", "b"), ("a", "c"))) != sequence_shape(
        moved(("a", "b"), ("b", "c"))
    )


def test_occurrences_fit_the_pattern_and_do_not_overlap(made: tuple[Problem, Plan]) -> None:
    _, plan = made
    for each in recurring_sequences(plan):
        pattern = tuple(
            Function(op.name, tuple(Variable(f"A{n}{m}") for m in range(len(op.arguments))))
            for n, op in enumerate(each.operators)
        )
        found = list(matching_sequences(PlanOrder(plan), pattern))
        assert found
        assert all(matches_pattern(pattern, [step.operator for step in steps]) for steps in found)
        ids = [step.id for steps in found for step in steps]
        assert len(ids) == len(set(ids))
