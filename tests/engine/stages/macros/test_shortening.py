"""Reused plans lose their loops and needless steps, and stay right."""

import itertools
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from random import Random

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cellwright.engine.stages.grounding.grounding_program import ChangingPredicates
from cellwright.engine.stages.grounding.initial_facts import initial_state
from cellwright.engine.stages.lifted.cell_domain import CellDomain, Situation
from cellwright.engine.stages.macros.lookup.macro_instances import check_instance
from cellwright.engine.stages.macros.lookup.macro_query import MacroQuery, make_query
from cellwright.engine.stages.macros.lookup.shortening import shortened
from cellwright.engine.stages.validation import validate_plan
from cellwright.kb.model.plan_model import GOAL_STEP, INITIAL_STEP, CausalLink, Plan, Step, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function, Number
from tests.road_maps import Roads, road_map, road_problem


def query_of(problem: Problem) -> MacroQuery:
    state, _ = initial_state(problem, ChangingPredicates(problem.domain))
    found = make_query(problem, Situation.of(CellDomain(problem), state))
    assert found is not None
    return found


def drive(roads: Roads, one: int, other: int) -> tuple[Function, int]:
    cost = roads[one, other]
    return Function(
        "drive", (Function("v0"), Function(f"p{one}"), Function(f"p{other}"), Number(cost))
    ), cost


def sequence(steps: Iterable[tuple[Function, int]]) -> Plan:
    return Plan(
        tuple(
            Step(StepId(n), operator, (StepId(n - 1),) if n > 1 else (), cost=cost)
            for n, (operator, cost) in enumerate(steps, 1)
        )
    )


def walk(roads: Roads, draw: Random, places: list[int], steps: int) -> list[int]:
    for _ in range(steps):
        places.append(draw.choice(sorted(b for a, b in roads if a == places[-1])))
    return places


def shorter(plan: Plan, asked: MacroQuery) -> Plan:
    after = check_instance(plan, asked)
    assert isinstance(after, Situation)
    made, end = shortened(plan, after, asked)
    assert end.state == after.state or len(made.steps) < len(plan.steps)
    return made


@given(seed=st.integers(0, 10_000), steps=st.integers(1, 12))
@settings(max_examples=25, deadline=None, suppress_health_check=list(HealthCheck))
def test_a_ride_visits_no_place_twice(tmp_path: Path, seed: int, steps: int) -> None:
    draw = Random(seed)
    roads = road_map(draw, 6)
    places = walk(roads, draw, [draw.randrange(6)], steps)
    if places[-1] == places[0]:
        return
    problem = road_problem(tmp_path, roads, places[0], f"at(v0, p{places[-1]})")
    plan = sequence(drive(roads, a, b) for a, b in itertools.pairwise(places))
    made = shorter(plan, query_of(problem))
    ends = [str(step.operator.arguments[2]) for step in made.steps]
    assert len({f"p{places[0]}", *ends}) == len(ends) + 1
    assert made.cost <= plan.cost
    assert validate_plan(problem, made) == []


def test_back_and_forth_before_the_start_is_left_out(tmp_path: Path) -> None:
    roads = {(0, 1): 3, (1, 0): 3, (1, 2): 4, (2, 1): 4}
    problem = road_problem(tmp_path, roads, 1, "at(v0, p2)")
    plan = sequence(drive(roads, a, b) for a, b in [(1, 0), (0, 1), (1, 2)])
    links = [(StepId(2), "at(v0, p1)", StepId(3)), (StepId(3), "at(v0, p2)", GOAL_STEP)]
    linked = replace(
        plan, links=tuple(CausalLink(one, _atom(text), other) for one, text, other in links)
    )
    made = shorter(linked, query_of(problem))
    assert [str(step.operator) for step in made.steps] == ["drive(v0, p1, p2, 4)"]
    assert [(link.producer, str(link.condition), link.consumer) for link in made.links] == [
        (INITIAL_STEP, "at(v0, p1)", 1),
        (1, "at(v0, p2)", GOAL_STEP),
    ]
    assert validate_plan(problem, made) == []


@pytest.mark.parametrize(
    ("goals", "left"), [("seen(p2)", 3), ("at(v0, p2), seen(p0)", 3), ("seen(p0)", 1)]
)
def test_only_what_the_goals_need_is_left(tmp_path: Path, goals: str, left: int) -> None:
    roads = {(0, 1): 3, (1, 0): 3, (1, 2): 4, (2, 1): 4}
    problem = road_problem(tmp_path, roads, 0, goals)
    steps = [look(0), drive(roads, 0, 1), look(1), drive(roads, 1, 2), look(2)]
    made = shorter(sequence(steps), query_of(problem))
    assert len(made.steps) == left
    assert validate_plan(problem, made) == []


def look(place: int) -> tuple[Function, int]:
    return Function("look", (Function("v0"), Function(f"p{place}"))), 1


def _atom(text: str) -> Function:
    from cellwright.kb.asp import ground_term

    found = ground_term(text)
    assert isinstance(found, Function)
    return found
