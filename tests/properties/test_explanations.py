"""Explanations against brute force: every single fact that would give a random problem a plan
is found.
"""

import itertools
import re
from collections.abc import Iterator
from dataclasses import replace

import pytest
from hypothesis import HealthCheck, event, given, settings
from hypothesis import strategies as st

from cellwright.engine.model.outcome import Found
from cellwright.engine.model.plan_explanation import Amendment, Edit, Explanation
from cellwright.engine.pipelines.explanation import apply_amendment, explain_infeasibility
from cellwright.engine.pipelines.explanation.helpful_changes import AlikeObjects
from cellwright.engine.pipelines.explanation.possible_facts import ProblemSpace
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.kb.model.conditions import And, BodyPart, Comparison, Exists, Literal
from cellwright.kb.model.domain_model import Domain, Effect, Kind, Operator, Predicate
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import (
    Atom,
    Function,
    Number,
    Operation,
    Term,
    Variable,
    exchange_subterms,
    substitute_atom,
)
from tests.properties.problems import OBJECTS, ONE_X, TYPES, X, problems, shortest

FLUENTS = [
    *(Function(name, (Function(each),)) for name in ("p", "q") for each in OBJECTS),
    Function("r"),
]


def single(layer: str, facts: tuple[Atom, ...], possible: list[Atom]) -> Iterator[Edit]:
    """Every fact that could be added, removed, or changed in one argument."""
    new = [atom for atom in possible if atom not in facts]
    yield from (Edit(layer, atom) for atom in new)
    yield from (Edit(layer, None, atom) for atom in facts)
    for old, atom in itertools.product(facts, new):
        if (old.name, len(old.arguments)) == (atom.name, len(atom.arguments)):
            differences = [
                pair
                for pair in zip(old.arguments, atom.arguments, strict=True)
                if pair[0] != pair[1]
            ]
            if len(differences) == 1:
                yield Edit(layer, atom, old)


def shape(edit: Edit) -> tuple[object, ...]:
    """The fact that an edit leaves behind, with any numbers."""
    assert edit.added is not None
    return (edit.added.name, *(a for a in edit.added.arguments if not isinstance(a, Number)))


def says_as_much(advice: Edit, wanted: Edit) -> bool:
    """Whether advice is the wanted edit, a part of it, or the same with another number or with
    less left beside it.
    """
    if advice.added is None:
        return advice.removed == wanted.removed
    return wanted.added is not None and shape(advice) == shape(wanted)


def check(
    problem: Problem, explanation: Explanation, wanted: Iterator[Edit], trivial: list[Atom]
) -> int:
    """Every change is proved, and every wanted edit is covered by advice. How many were wanted."""
    advice = [change.edits for change in explanation.changes if change.edits]
    assert explanation.untried == 0
    assert len(set(advice)) == len(advice)
    for change in explanation.changes:
        outcome = checked_plan.plan_problem(apply_amendment(problem, change))
        assert isinstance(outcome, Found)
        assert len(outcome.plan.steps) == change.proof
    # a thing that is not available is told as the reason; that it would be at hand is no advice
    barred = {line.partition(" ")[0] for line in explanation.obstacles}
    count = 0
    for edit in wanted:
        count += 1
        if edit.added is not None and barred & set(re.findall(r"\w+", str(edit.added))):
            continue
        assert {len(edits) for edits in advice} == {1}, edit
        serious = [edits for edits in advice if edits[0].added not in trivial]
        if edit.added not in trivial or not serious:
            assert any(says_as_much(edits[0], edit) for edits in advice), (
                str(edit),
                [*map(str, advice)],
            )
    return count


def goals(problem: Problem) -> list[Atom]:
    """Goals that could be claimed to hold from the start; those of some thing for each thing."""
    parts = problem.goal.parts if isinstance(problem.goal, And) else (problem.goal,)
    some = [part for part in parts if isinstance(part, Exists) and isinstance(part.part, Literal)]
    bound = [
        {p.variable: Function(name) for p in part.parameters} for part in some for name in OBJECTS
    ]
    inner = [part.part for part in some for _ in OBJECTS]
    for_each = [
        Literal(substitute_atom(each.atom, values), each.positive)
        for each, values in zip(inner, bound, strict=True)
        if isinstance(each, Literal)
    ]
    return [
        part.atom for part in (*parts, *for_each) if isinstance(part, Literal) and part.positive
    ]


@settings(max_examples=40, suppress_health_check=list(HealthCheck), deadline=None)
@given(problem=st.one_of(problems(), problems(conditional=True)))
def test_every_fluent_that_would_help_at_the_start_is_found(problem: Problem) -> None:
    explanation = explain_infeasibility(problem)
    if explanation.status == "infeasible":
        helping = (
            edit
            for edit in single("initial", problem.initial, FLUENTS)
            if shortest(apply_amendment(problem, Amendment((edit,)))) is not None
        )
        event(f"{min(check(problem, explanation, helping, goals(problem)), 3)} edits help")


