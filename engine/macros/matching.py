"""Bindings under which a MACROP serves a query: a join over its goals, preconditions and constraints.

Goals bind first, then preconditions over the few facts of a state, then statics, each narrowed by what is bound.
Tests whose variables are not bound yet wait until the end.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

from engine.macros.facts import Bindings, Facts, compare, satisfiable, solve
from engine.macros.query import Query
from kb.model.conditions import Aggregate, Body, Comparison, Literal, Parameter
from kb.model.macro import MacroChain, Macrop, part_variables
from kb.model.problem import Chain
from kb.terms import ANYTHING, Function, Term, Text, Variable, is_ground, match, substitute, substitute_atom

MAX_WORK = 20_000


class OutOfWork(Exception):
    """Matching took more steps than it is worth."""


@dataclass
class Work:
    """Steps of matching left."""

    left: int = MAX_WORK

    def spend(self) -> None:
        """Take one step. Raises `OutOfWork`."""
        self.left -= 1
        if self.left < 0:
            raise OutOfWork


Item = Literal | Parameter | Comparison


@dataclass(frozen=True)
class Program:
    """The order in which the parts of a MACROP are matched, made once per MACROP."""

    macrop: Macrop
    items: tuple[tuple[str, Item], ...] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "items", tuple(_ordered(self.macrop)))


def _ordered(macrop: Macrop) -> Iterator[tuple[str, Item]]:
    goal_atoms = [each.atom for each in macrop.goals] + [s for chain in macrop.chains for s in chain.stages]
    bound = {v for atom in goal_atoms for v in part_variables(Literal(atom))}
    pending: list[tuple[str, Item]] = [("state", each) for each in macrop.preconditions]
    tests = (*macrop.constraints, *macrop.disequalities)
    pending += [("static", each) for each in tests if not isinstance(each, Aggregate)]
    pending += [("type", each) for each in macrop.types]
    while pending:
        index = min(range(len(pending)), key=lambda i: _rank(*pending[i], bound))
        kind, item = pending.pop(index)
        yield kind, item
        bound |= _variables(item)


def _variables(item: Item) -> set[Variable]:
    return {item.variable} if isinstance(item, Parameter) else set(part_variables(item))


def _rank(kind: str, item: Item, bound: set[Variable]) -> tuple[int, int]:
    open_ = len(_variables(item) - bound)
    if not open_:
        return 0, 0 if kind == "type" else 1
    if isinstance(item, Literal) and item.positive:
        return (1 if kind == "state" else 2), open_
    return (3, open_) if isinstance(item, Parameter) else (4, open_)


def matches(program: Program, asked: Query, work: Work) -> Iterator[dict[Variable, Term]]:
    """Every binding that satisfies the MACROP's goals, preconditions and constraints. Raises `OutOfWork`."""
    macrop = program.macrop
    for goals in _assigned(macrop.goals, asked.goals, _goal, {}, work):
        for chained in _assigned(macrop.chains, asked.chains, _chain, goals, work):
            for found in _satisfied(program.items, 0, asked, chained, [], work):
                if not any(satisfiable(body, asked.world.statics, found) for body in macrop.exclusions):
                    yield found


Wanted = TypeVar("Wanted")
Given = TypeVar("Given")


def _assigned(
    wanted: Sequence[Wanted],
    given: Sequence[Given],
    fits: "Callable[[Wanted, Given, Bindings], Bindings | None]",
    bindings: Bindings,
    work: Work,
) -> Iterator[Bindings]:
    """Every way to pair what is wanted with what is given, one to one."""
    if not wanted:
        if not given:
            yield bindings
        return
    for index, each in enumerate(given):
        work.spend()
        extended = fits(wanted[0], each, bindings)
        if extended is not None:
            rest = (*given[:index], *given[index + 1 :])
            yield from _assigned(wanted[1:], rest, fits, extended, work)


def _goal(wanted: Literal, given: Literal, bindings: Bindings) -> Bindings | None:
    return match_open(wanted.atom, given.atom, bindings) if wanted.positive == given.positive else None


def match_open(pattern: Term, given: Term, bindings: Bindings) -> Bindings | None:
    """`match` where `_` in the given term fits anything and binds nothing."""
    if given == ANYTHING:
        return bindings
    if isinstance(pattern, Function) and isinstance(given, Function) and given.arguments:
        if pattern.name != given.name or len(pattern.arguments) != len(given.arguments):
            return None
        found: Bindings | None = bindings
        for one, other in zip(pattern.arguments, given.arguments, strict=True):
            found = match_open(one, other, found) if found is not None else None
        return found
    return match(pattern, given, bindings) if is_ground(given) else None


def _chain(wanted: MacroChain, given: Chain, bindings: Bindings) -> Bindings | None:
    if len(wanted.stages) != len(given.stages) or (wanted.subject is None) != (given.subject is None):
        return None
    found: Bindings | None = match(wanted.name, Text(given.name), bindings)
    if found is not None and wanted.subject is not None and given.subject is not None:
        found = match(wanted.subject, given.subject, found)
    for stage, other in zip(wanted.stages, given.stages, strict=True):
        found = match_open(stage, other, found) if found is not None else None
    if found is None or {substitute(name, found) for name in wanted.after} != set(map(Text, given.after)):
        return None
    return found


def _satisfied(
    items: tuple[tuple[str, Item], ...],
    place: int,
    asked: Query,
    bindings: Bindings,
    waiting: list[tuple[str, Item]],
    work: Work,
) -> Iterator[dict[Variable, Term]]:
    while place < len(items):
        work.spend()
        kind, item = items[place]
        place += 1
        truth = _test(kind, item, asked, bindings)
        if truth is False:
            return
        if truth is None and _must_wait(item):
            waiting = [*waiting, (kind, item)]
        elif truth is None:
            for extended in _bindings(kind, item, asked, bindings):
                yield from _satisfied(items, place, asked, extended, waiting, work)
            return
    if all(_finally(kind, item, asked, bindings) for kind, item in waiting):
        yield dict(bindings)


def _must_wait(item: Item) -> bool:
    return (isinstance(item, Literal) and not item.positive) or (
        isinstance(item, Comparison) and item.relation != "="
    )


def _test(kind: str, item: Item, asked: Query, bindings: Bindings) -> bool | None:
    """Whether an item holds, or None while it has open variables."""
    if isinstance(item, Parameter):
        value = bindings.get(item.variable)
        return asked.world.statics.has_type(value, item.type) if value is not None else None
    if isinstance(item, Comparison):
        left, right = substitute(item.left, bindings), substitute(item.right, bindings)
        return compare(left, item.relation, right) if is_ground(left) and is_ground(right) else None
    atom = substitute_atom(item.atom, bindings)
    return (atom in _facts(kind, asked)) == item.positive if is_ground(atom) else None


def _facts(kind: str, asked: Query) -> Facts:
    return asked.facts if kind == "state" else asked.world.statics


def _bindings(kind: str, item: Item, asked: Query, bindings: Bindings) -> Iterator[Bindings]:
    if isinstance(item, Parameter):
        found = asked.world.statics.named(item.type)
        yield from ({**bindings, item.variable: atom.arguments[0]} for atom in found)
    else:
        yield from solve((item,), _facts(kind, asked), bindings)


def _finally(kind: str, item: Item, asked: Query, bindings: Bindings) -> bool:
    if isinstance(item, Parameter):
        return True
    body: Body = (item,)
    return satisfiable(body, _facts(kind, asked), bindings)
