# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""Compiled loops of forward search: relaxed plans of a state, and the count of its landmarks.

Relaxed plans by additive costs give the estimate and the preferred operators (Hoffmann & Nebel
2001; Keyder & Geffner 2008). Landmarks are counted, too (Richter & Westphal 2010).

The module is plain Python. Cython compiles it with the types in `kernels.pxd`; without a compiler
it runs as it is, but slowly. A set of atoms is a row of bytes: atom i is bit i % 8 of byte i // 8.
"""

from array import array
from collections.abc import Sequence
from typing import TypeAlias

from cellwright.engine.kernels.packed_rows import PackedRows, zero_ints, zero_longs

Ints: TypeAlias = "array[int]"  # 32 bits each
Longs: TypeAlias = "array[int]"  # 64 bits each
UNREACHED = 1 << 60
MOST = 1 << 50  # additive costs are cut off here, because they can double with every step


class Queue:
    """Atoms ordered by cost, in a binary heap.

    The first atom is heap[0] and its cost is keys[0]; read them before `pop`.
    """

    def __init__(self, room: int) -> None:
        self.size = 0
        self.heap, self.keys = zero_ints(room), zero_longs(room)

    def push(self, atom: int, key: int) -> None:
        """Puts an atom in."""
        place = self.size
        self.size += 1
        while place > 0:
            parent = (place - 1) // 2
            if self.keys[parent] <= key:
                break
            self.keys[place] = self.keys[parent]
            self.heap[place] = self.heap[parent]
            place = parent
        self.keys[place] = key
        self.heap[place] = atom

    def pop(self) -> None:
        """Removes the first entry."""
        self.size -= 1
        key, atom = self.keys[self.size], self.heap[self.size]
        place, child = 0, 1
        while child < self.size:
            if child + 1 < self.size and self.keys[child + 1] < self.keys[child]:
                child += 1
            if key <= self.keys[child]:
                break
            self.keys[place] = self.keys[child]
            self.heap[place] = self.heap[child]
            place, child = child, 2 * child + 1
        self.keys[place] = key
        self.heap[place] = atom


class RelaxedPlans:
    """Relaxed plans from any state to one conjunction of goals, over operators that only add.

    `need` and `add` have a list of atoms for each operator, `users` has a list of operators for
    each atom. Costs are positive. After `evaluate` the results are in `applicable`, `preferred` and
    `relaxed`. `applicable` has operators below `listed` alone, if that is given.
    """

    def __init__(
        self,
        costs: Sequence[int],
        goals: Sequence[int],
        need: PackedRows,
        add: PackedRows,
        users: PackedRows,
        listed: int | None = None,
    ) -> None:
        self.atoms, self.operators = users.count, need.count
        self.listed = self.operators if listed is None else listed
        self.costs, self.goals = array("q", costs), array("i", goals)
        self.need, self.add, self.users = need, add, users
        wanted = set(goals)
        self.wanted = array("i", [atom in wanted for atom in range(self.atoms)])
        self.reached, self.supporter = zero_longs(self.atoms), zero_ints(self.atoms)
        self.spent, self.missing = zero_longs(self.operators), zero_ints(self.operators)
        self.marked, self.stack = zero_ints(self.operators), zero_ints(need.length + len(goals))
        self.queue = Queue(self.atoms + add.length)
        self._applicable, self._preferred = zero_ints(self.operators), zero_ints(self.operators)
        self._relaxed = zero_ints(self.operators)
        self._found = self._helpful = self._length = 0

    def evaluate(self, state: bytes) -> int:
        """The cost of a relaxed plan from `state`; -1 if there is none."""
        self._begin(state)
        self._reach()
        self._helpful = self._length = 0
        for index in range(len(self.goals)):
            if self.reached[self.goals[index]] == UNREACHED:
                return -1
        return self._extract()

    def charge(self, first: int, of: Ints, costs: Longs) -> None:
        """Gives other costs to the operators from `first` on: to the next one `costs[of[0]]`, then
        `costs[of[1]]` and so on.

        With a cost of UNREACHED an operator cannot be taken.
        """
        for index in range(len(of)):
            self.costs[first + index] = costs[of[index]]

    @property
    def applicable(self) -> list[int]:
        """The operators that are applicable in the state that was evaluated last."""
        return [self._applicable[index] for index in range(self._found)]

    @property
    def preferred(self) -> list[int]:
        """The applicable operators with which the relaxed plan of that state begins."""
        return [self._preferred[index] for index in range(self._helpful)]

    @property
    def relaxed(self) -> list[int]:
        """All operators of the relaxed plan of that state."""
        return [self._relaxed[index] for index in range(self._length)]

    def _begin(self, state: bytes) -> None:
        """Starts with the state's atoms and with the operators that need nothing."""
        self.queue.size = self._found = 0
        for atom in range(self.atoms):
            self.reached[atom] = UNREACHED
            self.supporter[atom] = -1
            if state[atom >> 3] >> (atom & 7) & 1:
                self.reached[atom] = 0
                self.queue.push(atom, 0)
        for operator in range(self.operators):
            self.marked[operator] = 0
            self.missing[operator] = self.need.starts[operator + 1] - self.need.starts[operator]
            self.spent[operator] = self.costs[operator]
            if self.missing[operator] == 0:
                self._ready(operator)

    def _reach(self) -> None:
        """Settles atoms, the cheapest first.

        It ends when all goals and all atoms of the state are settled, or when no atom is left.
        """
        open_goals = len(self.goals)
        while self.queue.size > 0:
            atom, cost = self.queue.heap[0], self.queue.keys[0]
            if open_goals == 0 and cost > 0:
                break
            self.queue.pop()
            if cost > self.reached[atom]:
                continue
            open_goals -= self.wanted[atom]
            for place in range(self.users.starts[atom], self.users.starts[atom + 1]):
                operator = self.users.items[place]
                self.missing[operator] -= 1
                self.spent[operator] += cost
                if self.missing[operator] == 0:
                    self._ready(operator)

    def _ready(self, operator: int) -> None:
        """Notes the atoms that an operator adds more cheaply than known so far.

        It also notes the operator if it is applicable in the state.
        """
        if self.costs[operator] >= UNREACHED:
            return
        if operator < self.listed and self.spent[operator] == self.costs[operator]:
            self._applicable[self._found] = operator
            self._found += 1
        cost = min(self.spent[operator], MOST)
        for place in range(self.add.starts[operator], self.add.starts[operator + 1]):
            atom = self.add.items[place]
            if cost < self.reached[atom]:
                self.reached[atom] = cost
                self.supporter[atom] = operator
                self.queue.push(atom, cost)

    def _extract(self) -> int:
        """The cost of the relaxed plan that consists of the goals' supporters.

        The plan's operators and those that it begins with are noted.
        """
        total = size = 0
        for index in range(len(self.goals)):
            self.stack[size] = self.goals[index]
            size += 1
        while size > 0:
            size -= 1
            operator = self.supporter[self.stack[size]]
            if operator < 0 or self.marked[operator]:
                continue
            self.marked[operator] = 1
            self._relaxed[self._length] = operator
            self._length += 1
            total += self.costs[operator]
            if self.spent[operator] == self.costs[operator]:
                self._preferred[self._helpful] = operator
                self._helpful += 1
            for place in range(self.need.starts[operator], self.need.starts[operator + 1]):
                self.stack[size] = self.need.items[place]
                size += 1
        return total


