"""Lookup misses nothing that fits, and its fast check accepts no plan that the independent
checker refuses.
"""

import dataclasses
import functools
import random
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from macro_cells import GOLDEN, Example, atom, bundled, golden

from cellwright.engine.stages.lifted.cell_domain import Situation
from cellwright.engine.stages.macros.lookup.macro_index import MacroIndex
from cellwright.engine.stages.macros.lookup.macro_instances import MacroRefusal, check_instance
from cellwright.engine.stages.macros.lookup.macro_lookup import look_up
from cellwright.engine.stages.macros.lookup.macro_matching import (
    MatchingBudget,
    MatchingOrder,
    OutOfWork,
    join_macro_goals,
    match_macro,
)
from cellwright.engine.stages.macros.lookup.macro_query import (
    MacroQuery,
    make_query,
    query_variants,
)
from cellwright.engine.stages.validation import validate_plan
from cellwright.kb.model.conditions import And, Literal
from cellwright.kb.model.plan_model import Plan, Step
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import sort_naturally

each_golden = pytest.mark.parametrize("path", GOLDEN, ids=[path.stem for path in GOLDEN])


def examples() -> list[Example]:
    """All golden plans, and what was learned from each."""
    return list(map(golden, GOLDEN))


def situation(found: Example) -> Situation:
    return Situation.of(found.world, found.initial)


def asked(found: Example, problem: Problem | None = None) -> MacroQuery:
    made = make_query(problem or found.problem, situation(found))
    assert made is not None
    return made


@each_golden
def test_the_problem_that_taught_a_macrop_is_served_by_it(path: Path) -> None:
    found = golden(path)
    index = MacroIndex()
    for key, each in enumerate(examples()):
        index.add(key, each.learned.macrop)
    hits = filter(None, (look_up(index, each) for each in query_variants(asked(found))))
    hit = next(hits, None)
    assert hit is not None
    assert hit.plan.cost <= found.plan.cost
    assert validate_plan(found.problem, hit.plan) == []


def states(found: Example) -> list[Situation]:
    """The situations along a plan."""
    here = situation(found)
    reached = [here]
    for step in found.plan.steps:
        change = found.world.change(step.operator, here.facts)
        here = Situation(found.world, change.applied(here.facts))
        reached.append(here)
    return reached


def goals_of(found: Example) -> list[Literal]:
    """Everything that is ever true of the cell along a plan."""
    return [
        Literal(each) for each in sort_naturally({a for here in states(found) for a in here.facts})
    ]


@functools.cache
def chainless() -> tuple[Example, ...]:
    """Those without chains, and the plan with a lid."""
    found = [each for each in examples() if not each.problem.chains]
    return (*found, bundled("themse/lid_on_stand"))


@pytest.mark.slow
@given(data=st.data())
@settings(max_examples=20, deadline=None, suppress_health_check=list(HealthCheck))
def test_the_index_offers_every_macrop_that_matches(data: st.DataObject) -> None:
    found = data.draw(st.sampled_from(chainless()))
    here = data.draw(st.sampled_from(states(found)))
    goals = data.draw(
        st.lists(st.sampled_from(goals_of(found)), min_size=1, max_size=2, unique=True)
    )
    problem = dataclasses.replace(found.problem, goal=And(tuple(goals)), chains=())
    whole = make_query(problem, here)
    assert whole is not None
    index = MacroIndex()
    taught = data.draw(st.lists(st.sampled_from(_lessons()), max_size=12))
    for key, macrop in enumerate(taught):
        index.add(key, macrop)
    for each in query_variants(whole):
        offered = {entry.key for entry in index.candidates(each)}
        fitting = {
            key
            for key, macrop in enumerate(taught)
            if next(match_macro(MatchingOrder(macrop), each, MatchingBudget()), None)
        }
        assert fitting <= offered


@pytest.mark.slow
@given(data=st.data())
@settings(max_examples=10, deadline=None, suppress_health_check=list(HealthCheck))
def test_goals_with_few_choices_first_gives_the_bindings_of_the_plain_join(
    data: st.DataObject,
) -> None:
    found = data.draw(st.sampled_from(chainless()))
    here = data.draw(st.sampled_from(states(found)))
    goals = data.draw(
        st.lists(st.sampled_from(goals_of(found)), min_size=1, max_size=3, unique=True)
    )
    whole = make_query(dataclasses.replace(found.problem, goal=And(tuple(goals)), chains=()), here)
    assert whole is not None
    for each in query_variants(whole):
        for macrop in data.draw(st.lists(st.sampled_from(_lessons()), max_size=12)):
            program = MatchingOrder(macrop)
            if len(macrop.goals) != len(each.goals):
                continue
            bare = MatchingOrder(dataclasses.replace(macrop, exclusions=()))
            try:
                plain = {
                    frozenset(bindings.items())
                    for bindings in join_macro_goals(program, each, MatchingBudget(20_000))
                }
            except OutOfWork:
                continue
            fast = {
                frozenset(bindings.items())
                for bindings in match_macro(bare, each, MatchingBudget(100_000))
            }
            assert fast == plain


