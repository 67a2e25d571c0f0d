"""The domain: types, predicates, operators, rules and travel speed of one kind of cell."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING

from cellwright.kb.diagnostics import NOWHERE, Source
from cellwright.kb.model.conditions import (
    ALWAYS_TRUE,
    Body,
    Condition,
    Literal,
    Parameter,
    StateAggregate,
)
from cellwright.kb.model.statement import Statement
from cellwright.kb.model.time_windows import TimeOfWork, TimeWindow
from cellwright.kb.terms import Atom, Function, Term, Variable

if TYPE_CHECKING:
    from cellwright.kb.model.name_conventions import Conventions

# of the top level of a run
RUN_TOOLS = ("sequencer", "library", "planner", "scheduler", "diagnosis")
OBJECT_TYPE = "object"
NUMERIC_TYPES = ("int", "time")
BUILT_IN_TYPES = (OBJECT_TYPE, *NUMERIC_TYPES, "text")
UNLISTED_TYPES = (*NUMERIC_TYPES, "text")  # types whose values cannot be enumerated

WORLD_FRAME = "world"  # the frame that a cell stands in


@dataclass(frozen=True, slots=True)
class Type:
    """A type: its parent, and, if it is a closed list, its constants."""

    name: str
    parent: str = OBJECT_TYPE
    constants: tuple[str, ...] = ()
    where: Source = field(default=NOWHERE, compare=False)


@dataclass(frozen=True, slots=True)
class FunctionSignature:
    """A compound term: the types of its arguments and the type it belongs to."""

    name: str
    arguments: tuple[str, ...]
    result: str
    where: Source = field(default=NOWHERE, compare=False)


class Kind(Enum):
    """What makes the atoms of a predicate true."""

    STATIC = "static"
    FLUENT = "fluent"
    DERIVED = "derived"
    EVENT = "event"


@dataclass(frozen=True, slots=True)
class Predicate:
    """A predicate with its argument types; `weight` is its criticality (None: derived from the
    operators).
    """

    name: str
    arguments: tuple[str, ...]
    kind: Kind
    weight: int | None = None
    where: Source = field(default=NOWHERE, compare=False)


@dataclass(frozen=True, slots=True)
class Quantity:
    """A number that operators change: a fluent whose last argument is its value, from `low` to
    `high`; None is no bound.
    """

    name: str
    low: int | None
    high: int | None
    where: Source = field(default=NOWHERE, compare=False)


@dataclass(frozen=True, slots=True)
class Effect:
    """`atom` becomes true (`adds`) or false, for every binding of `parameters` whose
    `condition` held before.
    """

    atom: Atom
    adds: bool = True
    parameters: tuple[Parameter, ...] = ()
    condition: Condition = ALWAYS_TRUE


@dataclass(frozen=True, slots=True)
class Measure:
    """What a step measures: the `quantity` `of` something, as `value` in the reply, with a tool.

    The value should be `nominal` and lie in a zone as wide as `tolerance` around it, or between
    `lower` and `upper`. All these count `unit`s, and so does `uncertainty`, the expanded one of a
    value (two standard deviations). `risk` is how many percent of the decisions may be wrong,
    `worth` is how long it may take to come to a decision. `usual` is about what a value is where no
    nominal value is known: a simulated part gives it, and nothing is judged by it.
    """

    of: Term
    value: Variable
    unit: str
    quantity: str
    by: Term | None = None
    nominal: Term | None = None
    tolerance: Term | None = None
    lower: Term | None = None
    upper: Term | None = None
    uncertainty: Term | None = None
    risk: Term | None = None
    worth: Term | None = None
    usual: Term | None = None
    where: Source = field(default=NOWHERE, compare=False)


@dataclass(frozen=True, slots=True)
class Command:
    """What the executive sends for a step, the reply that it expects, the fact that the reply gives
    (ITA, figure 3), and what is measured with it.
    """

    stream: Term
    reply: Term
    result: Term | None = None
    measures: Measure | None = None


@dataclass(frozen=True, slots=True)
class Look:
    """A fact that is looked at in the cell itself when a step begins; also while it lasts if it
    has to hold `during` it.
    """

    fact: Atom
    during: bool = False


SPREADS_EACH_WAY = 3  # standard deviations around the usual duration of a step without a range


@dataclass(frozen=True, slots=True)
class VaryingDuration:
    """How long a step may last that nobody decides: from `least` to `most`, both included.

    `spread` is the standard deviation, where one is given; else all durations are as likely.
    """

    least: Term
    most: Term
    spread: Term | None = None

    @property
    def terms(self) -> tuple[Term, ...]:
        """All its terms."""
        return (self.least, self.most, *(() if self.spread is None else (self.spread,)))


@dataclass(frozen=True, slots=True)
class Operator:
    """A static operator. `where` is a body over statics whose variables outside `parameters`
    are existential.
    """

    name: str
    parameters: tuple[Parameter, ...]
    precondition: Condition
    effects: tuple[Effect, ...]
    body: Body = ()
    resources: tuple[Term, ...] = ()
    duration: Term | None = None
    cost: Term | None = None
    command: Command | None = None
    online: tuple[Look, ...] = ()
    varies: VaryingDuration | None = None
    where: Source = field(default=NOWHERE, compare=False)
    timeout: Term | None = None  # how long the reply to its command may take

    @property
    def amounts(self) -> tuple[Term, ...]:
        """The terms that amount to its durations, its time limit and its cost."""
        terms = (self.duration, self.cost, self.timeout)
        own = tuple(term for term in terms if term is not None)
        return own if self.varies is None else (*own, *self.varies.terms)

    @property
    def header(self) -> Function:
        """`name(V1, ..., Vn)`."""
        return Function(self.name, self.variables)

    @property
    def variables(self) -> tuple[Variable, ...]:
        """The header's variables, in order."""
        return tuple(parameter.variable for parameter in self.parameters)


