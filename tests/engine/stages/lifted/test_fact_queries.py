"""What a condition rests on: found exactly when the condition holds, and enough to make it hold."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwright.engine.stages.lifted.cell_domain import CellDomain, body_holds, with_derived
from cellwright.engine.stages.lifted.fact_queries import FactSet
from cellwright.engine.stages.lifted.lifted_execution import find_support
from cellwright.kb.asp import ground_term
from cellwright.kb.loader import load_problem
from cellwright.kb.terms import Atom, Function

DOMAIN = """
domain: resting
include: [rules.lp]
types: {thing: object}
objects: {thing: [a, b, c]}
statics:
  near(thing, thing): {}
derived:
  warm(thing): {}
  ready(thing): {}
  calm: {}
fluents:
  hot(thing): {}
  open(thing): {}
operators:
  use(X, Y):
    preconditions: ready(X), open(Y), not hot(Y)
    adds: open(X)
  rest(X):
    preconditions: calm, open(X)
    adds: hot(X)
"""
RULES = """
near(a, b). near(b, c).
warm(X) :- hot(X).
warm(X) :- near(X, Y), hot(Y).
ready(X) :- thing(X), warm(X), not open(X).
calm :- thing(X), not warm(X).
"""
FLUENTS = [f"{name}({each})" for name in ("hot", "open") for each in "abc"]
STEPS = [f"use({x},{y})" for x in "abc" for y in "abc"] + [f"rest({x})" for x in "abc"]


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> CellDomain:
    folder: Path = tmp_path_factory.mktemp("resting")
    (folder / "domain.yaml").write_text(DOMAIN)
    (folder / "rules.lp").write_text(RULES)
    (folder / "p.yaml").write_text("problem: p\ndomain: domain.yaml\ngoals: [open(a)]\n")
    return CellDomain(load_problem(str(folder / "p.yaml")))


def atom(text: str) -> Atom:
    found = ground_term(text)
    assert isinstance(found, Function)
    return found


@given(state=st.sets(st.sampled_from(FLUENTS)), step=st.sampled_from(STEPS))
def test_a_support_is_found_exactly_where_the_condition_holds(
    world: CellDomain, state: set[str], step: str
) -> None:
    facts = FactSet(map(atom, sorted(state)))
    schema, bindings = world.binding(atom(step))
    (body,) = schema.alternatives
    found = find_support(body, world, facts, bindings)
    assert (found is not None) == body_holds(body, world, with_derived(world, facts), bindings)
    for each in found or ():
        inner = each.arguments[0] if each.name == "not" else each
        assert (inner in facts) == (each.name != "not")
