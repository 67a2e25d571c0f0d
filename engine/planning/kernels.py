"""Compiled evaluation of states for forward search: relaxed plans by additive costs (Hoffmann & Nebel 2001; Keyder &
Geffner 2008), the operators they begin with, and every applicable operator.

A state is a row of 64-bit words, bit i of the row being atom i. Operators come as compressed rows (`starts`, `items`).
"""

import numba
import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int32]
Words = NDArray[np.uint64]
UNREACHED = 1 << 30


@numba.njit(cache=True)
def _push(heap: Ints, keys: Ints, size: int, atom: int, key: int) -> int:
    place = size
    while place > 0:
        parent = (place - 1) // 2
        if keys[parent] <= key:
            break
        keys[place], heap[place] = keys[parent], heap[parent]
        place = parent
    keys[place], heap[place] = key, atom
    return size + 1


@numba.njit(cache=True)
def _pop(heap: Ints, keys: Ints, size: int) -> int:
    """Remove the first entry; the caller has read it. Returns the new size."""
    size -= 1
    key, atom = keys[size], heap[size]
    place = 0
    while True:
        child = 2 * place + 1
        if child >= size:
            break
        if child + 1 < size and keys[child + 1] < keys[child]:
            child += 1
        if key <= keys[child]:
            break
        keys[place], heap[place] = keys[child], heap[child]
        place = child
    keys[place], heap[place] = key, atom
    return size


@numba.njit(cache=True)
def _apply(
    operator: int,
    cost: int,
    add_starts: Ints,
    add_items: Ints,
    reached: Ints,
    supporter: Ints,
    heap: Ints,
    keys: Ints,
    size: int,
) -> int:
    """Note what an operator adds at a cost, where that is cheaper than before; the heap's new size."""
    for index in range(add_starts[operator], add_starts[operator + 1]):
        atom = add_items[index]
        if cost < reached[atom]:
            reached[atom], supporter[atom] = cost, operator
            size = _push(heap, keys, size, atom, cost)
    return size


@numba.njit(cache=True)
def _begin(
    state: Words,
    costs: Ints,
    missing: Ints,
    add_starts: Ints,
    add_items: Ints,
    reached: Ints,
    supporter: Ints,
    spent: Ints,
    open_needs: Ints,
    heap: Ints,
    keys: Ints,
    applicable: Ints,
) -> tuple[int, int]:
    """The state's atoms and the operators that need nothing; the heap's size and the number of applicable operators."""
    size, found = 0, 0
    for atom in range(reached.shape[0]):
        reached[atom], supporter[atom] = UNREACHED, -1
        if state[atom >> 6] >> np.uint64(atom & 63) & np.uint64(1):
            reached[atom] = 0
            size = _push(heap, keys, size, atom, 0)
    for operator in range(missing.shape[0]):
        open_needs[operator], spent[operator] = missing[operator], costs[operator]
        if missing[operator] == 0:
            applicable[found] = operator
            found += 1
            size = _apply(
                operator, costs[operator], add_starts, add_items, reached, supporter, heap, keys, size
            )
    return size, found


@numba.njit(cache=True)
def _reach(
    state: Words,
    costs: Ints,
    missing: Ints,
    add_starts: Ints,
    add_items: Ints,
    user_starts: Ints,
    user_items: Ints,
    reached: Ints,
    supporter: Ints,
    spent: Ints,
    open_needs: Ints,
    heap: Ints,
    keys: Ints,
    applicable: Ints,
) -> int:
    """Additive costs of all atoms from a state with best supporters; the number of applicable operators."""
    size, found = _begin(
        state,
        costs,
        missing,
        add_starts,
        add_items,
        reached,
        supporter,
        spent,
        open_needs,
        heap,
        keys,
        applicable,
    )
    while size > 0:
        atom, cost = heap[0], keys[0]
        size = _pop(heap, keys, size)
        if cost > reached[atom]:
            continue
        for place in range(user_starts[atom], user_starts[atom + 1]):
            operator = user_items[place]
            open_needs[operator] -= 1
            spent[operator] += cost
            if open_needs[operator] > 0:
                continue
            if spent[operator] == costs[operator]:
                applicable[found] = operator
                found += 1
            size = _apply(
                operator, spent[operator], add_starts, add_items, reached, supporter, heap, keys, size
            )
    return found


@numba.njit(cache=True)
def _extract(
    goals: Ints,
    costs: Ints,
    need_starts: Ints,
    need_items: Ints,
    supporter: Ints,
    spent: Ints,
    preferred: Ints,
    marked: Ints,
    stack: Ints,
) -> tuple[int, int]:
    """The cost of the relaxed plan that the supporters make, and how many operators it begins with."""
    size, total, helpful = 0, 0, 0
    marked[:] = 0
    for goal in goals:
        stack[size] = goal
        size += 1
    while size > 0:
        size -= 1
        operator = supporter[stack[size]]
        if operator < 0 or marked[operator] == 1:
            continue
        marked[operator] = 1
        total += costs[operator]
        if spent[operator] == costs[operator]:
            preferred[helpful] = operator
            helpful += 1
        for index in range(need_starts[operator], need_starts[operator + 1]):
            stack[size] = need_items[index]
            size += 1
    return total, helpful


@numba.njit(cache=True)
def evaluate(
    state: Words,
    goals: Ints,
    costs: Ints,
    need_starts: Ints,
    need_items: Ints,
    missing: Ints,
    add_starts: Ints,
    add_items: Ints,
    user_starts: Ints,
    user_items: Ints,
    reached: Ints,
    supporter: Ints,
    spent: Ints,
    open_needs: Ints,
    heap: Ints,
    keys: Ints,
    applicable: Ints,
    preferred: Ints,
    marked: Ints,
    stack: Ints,
) -> tuple[int, int, int]:
    """The cost of a relaxed plan (-1 if there is none), and how many operators are applicable and preferred."""
    found = _reach(
        state, costs, missing, add_starts, add_items, user_starts, user_items, reached, supporter, spent, open_needs,
        heap, keys, applicable,
    )  # fmt: skip
    for goal in goals:
        if reached[goal] == UNREACHED:
            return -1, found, 0
    total, helpful = _extract(
        goals, costs, need_starts, need_items, supporter, spent, preferred, marked, stack
    )
    return total, found, helpful
