# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False,
# initializedcheck=False cython: cdivision=True
"""A sequence of instants with the earliest times that its partial order allows, and relaxed plans
in time.

A sequence of codes stands for a plan: a start, an end, or the next change that happens by itself.
What must be apart in time are edges of a simple temporal network (Dechter, Meiri & Pearl 1991),
which holds earliest times and is propagated after each edge (Coles et al. 2010 order instants in
the same way). All times are whole numbers of one unit.

The module is plain Python. Cython compiles it with the types in `kernels.pxd`; without a compiler
it runs slowly.
"""

from array import array
from collections.abc import Sequence
from typing import Any, TypeAlias

Ints: TypeAlias = "array[int]"  # 32 bits each
Longs: TypeAlias = "array[int]"  # 64 bits each
UNREACHED = 1 << 60
NO_GOAL = -2  # instead of a node, whose number is -1 for the first one
MOST = 1 << 50  # additive costs are cut off here
NEAR = 1e-9  # numbers that differ by less are equal in the search; the checker compares exactly


def ints(length: int) -> Ints:
    """An array of zeros, 32 bits each."""
    return array("i", bytes(4 * length))


def longs(length: int) -> Longs:
    """An array of zeros, 64 bits each."""
    return array("q", bytes(8 * length))


class Lists:
    """Lists of numbers, stored one after another: list i is items[starts[i]:starts[i + 1]]."""

    def __init__(self, lists: Sequence[Sequence[int]]) -> None:
        starts, items = array("i", [0]), array("i")
        for each in lists:
            items.extend(each)
            starts.append(len(items))
        self.count, self.length = len(lists), len(items)
        self.starts, self.items = starts, items if len(items) else ints(1)

    def row(self, index: int) -> list[int]:
        """The list of that number."""
        return list(self.items[self.starts[index] : self.starts[index + 1]])


class Heap:
    """Numbers ordered by key, in a binary heap.

    The first is heap[0] and its key keys[0]; read them before `pop`.
    """

    def __init__(self, room: int) -> None:
        self.size, self.room = 0, max(room, 16)
        self.heap, self.keys = ints(self.room), longs(self.room)

    def _grow(self) -> None:
        heap, keys = ints(self.room), longs(self.room)
        self.heap_kept, self.keys_kept = array("i", self.heap) + heap, array("q", self.keys) + keys
        self.heap, self.keys = self.heap_kept, self.keys_kept
        self.room *= 2

    def push(self, item: int, key: int) -> None:
        """Puts a number in."""
        if self.size == self.room:
            self._grow()
        place = self.size
        self.size += 1
        while place > 0:
            parent = (place - 1) // 2
            if self.keys[parent] <= key:
                break
            self.heap[place], self.keys[place] = self.heap[parent], self.keys[parent]
            place = parent
        self.heap[place], self.keys[place] = item, key

    def pop(self) -> None:
        """Takes the first number out."""
        self.size -= 1
        item, key = self.heap[self.size], self.keys[self.size]
        place = 0
        while True:
            child = 2 * place + 1
            if child >= self.size:
                break
            if child + 1 < self.size and self.keys[child + 1] < self.keys[child]:
                child += 1
            if self.keys[child] >= key:
                break
            self.heap[place], self.keys[place] = self.heap[child], self.keys[child]
            place = child
        self.heap[place], self.keys[place] = item, key


class Programs:
    """Arithmetic in postfix order. Program i is an expression over the numbers of a state."""

    def __init__(
        self, programs: Sequence[Sequence[tuple[int, int]]], constants: Sequence[float]
    ) -> None:
        self.signs = Lists([[sign for sign, _ in each] for each in programs])
        self.values = Lists([[value for _, value in each] for each in programs])
        self.constants = array("d", [*constants, 0.0])
        self.stack = array("d", bytes(8 * (2 + max(map(len, programs), default=0))))

    def value(self, program: int, numbers: "array[float]") -> float:
        """The value of a program; not a number if it divides by 0 or reads what has no value."""
        size = 0
        for place in range(self.signs.starts[program], self.signs.starts[program + 1]):
            sign, index = self.signs.items[place], self.values.items[place]
            if sign == 0:
                self.stack[size] = self.constants[index]
                size += 1
            elif sign == 1:
                self.stack[size] = numbers[index]
                size += 1
            else:
                size -= 1
                self._calculate(sign, size)
        return self.stack[0]

    def _calculate(self, sign: int, size: int) -> None:
        one, two = self.stack[size - 1], self.stack[size]
        if sign == 2:
            self.stack[size - 1] = one + two
        elif sign == 3:
            self.stack[size - 1] = one - two
        elif sign == 4:
            self.stack[size - 1] = one * two
        elif two == 0:
            self.stack[size - 1] = self.constants[0]  # the first constant is not a number
        else:
            self.stack[size - 1] = one / two


