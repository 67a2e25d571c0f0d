"""Numeric functions of a PDDL task: which change, in which units they count, what plans cost.

A monomial is a tuple of functions; the empty one stands for the number 1. What a function is does
not matter here.
"""

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from math import lcm
from typing import Generic, NamedTuple, TypeVar

from cellwright.engine.formats.interop.pddl.expressions import Document, Expression, Group, PddlWord

Key = TypeVar("Key")
MAX_PARTS_OF_UNIT = 10**6  # parts into which a unit may be divided
MAX_PDDL_NUMBER = 2**31 - 1
_NUMBER_WORD = re.compile(
    r"[+-]?(?:[0-9]{1,15}(?:\.[0-9]{0,12})?|\.[0-9]{1,12})(?:e[+-]?[0-9]{1,2})?"
)
ARITHMETIC_SIGNS = ("+", "-", "*", "/")


class Unreadable(Exception):
    """Arithmetic that cannot be read: where, and why."""

    def __init__(self, at: Expression, why: str) -> None:
        super().__init__(why)
        self.at, self.why = at, why


class Polynomial(Generic[Key]):
    """A sum of monomials, each with its coefficient; those with the coefficient 0 are left out."""

    def __init__(self, parts: Mapping[tuple[Key, ...], Fraction]) -> None:
        self.parts = {monomial: factor for monomial, factor in parts.items() if factor}

    @classmethod
    def number(cls, value: Fraction) -> "Polynomial[Key]":
        """A polynomial without functions."""
        return cls({(): value})

    @property
    def constant(self) -> Fraction | None:
        """The value, if no function occurs."""
        return self.parts.get((), Fraction(0)) if not any(self.parts) else None

    @property
    def keys(self) -> set[Key]:
        """The functions that occur."""
        return {key for monomial in self.parts for key in monomial}

    def __add__(self, other: "Polynomial[Key]") -> "Polynomial[Key]":
        total = dict(self.parts)
        for monomial, factor in other.parts.items():
            total[monomial] = total.get(monomial, Fraction(0)) + factor
        return Polynomial(total)

    def __mul__(self, other: "Polynomial[Key]") -> "Polynomial[Key]":
        product: dict[tuple[Key, ...], Fraction] = {}
        for monomial_of_first, first in self.parts.items():
            for two, second in other.parts.items():
                monomial = tuple(sorted((*monomial_of_first, *two), key=str))
                product[monomial] = product.get(monomial, Fraction(0)) + first * second
        return Polynomial(product)

    def times(self, factor: Fraction) -> "Polynomial[Key]":
        """The polynomial with each coefficient multiplied."""
        return Polynomial(
            {monomial: factor * coefficient for monomial, coefficient in self.parts.items()}
        )


def written_number(at: Expression) -> Fraction | None:
    """The number that is written here, exactly; None if this is something else."""
    return (
        Fraction(at.text) if isinstance(at, PddlWord) and _NUMBER_WORD.fullmatch(at.text) else None
    )


def polynomial_of(at: Expression, key: Callable[[Group], Key]) -> Polynomial[Key]:
    """The polynomial that an expression is; `key` reads a function. Raises `Unreadable`."""
    if (value := written_number(at)) is not None:
        return Polynomial.number(value)
    if isinstance(at, PddlWord):
        # a function without arguments
        return Polynomial({(key(Group((at,), at.offset)),): Fraction(1)})
    if at.head not in ARITHMETIC_SIGNS:
        return Polynomial({(key(at),): Fraction(1)})
    parts = [polynomial_of(part, key) for part in at.rest]
    if not parts or (at.head == "/" and len(parts) != 2):
        raise Unreadable(at, f"'{at.head}' has a wrong number of arguments")
    return _calculate(at, parts)


def _calculate(at: Group, parts: list[Polynomial[Key]]) -> Polynomial[Key]:
    first, *others = parts
    if at.head == "-":
        return (
            sum((summand.times(Fraction(-1)) for summand in others), first)
            if others
            else first.times(Fraction(-1))
        )
    for factor in others:
        if at.head == "+":
            first = first + factor
        elif at.head == "*":
            first = first * factor
        elif not (divisor := factor.constant):
            raise Unreadable(at, "divisions are by numbers other than 0")
        else:
            first = first.times(1 / divisor)
    return first


class FunctionGrowth(NamedTuple):
    """An effect adds or assigns `amount` to the function `name`."""

    name: str
    amount: Polynomial[str]
    at: Group


