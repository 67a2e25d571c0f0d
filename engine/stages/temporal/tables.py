"""The ground problem in time as arrays for the compiled search: whole times, rows of facts,
programs of numbers.
"""

import math
from array import array
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from types import SimpleNamespace

from cellwright.engine.kernels.packed_rows import PackedRows
from cellwright.engine.model.temporal import (
    CONSTANT,
    KINDS,
    MINUS,
    PLUS,
    RELATIONS,
    TIMES,
    VALUE,
    GroundTimes,
    NumericTest,
    NumericUpdate,
    Program,
    Span,
    TimedHappening,
)
from cellwright.engine.stages.temporal.formulas import constant
from cellwright.engine.stages.temporal.postfix_programs import PostfixPrograms
from cellwright.engine.stages.temporal.windows import Windows
from cellwright.kb.terms import Function

# parts of the unit of time that the search may distinguish
DECIMAL_UNITS = (10**3, 10**4, 10**5, 10**6)
Linear = tuple[dict[int, Fraction], Fraction]


@dataclass(frozen=True)
class Tables:
    """The arrays of a problem, and the parts of a unit of time in which its times count."""

    task: GroundTimes
    scale: int
    parts: SimpleNamespace
    whole: tuple[bool, ...]

    def goals(self, alternative: int) -> PackedRows:
        """The facts, with those that stand for tests, of one alternative of the goal."""
        facts, tests = self.task.goals[alternative]
        return PackedRows([[*facts, *(self.parts.fact_of_test[test] for test in tests)]])


def scale_of(task: GroundTimes) -> int:
    """The parts of a unit of time in which all fixed times are whole.

    Those that no decimal says exactly are rounded, and so are those that numbers say: these may be
    of any size, so the parts are the smallest.
    """
    programs = [
        program for span in task.spans for program in (span.shortest, span.longest) if program
    ]
    fixed = [value for program in programs if (value := constant(program)) is not None]
    if len(fixed) < len(programs):
        return DECIMAL_UNITS[-1]
    times = [task.epsilon, *fixed, *(timed.at for timed in task.timed)]
    exact = math.lcm(*(time.denominator for time in times))
    return next((scale for scale in DECIMAL_UNITS if scale % exact == 0), DECIMAL_UNITS[-1])


def tables(task: GroundTimes) -> Tables:
    """The arrays of a problem."""
    return _Builder(task).result()