@functools.cache
def _lessons() -> list[object]:
    """MACROPs of the plans and of their last parts."""
    return [macrop for each in chainless() for macrop in _parts(each)]


_known: dict[int, list[object]] = {}


def _parts(found: Example) -> list[object]:
    if id(found) not in _known:
        _known[id(found)] = list(_taught(found))
    return _known[id(found)]


def _taught(found: Example) -> Iterator[object]:
    from cellwright.engine.stages.lifted.operator_schemas import NotGeneral
    from cellwright.engine.stages.macros.learning.plan_generalisation import generalise_plan

    reached = states(found)
    for first in range(0, len(found.plan.steps), 3):
        kept = found.plan.steps[first:]
        names = {step.id for step in kept}
        steps = tuple(
            dataclasses.replace(step, after=tuple(each for each in step.after if each in names))
            for step in kept
        )
        for goal in sort_naturally(set(reached[-1].facts) - set(reached[first].facts))[:3]:
            problem = dataclasses.replace(found.problem, goal=Literal(goal), chains=())
            try:
                yield generalise_plan(
                    problem, Plan(steps), found.world, reached[first].state
                ).macrop
            except NotGeneral:
                continue


@st.composite
def spoilt(draw: st.DrawFn, plan: Plan) -> Plan:
    """A plan with steps left out, changed over, or freed of their order."""
    steps = list(plan.steps)
    for _ in range(draw(st.integers(0, 2))):
        place = draw(st.integers(0, len(steps) - 1))
        what = draw(st.sampled_from(["drop", "swap", "free"]))
        if what == "drop" and len(steps) > 1:
            steps = _without(steps, place)
        elif what == "swap" and place + 1 < len(steps):
            one, other = steps[place], steps[place + 1]
            steps[place] = dataclasses.replace(other, id=one.id, after=one.after)
            steps[place + 1] = dataclasses.replace(one, id=other.id, after=other.after)
        elif what == "free":
            steps[place] = dataclasses.replace(steps[place], after=())
    return Plan(tuple(steps))


def _without(steps: list[Step], place: int) -> list[Step]:
    gone = steps[place]
    return [
        dataclasses.replace(
            step,
            after=tuple(
                dict.fromkeys(b for a in step.after for b in (gone.after if a == gone.id else (a,)))
            ),
        )
        for step in steps
        if step.id != gone.id
    ]


@each_golden
@given(data=st.data())
@settings(max_examples=12, deadline=None, suppress_health_check=list(HealthCheck))
def test_the_fast_check_accepts_only_what_the_checker_accepts(
    path: Path, data: st.DataObject
) -> None:
    found = golden(path)
    plan = data.draw(spoilt(found.plan))
    accepted = isinstance(check_instance(plan, asked(found)), Situation)
    problem = found.problem.replace(sort_naturally(found.initial))
    assert not (accepted and validate_plan(problem, plan))


@each_golden
def test_the_fast_check_accepts_plans_and_knows_where_they_lead(path: Path) -> None:
    found = golden(path)
    after = check_instance(found.plan, asked(found))
    assert isinstance(after, Situation)
    assert after.state == states(found)[-1].state


def test_a_goal_that_held_is_not_given_up_for_another() -> None:
    found = bundled("bulkhead/one_point")
    here = Literal(atom("at(t3_746, in_contact_point(meas(m1)))"))
    problem = dataclasses.replace(found.problem, goal=And((found.problem.goal, here)))
    both = asked(found, problem)
    assert both.kept == (here,)
    assert isinstance(check_instance(found.plan, both), MacroRefusal)
    index = MacroIndex()
    index.add(0, found.learned.macrop)
    assert all(look_up(index, each) is None for each in query_variants(both))


def test_what_is_removed_is_not_offered() -> None:
    found = bundled("bulkhead/one_point")
    index = MacroIndex()
    index.add("x", found.learned.macrop)
    assert [entry.key for entry in index.candidates(asked(found))] == ["x"]
    index.remove("x")
    assert index.candidates(asked(found)) == []
    assert len(index) == 0


def test_lookup_does_not_hang_on_the_order_in_which_macrops_were_learned() -> None:
    found = bundled("bulkhead/twelve_points")
    plans = set()
    for seed in range(3):
        index = MacroIndex()
        macrops = [each.learned.macrop for each in examples()]
        random.Random(seed).shuffle(macrops)
        for key, macrop in enumerate(macrops):
            index.add(key, macrop)
        hit = look_up(index, asked(found))
        assert hit is not None
        plans.add(hit.plan)
    assert len(plans) == 1
