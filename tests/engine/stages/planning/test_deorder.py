"""Deordering: a random sequence keeps what it does in every order and overlap, and no order
that nothing needs.
"""

import itertools
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.kernels.bits import Bits, bitset, indices
from cellwright.engine.model.ground_task import GroundOperator, GroundTask, progress_state
from cellwright.engine.stages.planning.improvement.plan_reordering import deorder_steps, is_internal
from cellwright.kb.model.plan_model import GOAL_STEP, INITIAL_STEP, Plan, Step, StepId
from cellwright.kb.terms import Function

SIZE = 5
ATOMS = tuple(Function(f"p{n}") for n in range(SIZE))
RESOURCES = (Function("arm"), Function("oven"))
MANY = settings(max_examples=150, deadline=None)
FEW = st.sets(st.integers(0, SIZE - 1), max_size=2).map(bitset)


@st.composite
def sequences(draw: st.DrawFn) -> tuple[GroundTask, list[GroundOperator], Bits]:
    """A task, an executable sequence of its operators, and goals that hold at its end.

    Few atoms hold at first, so that steps need what earlier steps add.
    """
    initial = draw(FEW)
    state, steps = initial, []
    for number in range(draw(st.integers(0, 5))):
        needed = (
            bitset(draw(st.sets(st.sampled_from(list(indices(state))), max_size=2))) if state else 0
        )
        added, deleted = draw(FEW), draw(FEW)
        held = tuple(draw(st.lists(st.sampled_from(RESOURCES), max_size=1)))
        made = Function(f"o{number}")
        steps.append(GroundOperator(made, needed, added, deleted, (), held, number, number + 2))
        state = progress_state(state, steps[-1])
    goals = draw(st.integers(0, (1 << SIZE) - 1)) & state
    return GroundTask(ATOMS, tuple(steps), initial, (goals,), (1,) * SIZE), steps, goals


def denied(operator: GroundOperator) -> Bits:
    return operator.deletes & ~operator.adds


def may_overlap(one: GroundOperator, other: GroundOperator) -> bool:
    """Language, Meaning 8: neither denies a precondition or an add of the other, and they share
    no resource.
    """
    touched = [each.preconditions | each.adds for each in (one, other)]
    apart = not denied(one) & touched[1] and not denied(other) & touched[0]
    return apart and not set(one.resources) & set(other.resources)


def sound(task: GroundTask, steps: list[GroundOperator], plan: Plan) -> bool:
    """Whether unordered steps may overlap, and every link is kept in every order."""
    before = plan.predecessors()
    ids = [step.id for step in plan.steps]
    made = dict(zip(ids, steps, strict=True))
    for one, other in itertools.combinations(ids, 2):
        if one not in before[other] and not may_overlap(made[one], made[other]):
            return False
    for link in plan.links:
        atom = task.atoms.index(link.condition)
        if (
            link.consumer != GOAL_STEP
            and link.producer != INITIAL_STEP
            and link.producer not in before[link.consumer]
        ):
            return False
        for other in ids:
            early = link.producer != INITIAL_STEP and other in before[link.producer]
            late = link.consumer != GOAL_STEP and link.consumer in before[other]
            if other in (link.producer, link.consumer) or early or late:
                continue
            if denied(made[other]) >> atom & 1:
                return False
    return True


def orders(plan: Plan) -> list[list[int]]:
    """Every order of the steps that the plan allows, as positions."""
    numbers = range(len(plan.steps))
    before = [{each - 1 for each in step.after} for step in plan.steps]
    return [
        list(order)
        for order in itertools.permutations(numbers)
        if all(before[each] <= set(order[:place]) for place, each in enumerate(order))
    ]


@given(sequences())
@MANY
def test_every_order_executes_and_ends_in_the_goals(
    case: tuple[GroundTask, list[GroundOperator], Bits],
) -> None:
    task, steps, goals = case
    plan = deorder_steps(task, steps, goals)
    assert sound(task, steps, plan)
    for order in orders(plan):
        state = task.initial
        for position in order:
            assert steps[position].preconditions & ~state == 0
            state = progress_state(state, steps[position])
        assert goals & ~state == 0


@given(sequences())
@MANY
def test_steps_keep_what_they_are(case: tuple[GroundTask, list[GroundOperator], Bits]) -> None:
    task, steps, goals = case
    found = [
        (s.id, s.operator, s.resources, s.duration, s.cost)
        for s in deorder_steps(task, steps, goals).steps
    ]
    assert found == [
        (n, o.instance, o.resources, o.duration, o.cost) for n, o in enumerate(steps, 1)
    ]


