"""Best supporters, compiled and interpreted, agree with a plain search; relaxed plans are the
unions of their charges.
"""

import heapq
from types import ModuleType
from typing import NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwright.engine.kernels.bits import Bits, bitset, indices
from cellwright.engine.model.ground_task import GroundOperator
from cellwright.engine.stages.planning import supporters
from cellwright.engine.stages.planning.delete_relaxation import UNREACHABLE_COST, Relaxation
from cellwright.kb.terms import Function
from tests.engine.interpreted import interpreted

SIZE = 11
BOTH = pytest.mark.parametrize(
    "module", [supporters, interpreted(supporters)], ids=["imported", "interpreted"]
)
sets = st.lists(st.integers(0, SIZE - 1), max_size=3, unique=True)


class Adder(NamedTuple):
    """An operator that only adds."""

    charge: int
    need: list[int]
    add: list[int]


operators = st.lists(st.builds(Adder, st.integers(1, 4), sets, sets), max_size=14)


def plainly(adders: list[Adder], initial: set[int], bound: int) -> list[int]:
    """Dijkstra over additive costs; a chain ends where its longest run of supporters is longer
    than the bound.
    """
    settled: dict[int, int] = {}
    supporter, depth = dict.fromkeys(range(SIZE), -1), dict.fromkeys(range(SIZE), 0)
    best = dict.fromkeys(initial, 0)
    queue = [(0, atom) for atom in sorted(initial)]
    used: set[int] = set()

    def offer() -> None:
        for number, (charge, need, add) in enumerate(adders):
            end = charge + max((depth[atom] for atom in need), default=0)
            if number in used or not set(need) <= set(settled):
                continue
            used.add(number)
            cost = charge + sum(settled[atom] for atom in need)
            for atom in add if end <= bound else ():
                if cost < best.get(atom, UNREACHABLE_COST):
                    best[atom], supporter[atom], depth[atom] = cost, number, end
                    heapq.heappush(queue, (cost, atom))

    offer()
    while queue:
        cost, atom = heapq.heappop(queue)
        if atom not in settled:
            settled[atom] = cost
            offer()
    return [supporter[atom] for atom in range(SIZE)]


@BOTH
@given(
    adders=operators,
    initial=st.sets(st.integers(0, SIZE - 1)),
    bound=st.sampled_from([1, 3, 6, UNREACHABLE_COST]),
)
def test_supporters_agree_with_a_plain_search(
    module: ModuleType, adders: list[Adder], initial: set[int], bound: int
) -> None:
    users = [
        [number for number, each in enumerate(adders) if atom in each.need] for atom in range(SIZE)
    ]
    needs, adds = [each.need for each in adders], [each.add for each in adders]
    search = module.Supporters([each.charge for each in adders], needs, adds, users)
    for _ in range(2):  # a second search finds nothing of the first
        assert search.spread(packed(initial), bound) == plainly(adders, initial, bound)


@BOTH
def test_costs_that_double_with_every_step_are_cut_off(module: ModuleType) -> None:
    length = 70
    need = [[2 * place, 2 * place + 1] for place in range(length) for _ in range(2)]
    add = [[2 * place + 2 + side] for place in range(length) for side in (0, 1)]
    users = [
        [number for number, each in enumerate(need) if atom in each]
        for atom in range(2 * length + 2)
    ]
    search = module.Supporters([1] * len(need), need, add, users)
    found = search.spread(bytes([3]) + bytes(len(users) // 8), UNREACHABLE_COST)
    assert found == [-1, -1, *range(2 * length)]


@given(operators, st.sets(st.integers(0, SIZE - 1)), st.sets(st.integers(0, SIZE - 1)))
def test_a_relaxed_plan_costs_what_its_supporters_cost(
    adders: list[Adder], initial: set[int], goals: set[int]
) -> None:
    grounded = [
        GroundOperator(
            Function(f"o{number}"), bitset(sorted(need)), bitset(sorted(add)), 0, cost=charge
        )
        for number, (charge, need, add) in enumerate(adders)
    ]
    plans = Relaxation(grounded, SIZE).plans(bitset(sorted(initial)))
    chosen, reachable = needed_for(
        adders, plainly(adders, initial, UNREACHABLE_COST), initial, goals
    )
    made = plans.plan(bitset(sorted(goals)))
    assert (made is not None) == reachable
    assert made is None or made.bit_count() == sum(adders[number].charge for number in chosen)
    assert plans.plan(bitset(sorted(goals))) == made


def needed_for(
    adders: list[Adder], supporter: list[int], initial: set[int], goals: set[int]
) -> tuple[set[int], bool]:
    """The operators below goals, and whether every goal is reached."""
    chosen: set[int] = set()
    waiting = list(goals - initial)
    while waiting:
        number = supporter[waiting.pop()]
        if number < 0:
            return set(), False
        if number not in chosen:
            chosen.add(number)
            waiting += set(adders[number].need) - initial
    return chosen, True


def packed(state: set[int]) -> bytes:
    bits: Bits = bitset(sorted(state))
    assert set(indices(bits)) == state
    return bits.to_bytes((SIZE + 7) // 8, "little")