class LandmarkCount:
    """Counts the landmarks that a path still has to visit, or has to visit again.

    Landmark i is true when one of the atoms in row i of `atoms` is. `before` has for each landmark
    the landmarks that come before it, `just_before` those that all its achievers need. `goals` are
    landmarks. A set of landmarks is a row of bytes, like a set of atoms.
    """

    def __init__(
        self, atoms: PackedRows, before: PackedRows, just_before: PackedRows, goals: Sequence[int]
    ) -> None:
        self.count, self.goal_count = atoms.count, len(goals)
        self.atoms, self.goals = atoms, array("i", goals)
        self.before, self.just_before = before, just_before
        self.again = zero_ints(self.count)

    def accept(self, accepted: bytes, state: bytes) -> bytes:
        """The accepted landmarks after one more state.

        A landmark is accepted when it is true and all landmarks before it are accepted.
        """
        after = bytearray(accepted)
        for landmark in range(self.count):
            if not after[landmark >> 3] >> (landmark & 7) & 1 and self._is_true(landmark, state):
                for place in range(self.before.starts[landmark], self.before.starts[landmark + 1]):
                    earlier = self.before.items[place]
                    if not after[earlier >> 3] >> (earlier & 7) & 1:
                        break
                else:
                    after[landmark >> 3] |= 1 << (landmark & 7)
        return bytes(after)

    def left(self, accepted: bytes, state: bytes) -> int:
        """The number of landmarks that a path has to visit, or to visit again.

        A landmark that is not accepted has to be visited. An accepted landmark that is false has to
        be visited again if it is a goal, or if a landmark that is not accepted needs it just
        before.
        """
        open_ = again = 0
        for landmark in range(self.count):
            self.again[landmark] = 0
        for index in range(self.goal_count):
            self.again[self.goals[index]] = 1
        for landmark in range(self.count):
            if not accepted[landmark >> 3] >> (landmark & 7) & 1:
                open_ += 1
                for place in range(
                    self.just_before.starts[landmark], self.just_before.starts[landmark + 1]
                ):
                    self.again[self.just_before.items[place]] = 1
        for landmark in range(self.count):
            if self.again[landmark] and accepted[landmark >> 3] >> (landmark & 7) & 1:
                again += not self._is_true(landmark, state)
        return open_ + again

    def _is_true(self, landmark: int, state: Sequence[int]) -> bool:
        for place in range(self.atoms.starts[landmark], self.atoms.starts[landmark + 1]):
            atom = self.atoms.items[place]
            if state[atom >> 3] >> (atom & 7) & 1:
                return True
        return False
