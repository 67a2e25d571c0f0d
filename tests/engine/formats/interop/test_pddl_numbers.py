"""Numbers in PDDL: what is read, what is refused, and plans against brute force with exact
fractions.
"""

import itertools
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.formats.interop.pddl import PddlProblem, read_pddl_task
from cellwright.engine.formats.interop.pddl.competition_plans import read_plan, write_plan
from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.validation import validate_plan
from cellwright.kb.diagnostics import InvalidInput

DOMAIN = """
(define (domain pumps)
  (:requirements :typing :numeric-fluents)
  (:types tank pump)
  (:predicates (open ?p - pump))
  (:functions (level ?t - tank) (portion ?p - pump) (wear) (energy) (tariff))
  (:action fill :parameters (?t - tank ?p - pump)
    :precondition (and (open ?p) (<= (+ (level ?t) (* 0.5 (portion ?p))) 2.5))
    :effect (and (increase (level ?t) (* 0.5 (portion ?p))) (increase (wear) 1) (increase (energy) (* 0.2 (tariff)))))
  (:action drain :parameters (?t - tank)
    :precondition (>= (level ?t) 0.75)
    :effect (and (decrease (level ?t) 0.75) (increase (energy) 0.1)))
  (:action switch :parameters (?p - pump) :effect (and (open ?p) (increase (energy) 1.5))))
"""
PROBLEM = """
(define (problem p) (:domain pumps)
  (:objects a b - tank quick slow - pump)
  (:init (= (level a) 0) (= (level b) 1.25) (= (portion quick) 1) (= (portion slow) 0.5) (open slow)
         (= (wear) 0) (= (energy) 0) (= (tariff) 3))
  (:goal (and (> (level a) (* 2 (level b))) (>= (level a) 1)))
  (:metric minimize (energy)))
"""


def read(folder: Path, domain: str = DOMAIN, problem: str = PROBLEM) -> PddlProblem:
    (folder / "domain.pddl").write_text(domain)
    (folder / "problem.pddl").write_text(problem)
    return read_pddl_task(folder / "domain.pddl", folder / "problem.pddl")


def test_decimals_become_whole_numbers_and_costs_are_told_as_they_were_meant(
    tmp_path: Path,
) -> None:
    task = read(tmp_path)
    outcome = checked_plan.plan_problem(task.problem, SearchLimits())
    assert isinstance(outcome, Found)
    assert not validate_plan(task.problem, outcome.plan)
    written = write_plan(task, outcome.plan)
    prices = {"(fill": Fraction("0.6"), "(drain": Fraction("0.1"), "(switch": Fraction("1.5")}
    total = sum(count * price for name, price in prices.items() if (count := written.count(name)))
    assert written.endswith(f"; cost = {float(total)}\n")
    (tmp_path / "plan").write_text(written)
    assert not validate_plan(task.problem, read_plan(task, tmp_path / "plan"))


def test_what_nothing_reads_is_left_out(tmp_path: Path) -> None:
    problem = read(tmp_path).problem
    assert set(problem.domain.quantities) == {"level"}
    assert not {"wear", "energy"} & set(problem.domain.predicates)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "(decrease (level ?t) 0.75)",
            "(decrease (level ?t) (* (level ?t) (level ?t)))",
            "not linear",
        ),
        ("(>= (level ?t) 0.75)", "(>= (* (level ?t) (level ?t)) 1)", "not linear"),
        ("(>= (level ?t) 0.75)", "(>= (/ 1 (level ?t)) 1)", "divisions are by numbers"),
        ("(>= (level ?t) 0.75)", "(>= (depth ?t) 1)", "no function 'depth'"),
        ("(>= (level ?t) 0.75)", "(>= (level ?t) full)", "no function 'full'"),
        ("(decrease (level ?t) 0.75)", "(scale-up (level ?t) 2)", "scale-up is not linear"),
        (
            "(decrease (level ?t) 0.75)",
            "(when (open quick) (decrease (level ?t) 1))",
            "only under a condition",
        ),
        (
            "(decrease (level ?t) 0.75)",
            "(decrease (level ?t) (* 0.5 (level ?t)))",
            "finer than a millionth",
        ),
        (
            "(increase (energy) 1.5)",
            "(when (open slow) (increase (energy) 1))",
            "only under a condition",
        ),
        ("(= (level a) 0)", "(= (level a) 1e3x)", "initial value"),
        ("(= (level a) 0)", "(= (level a) 99999999999)", "too large"),
    ],
)
def test_numbers_that_are_not_simple_are_refused_with_their_place(
    tmp_path: Path, old: str, new: str, said: str
) -> None:
    assert (old in DOMAIN) != (old in PROBLEM)
    domain = DOMAIN.replace("(:types", "(:constants quick slow - pump) (:types").replace(old, new)
    with pytest.raises(InvalidInput) as refused:
        read(tmp_path, domain, PROBLEM.replace("quick slow - pump", "").replace(old, new))
    found = [each for each in refused.value.diagnostics if said in each.message]
    assert found
    assert {each.code for each in found} <= {"K802", "K101"}
    assert all(each.where.line > 1 for each in found)


