"""The instances of a rule that follow when one of its conditions has just become possible.

The other conditions are met in an order decided once (`chains`). The checker's own, like the rest of its Datalog.
"""

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import count
from typing import NamedTuple

from cellwright.engine.stages.validation.chains import Chain, Slots
from cellwright.engine.stages.validation.ordering import in_order
from cellwright.engine.stages.validation.tables import Row, Table, Tables
from cellwright.kb.model.conditions import Body, Literal
from cellwright.kb.model.domain import Rule
from cellwright.kb.terms import ANYTHING, Atom, Function, Term, Variable, substitute_atom, variables


class Made(NamedTuple):
    """An instance of a rule: its head, and the numbers of what it needs. An excluded atom that is not ground stands for all that match."""

    head: Row
    needs: tuple[int, ...]
    excludes: tuple[Atom, ...]


class Join:
    """One condition of a rule and the other ones. `older` are those of the others that come before it in the rule and can change.

    If one of these is new as well, the same instance is found there. Without a condition there are instances from the start.
    """

    def __init__(
        self, rule: Rule, condition: Atom | None, others: Body, older: Iterable[Atom], tables: Tables
    ) -> None:
        """`others` are in order, and nothing that can change is denied among them: the rule says what an instance excludes."""
        chain = Chain(tables)
        self.head = _table(rule.head, tables)
        self.table = _table(condition, tables) if condition is not None else None
        self._write = chain.first(condition) if condition is not None else None
        for part in others:
            chain.meet(part)
        changing = [p for p in rule.body if isinstance(p, Literal) and p.atom.name in tables.dynamic]
        atoms = [part.atom for part in changing if part.positive]
        self._head = chain.row(rule.head)
        self._needs = [(_table(each, tables), chain.row(each)) for each in atoms]
        self._excludes = [(p.atom, chain.values(p.atom)) for p in changing if not p.positive]
        self._older = [(_table(each, tables), chain.row(each)) for each in older]
        self._run, self._start = chain.to(self._note), chain.start
        self._new: Collection[int] = ()
        self._found: list[Made] = []

    def instances(self, fresh: Sequence[Row], new: Collection[int]) -> list[Made]:
        """The instances in which the condition is one of some fresh rows; `new` are the numbers of all atoms that are fresh."""
        self._new, self._found = new, []
        slots = self._start.copy()
        if self._write is None:
            self._run(slots)
        else:
            for row in fresh:
                if self._write(row, slots):
                    self._run(slots)
        return self._found

    def _note(self, slots: Slots) -> None:
        for table, row in self._older:
            if table.numbers[row(slots)] in self._new:
                return
        needs = tuple([table.numbers[row(slots)] for table, row in self._needs])
        excludes = tuple([substitute_atom(atom, values(slots)) for atom, values in self._excludes])
        self._found.append(Made(self._head(slots), needs, excludes))


def joins(rule: Rule, tables: Tables) -> list[Join]:
    """A join for each condition of a rule that can change; if there is none, one without a condition."""
    rule = _named(rule)
    body = [p for p in rule.body if not (isinstance(p, Literal) and not p.positive and _changes(p, tables))]
    changing = {at: p.atom for at, p in enumerate(body) if isinstance(p, Literal) and _changes(p, tables)}
    if not changing:
        return [Join(rule, None, in_order(tuple(body), ()), (), tables)]
    return [
        Join(
            rule,
            atom,
            in_order((*body[:at], *body[at + 1 :]), variables(atom)),
            [other for place, other in changing.items() if place < at],
            tables,
        )
        for at, atom in changing.items()
    ]


def _named(rule: Rule) -> Rule:
    """A rule whose positive conditions have no `_`, but a variable each time: an instance says all that it needs."""
    names = (Variable(f"_some{number}") for number in count())
    return replace(
        rule,
        body=tuple(
            Literal(_open(p.atom, names)) if isinstance(p, Literal) and p.positive else p for p in rule.body
        ),
    )


def _open(atom: Atom, names: Iterator[Variable]) -> Atom:
    """An atom with the next names in place of each `_`."""
    if ANYTHING not in variables(atom):
        return atom
    arguments: list[Term] = []
    for each in atom.arguments:
        inside = _open(each, names) if isinstance(each, Function) else each
        arguments.append(next(names) if each == ANYTHING else inside)
    return Function(atom.name, tuple(arguments))


def _table(atom: Atom, tables: Tables) -> Table:
    return tables.table(atom.name, len(atom.arguments))


def _changes(part: Literal, tables: Tables) -> bool:
    return part.atom.name in tables.dynamic
