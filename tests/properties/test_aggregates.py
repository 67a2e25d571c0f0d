"""Aggregates over fluents: ground task, checker, library and clingo agree in every state."""

import random
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

import clingo
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.model.ground_task import GroundTask
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.lifted.cell_domain import CellDomain, with_derived
from cellwright.engine.stages.lifted.fact_queries import FactSet as LiftedFacts
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.loader import load
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function

DOMAIN = """
domain: counted
include: [rules.lp]
types: {{thing: object, place: object}}
objects: {{thing: [a, b, c], place: [p, q]}}
statics:
  weight(thing, int): {{}}
derived: {{fits(int): {{}}}}
fluents:
  at(thing, place): {{}}
  on(thing): {{}}
operators:
  put(T, P): {{preconditions: "not at(T, P)", adds: "at(T, P)"}}
  take(T, P): {{preconditions: "at(T, P)", adds: "on(T)", deletes: "at(T, P)"}}
  drop(T): {{preconditions: "on(T)", adds: "at(T, p)", deletes: "on(T)"}}
{deduction}
"""
ALONE = """
deductive_operators:
  - when: at(T, P)
    denies: at(T, Q), Q != P; at(O, P), O != T
"""
FACTS = "weight(a, 2). weight(b, -1). weight(c, 3)."
CONDITIONS = [
    "at(T, P), weight(T, W)",
    "at(T, p), weight(T, W)",
    "on(T), weight(T, W), not at(T, q)",
]
TERMS = ["W, T", "W", "-W, T", "W * 2, T, 1"]
RELATIONS = ["<", "<=", "=", "!=", ">", ">="]


@st.composite
def aggregates(draw: st.DrawFn) -> str:
    function = draw(st.sampled_from(["count", "sum", "min", "max"]))
    parts = draw(
        st.lists(
            st.tuples(st.sampled_from(TERMS), st.sampled_from(CONDITIONS)), min_size=1, max_size=2
        )
    )
    braces = "; ".join(f"{terms} : {body}" for terms, body in parts)
    relation, bound = draw(st.sampled_from(RELATIONS)), draw(st.integers(-3, 5))
    left = draw(st.sampled_from(["", "", "-2 < ", "1 != "]))
    sign = draw(st.sampled_from(["", "", "not "]))
    return f"{sign}{left}#{function} {{ {braces} }} {relation} {bound}"


@st.composite
def rules(draw: st.DrawFn) -> str:
    first = draw(aggregates())
    value = draw(st.sampled_from(["count", "sum", "min", "max"]))
    body = draw(st.sampled_from(CONDITIONS))
    return f"fits(0) :- {first}. fits(N + 10) :- N = #{value} {{ W, T : {body} }}, N > 0."


def problem(text: str, alone: bool, folder: str) -> Problem:
    path = Path(folder)
    (path / "domain.yaml").write_text(DOMAIN.format(deduction=ALONE if alone else ""))
    (path / "rules.lp").write_text(f"{FACTS} {text}")
    (path / "p.yaml").write_text("problem: p\ndomain: counted\ninitial: []\ngoals: [fits(_)]\n")
    found = load(path / "p.yaml").problem
    assert found is not None
    return found


def by_clingo(text: str, state: list[Atom]) -> set[str]:
    control = clingo.Control(["--warn=none"])
    control.add("base", [], f"{FACTS} {text} {' '.join(f'{atom}.' for atom in state)}")
    control.ground([("base", [])])
    return {
        str(each.symbol) for each in control.symbolic_atoms.by_signature("fits", 1) if each.is_fact
    }


def in_task(task: GroundTask, state: list[Atom]) -> set[str]:
    """The atoms of `fits` in a ground task, in which they are conditions of goals or stay as
    axioms.
    """
    assert task.axioms is not None
    true = set(state)
    bits = 0
    for number, atom in enumerate(task.atoms):
        inner = atom.arguments[0] if atom.name == "not" else None
        if atom in true or (
            isinstance(inner, Function) and inner.name in ("at", "on") and inner not in true
        ):
            bits |= 1 << number
    return {str(atom) for atom in task.names(task.axioms.closed(bits)) if atom.name == "fits"}


@given(rules(), st.booleans(), st.randoms(use_true_random=False))
@settings(max_examples=12, deadline=None)
def test_all_agree_on_an_aggregate(text: str, alone: bool, chance: random.Random) -> None:
    with TemporaryDirectory() as folder:
        given = problem(text, alone, folder)
        with (
            patch("cellwright.engine.stages.grounding.derived_atoms.MAX_SUPPORTS", 0),
            patch("cellwright.engine.stages.grounding.derived_atoms.MIN_SUPPORTS", 0),
        ):
            task = ground(given)
        semantics, world = Semantics(given), CellDomain(given)
        atoms = [Function("at", (Function(t), Function(p))) for t in "abc" for p in "pq"]
        atoms += [Function("on", (Function(t),)) for t in "abc"]
        for _ in range(20):
            state = chance.sample(atoms, chance.randrange(len(atoms)))
            state = _alone(state) if alone else state
            expected = by_clingo(text, state)
            checked = {str(atom) for atom in semantics.facts(state).named("fits")}
            assert checked == expected
            if task.axioms is not None:
                assert in_task(task, state) == expected
            known = with_derived(world, LiftedFacts(state))
            assert {str(each) for each in known.named("fits")} == expected


def _alone(state: list[Atom]) -> list[Atom]:
    """The atoms without those that others of them deny."""
    kept: list[Atom] = []
    for atom in state:
        if atom.name == "on" or all(
            set(atom.arguments).isdisjoint(each.arguments) for each in kept if each.name == "at"
        ):
            kept.append(atom)
    return kept
