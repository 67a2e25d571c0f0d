# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""Relaxed plans in time: what they cost, when they end, and what they begin with.

The module is plain Python. Cython compiles it with the types in `timed_relaxation.pxd`; without a
compiler it runs slowly.
"""

from array import array
from typing import Any

from cellwright.engine.kernels.packed_rows import zero_ints, zero_longs
from cellwright.engine.stages.temporal.key_heap import KeyHeap
from cellwright.engine.stages.temporal.timeline import Timeline

UNREACHED = 1 << 60  # the cost of what no relaxed plan reaches
MAX_COST = 1 << 50  # additive costs are cut off here


class TimedRelaxation:
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
        self.timed_adds = parts.timed_gives
        self.timed_at = parts.timed_at
        self.changes = parts.changes
        self.no_needs = parts.no_needs
        size = self.all_facts + 1
        self.costs, self.reached, self.missing = (
            zero_longs(size),
            zero_longs(size),
            zero_ints(self.operators + 1),
        )
        self.supporter, self.marked, self.stack = zero_ints(size), zero_ints(size), zero_ints(size)
        self.repeats, self.pure, self.is_goal = zero_longs(size), zero_longs(size), zero_ints(size)
        self.deficit = array("d", bytes(8 * size))
        self.spent, self.ready = zero_longs(self.operators + 1), zero_longs(self.operators + 1)
        self.used = zero_ints(self.operators + 1)
        self.fits, self.helpful, self.relaxed = (zero_ints(self.operators + 1) for _ in range(3))
        self.fitting = self.helping = self.length = self.waiting = 0
        self.reachable = False
        self.queue = KeyHeap(4 * size)
        self.estimate = 0
        self.slope = 0.0

    def evaluate(self, line: "Timeline") -> int:
        """What the cheapest relaxed plan found costs; `UNREACHED` if there is none. `estimate`
        is when it ends.
        """
        self._clear()
        self._begin(line)
        self._explore(line)
        return self._extract(line)

    def _clear(self) -> None:
        """Forgets the last evaluation."""
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

    def _begin(self, line: "Timeline") -> None:
        """Reaches what holds in the state: its facts, its open actions and its tests."""
        for fact in range(self.facts):
            if line.state[fact]:
                node = line.adder[fact]
                self._hold_true(fact, 0, line.times[node] if node >= 0 else 0)
        for place in range(line.opened):
            action = line.open_list[place]
            for index in range(self.open_adds.starts[action], self.open_adds.starts[action + 1]):
                self._hold_true(self.open_adds.items[index], 0, line.times[line.open_start[action]])
        for test in range(self.all_facts - self.first_test):
            if line.holds_test(self.tests[test]):
                self._hold_true(self.first_test + test, 0, 0)
            else:
                value = line.programs.value(line.test_program[self.tests[test]], line.amounts)
                self.deficit[self.first_test + test] = value if value >= 0 else -value
        self._begin_later(line)

    def _begin_later(self, line: "Timeline") -> None:
        """Reaches what will happen by itself, and what needs nothing."""
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

    def _count_goals(self) -> int:
        """Marks the goals; how many there are."""
        missing = 0
        for place in range(self.goals.starts[0], self.goals.starts[1]):
            if self.is_goal[self.goals.items[place]] == 0:
                missing += 1
                self.is_goal[self.goals.items[place]] = 1
        return missing

    def _explore(self, line: "Timeline") -> None:
        """Spreads from fact to fact, the cheapest first, until the goals are reached and all
        that fits now is known.
        """
        missing = self._count_goals()
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
            self._use(fact, line)

    def _use(self, fact: int, line: "Timeline") -> None:
        """Gives a fact to the operators that need it; fires those that lack nothing more."""
        pure = self.pure[fact]
        for place in range(self.users.starts[fact], self.users.starts[fact + 1]):
            operator = self.users.items[place]
            self.missing[operator] -= 1
            self.spent[operator] = min(self.spent[operator] + pure, MAX_COST)
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

    def _extract(self, line: "Timeline") -> int:
        """The relaxed plan, from the goals back to the state."""
        self.waiting = 0
        self.estimate = line.makespan
        self.reachable = False
        for place in range(self.goals.starts[0], self.goals.starts[1]):
            fact = self.goals.items[place]
            if self.costs[fact] >= UNREACHED:
                return UNREACHED
            if self.reached[fact] > self.estimate:
                self.estimate = self.reached[fact]
            self._want(fact)
        self.reachable = True
        total = 0
        while self.waiting > 0:
            self.waiting -= 1
            fact = self.stack[self.waiting]
            operator = self.supporter[fact]
            if operator < 0:
                continue
            total += (self.repeats[fact] - 1) * self.weights[operator]
            if self.used[operator] == 0:
                total += self.weights[operator]
                self._select(operator)
        return total + line.opened

    def _want(self, fact: int) -> None:
        """A fact that the relaxed plan must reach."""
        if self.marked[fact] != 2:
            self.marked[fact] = 2
            self.stack[self.waiting] = fact
            self.waiting += 1

    def _select(self, operator: int) -> None:
        """Takes an operator into the relaxed plan."""
        self.used[operator] = 1
        self.relaxed[self.length] = operator
        self.length += 1
        if self.spent[operator] == 0:
            self.helpful[self.helping] = operator
            self.helping += 1
        for place in range(
            self.relaxed_needs.starts[operator], self.relaxed_needs.starts[operator + 1]
        ):
            self._want(self.relaxed_needs.items[place])
