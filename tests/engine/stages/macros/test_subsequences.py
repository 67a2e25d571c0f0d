"""Sub-sequences are found, all and only those that can run on their own, and those of one shape together."""

import itertools

import pytest

from cellwright.engine.stages.macros.learning.subsequences import (
    LONGEST,
    Order,
    fits,
    occurring,
    recurring,
    shape,
)
from cellwright.engine.stages.macros.lifted.execution import executed
from cellwright.engine.stages.macros.lifted.situation import Situation
from cellwright.engine.stages.macros.lifted.world import CellDomain
from cellwright.engine.stages.validation.semantics import Semantics
from cellwright.kb.loader import load_plan
from cellwright.kb.model.plan import Plan, Step
from cellwright.kb.model.problem import Problem
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
        reached |= {b for a, b in links if a in reached} & ids | {a for a, b in links if b in reached} & ids
    return reached == ids


def slow(plan: Plan) -> list[tuple[Step, ...]]:
    """All connected sets of steps between which no other step must come, by looking at every set."""
    before = plan.predecessors()
    found = []
    for size in range(2, LONGEST + 1):
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
        key = shape([step.operator for step in steps])
        counts[key] = counts.get(key, 0) + 1
    assert counts
    assert {shape(each.operators): each.count for each in recurring(plan)} == counts


def test_what_comes_before_a_subsequence_leads_to_where_it_can_run(made: tuple[Problem, Plan]) -> None:
    problem, plan = made
    start = Situation.of(CellDomain(problem), Semantics(problem).initial())
    for each in recurring(plan):
        assert executed(Plan((*each.before, *each.steps)), start) is not None


def test_a_shape_forgets_names_and_keeps_what_is_equal() -> None:
    def moved(*pairs: tuple[str, str]) -> list[Function]:
        return [Function("move", (Function(a), Function("slot", (Function(b),)))) for a, b in pairs]

    assert shape(moved(("a", "b"), ("a", "c"))) == shape(moved(("c", "a"), ("c", "b")))
    assert shape(moved(("a", "b"), ("a", "c"))) != shape(moved(("a", "b"), ("b", "c")))


def test_occurrences_fit_the_pattern_and_do_not_overlap(made: tuple[Problem, Plan]) -> None:
    _, plan = made
    for each in recurring(plan):
        pattern = tuple(
            Function(op.name, tuple(Variable(f"A{n}{m}") for m in range(len(op.arguments))))
            for n, op in enumerate(each.operators)
        )
        found = list(occurring(Order(plan), pattern))
        assert found
        assert all(fits(pattern, [step.operator for step in steps]) for steps in found)
        ids = [step.id for steps in found for step in steps]
        assert len(ids) == len(set(ids))
