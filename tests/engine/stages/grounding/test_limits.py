import functools
import itertools
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine.formats.interop.pddl import read_pddl
from engine.stages.grounding import ground, limits
from kb.asp.trial import affordable
from kb.diagnostics import InvalidInput
from kb.loader import load_problem
from kb.terms import Variable

DOMAIN = """\
domain: runaway
include: [rules.lp]
types: {thing: object}
objects: {thing: [t1..SIZE]}
statics:
  n(int): {}
fluents:
  done(thing, thing, thing): {}
operators:
  act(A, B, C):
    adds: done(A, B, C)
"""
PROBLEM = """\
problem: p
domain: runaway
goals:
  - done(t1, t1, t1)
"""


@pytest.fixture
def domain(tmp_path: Path) -> Path:
    (tmp_path / "problems").mkdir()
    (tmp_path / "problems" / "p.yaml").write_text(PROBLEM)
    (tmp_path / "rules.lp").write_text("n(1).\n")
    return tmp_path


@pytest.fixture(autouse=True)
def _in_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "affordable", functools.partial(affordable, seconds=1, megabytes=500))


def test_an_operator_with_a_billion_instances_is_stopped_at_its_place(domain: Path) -> None:
    (domain / "domain.yaml").write_text(DOMAIN.replace("SIZE", "1000"))
    with pytest.raises(
        InvalidInput, match=r"domain\.yaml:10:3: error K307: .*act\(A, B, C\) \(up to 1e\+09 instances\)"
    ):
        ground(load_problem(str(domain / "problems" / "p.yaml")))


def test_a_rule_that_counts_for_ever_is_stopped_at_its_place(domain: Path) -> None:
    (domain / "domain.yaml").write_text(DOMAIN.replace("SIZE", "2"))
    (domain / "rules.lp").write_text("n(0).\nn(X+1) :- n(X).\n")
    with pytest.raises(InvalidInput, match=r"rules\.lp:2:1: error K307: .*no upper bound"):
        ground(load_problem(str(domain / "problems" / "p.yaml")))


def test_a_rule_that_counts_to_an_end_is_grounded(domain: Path) -> None:
    (domain / "domain.yaml").write_text(DOMAIN.replace("SIZE", "2"))
    (domain / "rules.lp").write_text("n(0).\nn(X+1) :- n(X), X < 9.\n")
    assert len(ground(load_problem(str(domain / "problems" / "p.yaml"))).operators) == 8


def test_a_large_bound_that_statics_cut_down_is_grounded(domain: Path) -> None:
    text = DOMAIN.replace("SIZE", "300").replace(
        "  act(A, B, C):\n", "  act(A, B, C):\n    where: A = B, B = C\n"
    )
    (domain / "domain.yaml").write_text(text)
    assert len(ground(load_problem(str(domain / "problems" / "p.yaml"))).operators) == 300


def test_the_bound_on_a_type_counts_its_subtypes_and_its_terms() -> None:
    problem = load_problem("bulkhead/one_point")
    sizes = limits.extents(problem)
    assert (sizes["tool"], sizes["measurement"], sizes["place"]) == (2, 3, 5)
    assert sizes["point"] == 3 * sizes["place"]
    more = replace(problem, objects={**problem.objects, "m4": "measurement"})
    assert limits.extents(more)["point"] == 3 * 6


A, B, C = map(Variable, "ABC")
pairs = st.sets(st.tuples(st.integers(0, 3), st.integers(0, 3)), min_size=1)


@given(pairs, pairs, st.sets(st.integers(0, 3), min_size=1))
def test_no_more_bindings_than_the_bound(
    one: set[tuple[int, int]], two: set[tuple[int, int]], three: set[int]
) -> None:
    """`one(A, B), two(B, C), three(A)` over four values for each variable."""
    counted = sum(
        (a, b) in one and (b, c) in two and a in three for a, b, c in itertools.product(range(4), repeat=3)
    )
    known = [({A, B}, len(one)), ({B, C}, len(two)), ({A}, len(three))]
    bound = limits.most_bindings({A: 4.0, B: 4.0, C: 4.0}, known)
    assert counted <= bound <= 64


def test_static_facts_that_bind_the_variables_need_no_trial(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def tried(_text: str) -> bool:
        raise AssertionError("tried")

    monkeypatch.setattr(limits, "affordable", tried)
    files = tmp_path / "domain.pddl", tmp_path / "problem.pddl"
    files[0].write_text("""(define (domain chain) (:predicates (next ?a ?b) (at ?a))
      (:action go :parameters (?a ?b ?c ?d) :precondition (and (at ?a) (next ?a ?b) (next ?b ?c) (next ?c ?d))
        :effect (at ?d)))""")
    names = [f"o{number}" for number in range(60)]
    chain = " ".join(f"(next {a} {b})" for a, b in itertools.pairwise(names))
    files[1].write_text(
        f"(define (problem p) (:domain chain) (:objects {' '.join(names)}) (:init (at o0) {chain}) (:goal (at o9)))"
    )
    assert len(ground(read_pddl(*files).problem).operators) == 19
