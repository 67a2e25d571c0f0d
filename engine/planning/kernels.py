"""Compiled evaluation of states for forward search: relaxed plans by additive costs (Hoffmann & Nebel 2001; Keyder &
Geffner 2008), the operators they begin with, and every applicable operator.

A state is a row of 64-bit words, bit i of the row being atom i. Operators come as compressed rows (`starts`, `items`).
"""

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int32]
Words = NDArray[np.uint64]
UNREACHED = 1 << 30


class Operators(NamedTuple):
    """Relaxed operators: costs and how many conditions; conditions, adds, and the operators that need each atom."""

    costs: Ints
    missing: Ints
    need_starts: Ints
    need_items: Ints
    add_starts: Ints
    add_items: Ints
    user_starts: Ints
    user_items: Ints


class Room(NamedTuple):
    """Room to work in: by atom, by operator, a heap with keys, a stack; `applicable` and `preferred` are results."""

    reached: Ints
    supporter: Ints
    spent: Ints
    open_needs: Ints
    heap: Ints
    keys: Ints
    marked: Ints
    stack: Ints
    applicable: Ints
    preferred: Ints


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
def _apply(operator: int, cost: int, operators: Operators, room: Room, size: int) -> int:
    """Note what an operator adds at a cost, where that is cheaper than before; the heap's new size."""
    for index in range(operators.add_starts[operator], operators.add_starts[operator + 1]):
        atom = operators.add_items[index]
        if cost < room.reached[atom]:
            room.reached[atom], room.supporter[atom] = cost, operator
            size = _push(room.heap, room.keys, size, atom, cost)
    return size


@numba.njit(cache=True)
def _begin(state: Words, operators: Operators, room: Room) -> tuple[int, int]:
    """The state's atoms and the operators that need nothing; the heap's size and the number of applicable operators."""
    size, found = 0, 0
    for atom in range(room.reached.shape[0]):
        room.reached[atom], room.supporter[atom] = UNREACHED, -1
        if state[atom >> 6] >> np.uint64(atom & 63) & np.uint64(1):
            room.reached[atom] = 0
            size = _push(room.heap, room.keys, size, atom, 0)
    for operator in range(operators.missing.shape[0]):
        room.open_needs[operator] = operators.missing[operator]
        room.spent[operator] = operators.costs[operator]
        if operators.missing[operator] == 0:
            room.applicable[found] = operator
            found += 1
            size = _apply(operator, operators.costs[operator], operators, room, size)
    return size, found


@numba.njit(cache=True)
def _reach(state: Words, operators: Operators, room: Room) -> int:
    """Additive costs of all atoms from a state with best supporters; the number of applicable operators."""
    size, found = _begin(state, operators, room)
    while size > 0:
        atom, cost = room.heap[0], room.keys[0]
        size = _pop(room.heap, room.keys, size)
        if cost > room.reached[atom]:
            continue
        for place in range(operators.user_starts[atom], operators.user_starts[atom + 1]):
            operator = operators.user_items[place]
            room.open_needs[operator] -= 1
            room.spent[operator] += cost
            if room.open_needs[operator] > 0:
                continue
            if room.spent[operator] == operators.costs[operator]:
                room.applicable[found] = operator
                found += 1
            size = _apply(operator, room.spent[operator], operators, room, size)
    return found


@numba.njit(cache=True)
def _extract(goals: Ints, operators: Operators, room: Room) -> tuple[int, int]:
    """The cost of the relaxed plan that the supporters make, and how many operators it begins with."""
    size, total, helpful = 0, 0, 0
    room.marked[:] = 0
    for goal in goals:
        room.stack[size] = goal
        size += 1
    while size > 0:
        size -= 1
        operator = room.supporter[room.stack[size]]
        if operator < 0 or room.marked[operator] == 1:
            continue
        room.marked[operator] = 1
        total += operators.costs[operator]
        if room.spent[operator] == operators.costs[operator]:
            room.preferred[helpful] = operator
            helpful += 1
        for index in range(operators.need_starts[operator], operators.need_starts[operator + 1]):
            room.stack[size] = operators.need_items[index]
            size += 1
    return total, helpful


@numba.njit(cache=True)
def evaluate(state: Words, goals: Ints, operators: Operators, room: Room) -> tuple[int, int, int]:
    """The cost of a relaxed plan (-1 if there is none), and how many operators are applicable and preferred."""
    found = _reach(state, operators, room)
    for goal in goals:
        if room.reached[goal] == UNREACHED:
            return -1, found, 0
    total, helpful = _extract(goals, operators, room)
    return total, found, helpful
