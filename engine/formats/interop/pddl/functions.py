"""The numeric functions of a PDDL task: which of them change, which are read, in which units they count, what plans cost.

Level 2 of PDDL 2.1 (Fox & Long 2003). A function that no effect changes is a static fact with its value. One that changes is a
quantity, or it is left out if nothing reads it. What `:metric` minimises is the cost, if steps add fixed amounts to it.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from math import lcm

from cellwright.engine.formats.interop.pddl.expressions import Document, Expression, Group, Word
from cellwright.engine.formats.interop.pddl.polynomials import (
    Growth,
    Polynomial,
    Unreadable,
    denominators,
    number_of,
    polynomial,
    units,
)

CHANGES = ("increase", "decrease", "assign", "scale-up", "scale-down")
COST = "total-cost"


@dataclass(frozen=True, slots=True)
class NumericEffect:
    """An effect `(kind (function ...) amount)`, and whether it happens only under a condition or for several bindings."""

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
    elif at.head in CHANGES and len(at.rest) == 2 and (function := applied(at.rest[0])) is not None:
        yield NumericEffect(at.head, function, at.rest[1], at, conditional)


def applied(at: Expression) -> Group | None:
    """A function with its arguments; a bare name has none."""
    if isinstance(at, Word):
        return None if number_of(at) is not None else Group((at,), at.offset)
    return at if at.head else None


def words(at: Expression | None) -> Iterator[str]:
    """All words in an expression."""
    if isinstance(at, Word):
        yield at.text
    for part in at.parts if isinstance(at, Group) else ():
        yield from words(part)


@dataclass
class Functions:
    """What is known of the functions of a task, all by their PDDL names."""

    declared: set[str] = field(default_factory=set)
    changing: set[str] = field(default_factory=set)  # those that become quantities
    ignored: set[str] = field(default_factory=set)  # those that change and that nothing reads
    units: dict[str, int] = field(default_factory=dict)  # the parts of 1 in which each counts
    metric: dict[str, Fraction] | None = None  # what each function adds to the cost; None: a step costs 1
    unit_of_cost: int = 1  # the parts of 1 in which costs count
    unfollowed: str = ""  # why the metric is not followed

    def unit(self, name: str) -> int:
        """The parts of 1 in which a function counts."""
        return self.units.get(name, 1)


class FunctionReader:
    """Looks through a task for what its functions are, before its actions are read."""

    def __init__(self, domain: Document, problem: Document, declared: set[str]) -> None:
        self.domain, self.problem = domain, problem
        self.declared = {*declared, COST}
        self._actions = [part for part in groups(domain) if part.head == ":action"]
        self._effects = [
            each for action in self._actions for each in numeric_effects(action.field(":effect"))
        ]

    def read(self) -> Functions:
        """The functions. What is wrong is noted in the documents."""
        found = Functions(self.declared)
        given = self._values()
        needed = self._needed()
        found.changing = {each.name for each in self._effects if each.name in needed}
        found.ignored = {COST, *(each.name for each in self._effects)} - found.changing
        kept = [each for each in self._effects if each.name in found.changing]
        try:
            found.units = units(given, [self._growth(each) for each in kept])
        except Unreadable as wrong:
            self._refuse(self.domain, wrong.at, str(wrong))
        self._metric(found)
        return found

    def _refuse(self, document: Document, at: Expression, why: str) -> None:
        hint = "numbers are whole or decimal, and conditions and effects are sums of functions with fixed factors"
        document.add(at, "K802", f"this number is not supported: {why}", hint)

    def _values(self) -> dict[str, list[Fraction]]:
        """The values of each function at the start."""
        found: dict[str, list[Fraction]] = {}
        for group in groups(self.problem):
            for part in group.rest if group.head == ":init" else ():
                if isinstance(part, Group) and part.head == "=" and len(part.rest) == 2:
                    function, value = applied(part.rest[0]), number_of(part.rest[1])
                    if function is not None and value is not None:
                        found.setdefault(function.head, []).append(value)
        return found

    def _needed(self) -> set[str]:
        """The functions that conditions read, and those that these are changed by."""
        conditions = [
            *(action.field(":precondition") for action in self._actions),
            *(when for action in self._actions for when in _premises(action.field(":effect"))),
            *(part for part in groups(self.domain) if part.head == ":derived"),
            *(part for part in groups(self.problem) if part.head == ":goal"),
        ]
        needed = {name for each in conditions for name in words(each)} & self.declared
        while True:
            read = {
                name for e in self._effects if e.name in needed for name in words(e.amount)
            } & self.declared
            if read <= needed:
                return needed
            needed |= read

    def _growth(self, effect: NumericEffect) -> Growth:
        return Growth(effect.name, self._named(effect.amount), effect.at)

    def _named(self, at: Expression) -> Polynomial[str]:
        return polynomial(at, lambda group: group.head)

    def _metric(self, found: Functions) -> None:
        metric = next((part for part in groups(self.problem) if part.head == ":metric"), None)
        if metric is None:
            return
        if metric.rest and isinstance(metric.rest[0], Word) and metric.rest[0].text == "maximize":
            found.unfollowed = "plans are made cheap, nothing is made as large as possible"
            return
        try:
            weights = self._weights(metric)
        except Unreadable as wrong:
            self._refuse(self.problem, wrong.at, str(wrong))
            return
        costs = [each for each in self._effects if each.name in weights]
        found.unfollowed = next(filter(None, map(self._no_cost, costs)), "")
        if found.unfollowed or not costs:
            return
        try:
            amounts = [self._named(each.amount).times(weights[each.name]) for each in costs]
        except Unreadable as wrong:
            self._refuse(self.domain, wrong.at, str(wrong))
            return
        found.metric = weights
        found.unit_of_cost = lcm(1, *(part for each in amounts for part in denominators(each, found.units)))

    def _weights(self, metric: Group) -> dict[str, Fraction]:
        """The factor of each function in what is minimised. Raises `Unreadable`."""
        aim = metric.rest[0] if len(metric.rest) == 2 else metric
        if not isinstance(aim, Word) or aim.text != "minimize":
            raise Unreadable(metric, "write (:metric minimize (function))")
        read = self._named(metric.rest[1])
        if any(len(monomial) > 1 for monomial in read.parts) or min(read.parts.values(), default=0) < 0:
            raise Unreadable(metric, "a metric is a sum of functions with positive factors")
        return {monomial[0]: factor for monomial, factor in read.parts.items() if monomial}

    def _no_cost(self, effect: NumericEffect) -> str:
        """Why an effect on the metric is no cost of a step; empty if it is one. A conditional one is refused."""
        if effect.conditional:
            self._refuse(self.domain, effect.at, "a cost that rises only under a condition")
        if effect.kind != "increase":
            return f"{effect.name} does not only rise"
        if set(words(effect.amount)) & {each.name for each in self._effects}:
            return f"{effect.name} rises by amounts that change"
        return ""


def groups(document: Document) -> list[Group]:
    """The sections of a file."""
    return [part for part in document.root.rest if isinstance(part, Group)]


def _premises(at: Expression | None) -> Iterator[Expression]:
    """The conditions of conditional effects."""
    if not isinstance(at, Group):
        return
    if at.head == "when" and len(at.rest) == 2:
        yield at.rest[0]
        yield from _premises(at.rest[1])
    elif at.head in ("and", "forall"):
        for part in at.rest:
            yield from _premises(part)