def test_a_metric_that_is_no_sum_of_fixed_costs_is_not_followed_and_that_is_told(
    tmp_path: Path,
) -> None:
    task = read(
        tmp_path, DOMAIN.replace("(increase (energy) 0.1)", "(increase (energy) (level ?t))")
    )
    assert [each.message for each in task.warnings] == [
        "the metric is not followed: energy rises by amounts that change"
    ]
    assert {operator.cost for operator in task.problem.domain.operators} == {None}
    task = read(tmp_path, problem=PROBLEM.replace("minimize", "maximize"))
    assert "as large as possible" in task.warnings[0].message


def test_a_function_without_arguments_may_stand_without_parentheses(tmp_path: Path) -> None:
    bare = DOMAIN.replace("(>= (level ?t) 0.75)", "(and (>= (level ?t) 0.75) (<= wear 2))")
    task = read(tmp_path, bare)
    assert set(task.problem.domain.quantities) == {"level", "wear"}
    assert isinstance(checked_plan.plan_problem(task.problem, SearchLimits()), Found)


@dataclass(frozen=True)
class Act:
    """An action on two numbers: it needs `factors` .

    (x, y) `relation` `bound`, and adds `by`, or assigns `by` to x.
    """

    factors: tuple[Fraction, Fraction]
    relation: str
    bound: Fraction
    by: tuple[Fraction, Fraction]
    assigns: bool

    def after(self, x: Fraction, y: Fraction) -> tuple[Fraction, Fraction] | None:
        """The numbers after it; None if it cannot be taken."""
        total = self.factors[0] * x + self.factors[1] * y
        holds = {"<=": total <= self.bound, ">=": total >= self.bound, "=": total == self.bound}
        moved = (self.by[0] if self.assigns else x + self.by[0], y + self.by[1])
        return moved if holds[self.relation] else None

    def text(self, name: str) -> str:
        """It in PDDL; it keeps both numbers between -3 and 3."""
        first, second = map(said, self.by)
        change = f"(assign (x) {first})" if self.assigns else f"(increase (x) {first})"
        kept = f"{first}" if self.assigns else f"(+ (x) {first})"
        needed = (
            f"({self.relation} (+ (* {said(self.factors[0])} (x)) (* {said(self.factors[1])} "
            f"(y))) {said(self.bound)})"
        )
        within = f"(<= {kept} 3) (>= {kept} -3) (<= (+ (y) {second}) 3) (>= (+ (y) {second}) -3)"
        return (
            f"(:action {name} :precondition (and {needed} {within})"
            f" :effect (and {change} (decrease (y) (- {second}))))"
        )


def said(number: Fraction) -> str:
    return str(float(number))


halves = st.integers(-4, 4).map(lambda each: Fraction(each, 2))
quarters = st.integers(-6, 6).map(lambda each: Fraction(each, 4))
acts = st.builds(
    Act, st.tuples(halves, halves), st.sampled_from(["<=", ">=", "="]), quarters, st.tuples(quarters, quarters),
    st.booleans(),
)  # fmt: skip


