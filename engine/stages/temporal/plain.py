"""Grounds the actions whose conditions are literals alone: most actions are so, and large tasks
have a hundred thousand instances.

What `grounding` does with formulas is done here with tables: each literal of an action knows, for
the objects of its own arguments, whether it is always true, never true or a fact.
"""

import itertools
from collections.abc import Iterator, Sequence, Set
from dataclasses import dataclass
from fractions import Fraction

from cellwright.engine.model.temporal import CONSTANT, Happening, Program, Span
from cellwright.engine.stages.temporal.formulas import Surroundings
from cellwright.kb.model.conditions import And, Condition, Literal
from cellwright.kb.model.durative import DURATION, DurativeAction, Moment
from cellwright.kb.terms import Atom, Function, Number, Operation, Term, Variable, term_variables

ALWAYS, NEVER = -1, -2
Facts = dict[tuple[Atom, bool], int]
Row = tuple[int, ...]
ZERO: Program = ((CONSTANT, Fraction(0)),)


@dataclass(frozen=True)
class _Template:
    """A literal whose arguments are columns of a row of objects."""

    atom: Atom
    positive: bool
    columns: tuple[int, ...]
    memory: dict[Row, int]
    effects: dict[Row, tuple[int, int]]


class PlainAction:
    """An action with literals alone, and its instances."""

    def __init__(
        self,
        action: DurativeAction,
        around: Surroundings,
        objects: Sequence[Function],
        facts: Facts,
    ) -> None:
        self.action, self.around, self.objects, self.facts = action, around, objects, facts
        self.places = {
            parameter.variable: place for place, parameter in enumerate(action.parameters)
        }
        self.conditions = {
            moment: [self._template(part) for part in _literals(action, moment)]
            for moment in Moment
        }
        self.changes = {
            moment: [
                self._template(e.change)
                for e in action.effects
                if e.moment is moment and isinstance(e.change, Literal)
            ]
            for moment in (Moment.START, Moment.END)
        }
        names = {v for limit in action.limits for v in term_variables(limit.amount)}
        self.length_columns = tuple(sorted(self.places[v] for v in names))
        self.lengths: dict[Row, tuple[Program, Program | None] | None] = {}

    def _template(self, literal: Literal) -> _Template:
        columns = tuple(
            self.places[each] for each in literal.atom.arguments if isinstance(each, Variable)
        )
        return _Template(literal.atom, literal.positive, columns, {}, {})

    def _ground(self, template: _Template, key: Row) -> Atom:
        left = iter(key)
        arguments: list[Term] = [
            self.objects[next(left)] if isinstance(each, Variable) else each
            for each in template.atom.arguments
        ]
        return Function(template.atom.name, tuple(arguments))

    def needs(self, row: Row) -> list[tuple[int, ...]] | None:
        """The facts that an instance needs at its start, throughout and at its end; None if one
        is never true.
        """
        result = []
        for moment in Moment:
            facts = []
            for template in self.conditions[moment]:
                key = tuple([row[column] for column in template.columns])
                fact = template.memory.get(key)
                if fact is None:
                    fact = template.memory[key] = self._fact(template, key)
                if fact == NEVER:
                    return None
                if fact != ALWAYS:
                    facts.append(fact)
            result.append(tuple(sorted(set(facts))))
        return result

    def _fact(self, template: _Template, key: Row) -> int:
        found = self.around.alternatives(
            Literal(self._ground(template, key), template.positive), {}
        )
        if not found:
            return NEVER
        if not found[0].literals:
            return ALWAYS
        (literal,) = found[0].literals
        return self.facts.setdefault(literal, len(self.facts))

    def limits(self, row: Row) -> tuple[Program, Program | None] | None:
        """The limits of the length of an instance; None if they contradict each other or have
        no value.
        """
        key = tuple([row[column] for column in self.length_columns])
        if key not in self.lengths:
            self.lengths[key] = self._limits(row)
        return self.lengths[key]

    def _limits(self, row: Row) -> tuple[Program, Program | None] | None:
        if self.action.instantaneous:
            return ZERO, ZERO
        own: dict[Variable, Term] = {
            v: self.objects[row[place]] for v, place in self.places.items()
        }
        low, high = Fraction(0), None
        for limit in self.action.limits:
            program = self.around.program(limit.amount, own)
            if program is None:
                return None
            value = program[0][1]
            assert isinstance(value, Fraction)
            low = max(low, value) if limit.relation in ("=", ">=") else low
            if limit.relation in ("=", "<="):
                high = value if high is None else min(high, value)
        if high is not None and high < low:
            return None
        return ((CONSTANT, low),), None if high is None else ((CONSTANT, high),)

    def changed_atoms(self, rows: Sequence[Row], names: Set[str]) -> Iterator[tuple[Atom, bool]]:
        """The atoms of some predicates that instances make true or false."""
        for template in itertools.chain.from_iterable(self.changes.values()):
            if template.atom.name in names:
                columns = template.columns
                for key in dict.fromkeys(tuple([row[c] for c in columns]) for row in rows):
                    yield self._ground(template, key), template.positive

    def span(
        self, row: Row, needs: Sequence[tuple[int, ...]], limits: tuple[Program, Program | None]
    ) -> Span:
        """The instance, once all facts are numbered."""
        start, during, end = needs
        name = Function(self.action.name, tuple([self.objects[number] for number in row]))
        return Span(
            name,
            Happening(start, *self._effects(Moment.START, row)),
            Happening(end, *self._effects(Moment.END, row)),
            during,
            (),
            limits[0],
            limits[1],
            self.action.instantaneous,
        )

    def _effects(self, moment: Moment, row: Row) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """What becomes true and what becomes false.

        An atom that is both deleted and added is true afterwards.
        """
        adds, deletes = set(), set()
        for template in sorted(self.changes[moment], key=lambda each: each.positive):
            key = tuple([row[column] for column in template.columns])
            both = template.effects.get(key)
            if both is None:
                atom = self._ground(template, key)
                same = self.facts.get((atom, template.positive), -1)
                opposite = self.facts.get((atom, not template.positive), -1)
                both = template.effects[key] = (same, opposite)
            same, opposite = both
            if same >= 0:
                adds.add(same)
                deletes.discard(same)
            if opposite >= 0:
                deletes.add(opposite)
                adds.discard(opposite)
        return tuple(sorted(adds)), tuple(sorted(deletes))


