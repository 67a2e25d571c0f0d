"""Successors of open conditions, compiled and interpreted, are what their definition says, in
its order.
"""

from types import ModuleType

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwright.engine.kernels.bits import Bits, bitset, indices
from cellwright.engine.model.ground_task import GroundOperator
from cellwright.engine.stages.planning.delete_relaxation import UNREACHABLE_COST, Relaxation
from cellwright.engine.stages.planning.regression import expansion
from cellwright.kb.terms import Function
from tests.engine.interpreted import interpreted

SIZE = 9
BOTH = pytest.mark.parametrize(
    "module", [expansion, interpreted(expansion)], ids=["imported", "interpreted"]
)
sets = st.sets(st.integers(0, SIZE - 1), max_size=3).map(bitset)
groups = st.lists(st.sets(st.integers(0, SIZE - 1), min_size=2, max_size=3), max_size=2)


@st.composite
def operators(draw: st.DrawFn) -> list[GroundOperator]:
    count = draw(st.integers(1, 12))
    return [
        GroundOperator(
            Function(f"o{number}"), draw(sets), draw(sets), draw(sets), cost=draw(st.integers(1, 4))
        )
        for number in range(count)
    ]


def excluding(exclusive: list[set[int]]) -> list[Bits]:
    """For each atom the others of its groups."""
    return [
        bitset({each for group in exclusive if atom in group for each in group} - {atom})
        for atom in range(SIZE)
    ]


def clashes(conditions: Bits, excluded: list[Bits]) -> bool:
    return any(excluded[atom] & conditions for atom in indices(conditions))


def plainly(
    steps: list[GroundOperator],
    excluded: list[Bits],
    heavy: list[int],
    start: Bits,
    open_: Bits,
    room: int,
) -> list[tuple[int, int, int, Bits]]:
    """The heaviest open conditions first, those that hold last, and for each its operators by
    number.

    What an operator adds can be open after it, even if that excludes one of its preconditions: it
    takes the place of that one.
    """
    plans = Relaxation(steps, SIZE).plans(start)
    charge = [max(each.cost, 1) for each in steps]
    unsatisfied = sorted(indices(open_ & ~start), key=lambda atom: (-heavy[atom], atom))
    found, used = [], set()
    for atom in [*unsatisfied, *indices(open_ & start)]:
        for number, each in enumerate(steps):
            conflict = any(
                (each.deletes >> one & 1 or excluded[one] & each.preconditions)
                and not each.adds >> one & 1
                for one in indices(open_)
            ) or any(excluded[one] & each.adds for one in indices(open_))
            need = plans.plan(each.preconditions)
            adds = each.adds & ~each.preconditions
            if (
                not adds >> atom & 1
                or clashes(each.preconditions, excluded)
                or conflict
                or need is None
            ):
                continue
            achieved = open_ & each.adds
            if achieved.bit_count() > 1 and number in used:
                continue
            used.add(number)
            rest = open_ & ~achieved if achieved.bit_count() > 1 else open_ & ~(1 << atom)
            others = 0
            for one in indices(rest & ~start):
                others |= plans.to(one) or 0
            if achieved.bit_count() > 1 and plans.plan(rest) is None:
                others = 0
            lightness = 1 if start >> atom & 1 else -heavy[atom]
            estimate = (need | others).bit_count()
            if charge[number] + estimate < room:
                found.append((lightness, estimate, number, open_ & ~achieved | each.preconditions))
    return found


@BOTH
@given(
    operators(),
    groups,
    st.lists(st.integers(0, 3), min_size=SIZE, max_size=SIZE),
    sets,
    sets,
    st.sampled_from([4, 9, UNREACHABLE_COST]),
)
def test_successors_agree_with_their_definition(
    module: ModuleType,
    steps: list[GroundOperator],
    exclusive: list[set[int]],
    heavy: list[int],
    start: Bits,
    open_: Bits,
    room: int,
) -> None:
    excluded = excluding(exclusive)
    if clashes(open_, excluded):
        return
    indexed = module.Operators(excluded, [-weight for weight in heavy])
    relaxation = Relaxation(steps, SIZE)
    for each, charge in zip(steps, relaxation.charges, strict=True):
        indexed.add(each.preconditions, each.adds, each.deletes, charge)
    made = module.Expansion(indexed, relaxation.plans(start))
    expected = plainly(steps, excluded, heavy, start, open_, room)
    for _ in range(2):  # what it remembers changes nothing
        assert made.successors(open_, room) == expected
