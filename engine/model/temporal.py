"""The ground problem in time: action instances over numbered facts and numbers, for the search in
time.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

from cellwright.kb.diagnostics import Diagnostic
from cellwright.kb.model.durative import TimedPlan
from cellwright.kb.terms import Atom, Function

# what an instruction of a program does
CONSTANT, VALUE, PLUS, MINUS, TIMES, OVER, LENGTH = range(7)
# in postfix order; LENGTH is the duration of the step
Program = tuple[tuple[int, Fraction | int], ...]
RELATIONS = ("=", "!=", "<", "<=", ">", ">=")
KINDS = ("assign", "increase", "decrease", "scale-up", "scale-down")


@dataclass(frozen=True, slots=True)
class NumericTest:
    """The value of a program stands in this relation to 0."""

    relation: str
    program: Program


@dataclass(frozen=True, slots=True)
class NumericUpdate:
    """The change of a number by the value of a program."""

    kind: str
    number: int
    program: Program


@dataclass(frozen=True, slots=True)
class Happening:
    """What one instant of an action needs and does.

    Its conditions read `facts_read` and `numbers_read`, too, as alternatives that need not be true:
    who changes them is apart from it (PDDL 2.1, definition 12).
    """

    needs: tuple[int, ...] = ()
    adds: tuple[int, ...] = ()
    deletes: tuple[int, ...] = ()
    tests: tuple[NumericTest, ...] = ()
    updates: tuple[NumericUpdate, ...] = ()
    facts_read: tuple[int, ...] = ()
    numbers_read: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Span:
    """An action instance: its two instants, what holds between them, and the limits of its
    length (None: none).
    """

    name: Function
    start: Happening
    end: Happening
    holds: tuple[int, ...] = ()
    tests: tuple[NumericTest, ...] = ()
    shortest: Program = ((CONSTANT, Fraction(0)),)
    longest: Program | None = None
    instantaneous: bool = False


@dataclass(frozen=True, slots=True)
class TimedHappening:
    """What happens by itself at a time."""

    at: Fraction
    happening: Happening


@dataclass(frozen=True, slots=True)
class GroundTimes:
    """The ground problem. The goal is a list of alternatives, each a set of facts and tests;
    none: it cannot be reached.
    """

    facts: tuple[tuple[Atom, bool], ...]
    numbers: tuple[Function, ...]
    spans: tuple[Span, ...]
    initial: frozenset[int]
    values: tuple[Fraction | None, ...]
    timed: tuple[TimedHappening, ...]
    goals: tuple[tuple[tuple[int, ...], tuple[NumericTest, ...]], ...]
    epsilon: Fraction


@dataclass(frozen=True, slots=True)
class PlannedInTime:
    """A plan in time that was checked; no plan of less makespan than `bound` exists."""

    plan: TimedPlan
    bound: Fraction
    counts: Mapping[str, int]

    @property
    def optimal(self) -> bool:
        """Whether the makespan is proved to be the least."""
        return self.plan.makespan <= self.bound


@dataclass(frozen=True, slots=True)
class NoPlanInTime:
    """Why there is no plan in the answer.

    It is `proved` that none exists, or the search came to an end without one.
    """

    reason: str
    proved: bool
    limit: str = "time"
    diagnostics: tuple[Diagnostic, ...] = ()