class Timeline:
    """The instants of a sequence, their times, and the state after them."""

    def __init__(self, parts: Any) -> None:
        self.facts = parts.facts
        self.actions = parts.actions
        self.numbers = parts.numbers
        self.changes = parts.changes
        self.epsilon = parts.epsilon
        self.needs = parts.needs
        self.adds = parts.adds
        self.deletes = parts.deletes
        self.holds = parts.holds
        self.end_needs = parts.end_needs
        self.end_adds = parts.end_adds
        self.end_deletes = parts.end_deletes
        self.timed_adds = parts.timed_adds
        self.timed_deletes = parts.timed_deletes
        self.whole = parts.whole
        self.instant = parts.instant
        self.least = parts.least
        self.most = parts.most
        self.least_program = parts.least_program
        self.most_program = parts.most_program
        self.scale = parts.scale
        self.start_tests = parts.start_tests
        self.hold_tests = parts.hold_tests
        self.end_tests = parts.end_tests
        self.test_program = parts.test_program
        self.test_relation = parts.test_relation
        self.test_numbers = parts.test_numbers
        self.start_updates = parts.start_updates
        self.end_updates = parts.end_updates
        self.timed_updates = parts.timed_updates
        self.update_kind = parts.update_kind
        self.update_number = parts.update_number
        self.update_program = parts.update_program
        self.update_reads = parts.update_reads
        self.programs = parts.programs
        self.timed_at = parts.timed_at
        self.initial = parts.initial
        self.values = parts.values
        self._rooms()
        self.reset()

    def _rooms(self) -> None:
        """Makes the arrays that `reset` fills."""
        self.state = array("b", bytes(self.facts + 1))
        self.amounts = array("d", bytes(8 * (self.numbers + 1)))
        self.adder, self.deleter, self.readers = (
            ints(self.facts),
            ints(self.facts),
            ints(self.facts),
        )
        self.holders, self.held, self.enders = ints(self.facts), ints(self.facts), ints(self.facts)
        self.due = ints(self.facts)
        self.changer, self.changed_by_sum = ints(self.numbers + 1), ints(self.numbers + 1)
        self.number_readers, self.number_holders = ints(self.numbers + 1), ints(self.numbers + 1)
        self.open_at, self.open_start, self.open_end = (
            ints(self.actions),
            ints(self.actions),
            ints(self.actions),
        )
        self.open_list = ints(self.actions + 1)
        self.node_room, self.edge_room, self.cell_room = 1024, 8192, 8192
        self.times, self.out = longs(self.node_room), ints(self.node_room)
        self.queue, self.queued = ints(self.node_room), ints(self.node_room)
        self.edge_to, self.edge_next, self.edge_gap = (
            ints(self.edge_room),
            ints(self.edge_room),
            longs(self.edge_room),
        )
        self.cell_node, self.cell_next = ints(self.cell_room), ints(self.cell_room)
        self.cell_start = ints(self.cell_room)
        self.update_value = array("d", bytes(8 * (len(self.update_kind) + 1)))

    def reset(self) -> None:
        """Goes back to the start: only what happens by itself has times."""
        self.nodes = self.edges = self.cells = self.opened = self.passed = 0
        self.makespan, self.consistent = 0, True
        for fact in range(self.facts):
            self.state[fact] = self.initial[fact]
            self.adder[fact] = self.deleter[fact] = self.readers[fact] = self.holders[fact] = -1
            self.held[fact] = 0
            self.enders[fact] = self.due[fact] = -1
        for number in range(self.numbers):
            self.amounts[number] = self.values[number]
            self.changer[number] = self.number_readers[number] = self.number_holders[number] = -1
            self.changed_by_sum[number] = 0
        for action in range(self.actions):
            self.open_at[action] = -1
        self._node()
        for change in range(self.changes):
            node = self._node()
            self.times[node] = self.timed_at[change]
            self._edge(0, node, self.timed_at[change])
            self._edge(node, 0, -self.timed_at[change])
        for change in range(self.changes - 1, -1, -1):
            for place in range(
                self.timed_deletes.starts[change], self.timed_deletes.starts[change + 1]
            ):
                self.due[self.timed_deletes.items[place]] = change + 1

    def _node(self) -> int:
        if self.nodes == self.node_room:
            self._grow_nodes()
        node = self.nodes
        self.nodes += 1
        self.times[node], self.out[node], self.queued[node] = 0, -1, 0
        return node

    def _grow_nodes(self) -> None:
        more = self.node_room
        self.times = array("q", self.times) + longs(more)
        self.out = array("i", self.out) + ints(more)
        self.queue = array("i", self.queue) + ints(more)
        self.queued = array("i", self.queued) + ints(more)
        self.node_room = 2 * more

    def _grow_edges(self) -> None:
        more = self.edge_room
        self.edge_to = array("i", self.edge_to) + ints(more)
        self.edge_next = array("i", self.edge_next) + ints(more)
        self.edge_gap = array("q", self.edge_gap) + longs(more)
        self.edge_room = 2 * more

    def _grow_cells(self) -> None:
        more = self.cell_room
        self.cell_node = array("i", self.cell_node) + ints(more)
        self.cell_next = array("i", self.cell_next) + ints(more)
        self.cell_start = array("i", self.cell_start) + ints(more)
        self.cell_room = 2 * more

    def _cell(self, node: int, start: int, following: int) -> int:
        """A new element of a list of nodes, in front of another one."""
        if self.cells == self.cell_room:
            self._grow_cells()
        cell = self.cells
        self.cells += 1
        self.cell_node[cell], self.cell_start[cell], self.cell_next[cell] = node, start, following
        return cell

    def _edge(self, before: int, after: int, gap: int) -> None:
        """`after` is at least `gap` after `before`.

        An edge that closes a cycle makes the timeline inconsistent.
        """
        if before == after:
            if gap > 0:
                self.consistent = False
            return
        if self.edges == self.edge_room:
            self._grow_edges()
        edge = self.edges
        self.edges += 1
        self.edge_to[edge], self.edge_gap[edge], self.edge_next[edge] = after, gap, self.out[before]
        self.out[before] = edge
        if self.times[before] + gap > self.times[after] and self.consistent:
            self.times[after] = self.times[before] + gap
            if after > self.changes and self.times[after] > self.makespan:
                self.makespan = self.times[after]
            self._propagate(after, before)

    def _propagate(self, first: int, source: int) -> None:
        """Moves what follows `first` to its earliest time.

        `source` may not move: then there is a cycle.
        """
        head, size = 0, 1
        room = self.node_room
        self.queue[0], self.queued[first] = first, 1
        while size > 0:
            node = self.queue[head]
            head = head + 1 if head + 1 < room else 0
            size -= 1
            self.queued[node] = 0
            edge = self.out[node]
            while edge >= 0:
                after = self.edge_to[edge]
                time = self.times[node] + self.edge_gap[edge]
                if time > self.times[after]:
                    if after == source or after == 0:
                        self.consistent = False
                        return
                    self.times[after] = time
                    if time > self.makespan and after > self.changes:
                        self.makespan = time
                    if self.queued[after] == 0:
                        self.queued[after] = 1
                        place = head + size
                        self.queue[place if place < room else place - room] = after
                        size += 1
                edge = self.edge_next[edge]

    def _read(self, fact: int, node: int) -> None:
        """A node needs a fact: after who adds it, before who will delete it."""
        if self.adder[fact] >= 0:
            self._edge(self.adder[fact], node, self.epsilon)
        self.readers[fact] = self._cell(node, node, self.readers[fact])
        cell = self.enders[fact]
        while cell >= 0:
            ender = self.cell_node[cell]
            if self.open_at[self.cell_start[cell]] >= 0 and ender != node:
                self._edge(node, ender, self.epsilon)
            cell = self.cell_next[cell]
        if self.due[fact] >= 0:
            self._edge(node, self.due[fact], self.epsilon)

    def _hold(self, fact: int, start: int, end: int) -> None:
        """An action needs a fact between two nodes."""
        if self.adder[fact] >= 0 and self.adder[fact] != start:
            self._edge(self.adder[fact], start, 0)
        self.holders[fact] = self._cell(end, start, self.holders[fact])
        cell = self.enders[fact]
        while cell >= 0:
            if self.open_at[self.cell_start[cell]] >= 0 and self.cell_node[cell] != end:
                self._edge(end, self.cell_node[cell], 0)
            cell = self.cell_next[cell]
        if self.due[fact] >= 0:
            self._edge(end, self.due[fact], 0)

    def _delete(self, fact: int, node: int) -> None:
        cell = self.readers[fact]
        while cell >= 0:
            if self.cell_node[cell] != node:
                self._edge(self.cell_node[cell], node, self.epsilon)
            cell = self.cell_next[cell]
        cell = self.holders[fact]
        while cell >= 0:
            if self.cell_node[cell] != node:
                self._edge(self.cell_node[cell], node, 0)
            cell = self.cell_next[cell]
        if self.adder[fact] >= 0 and self.adder[fact] != node:
            self._edge(self.adder[fact], node, self.epsilon)
        if self.deleter[fact] >= 0 and self.deleter[fact] != node:
            self._edge(self.deleter[fact], node, self.epsilon)
        self.deleter[fact], self.readers[fact], self.holders[fact] = node, -1, -1
        self.state[fact] = 0

    def _add(self, fact: int, node: int) -> None:
        """A node adds a fact. Two that add it are apart, too: PDDL 2.1 lets them be together,
        unified-planning does not.
        """
        cell = self.readers[fact]
        while cell >= 0:
            if self.cell_node[cell] != node:
                self._edge(self.cell_node[cell], node, self.epsilon)
            cell = self.cell_next[cell]
        if self.deleter[fact] >= 0 and self.deleter[fact] != node:
            self._edge(self.deleter[fact], node, self.epsilon)
        if self.adder[fact] >= 0 and self.adder[fact] != node:
            self._edge(self.adder[fact], node, self.epsilon)
        self.adder[fact], self.readers[fact] = node, -1
        self.state[fact] = 1

    def _tested(self, test: int) -> bool:
        """Whether a test holds in the state."""
        value: float = self.programs.value(self.test_program[test], self.amounts)
        relation: int = self.test_relation[test]
        if relation == 0:
            return -NEAR <= value <= NEAR
        if relation == 1:
            return value < -NEAR or value > NEAR
        if relation == 2:
            return value < -NEAR
        if relation == 3:
            return value <= NEAR
        if relation == 4:
            return value > NEAR
        return value >= -NEAR

    def _read_number(self, number: int, node: int) -> None:
        if self.changer[number] >= 0 and self.changer[number] != node:
            self._edge(self.changer[number], node, self.epsilon)
        self.number_readers[number] = self._cell(node, node, self.number_readers[number])

    def _hold_number(self, number: int, start: int, end: int) -> None:
        if self.changer[number] >= 0 and self.changer[number] != start:
            self._edge(self.changer[number], start, 0)
        self.number_holders[number] = self._cell(end, start, self.number_holders[number])

    def _change_number(self, number: int, node: int, is_sum: int) -> None:
        """A node changes a number. Sums may be at the same instant; all else is apart."""
        cell = self.number_readers[number]
        while cell >= 0:
            if self.cell_node[cell] != node:
                self._edge(self.cell_node[cell], node, self.epsilon)
            cell = self.cell_next[cell]
        cell = self.number_holders[number]
        while cell >= 0:
            start, end = self.cell_start[cell], self.cell_node[cell]
            if end != node and start != node:
                self._edge(start if self._is_open(end) else end, node, 0)
                if self._is_open(end):
                    self._edge(node, end, 0)
            cell = self.cell_next[cell]
        if self.changer[number] >= 0 and self.changer[number] != node:
            together = is_sum and self.changed_by_sum[number]
            self._edge(self.changer[number], node, 0 if together else self.epsilon)
        self.changer[number], self.changed_by_sum[number], self.number_readers[number] = (
            node,
            is_sum,
            -1,
        )

    def _is_open(self, end: int) -> bool:
        for place in range(self.opened):  # noqa: SIM110 - a loop compiles to less than a generator
            if self.open_end[self.open_list[place]] == end:
                return True
        return False

    def _tests(self, lists: "Lists", row: int, node: int) -> bool:
        """Whether the tests of a list hold; a node reads their numbers."""
        for place in range(lists.starts[row], lists.starts[row + 1]):
            test = lists.items[place]
            if not self._tested(test):
                return False
            for index in range(self.test_numbers.starts[test], self.test_numbers.starts[test + 1]):
                self._read_number(self.test_numbers.items[index], node)
        return True

    def _update(self, lists: "Lists", row: int, node: int) -> None:
        """Changes numbers, all by the values before."""
        first, last = lists.starts[row], lists.starts[row + 1]
        for place in range(first, last):
            update = lists.items[place]
            program = self.update_program[update]
            self.update_value[update] = self.programs.value(program, self.amounts)
            for index in range(
                self.update_reads.starts[update], self.update_reads.starts[update + 1]
            ):
                self._read_number(self.update_reads.items[index], node)
        for place in range(first, last):
            update = lists.items[place]
            number, kind, value = (
                self.update_number[update],
                self.update_kind[update],
                self.update_value[update],
            )
            if kind == 0:
                self.amounts[number] = value
            elif kind == 1:
                self.amounts[number] += value
            elif kind == 2:
                self.amounts[number] -= value
            elif kind == 3:
                self.amounts[number] *= value
            else:
                self.amounts[number] = (
                    self.amounts[number] / value if value != 0 else self.programs.constants[0]
                )
            self._change_number(number, node, 1 if kind == 1 or kind == 2 else 0)

    def _invariants(self) -> bool:
        """Whether the tests of all open actions hold."""
        for place in range(self.opened):
            action = self.open_list[place]
            for index in range(self.hold_tests.starts[action], self.hold_tests.starts[action + 1]):
                if not self._tested(self.hold_tests.items[index]):
                    return False
        return True

    def applicable(self, action: int) -> bool:
        """Whether an action may start, without a look at times."""
        if self.open_at[action] >= 0:
            return False
        for place in range(self.needs.starts[action], self.needs.starts[action + 1]):
            if self.state[self.needs.items[place]] == 0:
                return False
        for place in range(self.deletes.starts[action], self.deletes.starts[action + 1]):
            if self.held[self.deletes.items[place]] > 0:
                return False
        for place in range(self.start_tests.starts[action], self.start_tests.starts[action + 1]):
            if not self._tested(self.start_tests.items[place]):
                return False
        return True

    def can_end(self, action: int) -> bool:
        """Whether an open action may end, without a look at times."""
        if self.open_at[action] < 0:
            return False
        for place in range(self.end_needs.starts[action], self.end_needs.starts[action + 1]):
            if self.state[self.end_needs.items[place]] == 0:
                return False
        return True

    def apply(self, code: int) -> bool:
        """Adds an instant to the sequence; whether it may happen there, with consistent times."""
        if code < self.actions:
            done = self._start(code)
        elif code < 2 * self.actions:
            done = self._end(code - self.actions)
        else:
            done = self._pass(code - 2 * self.actions)
        return done and self.consistent

    def _length(self, program: int) -> int:
        value = self.programs.value(program, self.amounts) * self.scale
        return int(value + 0.5) if -1e15 < value < 1e15 else -2

    def _start(self, action: int) -> bool:  # noqa: C901
        if not self.applicable(action):
            return False
        least, most = self.least[action], self.most[action]
        start = self._node()
        if self.least_program[action] >= 0:
            least = self._length(self.least_program[action])
            self._read_length(self.least_program[action], start)
        if self.most_program[action] >= 0:
            most = self._length(self.most_program[action])
            self._read_length(self.most_program[action], start)
            if most < 0:
                return False
        if least < 0 or -1 < most < least:
            return False
        end = start
        if self.instant[action] == 0:
            end = self._node()
            self._edge(start, end, least)
            if most >= 0:
                self._edge(end, start, -most)
        for place in range(self.needs.starts[action], self.needs.starts[action + 1]):
            self._read(self.needs.items[place], start)
        if not self._tests(self.start_tests, action, start):
            return False
        for place in range(self.deletes.starts[action], self.deletes.starts[action + 1]):
            self._delete(self.deletes.items[place], start)
        for place in range(self.adds.starts[action], self.adds.starts[action + 1]):
            self._add(self.adds.items[place], start)
        self._update(self.start_updates, action, start)
        for place in range(self.holds.starts[action], self.holds.starts[action + 1]):
            if self.state[self.holds.items[place]] == 0:
                return False
            self._hold(self.holds.items[place], start, end)
        for place in range(self.hold_tests.starts[action], self.hold_tests.starts[action + 1]):
            test = self.hold_tests.items[place]
            if not self._tested(test):
                return False
            for index in range(self.test_numbers.starts[test], self.test_numbers.starts[test + 1]):
                self._hold_number(self.test_numbers.items[index], start, end)
        if self.instant[action] == 0:
            self._open(action, start, end)
            if self.whole[action]:
                return self._end(action)
        return self._invariants()

    def _read_length(self, program: int, node: int) -> None:
        for place in range(
            self.programs.signs.starts[program], self.programs.signs.starts[program + 1]
        ):
            if self.programs.signs.items[place] == 1:
                self._read_number(self.programs.values.items[place], node)

    def _open(self, action: int, start: int, end: int) -> None:
        self.open_at[action], self.open_start[action], self.open_end[action] = (
            self.opened,
            start,
            end,
        )
        self.open_list[self.opened] = action
        self.opened += 1
        if self.whole[action]:
            return
        for place in range(self.holds.starts[action], self.holds.starts[action + 1]):
            self.held[self.holds.items[place]] += 1
        for place in range(self.end_deletes.starts[action], self.end_deletes.starts[action + 1]):
            fact = self.end_deletes.items[place]
            self.enders[fact] = self._cell(end, action, self.enders[fact])

    def _close(self, action: int) -> None:
        last = self.open_list[self.opened - 1]
        self.open_list[self.open_at[action]] = last
        self.open_at[last] = self.open_at[action]
        self.open_at[action] = -1
        self.opened -= 1
        if self.whole[action]:
            return
        for place in range(self.holds.starts[action], self.holds.starts[action + 1]):
            self.held[self.holds.items[place]] -= 1
        for place in range(self.end_deletes.starts[action], self.end_deletes.starts[action + 1]):
            self._unlist(self.end_deletes.items[place], self.open_end[action])

    def _unlist(self, fact: int, end: int) -> None:
        """Takes a node out of those that will delete a fact."""
        cell, before = self.enders[fact], -1
        while cell >= 0:
            if self.cell_node[cell] == end:
                if before < 0:
                    self.enders[fact] = self.cell_next[cell]
                else:
                    self.cell_next[before] = self.cell_next[cell]
                return
            before, cell = cell, self.cell_next[cell]

    def _end(self, action: int) -> bool:
        if not self.can_end(action):
            return False
        end = self.open_end[action]
        self._close(action)
        for place in range(self.end_deletes.starts[action], self.end_deletes.starts[action + 1]):
            if self.held[self.end_deletes.items[place]] > 0:
                return False
        for place in range(self.end_needs.starts[action], self.end_needs.starts[action + 1]):
            self._read(self.end_needs.items[place], end)
        if not self._tests(self.end_tests, action, end):
            return False
        for place in range(self.end_deletes.starts[action], self.end_deletes.starts[action + 1]):
            self._delete(self.end_deletes.items[place], end)
        for place in range(self.end_adds.starts[action], self.end_adds.starts[action + 1]):
            self._add(self.end_adds.items[place], end)
        self._update(self.end_updates, action, end)
        return self._invariants()

    def _pass(self, change: int) -> bool:
        """What happens by itself next."""
        if change != self.passed:
            return False
        self.passed += 1
        node = change + 1
        for place in range(
            self.timed_deletes.starts[change], self.timed_deletes.starts[change + 1]
        ):
            fact = self.timed_deletes.items[place]
            if self.held[fact] > 0:
                return False
            self._delete(fact, node)
            self.due[fact] = -1
            for later in range(self.changes - 1, change, -1):
                for index in range(
                    self.timed_deletes.starts[later], self.timed_deletes.starts[later + 1]
                ):
                    if self.timed_deletes.items[index] == fact:
                        self.due[fact] = later + 1
        for place in range(self.timed_adds.starts[change], self.timed_adds.starts[change + 1]):
            self._add(self.timed_adds.items[place], node)
        self._update(self.timed_updates, change, node)
        return self._invariants()

    def digest(self) -> int:
        """A number for the state: facts, numbers, open actions and what has passed.

        Equal states have equal ones.
        """
        total = self.passed * 1000003 + 7
        for fact in range(self.facts):
            if self.state[fact]:
                total ^= self._mixed(fact + 1)
        for place in range(self.opened):
            total ^= self._mixed(self.facts + 17 + self.open_list[place])
        for number in range(self.numbers):
            value = self.amounts[number] * 4096.0
            if -1e17 < value < 1e17:
                total ^= self._mixed(int(value) * 31 + 1299721 * (number + 1))
        return total

    def _mixed(self, value: int) -> int:
        """A number that looks random (Steele, Lea & Flood 2014)."""
        mixed = (value * -7046029254386353131) & 0xFFFFFFFFFFFFFFFF
        mixed = ((mixed ^ (mixed >> 30)) * 0x3F58476D1CE4E5B9) & 0xFFFFFFFFFFFFFFFF
        mixed = ((mixed ^ (mixed >> 27)) * 0x14D049BB133111EB) & 0xFFFFFFFFFFFFFFFF
        return (mixed ^ (mixed >> 31)) >> 1