@dataclass(frozen=True, slots=True)
class ReplyTimes:
    """After how many seconds without a reply a command is given up: `factor` times its forecast,
    and at least `floor_s`. Without a floor, half a minute more than that.
    """

    factor: Fraction = Fraction(2)
    floor_s: Fraction | None = None

    def limit_s(self, lasts_s: Fraction) -> Fraction:
        """The limit for a command with a forecast."""
        if self.floor_s is None:
            return self.factor * lasts_s + USUAL_GRACE_S
        return max(self.floor_s, self.factor * lasts_s)


USUAL_GRACE_S = 30


@dataclass(frozen=True, slots=True)
class Consequence:
    """Matching atoms are added (`implied`) or denied, for each binding that satisfies `body`."""

    atom: Atom
    implied: bool
    body: Body = ()
    parameters: tuple[Parameter, ...] = ()


@dataclass(frozen=True, slots=True)
class DeductiveOperator:
    """What follows when an effect adds the trigger.

    If the trigger is not positive: when an effect denies it and it was true.
    """

    trigger: Literal
    parameters: tuple[Parameter, ...]
    body: Body
    consequences: tuple[Consequence, ...]
    where: Source = field(default=NOWHERE, compare=False)


@dataclass(frozen=True, slots=True)
class Default:
    """Facts that are true at the start unless other facts deny them."""

    atom: Atom
    parameters: tuple[Parameter, ...] = ()
    body: Body = ()
    where: Source = field(default=NOWHERE, compare=False)


@dataclass(frozen=True, slots=True)
class Rule:
    """`head :- body`, a rule whose body depends on fluents.

    Rules over statics only are statements for clingo.
    """

    head: Atom
    body: Body
    where: Source = field(default=NOWHERE, compare=False)


@dataclass(frozen=True, slots=True)
class Phrase:
    """A sentence pattern and the stage or goal that it stands for. The command grammar reads
    patterns.

    `subject` is the slot whose object the act is about; empty: the first in the pattern.
    """

    say: str
    goal: str = ""
    stage: str = ""
    subject: str = ""
    where: Source = field(default=NOWHERE, compare=False)


@lru_cache(maxsize=64)
def _renamed_conventions(renamed: tuple[tuple[str, str], ...]) -> "Conventions":
    # only measurements and schedules use them
    from cellwright.kb.model.name_conventions import Conventions

    return Conventions(**dict(renamed))