S, N, LIMIT = "s", "n", "limit"
NUMBERS = range(-3, 14)
M, V = Variable("M"), Variable("V")
STATICS = [
    *(Function(S, (Function(each),)) for each in OBJECTS),
    *(Function(N, (Function(each), Number(number))) for each in OBJECTS for number in NUMBERS),
    *(Function(LIMIT, (Number(number),)) for number in NUMBERS),
]
SUMS = st.sampled_from(
    [V, Operation("+", V, Number(2)), Operation("*", V, Number(2)), Operation("-", Number(3), V)]
)


@st.composite
def wheres(draw: st.DrawFn) -> tuple[BodyPart, ...]:
    """What an operator asks of statics: a mark, or numbers that compare."""
    value = Literal(Function(N, (X, V)))
    limit = Literal(Function(LIMIT, (M,)))
    relation = draw(st.sampled_from(["=", "<=", "<", ">=", ">"]))
    return draw(
        st.sampled_from(
            [
                (),
                (Literal(Function(S, (X,))),),
                (Literal(Function(S, (X,)), False),),
                (value, limit, Comparison(draw(SUMS), relation, M)),
                (value, Comparison(V, relation, Number(draw(st.integers(0, 6))))),
            ]
        )
    )


@st.composite
def marked(draw: st.DrawFn) -> Problem:
    """A chain of fluents p, q, r over two things, each step with constraints over statics."""
    p, q, r = Function("p", (X,)), Function("q", (X,)), Function("r")
    made = (
        Operator("o1", ONE_X, And((Literal(p),)), (Effect(q),), draw(wheres())),
        Operator("o2", ONE_X, And((Literal(q),)), (Effect(r),), draw(wheres())),
    )
    predicates = {
        "p": Predicate("p", ("thing",), Kind.FLUENT),
        "q": Predicate("q", ("thing",), Kind.FLUENT),
        "r": Predicate("r", (), Kind.FLUENT),
        S: Predicate(S, ("thing",), Kind.STATIC),
        N: Predicate(N, ("thing", "int"), Kind.STATIC),
        LIMIT: Predicate(LIMIT, ("int",), Kind.STATIC),
    }
    domain = Domain(
        "marked",
        TYPES,
        objects=dict.fromkeys(OBJECTS, "thing"),
        predicates=predicates,
        operators=made,
    )
    statics = draw(st.lists(st.sampled_from(STATICS), max_size=4, unique=True))
    initial = draw(st.lists(st.sampled_from(FLUENTS[:2]), min_size=1, max_size=2, unique=True))
    return Problem(
        "marked",
        domain,
        statics=tuple(statics),
        initial=tuple(initial),
        goal=Literal(r),
        complete=True,
    )


@pytest.mark.slow
@settings(max_examples=25, suppress_health_check=list(HealthCheck), deadline=None)
@given(problem=marked())
def test_every_static_that_would_help_is_found_with_the_nearest_number(problem: Problem) -> None:
    explanation = explain_infeasibility(problem)
    if explanation.status != "infeasible":
        return
    possible = [
        *single("static", problem.statics, STATICS),
        *single("initial", problem.initial, FLUENTS),
    ]
    helping = (
        edit
        for edit in possible
        if isinstance(
            checked_plan.plan_problem(apply_amendment(problem, Amendment((edit,)))), Found
        )
    )
    event(f"{min(check(problem, explanation, helping, goals(problem)), 3)} edits help")


def even(problem: Problem) -> Problem:
    """The problem with each fact for both things."""
    one, other = map(Function, OBJECTS)
    swap: dict[Term, Term] = {one: other, other: one}

    def both(facts: tuple[Atom, ...]) -> tuple[Atom, ...]:
        moved = (exchange_subterms(each, swap) for each in facts)
        return tuple(
            dict.fromkeys((*facts, *(each for each in moved if isinstance(each, Function))))
        )

    return replace(problem, statics=both(problem.statics), initial=both(problem.initial))


@pytest.mark.slow
@settings(max_examples=40, suppress_health_check=list(HealthCheck), deadline=None)
@given(problem=marked().map(even))
def test_of_changes_that_are_alike_but_for_names_all_help_or_none(problem: Problem) -> None:
    alike, marks = AlikeObjects(ProblemSpace.of(problem, problem.initial)), STATICS[: len(OBJECTS)]
    for edit in (
        *single("initial", problem.initial, FLUENTS),
        *single("static", problem.statics, marks),
    ):
        images = sorted(alike.images(edit), key=str)
        answers = {
            type(checked_plan.plan_problem(apply_amendment(problem, Amendment((each,)))))
            for each in images
        }
        assert len(answers) == 1, [*map(str, images)]
        event(f"{len(images)} alike: {answers}")
