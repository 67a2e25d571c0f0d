"""Generalising keeps the plan, and every instance that satisfies a MACROP is a plan to the
independent checker.
"""

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from macro_cells import GOLDEN, Example, atom, bundled, constraints_hold, golden, posed

from cellwright.engine.stages.lifted.cell_domain import Situation
from cellwright.engine.stages.lifted.operator_schemas import NotGeneral
from cellwright.engine.stages.macros.learning.plan_generalisation import generalise_plan
from cellwright.engine.stages.macros.lookup.macro_instances import instantiate_macro
from cellwright.engine.stages.macros.lookup.macro_matching import (
    MatchingBudget,
    MatchingOrder,
    match_macro,
)
from cellwright.engine.stages.macros.lookup.macro_query import MacroQuery
from cellwright.engine.stages.validation import validate_plan
from cellwright.kb.loader.problem_amounts import amounts_of
from cellwright.kb.model.conditions import And, Literal
from cellwright.kb.model.plan_model import Plan
from cellwright.kb.terms import Function, Term, Variable, substitute_atom


@pytest.mark.parametrize("path", GOLDEN, ids=lambda path: f"{path.parts[-3]}-{path.stem}")
def test_instantiating_with_the_original_constants_gives_the_plan_back(path: Path) -> None:
    found = golden(path)
    again = instantiate_macro(
        found.learned.macrop, found.learned.bindings, amounts_of(found.problem)
    )
    assert again.steps == found.plan.steps
    assert set(again.links) == set(found.plan.links)


@pytest.mark.parametrize("path", GOLDEN, ids=lambda path: f"{path.parts[-3]}-{path.stem}")
def test_what_the_domain_does_not_name_becomes_a_variable(path: Path) -> None:
    found = golden(path)
    domain = found.problem.domain
    named = {*domain.objects, *(c for type_ in domain.types.values() for c in type_.constants)}
    own = set(found.problem.objects) - named
    for step in found.learned.macrop.steps:
        assert not own & {str(part) for part in _leaves(step.operator)}


def _leaves(term: Term) -> Iterator[Term]:
    if isinstance(term, Function) and term.arguments:
        for argument in term.arguments:
            yield from _leaves(argument)
    else:
        yield term


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["bulkhead/one_point", "bulkhead/both_tools", "bulkhead/twelve_points", "themse/one", "themse/lid_on_stand",
             "themse/furnace_of_two", "themse/two"]
)  # fmt: skip
@given(data=st.data())
@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
def test_every_instance_that_satisfies_a_macrop_passes_the_checker(
    name: str, data: st.DataObject
) -> None:
    found = bundled(name)
    macrop = found.learned.macrop
    bindings = found.learned.bindings | dict(_changes(found, data))
    assume(constraints_hold(macrop, found.world, bindings))
    problem = posed(found, bindings)
    assert validate_plan(problem, instantiate_macro(macrop, bindings, amounts_of(problem))) == []


def _changes(found: Example, data: st.DataObject) -> Iterator[tuple[Variable, Term]]:
    """A few variables of the binding changed, some of them to what another variable stands for."""
    typed = found.learned.macrop.types
    for parameter in data.draw(st.lists(st.sampled_from(typed), max_size=4)):
        values = sorted(
            (each.arguments[0] for each in found.world.statics.named(parameter.type)), key=str
        )
        yield parameter.variable, data.draw(st.sampled_from(values))


def test_constants_are_kept_apart_only_where_a_step_needs_it() -> None:
    macrop = bundled("bulkhead/twelve_points").learned.macrop
    apart = {str(each) for each in macrop.disequalities}
    assert {"Id1 != Id2", "Id4 != Id5"} <= apart  # move demands that From and To differ
    assert not {"Id1 != Id3", "Id4 != Id6"} & apart  # two visits of one point are a plan, too


def test_a_plan_that_does_not_reach_its_goal_is_not_generalised() -> None:
    found = bundled("bulkhead/one_point")
    shorter = Plan(found.plan.steps[:-1])
    with pytest.raises(NotGeneral, match="does not hold at the end"):
        generalise_plan(found.problem, shorter, found.world, found.initial)


def test_links_are_found_where_a_plan_has_none() -> None:
    found = bundled("themse/one")
    bare = generalise_plan(found.problem, Plan(found.plan.steps), found.world, found.initial)
    assert bare.macrop.preconditions == found.learned.macrop.preconditions
    assert {str(each) for each in bare.macrop.disequalities} == {
        str(each) for each in found.learned.macrop.disequalities
    }


def test_a_goal_that_held_all_along_is_no_goal_of_the_macrop() -> None:
    found = bundled("bulkhead/one_point")
    goal = And((found.problem.goal, Literal(atom("holding(t3_746, us_probe)"))))
    problem = dataclasses.replace(found.problem, goal=goal)
    learned = generalise_plan(problem, found.plan, found.world, found.initial)
    assert learned.macrop.goals == found.learned.macrop.goals


def test_matching_agrees_with_brute_force() -> None:
    """All bindings of a small macrop, tried one by one."""
    found = bundled("bulkhead/one_point")
    macrop, world = found.learned.macrop, found.world
    situation = Situation.of(world, found.initial)
    goal = Literal(atom("measured(us_probe, t3_746, meas(m2))"))
    asked = MacroQuery(situation, (goal,), ())
    joined = {
        tuple(b[p] for p in macrop.parameters)
        for b in match_macro(MatchingOrder(macrop), asked, MatchingBudget())
    }
    objects = [Function(name) for name in (*found.problem.objects, *found.problem.domain.objects)]
    tried = set()
    for one in objects:
        bindings: dict[Variable, Term] = {
            Variable("Id1"): one,
            Variable("Tool1"): Function("us_probe"),
            Variable("Arm1"): Function("t3_746"),
            Variable("Id2"): Function("m2"),
        }
        held = all(
            substitute_atom(p.atom, bindings) in situation.facts for p in macrop.preconditions
        )
        if held and constraints_hold(macrop, world, bindings):
            tried.add(tuple(bindings[p] for p in macrop.parameters))
    assert joined
    assert joined == tried
