"""The problem in time before grounding: durative actions, timed literals and numbers (PDDL 2.1,
level 3).

Numbers are exact. In a term, `Operation("/", ...)` divides without rounding, a `Function` is the
value of a numeric function, and `DURATION` is the length of the step. A `Comparison` that is
`exact` compares numbers; any other compares objects.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from enum import StrEnum
from fractions import Fraction

from cellwright.kb.diagnostics import NOWHERE, Source
from cellwright.kb.model.conditions import ALWAYS_TRUE, Condition, Literal, Parameter
from cellwright.kb.terms import Atom, Function, Number, Operation, Term

DURATION = Function("duration__")
DECIMALS = 3  # of a time that are always written
MOST_DECIMALS = 9
EPSILON = Fraction(1, 1000)  # the least time between events that exclude each other at one instant


class Moment(StrEnum):
    """When a condition holds or an effect happens: at the first instant, at the last, or at
    every instant between.
    """

    START = "at start"
    THROUGHOUT = "over all"
    END = "at end"


@dataclass(frozen=True, slots=True)
class TimedCondition:
    """A condition at a moment of a step."""

    moment: Moment
    condition: Condition
    where: Source = field(default=NOWHERE, compare=False)


@dataclass(frozen=True, slots=True)
class NumericChange:
    """An assignment: `kind` is increase, decrease, assign, scale-up or scale-down."""

    kind: str
    fluent: Function
    amount: Term

    def __str__(self) -> str:
        return f"{self.kind} {self.fluent} {self.amount}"


@dataclass(frozen=True, slots=True)
class TimedEffect:
    """What changes at a moment, for all values of `parameters`, if all of `when` hold at their
    moments.
    """

    moment: Moment
    change: Literal | NumericChange
    parameters: tuple[Parameter, ...] = ()
    when: tuple[TimedCondition, ...] = ()


@dataclass(frozen=True, slots=True)
class DurationLimit:
    """The length of a step stands in this relation to an amount, which is read at the start or
    at the end.
    """

    relation: str  # = <= >=
    amount: Term
    moment: Moment = Moment.START


@dataclass(frozen=True, slots=True)
class DurativeAction:
    """An action schema. An `instantaneous` one has all conditions and effects at its start, and
    no length.
    """

    name: str
    parameters: tuple[Parameter, ...]
    limits: tuple[DurationLimit, ...] = ()
    conditions: tuple[TimedCondition, ...] = ()
    effects: tuple[TimedEffect, ...] = ()
    instantaneous: bool = False
    where: Source = field(default=NOWHERE, compare=False)


@dataclass(frozen=True, slots=True)
class TimedChange:
    """What changes by itself at a time."""

    at: Fraction
    change: Literal | NumericChange
    where: Source = field(default=NOWHERE, compare=False)


@dataclass(frozen=True, slots=True)
class TemporalProblem:
    """A problem in time. `objects` gives each object all its types, with their ancestors;
    `epsilon` separates events.
    """

    name: str
    objects: Mapping[str, frozenset[str]]
    actions: tuple[DurativeAction, ...]
    initial: frozenset[Atom]
    values: Mapping[Function, Fraction]
    changes: tuple[TimedChange, ...] = ()
    goal: Condition = ALWAYS_TRUE
    epsilon: Fraction = EPSILON
    where: Source = field(default=NOWHERE, compare=False)

    def members(self, type_: str) -> list[str]:
        """The objects of a type, in the order in which they are declared."""
        return [name for name, types in self.objects.items() if type_ in types]


@dataclass(frozen=True, slots=True)
class TimedStep:
    """An action instance from `start` on, for `duration`."""

    start: Fraction
    action: Function
    duration: Fraction = Fraction(0)

    @property
    def end(self) -> Fraction:
        """When the step ends."""
        return self.start + self.duration


@dataclass(frozen=True, slots=True)
class TimedPlan:
    """A time-triggered plan: steps in the order of their starts."""

    steps: tuple[TimedStep, ...]

    @property
    def makespan(self) -> Fraction:
        """When the last step ends."""
        return max((step.end for step in self.steps), default=Fraction(0))


def rational(value: Fraction) -> Term:
    """A number as a term."""
    whole = Number(value.numerator)
    return whole if value.denominator == 1 else Operation("/", whole, Number(value.denominator))


def decimals(value: Fraction) -> str:
    """A time with at least three decimals, and with more where it has them."""
    text = f"{Decimal(value.numerator) / Decimal(value.denominator):.{MOST_DECIMALS}f}"
    whole, _, part = text.partition(".")
    return f"{whole}.{part.rstrip('0').ljust(DECIMALS, '0')}"
