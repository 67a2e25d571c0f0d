"""Quantities: searches, which see comparisons only, against brute force over the checker's
meaning of steps.
"""

import itertools
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st

from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.pipelines.explanation import apply_amendment, explain_infeasibility
from cellwright.engine.pipelines.explanation.possible_facts import ProblemSpace
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.planning.search_control import NO_PLAN, Effort
from cellwright.engine.stages.planning.unsolvability import UnsolvabilityProof
from cellwright.engine.stages.validation.condition_solving import condition_holds
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import load
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function, Number

DOMAIN = """
domain: jugs
types: {{jug: object}}
objects: {{jug: [a, b]}}
quantities:
  level(jug): 0..{high}
  moves: 0..9
fluents:
  shut(jug): {{}}
operators:
  fill(J):
    preconditions: not shut(J), level(J) {relation} {bound}
    assign: {{level(J): {full}}}
  pour(J, K, N):
    where: portion(N)
    preconditions: level(J) - N >= 0, not shut(K)
    decrease: {{level(J): N}}
    increase: {{level(K): N}}
  swap:
    preconditions: level(a) != level(b)
    assign: {{level(a): level(b), level(b): level(a)}}
  close(J):
    preconditions: not shut(J), 2 * level(J) - level(a) <= {low}
    adds: shut(J)
    increase: {{moves: 1}}
statics: {{portion(int): {{}}}}
"""
PROBLEM = """
problem: p
domain: jugs
statics: [portion({one}), portion({two})]
initial: ["level(a, {a})", "level(b, {b})", "moves(0)"]
goals: [{goal}]
"""
GOALS = [
    "level(a) = {n}",
    "level(a) + level(b) > {n}, shut(a)",
    "level(b) < {n}, moves = 2",
    "not shut(b), level(b) = {n}",
]


@st.composite
def cases(draw: st.DrawFn) -> tuple[str, str]:
    high = draw(st.integers(2, 7))
    level = st.integers(0, high)
    relations = st.sampled_from(["<", "<=", "=", "!=", ">", ">="])
    domain = DOMAIN.format(
        high=high,
        relation=draw(relations),
        bound=draw(level),
        full=draw(level),
        low=draw(st.integers(-2, high)),
    )
    one, two = draw(st.permutations(range(1, 5)))[:2]
    goal = draw(st.sampled_from(GOALS)).format(n=draw(level))
    return domain, PROBLEM.format(one=one, two=two, a=draw(level), b=draw(level), goal=f'"{goal}"')


def loaded(domain: str, problem: str, folder: str) -> Problem:
    (Path(folder) / "domain.yaml").write_text(domain)
    (Path(folder) / "p.yaml").write_text(problem)
    found = load(Path(folder) / "p.yaml").problem
    assert found is not None
    return found


def reachable(problem: Problem) -> bool:
    """Whether some state that steps lead to satisfies the goals."""
    semantics = Semantics(problem)
    jugs, portions = (Function("a"), Function("b")), [atom.arguments[0] for atom in problem.statics]
    steps = [
        Function("swap"),
        *(Function(name, (jug,)) for name in ("fill", "close") for jug in jugs),
    ]
    steps += [
        Function("pour", (one, two, n))
        for one, two in itertools.product(jugs, jugs)
        for n in portions
    ]
    seen: set[frozenset[Atom]] = set()
    waiting = [semantics.initial()]
    while waiting:
        state = waiting.pop()
        if state in seen:
            continue
        seen.add(state)
        facts = semantics.facts(state)
        if condition_holds(problem.goal, facts, {}):
            return True
        for step in steps:
            bound = semantics.binding(step)
            if not isinstance(bound, str) and condition_holds(
                bound[0].precondition, facts, bound[1]
            ):
                change = semantics.change(*bound, facts, state)
                waiting.append(state - change.ends | change.adds)
    return False


@given(cases(), st.sampled_from(["auto", "forward", "landmarks", "novelty", "counting"]))
@settings(max_examples=8, deadline=None)
def test_a_search_over_quantities_agrees_with_brute_force(
    case: tuple[str, str], strategy: str
) -> None:
    """Every plan has been accepted by the checker, which follows the values themselves."""
    with TemporaryDirectory() as folder:
        problem = loaded(*case, folder)
        outcome = checked_plan.plan_problem(problem, SearchLimits(strategy=strategy))
        assert isinstance(outcome, Found if reachable(problem) else Infeasible)