def is_plain(action: DurativeAction, around: Surroundings) -> bool:
    """Whether an action has only literals, and a length that no effect changes."""
    changing = {fluent.name for fluent in around.numbers}
    if any(e.parameters or e.when or not isinstance(e.change, Literal) for e in action.effects):
        return False
    if not all(_is_plain(each.condition) for each in action.conditions):
        return False
    return not any(
        each.name in changing or each == DURATION
        for limit in action.limits
        for each in _fluents(limit.amount)
    )


def _is_plain(condition: Condition) -> bool:
    if isinstance(condition, And):
        return all(map(_is_plain, condition.parts))
    return isinstance(condition, Literal)


def _literals(action: DurativeAction, moment: Moment) -> Iterator[Literal]:
    for timed in action.conditions:
        if timed.moment is moment:
            yield from _parts(timed.condition)


def _parts(condition: Condition) -> Iterator[Literal]:
    if isinstance(condition, Literal):
        yield condition
    elif isinstance(condition, And):
        for part in condition.parts:
            yield from _parts(part)


def _fluents(term: Term) -> Iterator[Function]:
    if isinstance(term, Function):
        yield term
    elif isinstance(term, Operation):
        yield from _fluents(term.left)
        yield from _fluents(term.right)
    else:
        assert isinstance(term, Number | Variable)