def reachable(
    given: list[Act], start: tuple[Fraction, Fraction], wanted: tuple[Fraction, Fraction]
) -> bool:
    """Whether steps lead to x >= wanted[0] and not y = wanted[1]."""
    seen, waiting = {start}, [start]
    while waiting:
        x, y = waiting.pop()
        if x >= wanted[0] and y != wanted[1]:
            return True
        for each in given:
            found = each.after(x, y)
            if found is not None and max(map(abs, found)) <= 3 and found not in seen:
                seen.add(found)
                waiting.append(found)
    return False


@given(
    st.lists(acts, min_size=1, max_size=3),
    st.tuples(quarters, quarters),
    st.tuples(quarters, quarters),
    st.sampled_from(["auto", "forward"]),
)
@settings(max_examples=12, deadline=None)
def test_plans_with_fractions_agree_with_brute_force(
    given: list[Act],
    start: tuple[Fraction, Fraction],
    wanted: tuple[Fraction, Fraction],
    strategy: str,
) -> None:
    """Every plan has been accepted by the checker."""
    names = (f"act{number}" for number in itertools.count())
    actions = " ".join(act.text(name) for act, name in zip(given, names, strict=False))
    domain = f"(define (domain d) (:functions (x) (y)) {actions})"
    problem = (
        f"(define (problem p) (:domain d) (:init (= (x) {said(start[0])}) (= (y) {said(start[1])}))"
        f" (:goal (and (>= (x) {said(wanted[0])}) (not (= (y) {said(wanted[1])})))))"
    )
    with TemporaryDirectory() as folder:
        outcome = checked_plan.plan_problem(
            read(Path(folder), domain, problem).problem, SearchLimits(strategy=strategy)
        )
    assert isinstance(outcome, Found if reachable(given, start, wanted) else Infeasible)


HOT = """
(define (domain hot) (:types plate) (:predicates (hot) (cold ?p - plate) (all_warm) (ok))
  (:functions (heat) (warmth ?p - plate) (limit ?p - plate))
  (:derived (hot) (> (heat) 3))
  (:derived (cold ?p - plate) (not (>= (warmth ?p) (limit ?p))))
  (:derived (all_warm) (forall (?p - plate) (not (cold ?p))))
  (:action warm :parameters () :effect (increase (heat) 2))
  (:action lay :parameters (?p - plate) :precondition (hot) :effect (increase (warmth ?p) 1))
  (:action fin :parameters () :precondition (all_warm) :effect (ok)))
"""
PLATES = """
(define (problem p) (:domain hot) (:objects a b - plate)
  (:init (= (heat) 0) (= (warmth a) 0) (= (warmth b) 1) (= (limit a) 2) (= (limit b) 1))
  (:goal (and (ok) (not (cold a)) (exists (?p - plate) (> (warmth ?p) (warmth b))))))
"""


def test_derived_predicates_that_read_numbers_are_planned_and_checked(tmp_path: Path) -> None:
    task = read(tmp_path, HOT, PLATES)
    outcome = checked_plan.plan_problem(task.problem, SearchLimits())
    assert isinstance(outcome, Found)
    written = write_plan(task, outcome.plan)
    steps = [line for line in written.splitlines() if line.startswith("(")]
    assert sorted(steps) == ["(fin)", "(lay a)", "(lay a)", "(warm)", "(warm)"]
    (tmp_path / "plan").write_text(written)
    assert not validate_plan(task.problem, read_plan(task, tmp_path / "plan"))
    (tmp_path / "plan").write_text("(warm)\n(lay a)\n(lay a)\n(fin)\n")
    assert validate_plan(task.problem, read_plan(task, tmp_path / "plan"))


@pytest.mark.parametrize(
    "condition",
    [
        "(not (hot))",
        "(forall (?p - plate) (or (hot) (cold ?p)))",
        "(not (exists (?p - plate) (and (cold ?p) (hot))))",
    ],
)
def test_a_derived_predicate_that_depends_on_its_own_negation_is_refused(
    tmp_path: Path, condition: str
) -> None:
    with pytest.raises(InvalidInput) as refused:
        read(
            tmp_path,
            HOT.replace("(:derived (hot) (> (heat) 3))", f"(:derived (hot) {condition})"),
            PLATES,
        )
    assert [each.code for each in refused.value.diagnostics] == ["K802"]
    assert "depends on itself" in refused.value.diagnostics[0].message