def function_units(
    values: Mapping[str, Iterable[Fraction]], growths: Iterable[FunctionGrowth]
) -> dict[str, int]:
    """For each function the number of parts of 1 in which it counts, so that `values` and all it
    becomes are whole.

    Raises `Unreadable` if no number of parts is fine enough.
    """
    parts_of_unit = {
        name: math.lcm(1, *(value.denominator for value in given)) for name, given in values.items()
    }
    waiting = list(growths)
    moved = True
    while moved:
        moved = False
        for growth in waiting:
            finer = math.lcm(
                parts_of_unit.get(growth.name, 1), *cost_denominators(growth.amount, parts_of_unit)
            )
            if finer > MAX_PARTS_OF_UNIT:
                raise Unreadable(
                    growth.at, f"{growth.name} would take values finer than a millionth"
                )
            moved |= finer != parts_of_unit.get(growth.name, 1)
            parts_of_unit[growth.name] = finer
    return parts_of_unit


def cost_denominators(amount: Polynomial[str], units: Mapping[str, int]) -> list[int]:
    """What must divide the parts of 1 in which an amount counts, if functions count in `units`."""
    return [
        (factor / math.prod(units.get(name, 1) for name in monomial)).denominator
        for monomial, factor in amount.parts.items()
    ]


CHANGE_WORDS = ("increase", "decrease", "assign", "scale-up", "scale-down")
TOTAL_COST = "total-cost"


@dataclass(frozen=True, slots=True)
class NumericEffect:
    """An effect `(kind (function ...) amount)`, and whether it happens only under a condition
    or for several bindings.
    """

    kind: str
    function: Group
    amount: Expression
    at: Group
    conditional: bool

    @property
    def name(self) -> str:
        """The function that changes."""
        return self.function.head


def numeric_effects(at: Expression | None, conditional: bool = False) -> Iterator[NumericEffect]:
    """The numeric effects in an effect."""
    if not isinstance(at, Group):
        return
    if at.head in ("and", ""):
        for part in at.rest:
            yield from numeric_effects(part, conditional)
    elif at.head in ("when", "forall") and len(at.rest) == 2:
        yield from numeric_effects(at.rest[1], True)
    elif (
        at.head in CHANGE_WORDS
        and len(at.rest) == 2
        and (function := function_of(at.rest[0])) is not None
    ):
        yield NumericEffect(at.head, function, at.rest[1], at, conditional)


def function_of(at: Expression) -> Group | None:
    """A function with its arguments; a bare name has none."""
    if isinstance(at, PddlWord):
        return None if written_number(at) is not None else Group((at,), at.offset)
    return at if at.head else None


def words_in(at: Expression | None) -> Iterator[str]:
    """All words in an expression."""
    if isinstance(at, PddlWord):
        yield at.text
    for part in at.parts if isinstance(at, Group) else ():
        yield from words_in(part)


@dataclass
class TaskFunctions:
    """What is known of the functions of a task, all by their PDDL names."""

    declared: set[str] = field(default_factory=set)
    changing: set[str] = field(default_factory=set)  # those that become quantities
    ignored: set[str] = field(default_factory=set)  # those that change and that nothing reads
    # those without a value for some objects at the start
    partial: set[str] = field(default_factory=set)
    # those that are read for objects beyond their types
    wide: set[str] = field(default_factory=set)
    units: dict[str, int] = field(default_factory=dict)  # the parts of 1 in which each counts
    # what each function adds to the cost; None: a step costs 1
    metric: dict[str, Fraction] | None = None
    unit_of_cost: int = 1  # the parts of 1 in which costs count
    unfollowed: str = ""  # why the metric is not followed

    def widen(self, name: str) -> None:
        """Note that a function is read for variables that may have values beyond its types,
        where it has no value.
        """
        self.wide.add(name)
        self.partial.add(name)

    def unit(self, name: str) -> int:
        """The parts of 1 in which a function counts."""
        return self.units.get(name, 1)