class Relaxation:
    """Relaxed plans from the state of a timeline: what they cost, when they end, and what they
    begin with.

    Operator i < actions is the start of action i, or all of it; the others are ends of actions that
    are not whole. A fact that is greater than the facts of the problem stands for a running action
    or for a test.
    """

    def __init__(self, parts: Any) -> None:
        self.all_facts = parts.all_facts
        self.facts = parts.facts
        self.actions = parts.actions
        self.operators = parts.operators
        self.first_test = parts.first_test
        self.relaxed_needs = parts.relaxed_needs
        self.early_adds = parts.early_adds
        self.late_adds = parts.late_adds
        self.users = parts.users
        self.spans = parts.spans
        self.end_of = parts.end_of
        self.open_adds = parts.open_adds
        self.weights = parts.weights
        self.nudges = parts.nudges
        self.nudge_by = parts.nudge_by
        self.tests = parts.tests
        self.goals = parts.goals
        self.timed_adds = parts.timed_adds
        self.timed_at = parts.timed_at
        self.changes = parts.changes
        self.no_needs = parts.no_needs
        size = self.all_facts + 1
        self.costs, self.reached, self.missing = longs(size), longs(size), ints(self.operators + 1)
        self.supporter, self.marked, self.stack = ints(size), ints(size), ints(size)
        self.repeats, self.pure, self.is_goal = longs(size), longs(size), ints(size)
        self.deficit = array("d", bytes(8 * size))
        self.spent, self.ready = longs(self.operators + 1), longs(self.operators + 1)
        self.used = ints(self.operators + 1)
        self.fits, self.helpful, self.relaxed = (ints(self.operators + 1) for _ in range(3))
        self.fitting = self.helping = self.length = 0
        self.queue = Heap(4 * size)
        self.estimate = 0
        self.slope = 0.0

    def evaluate(self, line: "Timeline") -> int:
        """What the cheapest relaxed plan found costs; `UNREACHED` if there is none. `estimate`
        is when it ends.
        """
        self._begin(line)
        self._explore(line)
        return self._extract(line)

    def _begin(self, line: "Timeline") -> None:  # noqa: C901
        self.queue.size = self.fitting = self.helping = self.length = 0
        for fact in range(self.all_facts):
            self.costs[fact], self.supporter[fact], self.marked[fact] = UNREACHED, -1, 0
            self.is_goal[fact] = 0
            self.repeats[fact] = 1
        for operator in range(self.operators):
            self.missing[operator] = (
                self.relaxed_needs.starts[operator + 1] - self.relaxed_needs.starts[operator]
            )
            self.spent[operator] = self.ready[operator] = self.used[operator] = 0
        for fact in range(self.facts):
            if line.state[fact]:
                node = line.adder[fact]
                self._hold_true(fact, 0, line.times[node] if node >= 0 else 0)
        for place in range(line.opened):
            action = line.open_list[place]
            for index in range(self.open_adds.starts[action], self.open_adds.starts[action + 1]):
                self._hold_true(self.open_adds.items[index], 0, line.times[line.open_start[action]])
        for test in range(self.all_facts - self.first_test):
            if line._tested(self.tests[test]):
                self._hold_true(self.first_test + test, 0, 0)
            else:
                value = line.programs.value(line.test_program[self.tests[test]], line.amounts)
                self.deficit[self.first_test + test] = value if value >= 0 else -value
        for change in range(line.passed, self.changes):
            for place in range(self.timed_adds.starts[change], self.timed_adds.starts[change + 1]):
                if self.costs[self.timed_adds.items[place]] > 1:
                    self._hold_true(self.timed_adds.items[place], 1, self.timed_at[change])
        for place in range(self.no_needs.starts[0], self.no_needs.starts[1]):
            self._fire(self.no_needs.items[place], line)

    def _hold_true(self, fact: int, cost: int, time: int) -> None:
        """A fact of the state, or one that comes true by itself."""
        self.costs[fact], self.pure[fact], self.reached[fact], self.supporter[fact] = (
            cost,
            cost,
            time,
            -1,
        )
        self.queue.push(fact, cost)

    def _reach(self, fact: int, cost: int, time: int, operator: int) -> None:
        """A fact can be true at a cost and a time."""
        key = cost + int(self.slope * time)
        if key < self.costs[fact]:
            self.pure[fact] = cost
            self.costs[fact], self.reached[fact], self.supporter[fact] = key, time, operator
            self.repeats[fact] = 1
            self.queue.push(fact, key)

    def _explore(self, line: "Timeline") -> None:  # noqa: C901
        """Spreads from fact to fact, the cheapest first, until the goals are reached and all
        that fits now is known.
        """
        missing = 0
        for place in range(self.goals.starts[0], self.goals.starts[1]):
            if self.is_goal[self.goals.items[place]] == 0:
                missing += 1
                self.is_goal[self.goals.items[place]] = 1
        while self.queue.size > 0:
            fact, key = self.queue.heap[0], self.queue.keys[0]
            self.queue.pop()
            if key != self.costs[fact] or self.marked[fact]:
                continue
            self.marked[fact] = 1
            if self.is_goal[fact]:
                self.is_goal[fact] = 0
                missing -= 1
                if missing == 0 and key > 1:
                    break
            pure = self.pure[fact]
            for place in range(self.users.starts[fact], self.users.starts[fact + 1]):
                operator = self.users.items[place]
                self.missing[operator] -= 1
                self.spent[operator] = min(self.spent[operator] + pure, MOST)
                if self.reached[fact] > self.ready[operator]:
                    self.ready[operator] = self.reached[fact]
                if self.missing[operator] == 0:
                    self._fire(operator, line)

    def _fire(self, operator: int, line: "Timeline") -> None:
        cost, time = self.spent[operator] + self.weights[operator], self.ready[operator]
        if self.spent[operator] == 0:
            self.fits[self.fitting] = operator
            self.fitting += 1
        end = time + self.spans[operator]
        action = self.end_of[operator]
        if (
            operator >= self.actions
            and line.open_at[action] >= 0
            and line.times[line.open_end[action]] > end
        ):
            end = line.times[line.open_end[action]]
        for place in range(self.early_adds.starts[operator], self.early_adds.starts[operator + 1]):
            self._reach(self.early_adds.items[place], cost, time, operator)
        for place in range(self.late_adds.starts[operator], self.late_adds.starts[operator + 1]):
            self._reach(self.late_adds.items[place], cost, end, operator)
        for place in range(self.nudges.starts[operator], self.nudges.starts[operator + 1]):
            fact, by = self.nudges.items[place], self.nudge_by[place]
            repeats = 1
            if by > 0 and self.deficit[fact] > by:
                repeats = int(self.deficit[fact] / by + 0.999999)
            more = cost + (repeats - 1) * self.weights[operator]
            before = self.costs[fact]
            self._reach(fact, more, end, operator)
            if self.costs[fact] < before:
                self.repeats[fact] = repeats

    def _extract(self, line: "Timeline") -> int:  # noqa: C901
        """The relaxed plan, from the goals back to the state."""
        size = 0
        self.estimate = line.makespan
        for place in range(self.goals.starts[0], self.goals.starts[1]):
            fact = self.goals.items[place]
            if self.costs[fact] >= UNREACHED:
                return UNREACHED
            if self.reached[fact] > self.estimate:
                self.estimate = self.reached[fact]
            if self.marked[fact] != 2:
                self.marked[fact] = 2
                self.stack[size] = fact
                size += 1
        total = 0
        while size > 0:
            size -= 1
            fact = self.stack[size]
            operator = self.supporter[fact]
            if operator < 0:
                continue
            total += (self.repeats[fact] - 1) * self.weights[operator]
            if self.used[operator]:
                continue
            self.used[operator] = 1
            total += self.weights[operator]
            self.relaxed[self.length] = operator
            self.length += 1
            if self.spent[operator] == 0:
                self.helpful[self.helping] = operator
                self.helping += 1
            for place in range(
                self.relaxed_needs.starts[operator], self.relaxed_needs.starts[operator + 1]
            ):
                need = self.relaxed_needs.items[place]
                if self.marked[need] != 2:
                    self.marked[need] = 2
                    self.stack[size] = need
                    size += 1
        return total + line.opened


