"""Landmarks are really met, and reasonable orders say truly what would have to be given up."""

import itertools
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path

from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from cellwright.engine.formats.interop.pddl import read_pddl_task
from cellwright.engine.kernels.bits import Bits, indices
from cellwright.engine.model.ground_task import GroundOperator, GroundTask, progress_state
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.planning.forward.landmarks import (
    LandmarkHints,
    Landmarks,
    ReachingMoment,
    interfering_pairs,
    predicate_kinds,
    reasonable_orders,
)
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function
from tests.properties.problems import problems

DILIGENT = settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))

Seen = tuple[Bits, bool]  # a state, and whether a landmark was true in it or before

BLOCKS = """
(define (domain blocks) (:requirements :strips)
  (:predicates (on ?x ?y) (table ?x) (clear ?x) (empty) (held ?x))
  (:action lift :parameters (?x) :precondition (and (clear ?x) (table ?x) (empty))
    :effect (and (held ?x) (not (table ?x)) (not (clear ?x)) (not (empty))))
  (:action lower :parameters (?x) :precondition (held ?x)
    :effect (and (table ?x) (clear ?x) (empty) (not (held ?x))))
  (:action stack :parameters (?x ?y) :precondition (and (held ?x) (clear ?y))
    :effect (and (on ?x ?y) (clear ?x) (empty) (not (held ?x)) (not (clear ?y))))
  (:action take :parameters (?x ?y) :precondition (and (on ?x ?y) (clear ?x) (empty))
    :effect (and (held ?x) (clear ?y) (not (on ?x ?y)) (not (clear ?x)) (not (empty)))))
"""


@st.composite
def towers(draw: st.DrawFn, count: int) -> tuple[list[str], list[str]]:
    """Random piles of blocks: what stands on what, and the rest of the facts."""
    names, piles = (
        draw(st.permutations([f"b{number}" for number in range(count)])),
        list[list[str]](),
    )
    for name in names:
        if piles and draw(st.integers(0, 2)):
            piles[-1].append(name)
        else:
            piles.append([name])
    stacked = [
        f"(on {upper} {lower})" for pile in piles for lower, upper in itertools.pairwise(pile)
    ]
    rest = [fact for pile in piles for fact in (f"(table {pile[0]})", f"(clear {pile[-1]})")]
    return stacked, [*rest, "(empty)"]


@st.composite
def blocks(draw: st.DrawFn, count: int = 4) -> Problem:
    """Random piles of blocks to be made into others."""
    (stacked, rest), (wanted, _) = draw(towers(count)), draw(towers(count))
    return posed(" ".join(stacked + rest), " ".join(wanted))


def posed(facts: str, goals: str) -> Problem:
    objects = " ".join(sorted(set(re.findall(r"\bb\d|\b[a-e]\b", facts))))
    text = (
        f"(define (problem p) (:domain blocks) (:objects {objects}) (:init {facts}) (:goal (and "
        f"{goals})))"
    )
    with tempfile.TemporaryDirectory() as folder:
        files = Path(folder) / "domain.pddl", Path(folder) / "problem.pddl"
        for file, content in zip(files, (BLOCKS, text), strict=True):
            file.write_text(content)
        return read_pddl_task(*files).problem


FAMILIES = st.one_of(problems(), blocks())


def plain(problem: Problem) -> GroundTask:
    """The ground task of a problem, without conditional effects, derived atoms and alternatives
    of goals.
    """
    try:
        task = ground(problem)
    except InvalidInput:
        assume(False)
    assume(len(task.goals) == 1 and task.axioms is None)
    assume(not any(operator.conditional or operator.changes for operator in task.operators))
    return task


def of(task: GroundTask) -> Landmarks:
    return Landmarks(
        task.operators, task.initial, task.goals[0], len(task.atoms), hints=LandmarkHints.of(task)
    )


def transitions(task: GroundTask, landmark: Bits) -> Iterator[tuple[Seen, Bits]]:
    """Every transition that can be made from the start, as the state before and the one after.

    A landmark is one of some atoms.
    """
    start = task.initial, bool(task.initial & landmark)
    seen, waiting = {start}, [start]
    while waiting:
        state, known = waiting.pop()
        for operator in task.operators:
            if operator.preconditions & ~state == 0:
                after = progress_state(state, operator)
                yield (state, known), after
                then = after, known or bool(after & landmark)
                if then not in seen:
                    seen.add(then)
                    waiting.append(then)