@given(sequences())
@MANY
def test_no_order_is_left_that_nothing_needs(
    case: tuple[GroundTask, list[GroundOperator], Bits],
) -> None:
    """Neither one that follows from others, nor one without which the plan is as sound."""
    task, steps, goals = case
    plan = deorder_steps(task, steps, goals)
    before = plan.predecessors()
    for place, step in enumerate(plan.steps):
        assert list(step.after) == sorted(set(step.after))
        for gone in step.after:
            assert not any(gone in before[other] for other in step.after)
            whole = [replace(each, after=tuple(sorted(before[each.id]))) for each in plan.steps]
            whole[place] = replace(
                step, after=tuple(each for each in sorted(before[step.id]) if each != gone)
            )
            assert not sound(task, steps, _exactly(plan, whole))


def _exactly(plan: Plan, steps: list[Step]) -> Plan:
    """A plan whose steps come after those that are listed, and no others that follow from them."""

    class Loosened(Plan):
        __slots__ = ()

        def predecessors(self) -> dict[StepId, frozenset[StepId]]:
            return {each.id: frozenset(each.after) for each in self.steps}

    return Loosened(tuple(steps), plan.links)


@given(sequences())
@MANY
def test_each_condition_is_linked_to_the_earliest_step_that_provides_it_for_good(
    case: tuple[GroundTask, list[GroundOperator], Bits],
) -> None:
    task, steps, goals = case
    states = [task.initial]
    for step in steps:
        states.append(progress_state(states[-1], step))
    expected = []
    for place, needed in enumerate([*(step.preconditions for step in steps), goals]):
        for atom in indices(needed):
            first = place
            while first and states[first - 1] >> atom & 1:
                first -= 1
            expected.append(
                (first, task.atoms[atom], place + 1 if place < len(steps) else GOAL_STEP)
            )
    found = [
        (link.producer, link.condition, link.consumer)
        for link in deorder_steps(task, steps, goals).links
    ]
    assert sorted(found, key=str) == sorted(expected, key=str)
    assert len(set(found)) == len(found)


def operator(
    name: str, needs: set[int], adds: set[int], deletes: tuple[int, ...] = ()
) -> GroundOperator:
    return GroundOperator(Function(name), bitset(needs), bitset(adds), bitset(deletes))


def task_of(
    *steps: GroundOperator, initial: Bits = 0, atoms: tuple[Function, ...] = ATOMS
) -> GroundTask:
    return GroundTask(atoms, steps, initial, (0,), (1,) * len(atoms))


def test_internal_steps_and_conditions_are_left_out() -> None:
    """The last operator only notes that a goal is met: what it needs is a goal; stages are kept."""
    atoms = (Function("p"), Function("_goal"), Function("_stage", (Function("c"),)))
    make = operator("make", set(), {0, 2})
    note = GroundOperator(Function("_note"), bitset([0, 2]), bitset([1]), 0)
    plan = deorder_steps(task_of(make, note, atoms=atoms), [make, note], bitset([1]))
    assert [str(step.operator) for step in plan.steps] == ["make"]
    assert {(link.producer, str(link.condition), link.consumer) for link in plan.links} == {
        (1, "p", GOAL_STEP),
        (1, "_stage(c)", GOAL_STEP),
    }
    assert is_internal(Function("_note"))
    assert not is_internal(Function("_stage"))
    assert not is_internal(Function("note"))


def test_a_condition_that_two_internal_steps_need_is_linked_once() -> None:
    atoms = (Function("p"), Function("_one"), Function("_two"))
    make = operator("make", set(), {0})
    notes = [GroundOperator(Function(f"_note{n}"), bitset([0]), bitset([n]), 0) for n in (1, 2)]
    plan = deorder_steps(task_of(make, *notes, atoms=atoms), [make, *notes], bitset([0, 1, 2]))
    assert len(plan.links) == 1


def test_an_internal_condition_that_holds_at_first_is_linked_to_nothing() -> None:
    atoms = (Function("p"), Function("_ready"))
    make = operator("make", {1}, {0})
    plan = deorder_steps(task_of(make, initial=bitset([1]), atoms=atoms), [make], bitset([0, 1]))
    assert [str(link.condition) for link in plan.links] == ["p"]


@pytest.mark.parametrize(
    ("initial", "starts", "producer"),
    [
        ((), (0, 4, 7), 1),  # both have ended: the earlier one
        ((), (0, 3, 5), 2),  # the first ends at 6
        ((), (2, 4, 6), 2),  # the other ends as the consumer starts
        ((), (1, 4, 5), 1),  # none has ended: the earlier one
        ((0,), (9, 9, 0), INITIAL_STEP),  # the initial state is always there
    ],
)
def test_with_starts_a_condition_is_linked_to_a_step_that_has_ended(
    initial: tuple[int, ...], starts: tuple[int, ...], producer: StepId
) -> None:
    long, short = operator("long", set(), {0}), operator("short", set(), {0})
    steps = [replace(long, duration=6), replace(short, duration=2), operator("use", {0}, {1})]
    plan = deorder_steps(task_of(*steps, initial=bitset(initial)), steps, bitset([1]), starts)
    assert [link.producer for link in plan.links if link.consumer == 3] == [producer]