class Nodes:
    """The tree of a search: the parent of each node, and the instant that leads to it."""

    def __init__(self, room: int) -> None:
        self.size, self.room = 0, room
        self.parents, self.codes, self.depths = ints(room), ints(room), ints(room)

    def add(self, parent: int, code: int, depth: int) -> int:
        """A new node."""
        if self.size == self.room:
            more = self.room
            self.parents = array("i", self.parents) + ints(more)
            self.codes = array("i", self.codes) + ints(more)
            self.depths = array("i", self.depths) + ints(more)
            self.room = 2 * more
        node = self.size
        self.size += 1
        self.parents[node], self.codes[node], self.depths[node] = parent, code, depth
        return node


class Seen:
    """The least makespan with which each state was reached, in a table with open addressing."""

    def __init__(self, room: int) -> None:
        self.size, self.room = 0, room
        self.keys, self.least = longs(room), longs(room)

    def better(self, digest: int, makespan: int) -> bool:
        """Whether a state is new, or reached sooner than before; then it is noted."""
        if 2 * self.size >= self.room:
            self._grow()
        key = digest | 1
        place = key % self.room
        while self.keys[place] != 0:
            if self.keys[place] == key:
                if self.least[place] <= makespan:
                    return False
                self.least[place] = makespan
                return True
            place = place + 1 if place + 1 < self.room else 0
        self.keys[place], self.least[place] = key, makespan
        self.size += 1
        return True

    def _grow(self) -> None:
        keys, least, room = self.keys, self.least, self.room
        self.room = 2 * room
        self.keys, self.least = longs(self.room), longs(self.room)
        for old in range(room):
            if keys[old] != 0:
                place = keys[old] % self.room
                while self.keys[place] != 0:
                    place = place + 1 if place + 1 < self.room else 0
                self.keys[place], self.least[place] = keys[old], least[old]


