"""Bindings under which a MACROP serves a query: a join over its goals, preconditions and constraints.

Goals bind first, one after another, each followed by all tests that it decides; then preconditions over the few facts of
a state, then statics. Tests of variables that nothing binds wait until the end.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from engine.macros.bodies import Bindings, compare, satisfiable, solve
from engine.macros.facts import Facts
from engine.macros.query import Query
from kb.model.conditions import Aggregate, Comparison, Literal, Parameter, part_variables
from kb.model.macro import MacroChain, Macrop
from kb.model.problem import Chain
from kb.terms import ANYTHING, Function, Term, Text, Variable, is_ground, match, substitute, substitute_atom
from kb.terms import variables as variables_of

MAX_WORK = 5_000


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


@dataclass(frozen=True, slots=True)
class Item:
    """One part to satisfy: a `goal` or `chain` by one that is asked for, the others by `state`, `static` or `type`."""

    kind: str
    part: Literal | Parameter | Comparison | MacroChain
    variables: frozenset[Variable]


@dataclass(frozen=True)
class Program:
    """The order in which the parts of a MACROP are matched, made once per MACROP."""

    macrop: Macrop
    items: tuple[Item, ...] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "items", tuple(_ordered(self.macrop)))


def _ordered(macrop: Macrop) -> Iterator[Item]:
    asked = [_item("goal", each) for each in macrop.goals] + [
        _item("chain", each) for each in _in_order(macrop.chains)
    ]
    pending = [_item("state", each) for each in macrop.preconditions]
    tests = (*macrop.constraints, *macrop.disequalities)
    pending += [_item("static", each) for each in tests if not isinstance(each, Aggregate)]
    pending += [_item("type", each) for each in macrop.types]
    bound: set[Variable] = set()
    while pending or asked:
        index = min(range(len(pending)), key=lambda i: _rank(pending[i], bound), default=None)
        if asked and (index is None or pending[index].variables - bound):
            item = asked.pop(0)
        else:
            item = pending.pop(index or 0)
        yield item
        bound |= item.variables


def _in_order(chains: Sequence[MacroChain]) -> list[MacroChain]:
    """Chains behind those that they come after."""
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


def matches(program: Program, asked: Query, work: Work) -> Iterator[dict[Variable, Term]]:
    """Every binding that satisfies the MACROP's goals, preconditions and constraints. Raises `OutOfWork`."""
    macrop = program.macrop
    if (len(macrop.goals), len(macrop.chains)) != (len(asked.goals), len(asked.chains)):
        return
    for found in _Matching(program.items, asked, work).solutions(0, {}, (), frozenset()):
        if not any(satisfiable(body, asked.world.statics, found) for body in macrop.exclusions):
            yield found


@dataclass(frozen=True, slots=True)
class _Matching:
    items: tuple[Item, ...]
    asked: Query
    work: Work

    def solutions(
        self, place: int, bindings: Bindings, waiting: tuple[Item, ...], taken: frozenset[object]
    ) -> Iterator[dict[Variable, Term]]:
        """Bindings from an item on; `taken` are the goals and chains that are served."""
        while place < len(self.items):
            self.work.spend()
            item = self.items[place]
            place += 1
            if item.kind in ("goal", "chain"):
                for given, extended in self._served(item, bindings, taken):
                    yield from self.solutions(place, extended, waiting, taken | {given})
                return
            truth = self._test(item, bindings)
            if truth is None and _must_wait(item.part):
                waiting = (*waiting, item)
            elif not truth:
                for extended in self._bindings(item, bindings) if truth is None else ():
                    yield from self.solutions(place, extended, waiting, taken)
                return
        if all(self._finally(item, bindings) for item in waiting):
            yield dict(bindings)

    def _served(
        self, item: Item, bindings: Bindings, taken: frozenset[object]
    ) -> Iterator[tuple[Literal | Chain, Bindings]]:
        """What is asked for and not taken yet, with the bindings that make the item serve it."""
        given: Iterable[Literal | Chain] = self.asked.goals if item.kind == "goal" else self.asked.chains
        for each in given:
            if each in taken:
                continue
            self.work.spend()
            if isinstance(each, Literal) and isinstance(item.part, Literal):
                same = item.part.positive == each.positive
                found = match_open(item.part.atom, each.atom, bindings) if same else None
            elif isinstance(each, Chain) and isinstance(item.part, MacroChain):
                found = _chain(item.part, each, bindings)
            else:
                continue
            if found is not None:
                yield each, found

    def _test(self, item: Item, bindings: Bindings) -> bool | None:
        """Whether an item holds, or None while it has open variables."""
        part = item.part
        if isinstance(part, Parameter):
            value = bindings.get(part.variable)
            return self.asked.world.statics.has_type(value, part.type) if value is not None else None
        if not item.variables <= bindings.keys():
            return None
        if isinstance(part, Comparison):
            return compare(substitute(part.left, bindings), part.relation, substitute(part.right, bindings))
        if isinstance(part, Literal):
            return (substitute_atom(part.atom, bindings) in self._facts(item)) == part.positive
        return None

    def _facts(self, item: Item) -> Facts:
        return self.asked.facts if item.kind == "state" else self.asked.world.statics

    def _bindings(self, item: Item, bindings: Bindings) -> Iterator[Bindings]:
        if isinstance(item.part, Parameter):
            found = self.asked.world.statics.named(item.part.type)
            yield from ({**bindings, item.part.variable: atom.arguments[0]} for atom in found)
        elif not isinstance(item.part, MacroChain):
            yield from solve((item.part,), self._facts(item), bindings)

    def _finally(self, item: Item, bindings: Bindings) -> bool:
        if isinstance(item.part, Parameter | MacroChain):
            return True
        return satisfiable((item.part,), self._facts(item), bindings)


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


def _must_wait(part: Literal | Parameter | Comparison | MacroChain) -> bool:
    return (isinstance(part, Literal) and not part.positive) or (
        isinstance(part, Comparison) and part.relation != "="
    )
