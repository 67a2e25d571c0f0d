# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""Cheapest plan of a small task by uniform-cost search over all its states (Dijkstra 1959).

Plain Python, which Cython compiles with the types in `cheapest.pxd`; without a compiler it runs as
it stands, slowly. A set of atoms is a row of `words` whole numbers of 32 bits. Costs are small
whole numbers, so that the queue is a list of states for each cost (Dial 1969).
"""

from array import array
from collections.abc import Sequence
from typing import TypeAlias

from cellwright.engine.kernels.packed_rows import zero_ints

Ints: TypeAlias = "array[int]"  # 32 bits each
Words: TypeAlias = "array[int]"  # 32 bits each, without a sign
NONE, HOPELESS, MORE = -1, -2, -3
SHRINKS = 4  # so many times fewer states than wait now may come with each level that is left


def rows(sets: Sequence[int], words: int) -> Words:
    """Sets of atoms, one after another."""
    found = array("I")
    for each in sets:
        found.frombytes(each.to_bytes(4 * words, "little"))
    return found


class Cheapest:
    """States that are reached at a cost below `bound`, at most `room` of them.

    `needs`, `adds` and `drops` are rows for each operator: what it needs, adds, and ends. The last
    `eager` operators cost nothing and are taken as soon as they can be. `goals` are alternatives. A
    search that would very likely not end within `room` is given up early.
    """

    def __init__(
        self,
        words: int,
        costs: Sequence[int],
        needs: Words,
        adds: Words,
        drops: Words,
        eager: int,
        goals: Words,
        bound: int,
        room: int,
    ) -> None:
        self.words, self.eager, self.bound, self.room = words, eager, bound, room
        self.operators, self.choices = len(costs) - eager, len(goals) // words
        self.costs, self.needs, self.adds, self.drops, self.goals = (
            array("i", costs),
            needs,
            adds,
            drops,
            goals,
        )
        self.count = self.expanded = self.level = self.waiting = 0
        self.states = array("I", bytes(4 * words * (room + 1)))
        self.cost, self.parent, self.by = (
            zero_ints(room + 1),
            zero_ints(room + 1),
            zero_ints(room + 1),
        )
        self.later, self.earlier = zero_ints(room + 1), zero_ints(room + 1)
        self.first = array("i", [-1]) * (bound + 1)
        self.size = 1
        while self.size < 2 * room + 2:
            self.size *= 2
        self.table = array("i", [-1]) * self.size
        self.fresh = array("I", bytes(4 * words))

    def begin(self, initial: Words) -> None:
        """Start from a state."""
        for word in range(self.words):
            self.fresh[word] = initial[word]
        self._settle()
        self.waiting = self._meet(0, -1, -1)

    def run(self, expansions: int) -> int:
        """The number of the goal state that is reached at the least cost, or why there is none:
        `NONE` is below the bound, the search is `HOPELESS` within its room, or `MORE` expansions
        are needed."""
        while self.level < self.bound:
            while self.first[self.level] >= 0:
                if expansions == 0:
                    return MORE
                expansions -= 1
                state = self.first[self.level]
                self._unlink(state, self.level)
                self.waiting -= 1
                if self._is_goal(state):
                    return state
                self.expanded += 1
                self._expand(state)
                if self.count >= self.room:
                    return HOPELESS
            self.level += 1
            if self.count + self.waiting * (self.bound - self.level - 1) // SHRINKS > self.room:
                return HOPELESS
        return NONE

    def _expand(self, state: int) -> None:
        for operator in range(self.operators):
            cost = self.level + self.costs[operator]
            if cost >= self.bound or not self._applies(operator, state) or self.count >= self.room:
                continue
            for word in range(self.words):
                place = operator * self.words + word
                old = self.states[state * self.words + word]
                self.fresh[word] = (old & ~self.drops[place]) | self.adds[place]
            self._settle()
            self.waiting += self._meet(cost, state, operator)

    def _applies(self, operator: int, state: int) -> bool:
        for word in range(self.words):
            if self.needs[operator * self.words + word] & ~self.states[state * self.words + word]:
                return False
        return True

    def _is_goal(self, state: int) -> bool:
        for choice in range(self.choices):
            for word in range(self.words):
                if self.goals[choice * self.words + word] & ~self.states[state * self.words + word]:
                    break
            else:
                return True
        return False

    def _settle(self) -> None:
        """Take eager operators in the fresh state until none is left."""
        operator, last = self.operators, self.operators + self.eager
        while operator < last:
            for word in range(self.words):
                if self.needs[operator * self.words + word] & ~self.fresh[word]:
                    operator += 1
                    break
            else:
                for word in range(self.words):
                    place = operator * self.words + word
                    self.fresh[word] = (self.fresh[word] & ~self.drops[place]) | self.adds[place]
                operator = self.operators

    def _meet(self, cost: int, parent: int, by: int) -> int:
        """Note the fresh state if it is new or reached more cheaply than before; by how much
        the queue grows.
        """
        slot, same = self._slot(), 0
        state = self.table[slot]
        if state < 0:
            state = self.table[slot] = self.count
            self.count += 1
            for word in range(self.words):
                self.states[state * self.words + word] = self.fresh[word]
            same = 1
        elif self.cost[state] <= cost:
            return 0
        else:
            self._unlink(state, self.cost[state])
        self.cost[state], self.parent[state], self.by[state] = cost, parent, by
        self._link(state, cost)
        return same

    def _slot(self) -> int:
        """Where the fresh state is in the table, or belongs."""
        # as locals they are numbers of C
        hashed, odd, bits = 0, 0x9E3779B97F4A7C15, 0xFFFFFFFFFFFFFFFF
        for word in range(self.words):
            hashed = (hashed ^ self.fresh[word]) * odd & bits
            hashed ^= hashed >> 29
        slot = hashed & (self.size - 1)
        while self.table[slot] >= 0:
            state = self.table[slot]
            for word in range(self.words):
                if self.states[state * self.words + word] != self.fresh[word]:
                    break
            else:
                return slot
            slot = (slot + 1) & (self.size - 1)
        return slot

    def _link(self, state: int, cost: int) -> None:
        other = self.first[cost]
        self.later[state], self.earlier[state] = other, -1
        if other >= 0:
            self.earlier[other] = state
        self.first[cost] = state

    def _unlink(self, state: int, cost: int) -> None:
        before, behind = self.earlier[state], self.later[state]
        if before >= 0:
            self.later[before] = behind
        else:
            self.first[cost] = behind
        if behind >= 0:
            self.earlier[behind] = before

    def path(self, state: int) -> list[int]:
        """The operators that lead to a state, without eager ones."""
        found = []
        while self.by[state] >= 0:
            found.append(self.by[state])
            state = self.parent[state]
        return found[::-1]