@given(cases())
@settings(max_examples=15, deadline=None)
def test_what_is_proved_or_relaxed_over_quantities_agrees_with_brute_force(
    case: tuple[str, str],
) -> None:
    """No proof where there is a plan, and a relaxed task then reaches all goals."""
    with TemporaryDirectory() as folder:
        problem = loaded(*case, folder)
        task, possible = ground(problem), reachable(problem)
        proof = UnsolvabilityProof(task).run(Effort(1 << 60))
        relaxed = ProblemSpace.of(problem, task.names(task.initial)).reachable
        event(f"reachable: {possible}, proved: {proof is NO_PLAN}, relaxed: {relaxed}")
        assert not possible or (proof is None and relaxed)


@pytest.mark.slow
@given(cases())
@settings(max_examples=60, deadline=None)
def test_a_value_at_the_start_that_would_help_is_found(case: tuple[str, str]) -> None:
    with TemporaryDirectory() as folder:
        problem = loaded(*case, folder)
        if reachable(problem):
            return
        explanation = explain_infeasibility(problem)
        values = [fact for fact in problem.initial if fact.name == "level"]
        others = [
            replace(
                problem, initial=(*(f for f in problem.initial if f != fact), _with(fact, value))
            )
            for fact in values
            for value in range(1 + (problem.domain.quantities["level"].high or 0))
        ]
        helping = any(map(reachable, others))
        event(f"a value helps: {helping}")
        assert not helping or [len(each.edits) for each in explanation.changes if each.edits][
            :1
        ] == [1]
        for change in (each for each in explanation.changes if each.edits):
            assert reachable(apply_amendment(problem, change))


def _with(fact: Atom, value: int) -> Atom:
    return Function(fact.name, (*fact.arguments[:-1], Number(value)))


FINE = DOMAIN.format(high=5, relation="<", bound=5, full=5, low=3)


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [
        ("level(jug): 0..5", "level(jug): 5..0", "K113"),
        ("level(jug): 0..5", "level(jug): many", "K113"),
        ("adds: shut(J)", "adds: level(J, 3)", "K108"),
        ("preconditions: not shut(J), level", "preconditions: level(J, 3), level", "K108"),
        ("increase: {moves: 1}", "increase: {moved: 1}", "K101"),
        ("decrease: {level(J): N}", "decrease: {level(J): M}", "K105"),
        ("increase: {level(K): N}", "increase: {level(J): N}", "K104"),
        ("level(J) - N >= 0", "level(J) * level(K) >= 0", "K107"),
    ],
)
def test_what_is_wrong_with_a_quantity_is_told(
    old: str, new: str, code: str, tmp_path: Path
) -> None:
    problem = PROBLEM.format(one=1, two=2, a=0, b=5, goal="level(a) = 5")
    assert old in FINE
    with pytest.raises(InvalidInput) as refused:
        checked_plan.plan_problem(loaded(FINE.replace(old, new), problem, str(tmp_path)))
    assert code in {each.code for each in refused.value.diagnostics}


@pytest.mark.parametrize(
    ("fact", "code", "line"),
    [
        ('"level(a, 9)"', "K113", "level(a, 9)"),
        ('"level(a, 1)", "level(a, 2)"', "K115", "level(a, 1)"),
        ("", "K115", "problem:"),
    ],
)
def test_a_quantity_has_one_value_within_its_range(
    fact: str, code: str, line: str, tmp_path: Path
) -> None:
    problem = PROBLEM.format(one=1, two=2, a=0, b=5, goal="level(a) = 5").replace(
        '"level(a, 0)",', f"{fact},".lstrip(",")
    )
    with pytest.raises(InvalidInput) as refused:
        checked_plan.plan_problem(loaded(FINE, problem, str(tmp_path)))
    (found,) = (each for each in refused.value.diagnostics if each.code == code)
    assert line in found.where.text
