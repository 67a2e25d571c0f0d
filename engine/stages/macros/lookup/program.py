"""The order in which the parts of a MACROP are matched. It is computed once per MACROP."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from cellwright.kb.model.conditions import (
    Aggregate,
    Comparison,
    Literal,
    Parameter,
    StateAggregate,
    part_variables,
    substitute_part,
)
from cellwright.kb.model.macro import MacroChain, Macrop
from cellwright.kb.terms import Variable
from cellwright.kb.terms import variables as variables_of


@dataclass(frozen=True, slots=True)
class Item:
    """One part of a MACROP that must be satisfied.

    `kind` says by what: a `goal` or `chain` of the query, an atom of the `state`, a `static` fact, or a
    `type`.
    """

    kind: str
    part: Literal | Parameter | Comparison | MacroChain
    variables: frozenset[Variable]


@dataclass(frozen=True, slots=True)
class Wanted:
    """A goal with the tests on its variables alone.

    Those that are `fixed` ask the statics, those that are `changing` the state. Goals with equal `key` fit the same goals of a
    query; those with equal `fixed_key` do so as far as the statics decide.
    """

    part: Literal
    variables: tuple[Variable, ...]
    fixed: tuple[Item, ...]
    changing: tuple[Item, ...]
    fixed_key: str
    key: str


@dataclass(frozen=True)
class Program:
    """The order in which the parts of a MACROP are matched. Each part of it is computed at its first use."""

    macrop: Macrop

    @cached_property
    def items(self) -> tuple[Item, ...]:
        """The parts in order. Goals and chains come first, each followed by the tests that it decides."""
        chains = [_item("chain", each) for each in _in_order(self.macrop.chains)]
        return tuple(_ordered([*_goals(self.macrop), *chains], list(self.tests), set()))

    @cached_property
    def tests(self) -> tuple[Item, ...]:
        """Preconditions, constraints and types."""
        return tuple(_tests(self.macrop))

    @cached_property
    def wanted(self) -> tuple[Wanted, ...]:
        """The goals, each with the tests of its own variables."""
        return tuple(_wanted(goal, self.tests) for goal in _goals(self.macrop))

    @cached_property
    def between(self) -> tuple[Item, ...]:
        """The tests that several goals decide together."""
        return tuple(
            each for each in self.tests if each.variables <= self._bound and id(each) not in self._own
        )

    @cached_property
    def rest(self) -> tuple[Item, ...]:
        """The tests that remain when all goals are bound."""
        return tuple(
            _ordered([], [each for each in self.tests if not each.variables <= self._bound], self._bound)
        )

    def prepare(self) -> None:
        """Compute now what matching asks for."""
        _ = (self.between, self.rest) if not self.macrop.chains else self.items

    @cached_property
    def _bound(self) -> set[Variable]:
        return {variable for goal in self.wanted for variable in goal.variables}

    @cached_property
    def _own(self) -> set[int]:
        return {id(item) for goal in self.wanted for item in (*goal.fixed, *goal.changing)}


def _goals(macrop: Macrop) -> list[Item]:
    return [_item("goal", each) for each in macrop.goals]


def _tests(macrop: Macrop) -> list[Item]:
    found = [_item("state", each) for each in macrop.preconditions]
    tests = (*macrop.constraints, *macrop.disequalities)
    found += [_item("static", each) for each in tests if not isinstance(each, Aggregate | StateAggregate)]
    return found + [_item("type", each) for each in macrop.types]


def _wanted(goal: Item, tests: Iterable[Item]) -> Wanted:
    assert isinstance(goal.part, Literal)
    order = tuple(dict.fromkeys(variables_of(goal.part.atom)))
    own = tuple(item for item in tests if item.variables and item.variables <= goal.variables)
    names = {variable: Variable(f"V{number}") for number, variable in enumerate(order)}
    fixed = tuple(item for item in own if item.kind != "state")
    changing = tuple(item for item in own if item.kind == "state")
    fixed_key, rest = (_said(items, names) for items in ((goal, *fixed), changing))
    return Wanted(goal.part, order, fixed, changing, fixed_key, f"{fixed_key}\n{rest}")


def _said(items: Iterable[Item], names: Mapping[Variable, Variable]) -> str:
    return "\n".join(f"{item.kind} {_renamed(item.part, names)}" for item in items)


def _renamed(part: Literal | Parameter | Comparison | MacroChain, names: Mapping[Variable, Variable]) -> str:
    if isinstance(part, Parameter):
        return f"{part.type} {names[part.variable]}"
    return str(substitute_part(part, names)) if not isinstance(part, MacroChain) else str(part)


def _ordered(asked: list[Item], pending: list[Item], bound: set[Variable]) -> Iterator[Item]:
    bound = set(bound)
    while asked:
        yield from _decided(pending, bound)
        item = asked.pop(0)
        yield item
        bound |= item.variables
    while pending:
        item = min(pending, key=lambda each: _rank(each, bound))
        pending.remove(item)
        yield item
        bound |= item.variables


def _decided(pending: list[Item], bound: set[Variable]) -> list[Item]:
    """Remove the items without open variables from `pending`, and return them, types first."""
    found = [item for item in pending if item.variables <= bound]
    pending[:] = [item for item in pending if not item.variables <= bound]
    return sorted(found, key=lambda item: item.kind != "type")


def _in_order(chains: Sequence[MacroChain]) -> list[MacroChain]:
    """The chains, each behind those that it must come after."""
    placed: list[MacroChain] = []
    waiting = list(chains)
    while waiting:
        known = {chain.name for chain in placed}
        ready = [chain for chain in waiting if known.issuperset(chain.after)] or waiting
        placed += ready
        waiting = [chain for chain in waiting if chain not in ready]
    return placed


def _item(kind: str, part: Literal | Parameter | Comparison | MacroChain) -> Item:
    if isinstance(part, Parameter):
        return Item(kind, part, frozenset({part.variable}))
    if isinstance(part, MacroChain):
        terms = [part.name, *part.stages, *([part.subject] if part.subject is not None else [])]
        return Item(kind, part, frozenset(v for term in terms for v in variables_of(term)))
    return Item(kind, part, frozenset(part_variables(part)))


def _rank(item: Item, bound: set[Variable]) -> tuple[int, int]:
    open_ = len(item.variables - bound)
    if not open_:
        return 0, 0 if item.kind == "type" else 1
    if isinstance(item.part, Literal) and item.part.positive:
        return (1 if item.kind == "state" else 2), open_
    return (3, open_) if isinstance(item.part, Parameter) else (4, open_)
