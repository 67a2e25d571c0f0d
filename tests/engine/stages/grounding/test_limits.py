import itertools
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwright.engine.stages.grounding import ground, instance_bounds
from cellwright.kb.asp import trial_grounding
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import load_problem
from cellwright.kb.terms import Variable

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
    monkeypatch.setattr(trial_grounding, "MAX_TRIAL_S", 1)


def test_an_operator_with_a_billion_instances_is_stopped_at_its_place(domain: Path) -> None:
    (domain / "domain.yaml").write_text(DOMAIN.replace("SIZE", "1000"))
    with pytest.raises(
        InvalidInput,
        match=r"domain\.yaml:10:3: error K307: .*act\(A, B, C\) \(up to 1e\+09 instances\)",
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
    sizes = instance_bounds.bound_type_sizes(problem)
    assert (sizes["tool"], sizes["measurement"], sizes["place"]) == (2, 3, 5)
    assert sizes["point"] == 3 * sizes["place"]
    more = replace(problem, objects={**problem.objects, "m4": "measurement"})
    assert instance_bounds.bound_type_sizes(more)["point"] == 3 * 6


A, B, C = map(Variable, "ABC")
pairs = st.sets(st.tuples(st.integers(0, 3), st.integers(0, 3)), min_size=1)


@given(pairs, pairs, st.sets(st.integers(0, 3), min_size=1))
def test_no_more_bindings_than_the_bound(
    one: set[tuple[int, int]], two: set[tuple[int, int]], three: set[int]
) -> None:
    """`one(A, B), two(B, C), three(A)` over four values for each variable."""
    counted = sum(
        (a, b) in one and (b, c) in two and a in three
        for a, b, c in itertools.product(range(4), repeat=3)
    )
    known = [({A, B}, len(one)), ({B, C}, len(two)), ({A}, len(three))]
    bound = instance_bounds.most_bindings({A: 4.0, B: 4.0, C: 4.0}, known)
    assert counted <= bound <= 64