class TimeSearch:
    """Best-first search over sequences of instants, with deferred evaluation and preferred
    instants (Richter & Helmert 2009).
    """

    def __init__(self, line: "Timeline", guide: "Relaxation", poll: Any) -> None:
        self.line, self.guide, self.poll = line, guide, poll
        self.nodes = Nodes(4096)
        self.every, self.preferred = Heap(4096), Heap(4096)
        self.expanded = self.generated = self.most = self.best = 0
        self.tie = 1
        self.weight = 1.0
        self.greedy = self.revisit = self.cut = self.newest_first = 0
        self.pushed = 0
        self.path = ints(4096)

    def run(
        self, prefix: Sequence[int], bound: int, most: int, most_nodes: int
    ) -> list[int] | None:
        """A sequence of codes that reaches the goal before `bound`; None if none was found
        within `most` expansions.
        """
        self.nodes = Nodes(4096)
        self.every, self.preferred = Heap(4096), Heap(4096)
        self.seen = Seen(1 << 13)
        self.expanded, self.best, self.bound = 0, UNREACHED, bound
        self.boost_every, self.boost_preferred = 0, 0
        self.at = -1
        node = -1
        for depth, code in enumerate(prefix):
            node = self.nodes.add(node, code, depth + 1)
        self.first = node
        goal = self._expand(node)
        while goal == NO_GOAL and self.expanded < most and self.nodes.size < most_nodes:
            if self.every.size + self.preferred.size == 0:
                break
            if self.poll.due(4000 + 10 * self.line.facts):
                break
            goal = self._expand(self._next())
        if goal == NO_GOAL:
            return None
        return self._sequence(goal)

    def _next(self) -> int:
        """The node that is looked at next, from the two queues in turn."""
        queue = self.every
        if self.every.size == 0 or (
            self.preferred.size > 0 and self.boost_preferred <= self.boost_every
        ):
            queue = self.preferred
            self.boost_preferred += 1
        else:
            self.boost_every += 1
        node = queue.heap[0]
        queue.pop()
        return node

    def _sequence(self, node: int) -> list[int]:
        codes = []
        while node >= 0:
            codes.append(self.nodes.codes[node])
            node = self.nodes.parents[node]
        codes.reverse()
        return codes

    def _replay(self, node: int) -> bool:
        """Brings the timeline to a node; False if that is not possible."""
        if node < 0:
            self.line.reset()
            return True
        if (
            self.at >= -1
            and self.at == self.nodes.parents[node]
            and (self.at >= 0 or self.line.nodes <= self.line.changes + 1)
        ):
            self.at = -2
            return self.line.apply(self.nodes.codes[node])
        self.at = -2
        depth = self.nodes.depths[node]
        if depth > self.path_room():
            self.path = ints(2 * depth)
        each = node
        for place in range(depth - 1, -1, -1):
            self.path[place] = self.nodes.codes[each]
            each = self.nodes.parents[each]
        self.line.reset()
        for place in range(depth):  # noqa: SIM110 - a loop compiles to less than a generator
            if not self.line.apply(self.path[place]):
                return False
        return True

    def path_room(self) -> int:
        """How long a path may be."""
        return len(self.path)

    def _expand(self, node: int) -> int:
        """Looks at a node: the node if it is a goal (-1: the first), `NO_GOAL` if not."""
        if not self._replay(node):
            return NO_GOAL
        line = self.line
        self.at = node
        if line.makespan >= self.bound or not self.seen.better(
            line.digest(), line.makespan if self.revisit else 0
        ):
            return NO_GOAL
        self.expanded += 1
        cost = self.guide.evaluate(line)
        if cost >= UNREACHED or (self.cut and self.guide.estimate >= self.bound):
            return NO_GOAL
        if self.guide.length == 0 and line.opened == 0 and self._is_goal():
            return node
        if cost < self.best:
            self.best = cost
            self.boost_preferred -= 1000
        key = cost + int(self.weight * self.guide.estimate)
        depth = self.nodes.depths[node] + 1 if node >= 0 else 1
        self._push_helpful(node, depth, key)
        if not self.greedy:
            self._push_all(node, depth, key)
        return NO_GOAL

    def _key(self, key: int) -> int:
        """A key whose ties are broken in favour of the newest, or at random."""
        if self.newest_first:
            self.pushed = (self.pushed + 1) & 0xFFFFFF
            return key * 0x1000000 + 0xFFFFFF - self.pushed
        self.tie = (self.tie * 1103515245 + 12345) & 0x7FFFFFFF
        return key * 0x1000000 + (self.tie >> 7)

    def _push_helpful(self, node: int, depth: int, key: int) -> None:
        """The instants that relaxed plans begin with.

        Ends come a little later than starts: they can wait.
        """
        guide, line = self.guide, self.line
        self.tie = (self.tie * 1103515245 + 12345) & 0x7FFFFFFF
        shift = (self.tie >> 8) % guide.helping if guide.helping > 0 else 0
        for step in range(guide.helping):
            place = step + shift if step + shift < guide.helping else step + shift - guide.helping
            operator = guide.helpful[place]
            if operator < guide.actions and line.applicable(operator):
                self.preferred.push(self.nodes.add(node, operator, depth), self._key(key))
        for place in range(line.opened):
            action = line.open_list[place]
            if line.can_end(action):
                self.preferred.push(
                    self.nodes.add(node, line.actions + action, depth), self._key(key + 1)
                )
        if line.passed < line.changes:
            self.preferred.push(
                self.nodes.add(node, 2 * line.actions + line.passed, depth), self._key(key + 1)
            )

    def _push_all(self, node: int, depth: int, key: int) -> None:
        """All instants that may come next."""
        guide, line = self.guide, self.line
        for place in range(guide.fitting):
            operator = guide.fits[place]
            if operator < guide.actions and line.applicable(operator):
                self.every.push(self.nodes.add(node, operator, depth), self._key(key))
        for place in range(line.opened):
            action = line.open_list[place]
            if line.can_end(action):
                self.every.push(
                    self.nodes.add(node, line.actions + action, depth), self._key(key + 1)
                )
        if line.passed < line.changes:
            self.every.push(
                self.nodes.add(node, 2 * line.actions + line.passed, depth), self._key(key + 1)
            )

    def _is_goal(self) -> bool:
        """Whether the goal holds after all that happens by itself."""
        line, guide = self.line, self.guide
        self.at = -2
        for change in range(line.passed, line.changes):
            if not line.apply(2 * line.actions + change):
                return False
        for place in range(guide.goals.starts[0], guide.goals.starts[1]):
            fact = guide.goals.items[place]
            if fact < line.facts:
                if line.state[fact] == 0:
                    return False
            elif not line._tested(guide.tests[fact - guide.first_test]):
                return False
        return True
