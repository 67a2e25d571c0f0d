# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""A sequence of instants with their earliest times, and the state after them.

A sequence of codes stands for a plan: a start, an end, or the next change that happens by itself.
What must be apart in time becomes an edge of the temporal network (Coles et al. 2010 order instants
in the same way).

The module is plain Python. Cython compiles it with the types in `timeline.pxd`; without a
compiler it runs slowly.
"""

from array import array
from typing import Any

from cellwright.engine.kernels.packed_rows import PackedRows, zero_ints
from cellwright.engine.stages.temporal.temporal_network import TemporalNetwork

# Numbers that differ by less are equal in the search; the checker compares exactly.
TOLERANCE = 1e-9


class Timeline(TemporalNetwork):
    """The instants of a sequence, their times, and the state after them."""

    def __init__(self, parts: Any) -> None:
        super().__init__(parts.changes, parts.epsilon)
        self.facts = parts.facts
        self.actions = parts.actions
        self.numbers = parts.numbers
        self.needs = parts.needs
        self.adds = parts.adds
        self.deletes = parts.deletes
        self.holds = parts.holds
        self.end_needs = parts.end_needs
        self.end_adds = parts.end_adds
        self.end_deletes = parts.end_deletes
        self.facts_read = parts.facts_read
        self.numbers_read = parts.numbers_read
        self.end_facts_read = parts.end_facts_read
        self.end_numbers_read = parts.end_numbers_read
        self.keeps_lags = 0
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
        self.names = parts.names
        self._rooms()
        self.reset()

    def _rooms(self) -> None:
        """Makes the arrays that `reset` fills."""
        self.state = array("b", bytes(self.facts + 1))
        self.amounts = array("d", bytes(8 * (self.numbers + 1)))
        self.adder, self.deleter, self.readers = (
            zero_ints(self.facts),
            zero_ints(self.facts),
            zero_ints(self.facts),
        )
        self.holders, self.held, self.enders = (
            zero_ints(self.facts),
            zero_ints(self.facts),
            zero_ints(self.facts),
        )
        self.due = zero_ints(self.facts)
        self.changer, self.changed_by_sum = zero_ints(self.numbers + 1), zero_ints(self.numbers + 1)
        self.number_readers, self.number_holders = (
            zero_ints(self.numbers + 1),
            zero_ints(self.numbers + 1),
        )
        self.open_at, self.open_start, self.open_end = (
            zero_ints(self.actions),
            zero_ints(self.actions),
            zero_ints(self.actions),
        )
        self.last_start, self.last_end = zero_ints(self.actions), zero_ints(self.actions)
        self.open_list = zero_ints(self.actions + 1)
        self.cell_room = 8192
        self.first_added = self.last_added = 0
        self.cell_node, self.cell_next = zero_ints(self.cell_room), zero_ints(self.cell_room)
        self.cell_start = zero_ints(self.cell_room)
        self.update_value = array("d", bytes(8 * (len(self.update_kind) + 1)))

    def reset(self) -> None:
        """Goes back to the start: only what happens by itself has times."""
        self._clear_network()
        self.cells = self.opened = self.passed = 0
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
            self.open_at[action] = self.last_start[action] = -1
        self._add_node()
        for change in range(self.changes):
            node = self._add_node()
            self.times[node] = self.timed_at[change]
            self._add_edge(0, node, self.timed_at[change])
            self._add_edge(node, 0, -self.timed_at[change])
        for change in range(self.changes - 1, -1, -1):
            for place in range(
                self.timed_deletes.starts[change], self.timed_deletes.starts[change + 1]
            ):
                self.due[self.timed_deletes.items[place]] = change + 1

    def _grow_cells(self) -> None:
        more = self.cell_room
        self.cell_node = array("i", self.cell_node) + zero_ints(more)
        self.cell_next = array("i", self.cell_next) + zero_ints(more)
        self.cell_start = array("i", self.cell_start) + zero_ints(more)
        self.cell_room = 2 * more

    def _add_cell(self, node: int, start: int, following: int) -> int:
        """A new element of a list of nodes, in front of another one."""
        if self.cells == self.cell_room:
            self._grow_cells()
        cell = self.cells
        self.cells += 1
        self.cell_node[cell], self.cell_start[cell], self.cell_next[cell] = node, start, following
        return cell

    def _read_fact(self, fact: int, node: int) -> None:
        """A node needs a fact: after who adds it, before who will delete it."""
        if self.adder[fact] >= 0:
            self._add_edge(self.adder[fact], node, self.epsilon)
        self.readers[fact] = self._add_cell(node, node, self.readers[fact])
        cell = self.enders[fact]
        while cell >= 0:
            ender = self.cell_node[cell]
            if self.open_at[self.cell_start[cell]] >= 0 and ender != node:
                self._add_edge(node, ender, self.epsilon)
            cell = self.cell_next[cell]
        if self.due[fact] >= 0:
            self._add_edge(node, self.due[fact], self.epsilon)

    def _read_choices(
        self, facts: "PackedRows", numbers: "PackedRows", action: int, node: int
    ) -> None:
        """A node reads facts, true or not, and numbers: after and before who changes them."""
        for place in range(facts.starts[action], facts.starts[action + 1]):
            fact = facts.items[place]
            if self.adder[fact] >= 0 and self.adder[fact] != node:
                self._add_edge(self.adder[fact], node, self.epsilon)
            if self.deleter[fact] >= 0 and self.deleter[fact] != node:
                self._add_edge(self.deleter[fact], node, self.epsilon)
            self.readers[fact] = self._add_cell(node, node, self.readers[fact])
        for place in range(numbers.starts[action], numbers.starts[action + 1]):
            self._read_number(numbers.items[place], node)

    def _hold_fact(self, fact: int, start: int, end: int) -> None:
        """An action needs a fact between two nodes."""
        if self.adder[fact] >= 0 and self.adder[fact] != start:
            self._add_edge(self.adder[fact], start, 0)
        self.holders[fact] = self._add_cell(end, start, self.holders[fact])
        cell = self.enders[fact]
        while cell >= 0:
            if self.open_at[self.cell_start[cell]] >= 0 and self.cell_node[cell] != end:
                self._add_edge(end, self.cell_node[cell], 0)
            cell = self.cell_next[cell]
        if self.due[fact] >= 0:
            self._add_edge(end, self.due[fact], 0)

    def _delete_fact(self, fact: int, node: int) -> None:
        cell = self.readers[fact]
        while cell >= 0:
            if self.cell_node[cell] != node:
                self._add_edge(self.cell_node[cell], node, self.epsilon)
            cell = self.cell_next[cell]
        cell = self.holders[fact]
        while cell >= 0:
            if self.cell_node[cell] != node:
                self._add_edge(self.cell_node[cell], node, 0)
            cell = self.cell_next[cell]
        if self.adder[fact] >= 0 and self.adder[fact] != node:
            self._add_edge(self.adder[fact], node, self.epsilon)
        if self.deleter[fact] >= 0 and self.deleter[fact] != node:
            self._add_edge(self.deleter[fact], node, self.epsilon)
        self.deleter[fact], self.readers[fact], self.holders[fact] = node, -1, -1
        self.state[fact] = 0

    def _add_fact(self, fact: int, node: int) -> None:
        """A node adds a fact. Two that add it are apart, too: PDDL 2.1 lets them be together,
        unified-planning does not.
        """
        cell = self.readers[fact]
        while cell >= 0:
            if self.cell_node[cell] != node:
                self._add_edge(self.cell_node[cell], node, self.epsilon)
            cell = self.cell_next[cell]
        if self.deleter[fact] >= 0 and self.deleter[fact] != node:
            self._add_edge(self.deleter[fact], node, self.epsilon)
        if self.adder[fact] >= 0 and self.adder[fact] != node:
            self._add_edge(self.adder[fact], node, self.epsilon)
        self.adder[fact], self.readers[fact] = node, -1
        self.state[fact] = 1

    def holds_test(self, test: int) -> bool:
        """Whether a test holds in the state."""
        value: float = self.programs.value(self.test_program[test], self.amounts)
        relation: int = self.test_relation[test]
        if relation == 0:
            return -TOLERANCE <= value <= TOLERANCE
        if relation == 1:
            return value < -TOLERANCE or value > TOLERANCE
        if relation == 2:
            return value < -TOLERANCE
        if relation == 3:
            return value <= TOLERANCE
        if relation == 4:
            return value > TOLERANCE
        return value >= -TOLERANCE

    def _read_number(self, number: int, node: int) -> None:
        if self.changer[number] >= 0 and self.changer[number] != node:
            self._add_edge(self.changer[number], node, self.epsilon)
        self.number_readers[number] = self._add_cell(node, node, self.number_readers[number])

    def _hold_number(self, number: int, start: int, end: int) -> None:
        if self.changer[number] >= 0 and self.changer[number] != start:
            self._add_edge(self.changer[number], start, 0)
        self.number_holders[number] = self._add_cell(end, start, self.number_holders[number])

    def _change_number(self, number: int, node: int, is_sum: int) -> None:
        """A node changes a number. Sums may be at the same instant; all else is apart."""
        cell = self.number_readers[number]
        while cell >= 0:
            if self.cell_node[cell] != node:
                self._add_edge(self.cell_node[cell], node, self.epsilon)
            cell = self.cell_next[cell]
        cell = self.number_holders[number]
        while cell >= 0:
            start, end = self.cell_start[cell], self.cell_node[cell]
            if end != node and start != node:
                self._add_edge(start if self._is_open(end) else end, node, 0)
                if self._is_open(end):
                    self._add_edge(node, end, 0)
            cell = self.cell_next[cell]
        if self.changer[number] >= 0 and self.changer[number] != node:
            together = is_sum and self.changed_by_sum[number]
            self._add_edge(self.changer[number], node, 0 if together else self.epsilon)
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

    def _check_tests(self, lists: "PackedRows", row: int, node: int) -> bool:
        """Whether the tests of a list hold; a node reads their numbers."""
        for place in range(lists.starts[row], lists.starts[row + 1]):
            test = lists.items[place]
            if not self.holds_test(test):
                return False
            for index in range(self.test_numbers.starts[test], self.test_numbers.starts[test + 1]):
                self._read_number(self.test_numbers.items[index], node)
        return True

    def _apply_updates(self, lists: "PackedRows", row: int, node: int) -> None:
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

    def _check_invariants(self) -> bool:
        """Whether the tests of all open actions hold."""
        for place in range(self.opened):
            action = self.open_list[place]
            for index in range(self.hold_tests.starts[action], self.hold_tests.starts[action + 1]):
                if not self.holds_test(self.hold_tests.items[index]):
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
            if not self.holds_test(self.start_tests.items[place]):
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
            done = self._start_action(code)
        elif code < 2 * self.actions:
            done = self._end_action(code - self.actions)
        else:
            done = self._pass_change(code - 2 * self.actions)
        return done and self.consistent

    def _length_of(self, program: int) -> int:
        value = self.programs.value(program, self.amounts) * self.scale
        return int(value + 0.5) if -1e15 < value < 1e15 else -2

    def _start_action(self, action: int) -> bool:
        """Starts an action, and ends it at once where nothing can come between."""
        if not self.applicable(action) or not self._add_instants(action):
            return False
        start, end = self.first_added, self.last_added
        self._follow_itself(action, start, end)
        if not self._apply_start(action, start) or not self._hold_conditions(action, start, end):
            return False
        if self.instant[action] == 0:
            self._open_action(action, start, end)
            if self.whole[action]:
                return self._end_action(action)
        return self._check_invariants()

    def _apply_start(self, action: int, start: int) -> bool:
        """Reads and changes the state as the start of an action does; False if a test fails."""
        for place in range(self.needs.starts[action], self.needs.starts[action + 1]):
            self._read_fact(self.needs.items[place], start)
        self._read_choices(self.facts_read, self.numbers_read, action, start)
        if not self._check_tests(self.start_tests, action, start):
            return False
        for place in range(self.deletes.starts[action], self.deletes.starts[action + 1]):
            self._delete_fact(self.deletes.items[place], start)
        for place in range(self.adds.starts[action], self.adds.starts[action + 1]):
            self._add_fact(self.adds.items[place], start)
        self._apply_updates(self.start_updates, action, start)
        return True

    def _add_instants(self, action: int) -> bool:
        """Adds the start and the end of an action; False if its duration has no value."""
        least, most = self.least[action], self.most[action]
        start = self._add_node()
        if self.least_program[action] >= 0:
            least = self._length_of(self.least_program[action])
            self._read_length(self.least_program[action], start)
        if self.most_program[action] >= 0:
            most = self._length_of(self.most_program[action])
            self._read_length(self.most_program[action], start)
            if most < 0:
                return False
        if least < 0 or -1 < most < least:
            return False
        end = start
        if self.instant[action] == 0:
            end = self._add_node()
            self._add_edge(start, end, least)
            if most >= 0:
                self._add_edge(end, start, -most)
        self.first_added, self.last_added = start, end
        return True

    def _follow_itself(self, action: int, start: int, end: int) -> None:
        """An instance begins again only after its end: a plan is a set of steps, so two at one
        time would be one.
        """
        name = self.names[action]
        if self.last_start[name] >= 0:
            self._add_edge(self.last_start[name], start, self.epsilon)
            self._add_edge(self.last_end[name], start, 0)
        self.last_start[name], self.last_end[name] = start, end

    def _hold_conditions(self, action: int, start: int, end: int) -> bool:
        """Whether all that must hold between two instants holds; it is kept until then."""
        for place in range(self.holds.starts[action], self.holds.starts[action + 1]):
            if self.state[self.holds.items[place]] == 0:
                return False
            self._hold_fact(self.holds.items[place], start, end)
        for place in range(self.hold_tests.starts[action], self.hold_tests.starts[action + 1]):
            test = self.hold_tests.items[place]
            if not self.holds_test(test):
                return False
            for index in range(self.test_numbers.starts[test], self.test_numbers.starts[test + 1]):
                self._hold_number(self.test_numbers.items[index], start, end)
        return True

    def _read_length(self, program: int, node: int) -> None:
        for place in range(
            self.programs.signs.starts[program], self.programs.signs.starts[program + 1]
        ):
            if self.programs.signs.items[place] == 1:
                self._read_number(self.programs.values.items[place], node)

    def _open_action(self, action: int, start: int, end: int) -> None:
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
            self.enders[fact] = self._add_cell(end, action, self.enders[fact])

    def _close_action(self, action: int) -> None:
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
            self._remove_ender(self.end_deletes.items[place], self.open_end[action])

    def _remove_ender(self, fact: int, end: int) -> None:
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

    def _end_action(self, action: int) -> bool:
        if not self.can_end(action):
            return False
        end = self.open_end[action]
        self._close_action(action)
        for place in range(self.end_deletes.starts[action], self.end_deletes.starts[action + 1]):
            if self.held[self.end_deletes.items[place]] > 0:
                return False
        for place in range(self.end_needs.starts[action], self.end_needs.starts[action + 1]):
            self._read_fact(self.end_needs.items[place], end)
        self._read_choices(self.end_facts_read, self.end_numbers_read, action, end)
        if not self._check_tests(self.end_tests, action, end):
            return False
        for place in range(self.end_deletes.starts[action], self.end_deletes.starts[action + 1]):
            self._delete_fact(self.end_deletes.items[place], end)
        for place in range(self.end_adds.starts[action], self.end_adds.starts[action + 1]):
            self._add_fact(self.end_adds.items[place], end)
        self._apply_updates(self.end_updates, action, end)
        return self._check_invariants()

    def _pass_change(self, change: int) -> bool:
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
            self._delete_fact(fact, node)
            self.due[fact] = -1
            for later in range(self.changes - 1, change, -1):
                for index in range(
                    self.timed_deletes.starts[later], self.timed_deletes.starts[later + 1]
                ):
                    if self.timed_deletes.items[index] == fact:
                        self.due[fact] = later + 1
        for place in range(self.timed_adds.starts[change], self.timed_adds.starts[change + 1]):
            self._add_fact(self.timed_adds.items[place], node)
        self._apply_updates(self.timed_updates, change, node)
        return self._check_invariants()

    def digest(self) -> int:
        """A number for the state: facts, numbers, open actions and what has passed.

        Equal states have equal ones. With `keeps_lags` states differ, too, where actions that
        must end in time have begun at other times.
        """
        total = self.passed * 1000003 + 7
        for fact in range(self.facts):
            if self.state[fact]:
                total ^= self._mix(fact + 1)
        for place in range(self.opened):
            action = self.open_list[place]
            total ^= self._mix(self.facts + 17 + action)
            if self.keeps_lags and (self.most[action] >= 0 or self.most_program[action] >= 0):
                total ^= self._mix(self.times[self.open_start[action]] * 8191 + action)
        for number in range(self.numbers):
            value = self.amounts[number] * 4096.0
            if -1e17 < value < 1e17:
                total ^= self._mix(int(value) * 31 + 1299721 * (number + 1))
        return total

    def _mix(self, value: int) -> int:
        """A number that looks random (Steele, Lea & Flood 2014)."""
        mixed = (value * -7046029254386353131) & 0xFFFFFFFFFFFFFFFF
        mixed = ((mixed ^ (mixed >> 30)) * 0x3F58476D1CE4E5B9) & 0xFFFFFFFFFFFFFFFF
        mixed = ((mixed ^ (mixed >> 27)) * 0x14D049BB133111EB) & 0xFFFFFFFFFFFFFFFF
        return (mixed ^ (mixed >> 31)) >> 1