class _Builder:
    def __init__(self, task: GroundTimes) -> None:
        self.task, self.scale = task, scale_of(task)
        self.programs: dict[Program, int] = {}
        self.tests: dict[NumericTest, int] = {}
        self.updates: list[NumericUpdate] = []
        self.constants: list[float] = [math.nan]
        self.units: dict[Fraction, int] = {}
        self.windows = Windows({}, {}, 0)
        self.read = self._read_numbers()
        self.undone = {fact for timed in task.timed for fact in timed.happening.deletes}
        self.whole = tuple(map(self.is_whole, task.spans))

    def _read_numbers(self) -> frozenset[int]:
        """The numbers that some condition, duration or update reads."""
        spans = self.task.spans
        tests = [t for s in spans for t in (*s.start.tests, *s.tests, *s.end.tests)]
        tests += [test for _, part in self.task.goals for test in part]
        programs = [test.program for test in tests]
        programs += [u.program for s in spans for u in (*s.start.updates, *s.end.updates)]
        programs += [p for s in spans for p in (s.shortest, s.longest) if p is not None]
        return frozenset(
            int(value) for program in programs for sign, value in program if sign == VALUE
        )

    def is_whole(self, span: Span) -> bool:
        """Whether an end may directly follow its start in a sequence, without loss (Coles et al.

        2009). What deletes by itself what the end adds may have to come between.
        """
        sure = {*span.holds, *span.start.adds}
        end = span.end
        plain = not end.deletes and not end.tests and set(end.needs) <= sure
        plain = plain and not end.facts_read and not end.numbers_read
        plain = plain and self.undone.isdisjoint(end.adds)
        counted = any(update.number in self.read for update in span.end.updates)
        return span.instantaneous or (plain and not counted)

    def result(self) -> Tables:
        """The arrays."""
        parts = SimpleNamespace()
        spans, timed = self.task.spans, self.task.timed
        parts.facts, parts.actions, parts.numbers = (
            len(self.task.facts),
            len(spans),
            len(self.task.numbers),
        )
        parts.changes, parts.scale = len(timed), float(self.scale)
        parts.epsilon = self._units(self.task.epsilon)
        for name in ("needs", "adds", "deletes", "facts_read", "numbers_read"):
            setattr(parts, name, PackedRows([getattr(span.start, name) for span in spans]))
            setattr(parts, f"end_{name}", PackedRows([getattr(span.end, name) for span in spans]))
        parts.holds = PackedRows([span.holds for span in spans])
        parts.timed_adds = PackedRows([each.happening.adds for each in timed])
        parts.timed_deletes = PackedRows([each.happening.deletes for each in timed])
        parts.timed_at = array("q", [*(self._units(each.at) for each in timed), 0])
        parts.whole = array("i", [*map(int, self.whole), 0])
        parts.instant = array("i", [*(int(span.instantaneous) for span in spans), 0])
        # variants of one instance have one number
        numbers: dict[Function, int] = {}
        parts.names = array("i", [*(numbers.setdefault(s.name, len(numbers)) for s in spans), 0])
        parts.initial = array(
            "b", [int(fact in self.task.initial) for fact in range(parts.facts)] + [0]
        )
        values = [math.nan if value is None else float(value) for value in self.task.values]
        parts.values = array("d", [*values, *[math.nan] * (parts.numbers - len(values)), 0.0])
        self._lengths(parts)
        self._numeric(parts)
        self._relaxed(parts)
        return Tables(self.task, self.scale, parts, self.whole)

    def _units(self, time: Fraction) -> int:
        units = self.units.get(time)
        if units is None:
            units = self.units[time] = round(time * self.scale)
        return units

    def _program(self, program: Program) -> int:
        return self.programs.setdefault(program, len(self.programs))

    def _lengths(self, parts: SimpleNamespace) -> None:
        least, most, least_program, most_program = array("q"), array("q"), array("i"), array("i")
        for span in self.task.spans:
            low = constant(span.shortest)
            high = constant(span.longest) if span.longest is not None else Fraction(-1)
            least.append(self._units(max(low, Fraction(0))) if low is not None else 0)
            most.append(-1 if span.longest is None or high is None else self._units(high))
            least_program.append(self._program(span.shortest) if low is None else -1)
            most_program.append(
                self._program(span.longest) if span.longest and high is None else -1
            )
        for row in (least, most, least_program, most_program):
            row.append(0)
        parts.least, parts.most = least, most
        parts.least_program, parts.most_program = least_program, most_program

    def _numeric(self, parts: SimpleNamespace) -> None:
        spans, timed = self.task.spans, self.task.timed
        parts.start_tests = PackedRows([self._number_tests(span.start.tests) for span in spans])
        parts.hold_tests = PackedRows([self._number_tests(span.tests) for span in spans])
        parts.end_tests = PackedRows([self._number_tests(span.end.tests) for span in spans])
        for _, tests in self.task.goals:
            self._number_tests(tests)
        parts.start_updates = PackedRows(
            [self._number_updates(span.start.updates) for span in spans]
        )
        parts.end_updates = PackedRows([self._number_updates(span.end.updates) for span in spans])
        parts.timed_updates = PackedRows(
            [self._number_updates(each.happening.updates) for each in timed]
        )
        parts.test_program = array("i", [*(self._program(test.program) for test in self.tests), 0])
        parts.test_relation = array(
            "i", [*(RELATIONS.index(test.relation) for test in self.tests), 0]
        )
        parts.test_numbers = PackedRows([_numbers(test.program) for test in self.tests])
        parts.update_kind = array("i", [*(KINDS.index(update.kind) for update in self.updates), 0])
        parts.update_number = array("i", [*(update.number for update in self.updates), 0])
        parts.update_program = array(
            "i", [*(self._program(update.program) for update in self.updates), 0]
        )
        parts.update_reads = PackedRows([_numbers(update.program) for update in self.updates])
        rows = [[self._step(sign, value) for sign, value in program] for program in self.programs]
        parts.programs = PostfixPrograms(rows, self.constants)

    def _step(self, sign: int, value: Fraction | int) -> tuple[int, int]:
        if sign != CONSTANT:
            return sign, int(value)
        self.constants.append(float(value))
        return sign, len(self.constants) - 1

    def _number_tests(self, tests: Iterable[NumericTest]) -> list[int]:
        return [self.tests.setdefault(test, len(self.tests)) for test in tests]

    def _number_updates(self, updates: Iterable[NumericUpdate]) -> list[int]:
        first = len(self.updates)
        self.updates += updates
        return list(range(first, len(self.updates)))

    def _relaxed(self, parts: SimpleNamespace) -> None:
        """The operators of relaxed plans: actions, then the ends of those that are not whole."""
        spans = self.task.spans
        ends = [action for action, whole in enumerate(self.whole) if not whole]
        parts.running = array("i", [-1] * (len(spans) + 1))
        for place, action in enumerate(ends):
            parts.running[action] = parts.facts + place
        self.windows = Windows.of(self.task, parts.facts + len(ends))
        parts.first_test = parts.facts + len(ends) + self.windows.count
        parts.open_adds = PackedRows(
            [
                [] if self.whole[action] else [parts.running[action], *self.windows.gives(action)]
                for action in range(len(spans))
            ]
        )
        parts.all_facts = parts.first_test + len(self.tests)
        parts.operators = len(spans) + len(ends)
        parts.fact_of_test = {test: parts.first_test + place for test, place in self.tests.items()}
        parts.tests = array("i", [*range(len(self.tests)), 0])
        needs, early, late = self._operators(parts, ends)
        parts.relaxed_needs, parts.early_adds, parts.late_adds = (
            PackedRows(needs),
            PackedRows(early),
            PackedRows(late),
        )
        users: list[list[int]] = [[] for _ in range(parts.all_facts)]
        for operator, row in enumerate(needs):
            for fact in row:
                users[fact].append(operator)
        parts.users = PackedRows(users)
        parts.no_needs = PackedRows([[operator for operator, row in enumerate(needs) if not row]])
        lengths = array("q", [max(0, parts.least[action]) for action in range(len(spans))])
        zeros = [
            0 if not whole else length for whole, length in zip(self.whole, lengths, strict=True)
        ]
        parts.spans = array("q", [*zeros, *(lengths[action] for action in ends), 0])
        parts.end_of = array("i", [*range(len(spans)), *ends, 0])
        parts.weights = array("q", [1] * (parts.operators + 1))
        parts.goals = PackedRows([[]])
        parts.timed_gives = PackedRows([self._timed_gives(parts, each) for each in self.task.timed])
        self._nudges(parts)

    def _operators(
        self, parts: SimpleNamespace, ends: Sequence[int]
    ) -> tuple[list[list[int]], ...]:
        needs: list[list[int]] = []
        early: list[list[int]] = []
        late: list[list[int]] = []
        for action, span in enumerate(self.task.spans):
            changed = {update.number for update in span.start.updates}
            before = [t for t in span.tests if not changed.intersection(_numbers(t.program))]
            tests = [parts.fact_of_test[test] for test in (*span.start.tests, *before)]
            own = set(span.start.adds)
            held = [self.windows.needed(fact, span) for fact in span.holds if fact not in own]
            needs.append(sorted({*span.start.needs, *held, *tests}))
            running = parts.open_adds.row(action)
            early.append([*span.start.adds, *running])
            late.append(list(span.end.adds) if self.whole[action] else [])
        for action in ends:
            span = self.task.spans[action]
            tests = [parts.fact_of_test[test] for test in span.end.tests]
            needs.append(list(dict.fromkeys([parts.running[action], *span.end.needs, *tests])))
            early.append([])
            late.append(list(span.end.adds))
        return needs, early, late

    def _timed_gives(self, parts: SimpleNamespace, timed: TimedHappening) -> list[int]:
        """The facts that become true by themselves, with the tests that may."""
        changed = {update.number for update in timed.happening.updates}
        tests = [test for test in self.tests if changed.intersection(_numbers(test.program))]
        return [*timed.happening.adds, *(parts.fact_of_test[test] for test in tests)]

    def _nudges(self, parts: SimpleNamespace) -> None:
        """What each operator does for each test, in one application; 0 if that cannot be told."""
        linear = {test: _linear(test.program) for test in self.tests}
        by_number: dict[int, list[NumericTest]] = {}
        for test in self.tests:
            for number in _numbers(test.program):
                by_number.setdefault(number, []).append(test)
        rows: list[list[int]] = []
        amounts = array("d")
        for operator in range(parts.operators):
            action = parts.end_of[operator]
            span = self.task.spans[action]
            updates = (
                [*span.start.updates] if operator < len(self.task.spans) else [*span.end.updates]
            )
            updates += (
                span.end.updates if operator < len(self.task.spans) and self.whole[action] else ()
            )
            row = []
            touched = dict.fromkeys(test for u in updates for test in by_number.get(u.number, ()))
            for test in touched:
                by = _help(test, linear[test], updates)
                if by is not None:
                    row.append(parts.fact_of_test[test])
                    amounts.append(by)
            rows.append(row)
        parts.nudges = PackedRows(rows)
        amounts.append(0.0)
        parts.nudge_by = amounts