@dataclass(frozen=True, slots=True)
class Domain:
    """One kind of cell. Mappings keep the order of declaration."""

    name: str
    types: Mapping[str, Type] = field(default_factory=dict)
    functions: Mapping[str, FunctionSignature] = field(default_factory=dict)
    objects: Mapping[str, str] = field(default_factory=dict)  # object: its type
    predicates: Mapping[str, Predicate] = field(default_factory=dict)
    operators: tuple[Operator, ...] = ()
    deductive_operators: tuple[DeductiveOperator, ...] = ()
    defaults: tuple[Default, ...] = ()
    asp: tuple[Statement, ...] = ()  # over statics only
    rules: tuple[Rule, ...] = ()
    time_unit: str = "s"
    motion: "Motion | None" = None  # what gives the travel times that no fact gives
    words: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    phrases: tuple[Phrase, ...] = ()
    path: str = ""
    renamed: Mapping[str, str] = field(
        default_factory=dict
    )  # roles of conventions: their names in this domain
    quantities: Mapping[str, Quantity] = field(default_factory=dict)
    tools: tuple[str, ...] = RUN_TOOLS  # what a run plans with, the preferred ones first
    unit_of_cost: int = 1  # costs of operators count in parts of 1, so that all are whole
    windows: tuple[TimeWindow, ...] = ()
    calendars: tuple[TimeOfWork, ...] = ()
    further_parents: Mapping[str, tuple[str, ...]] = field(
        default_factory=dict
    )  # types with several parents: those beside `Type.parent`
    reply_times: ReplyTimes = ReplyTimes()

    @property
    def conventions(self) -> "Conventions":
        """This domain's names for the conventions of the engine."""
        return _renamed_conventions(tuple(self.renamed.items()))

    @property
    def counts_fluents(self) -> bool:
        """Whether a rule has an aggregate over what can change."""
        return any(isinstance(part, StateAggregate) for rule in self.rules for part in rule.body)

    def is_subtype(self, name: str, ancestor: str) -> bool:
        """Whether type `name` is `ancestor` or below it.

        `object` is above every type except numbers and texts.
        """
        if ancestor == OBJECT_TYPE:
            return name == OBJECT_TYPE or name not in BUILT_IN_TYPES
        while name != ancestor:
            if any(self.is_subtype(each, ancestor) for each in self.further_parents.get(name, ())):
                return True
            if name not in self.types:
                return False
            name = self.types[name].parent
        return True

    def parents(self, name: str) -> tuple[str, ...]:
        """The types right above a type."""
        if name not in self.types:
            return ()
        return (self.types[name].parent, *self.further_parents.get(name, ()))


Point = tuple[int, int, int]  # micrometres

DISTANCE_TERM = "distance"  # what durations and costs call the length of a way


@dataclass(frozen=True, slots=True)
class Motion:
    """Straight ways at `speed`, in micrometres per unit of the domain's time, which is greater than
    0.

    Each way between two different places takes `settling` units more. Points are in the frame
    `frame` of the cell.
    """

    speed: Fraction
    settling: Fraction = Fraction(0)
    frame: str = "world"
    where: Source = field(default=NOWHERE, compare=False)

    def time(self, here: Point, there: Point) -> int:
        """The time from one place to another one, in the domain's unit, rounded up to a whole
        number.
        """
        first, scale = self.settling.numerator * self.speed.numerator, self.settling.denominator
        squared = _squared_distance(here, there) * (self.speed.denominator * scale) ** 2
        root = math.isqrt(squared)
        # the greatest whole number below the exact root
        below = root - 1 if root * root == squared else root
        return (below + first) // (self.speed.numerator * scale) + 1


def distance_um(here: Point, there: Point) -> int:
    """The straight way between two points, rounded to whole micrometres."""
    return (math.isqrt(4 * _squared_distance(here, there)) + 1) // 2


def _squared_distance(here: Point, there: Point) -> int:
    return sum((from_here - to_there) ** 2 for from_here, to_there in zip(here, there, strict=True))