@given(FAMILIES)
@DILIGENT
def test_every_state_in_which_the_goals_hold_comes_after_every_landmark(problem: Problem) -> None:
    task = plain(problem)
    landmarks = of(task)
    single = (1 << atom for atom in indices(landmarks.all & ~task.initial))
    for atoms in [*single, *landmarks.sets]:
        for (_, known), after in transitions(task, atoms):
            assert known or after & atoms or task.goals[0] & ~after


@given(FAMILIES)
@DILIGENT
def test_a_goal_does_not_stay_true_when_a_landmark_is_reached_that_is_better_first(
    problem: Problem,
) -> None:
    task = plain(problem)
    landmarks = of(task)
    for later, earlier in interfering_pairs(task.goals[0], landmarks.moments, task.mutex_groups):
        again = bool(task.initial >> earlier & 1)
        for (before, known), after in transitions(task, 1 << earlier):
            if after >> earlier & 1 and not before >> earlier & 1 and (again or not known):
                assert not (before & after) >> later & 1


@given(FAMILIES)
@DILIGENT
def test_orders_are_transitive_and_close_no_circle(problem: Problem) -> None:
    before = of(plain(problem)).before
    for landmark, earlier in before.items():
        assert not earlier >> landmark & 1
        for each in indices(earlier):
            assert before[each] & ~earlier == 0


def test_the_lower_one_of_two_blocks_is_stacked_first() -> None:
    upper, lower, holding, clear = range(4)  # on(a, b), on(b, c), holding(b), clear(b)
    moments = {
        upper: ReachingMoment(1 << clear, 1 << upper),
        lower: ReachingMoment(1 << holding, 1 << lower | 1 << clear),
    }
    groups = [1 << upper | 1 << clear | 1 << holding]
    assert reasonable_orders(0b11, {upper: 0, lower: 0}, moments, groups) == {
        upper: 1 << lower,
        lower: 0,
    }


def test_one_of_several_hands_is_a_landmark() -> None:
    atoms = [Function("holds", (Function("left"),)), Function("holds", (Function("right"),))]
    atoms += [Function("there"), Function("ready")]
    left, right, there, ready = (1 << number for number in range(4))
    steps = [("take_left", ready, left), ("take_right", ready, right)]
    steps += [("put_left", left, there), ("put_right", right, there)]
    operators = [GroundOperator(Function(name), needs, adds, 0) for name, needs, adds in steps]
    found = Landmarks(operators, ready, there, 4, hints=LandmarkHints((), predicate_kinds(atoms)))
    assert found.sets == [left | right]
    assert found.before == {2: 1 << 4, 3: 0, 4: 0}  # the set has the number 4
    begun = found.accept(found.none, bytes([ready]))
    assert found.left(begun, bytes([ready])) == 2
    held = found.accept(begun, bytes([ready | left]))
    assert found.left(held, bytes([ready | left])) == 1
    assert found.left(held, bytes([ready])) == 1  # put away again, it does not count


def test_a_goal_that_will_be_in_the_way_counts_only_once_it_is_not() -> None:
    facts = "(on c b) (on b a) (table a) (table d) (table e) (clear c) (clear d) (clear e) (empty)"
    task = ground(posed(facts, "(on d c) (on b e)"))
    landmarks, state, left = of(task), task.initial, []
    accepted = landmarks.accept(landmarks.none, packed(state))
    for name in (
        "lift(d)",
        "stack(d, c)",
        "take(d, c)",
        "lower(d)",
        "take(c, b)",
        "lower(c)",
        "lift(d)",
        "stack(d, c)",
    ):
        left.append(landmarks.left(accepted, packed(state)))
        state = progress_state(
            state, next(each for each in task.operators if str(each.instance) == name)
        )
        accepted = landmarks.accept(accepted, packed(state))
    left.append(landmarks.left(accepted, packed(state)))
    assert left[2] >= left[0]  # d is on c, and must be taken away again before b can be lifted
    assert left[8] < left[6]


def packed(state: Bits) -> bytes:
    return state.to_bytes(8, "little")