def _numbers(program: Program) -> list[int]:
    return list(dict.fromkeys(int(value) for sign, value in program if sign == VALUE))


def _linear(program: Program) -> Linear | None:
    """The factors of the numbers in a program, and its constant; None if it is not linear."""
    stack: list[Linear] = []
    for sign, value in program:
        if sign == CONSTANT:
            stack.append(({}, Fraction(value)))
        elif sign == VALUE:
            stack.append(({int(value): Fraction(1)}, Fraction(0)))
        else:
            two, one = stack.pop(), stack.pop()
            joined = _join_linear(sign, one, two)
            if joined is None:
                return None
            stack.append(joined)
    return stack[0]


def _join_linear(sign: int, one: Linear, two: Linear) -> Linear | None:
    if sign in (PLUS, MINUS):
        factor = Fraction(1 if sign == PLUS else -1)
        keys = {**one[0], **two[0]}
        return (
            {
                key: one[0].get(key, Fraction(0)) + factor * two[0].get(key, Fraction(0))
                for key in keys
            },
            one[1] + factor * two[1],
        )
    if sign == TIMES and not one[0]:
        one, two = two, one
    if two[0] or (sign != TIMES and two[1] == 0):
        return None
    factor = two[1] if sign == TIMES else 1 / two[1]
    return {key: factor * value for key, value in one[0].items()}, factor * one[1]


def _help(
    test: NumericTest, linear: Linear | None, updates: Sequence[NumericUpdate]
) -> float | None:
    """By how much one application brings a test nearer: 0 if that cannot be told, None if it
    does not help.
    """
    total = Fraction(0)
    for update in updates:
        amount = constant(update.program)
        if linear is None or amount is None or update.kind not in ("increase", "decrease"):
            return 0.0
        factor = linear[0].get(update.number, Fraction(0))
        total += factor * (amount if update.kind == "increase" else -amount)
    if (
        total == 0
        or (test.relation in (">", ">=") and total < 0)
        or (test.relation in ("<", "<=") and total > 0)
    ):
        return None
    return float(abs(total))


__all__ = ["Tables", "scale_of", "tables"]