class FunctionReader:
    """Looks through a task for what its functions are, before its actions are read."""

    def __init__(
        self, domain: Document, problem: Document, declared: set[str], count: Callable[[str], int]
    ) -> None:
        """`count` says for how many objects a function is declared."""
        self.domain, self.problem, self.count = domain, problem, count
        self.declared = {*declared, TOTAL_COST}
        self._actions = [part for part in file_sections(domain) if part.head == ":action"]
        self._effects = [
            numeric_effect
            for action in self._actions
            for numeric_effect in numeric_effects(action.field(":effect"))
        ]

    def read(self) -> TaskFunctions:
        """The functions. What is wrong is noted in the documents."""
        functions = TaskFunctions(self.declared)
        given = self._values()
        needed = self._needed()
        functions.changing = {effect.name for effect in self._effects if effect.name in needed}
        functions.ignored = {
            TOTAL_COST,
            *(effect.name for effect in self._effects),
        } - functions.changing
        kept = [effect for effect in self._effects if effect.name in functions.changing]
        try:
            functions.units = function_units(
                given, [self._growth(followed_effect) for followed_effect in kept]
            )
        except Unreadable as wrong:
            self._refuse(self.domain, wrong.at, str(wrong))
        self._metric(functions)
        return functions

    def _refuse(self, document: Document, at: Expression, why: str) -> None:
        hint = (
            "numbers are whole or decimal, and conditions and effects are sums of functions "
            "with fixed factors"
        )
        document.add(at, "K802", f"this number is not supported: {why}", hint)

    def _values(self) -> dict[str, list[Fraction]]:
        """The values of each function at the start."""
        values: dict[str, list[Fraction]] = {}
        for group in file_sections(self.problem):
            for part in group.rest if group.head == ":init" else ():
                if isinstance(part, Group) and part.head == "=" and len(part.rest) == 2:
                    function, value = function_of(part.rest[0]), written_number(part.rest[1])
                    if function is not None and value is not None:
                        values.setdefault(function.head, []).append(value)
        return values

    def _needed(self) -> set[str]:
        """The functions that conditions read, and those that these are changed by."""
        conditions = [
            *(action.field(":precondition") for action in self._actions),
            *(
                when
                for action in self._actions
                for when in _effect_premises(action.field(":effect"))
            ),
            *(part for part in file_sections(self.domain) if part.head == ":derived"),
            *(part for part in file_sections(self.problem) if part.head == ":goal"),
        ]
        needed = {name for condition in conditions for name in words_in(condition)} & self.declared
        while True:
            read = {
                name for e in self._effects if e.name in needed for name in words_in(e.amount)
            } & self.declared
            if read <= needed:
                return needed
            needed |= read

    def _growth(self, effect: NumericEffect) -> FunctionGrowth:
        return FunctionGrowth(effect.name, self._named(effect.amount), effect.at)

    def _named(self, at: Expression) -> Polynomial[str]:
        return polynomial_of(at, lambda group: group.head)

    def _metric(self, functions: TaskFunctions) -> None:
        metric = next(
            (part for part in file_sections(self.problem) if part.head == ":metric"), None
        )
        if metric is None:
            return
        if (
            metric.rest
            and isinstance(metric.rest[0], PddlWord)
            and metric.rest[0].text == "maximize"
        ):
            functions.unfollowed = "plans are made cheap, nothing is made as large as possible"
            return
        try:
            weights = self._weights(metric)
        except Unreadable as wrong:
            self._refuse(self.problem, wrong.at, str(wrong))
            return
        costs = [effect for effect in self._effects if effect.name in weights]
        uneven = (name for name in sorted({cost.name for cost in costs}) if weights[name] is None)
        functions.unfollowed = next((f"{name} counts for some objects only" for name in uneven), "")
        functions.unfollowed = functions.unfollowed or next(
            filter(None, map(self._no_cost, costs)), ""
        )
        if functions.unfollowed or not costs:
            return
        try:
            even = {name: weight for name, weight in weights.items() if weight is not None}
            amounts = [
                self._named(cost_amount.amount).times(even[cost_amount.name])
                for cost_amount in costs
            ]
        except Unreadable as wrong:
            self._refuse(self.domain, wrong.at, str(wrong))
            return
        functions.metric = even
        functions.unit_of_cost = lcm(
            1, *(part for each in amounts for part in cost_denominators(each, functions.units))
        )

    def _weights(self, metric: Group) -> dict[str, Fraction | None]:
        """The factor of each function in what is minimised; None if it is not the same for all
        objects. Raises `Unreadable`.
        """
        aim = metric.rest[0] if len(metric.rest) == 2 else metric
        if not isinstance(aim, PddlWord) or aim.text != "minimize":
            raise Unreadable(metric, "write (:metric minimize (function))")
        read = polynomial_of(metric.rest[1], lambda group: tuple(words_in(group)))
        if (
            any(len(monomial) > 1 for monomial in read.parts)
            or min(read.parts.values(), default=0) < 0
        ):
            raise Unreadable(metric, "a metric is a sum of functions with positive factors")
        factors: dict[str, list[Fraction]] = {}
        for monomial, factor in read.parts.items():
            if monomial:
                factors.setdefault(monomial[0][0], []).append(factor)
        return {
            name: own[0] if len(set(own)) == 1 and len(own) == self.count(name) else None
            for name, own in factors.items()
        }

    def _no_cost(self, effect: NumericEffect) -> str:
        """Why an effect on the metric is no cost of a step; empty if it is one.

        A conditional one is refused.
        """
        if effect.conditional:
            self._refuse(self.domain, effect.at, "a cost that rises only under a condition")
        if effect.kind != "increase":
            return f"{effect.name} does not only rise"
        if set(words_in(effect.amount)) & {numeric.name for numeric in self._effects}:
            return f"{effect.name} rises by amounts that change"
        return ""


def file_sections(document: Document) -> list[Group]:
    """The sections of a file."""
    return [part for part in document.root.rest if isinstance(part, Group)]


def _effect_premises(at: Expression | None) -> Iterator[Expression]:
    """The conditions of conditional effects."""
    if not isinstance(at, Group):
        return
    if at.head == "when" and len(at.rest) == 2:
        yield at.rest[0]
        yield from _effect_premises(at.rest[1])
    elif at.head in ("and", "forall"):
        for part in at.rest:
            yield from _effect_premises(part)
