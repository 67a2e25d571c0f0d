"""Bindings under which a MACROP serves a query: a join over its goals, preconditions and constraints.

Goals are bound first. After each goal come all tests that it decides. Then come preconditions, as a state has
few facts, then statics. Tests with variables that nothing binds wait until the end. A goal of a MACROP can
stand for some goals of the query. These choices are computed once for all MACROPs that test the goal in the
same way, and goals with the fewest choices are assigned first.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from cellwright.engine.stages.macros.lifted.bodies import Bindings, satisfiable, solve
from cellwright.engine.stages.macros.lifted.facts import Facts
from cellwright.engine.stages.macros.lookup.program import Item, Program, Wanted
from cellwright.engine.stages.macros.lookup.query import Query
from cellwright.kb.arithmetic import compare
from cellwright.kb.model.conditions import Comparison, Literal, Parameter
from cellwright.kb.model.macro import MacroChain
from cellwright.kb.model.problem import Chain
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Function,
    Term,
    Text,
    Variable,
    is_ground,
    match,
    substitute,
    substitute_atom,
)

MAX_WORK = 5_000
REMEMBERED = 1 << 16  # goals whose values are remembered


class OutOfWork(Exception):
    """Matching took more steps than it is allowed."""


@dataclass
class MatchingBudget:
    """The number of matching steps that are left."""

    left: int = MAX_WORK

    def spend(self) -> None:
        """Count one step. Raises `OutOfWork` if none is left."""
        self.left -= 1
        if self.left < 0:
            raise OutOfWork


def matches(program: Program, asked: Query, work: MatchingBudget) -> Iterator[dict[Variable, Term]]:
    """Every binding that satisfies the MACROP's goals, preconditions and constraints. Raises `OutOfWork`."""
    macrop = program.macrop
    if (len(macrop.goals), len(macrop.chains)) != (len(asked.goals), len(asked.chains)):
        return
    for found in _solutions(program, asked, work):
        if not any(satisfiable(body, asked.world.statics, found) for body in macrop.exclusions):
            yield found


def joined(program: Program, asked: Query, work: MatchingBudget) -> Iterator[dict[Variable, Term]]:
    """The bindings before exclusions are tested. Goals are bound one by one, in the MACROP's own order.

    This way works for workflow chains and for goals with `_`, too.
    """
    return _Matching(program.items, asked, work).solutions(0, {}, (), frozenset())


def _solutions(program: Program, asked: Query, work: MatchingBudget) -> Iterator[dict[Variable, Term]]:
    if asked.chains or not all(is_ground(goal.atom) for goal in asked.goals):
        yield from joined(program, asked, work)
        return
    rest = _Matching(program.rest, asked, work)
    for bindings in _Assignment(program, asked, work).solutions():
        yield from rest.solutions(0, bindings, (), frozenset())


@dataclass(frozen=True, slots=True)
class _Assignment:
    """Assigns the goals of a query, all of them ground, to the goals of a MACROP.

    The goals with the fewest choices are assigned first.
    """

    program: Program
    asked: Query
    work: MatchingBudget

    def solutions(self) -> Iterator[Bindings]:
        """The bindings of the goals' variables under which all tests hold that they decide."""
        choices = [self._choices(wanted) for wanted in self.program.wanted]
        if all(choices):
            order = sorted(range(len(choices)), key=lambda place: len(choices[place]))
            yield from self._given(
                [choices[place] for place in order], order, {}, 0, list(self.program.between)
            )

    def _choices(self, wanted: Wanted) -> tuple[tuple[int, tuple[Term, ...]], ...]:
        """The numbers of the query's goals that fit, with the values of the variables.

        They are shared by all MACROPs with the same tests.
        """
        known = self.asked.memory.get(wanted.key)
        if known is None:
            known = self.asked.memory[wanted.key] = tuple(self._fitting(wanted))
        return known

    def _fitting(self, wanted: Wanted) -> Iterator[tuple[int, tuple[Term, ...]]]:
        tests = _Matching((), self.asked, self.work)
        for number, goal in enumerate(self.asked.goals):
            self.work.spend()
            values = self._known(wanted, goal.atom, tests) if goal.positive == wanted.part.positive else None
            if values is None:
                continue
            found = dict(zip(wanted.variables, values, strict=True)) if wanted.changing else {}
            if all(tests.test(item, found) for item in wanted.changing):
                yield number, values

    def _known(self, wanted: Wanted, goal: Atom, tests: "_Matching") -> tuple[Term, ...] | None:
        """The values of the variables if a goal fits, as far as the statics decide: queries in one cell have the same goals."""
        known, key = self.asked.world.fitting, (wanted.fixed_key, goal)
        if key not in known:
            if len(known) >= REMEMBERED:
                known.clear()
            found = match(wanted.part.atom, goal, {})
            fits = found is not None and all(tests.test(item, found) for item in wanted.fixed)
            known[key] = (
                tuple(found[each] for each in wanted.variables) if found is not None and fits else None
            )
        return known[key]

    def _given(
        self,
        choices: Sequence[tuple[tuple[int, tuple[Term, ...]], ...]],
        order: Sequence[int],
        bindings: dict[Variable, Term],
        taken: int,
        open_: list[Item],
    ) -> Iterator[Bindings]:
        if not order:
            yield bindings
            return
        variables = self.program.wanted[order[0]].variables
        for number, values in choices[0]:
            if taken >> number & 1:
                continue
            self.work.spend()
            extended = _extended(bindings, variables, values)
            if extended is None:
                continue
            left = self._untested(open_, extended)
            if left is not None:
                yield from self._given(choices[1:], order[1:], extended, taken | 1 << number, left)

    def _untested(self, open_: list[Item], bindings: dict[Variable, Term]) -> list[Item] | None:
        """The tests that still have open variables; None if one of the others is false."""
        tests = _Matching((), self.asked, self.work)
        left = []
        for item in open_:
            if not item.variables <= bindings.keys():
                left.append(item)
            elif not tests.test(item, bindings):
                return None
        return left


def _extended(
    bindings: dict[Variable, Term], variables: Sequence[Variable], values: Sequence[Term]
) -> dict[Variable, Term] | None:
    extended = bindings.copy()
    for variable, value in zip(variables, values, strict=True):
        if extended.setdefault(variable, value) != value:
            return None
    return extended


@dataclass(frozen=True, slots=True)
class _Matching:
    items: tuple[Item, ...]
    asked: Query
    work: MatchingBudget

    def solutions(
        self, place: int, bindings: Bindings, waiting: tuple[Item, ...], taken: frozenset[object]
    ) -> Iterator[dict[Variable, Term]]:
        """The bindings that satisfy all items from `place` on.

        `taken` are the goals and chains that are already served.
        """
        while place < len(self.items):
            self.work.spend()
            item = self.items[place]
            place += 1
            if item.kind in ("goal", "chain"):
                for given, extended in self._served(item, bindings, taken):
                    yield from self.solutions(place, extended, waiting, taken | {given})
                return
            truth = self.test(item, bindings)
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
        """The free goals or chains of the query that the item can serve, each with its bindings."""
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

    def test(self, item: Item, bindings: Bindings) -> bool | None:
        """Whether an item holds; None while it has open variables."""
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
    """The same as `match`, except that `_` in the given term fits anything and binds nothing."""
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
