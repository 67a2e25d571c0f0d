"""Joins of rule conditions over tables: instances that follow from a newly possible one.

Variables and constants have places in one list of numbers. The checker's own, like the rest of its
Datalog.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import count
from typing import NamedTuple

from cellwright.engine.stages.validation.atom_tables import AtomTable, AtomTables, Row, pick_places
from cellwright.engine.stages.validation.condition_solving import (
    bound_variables,
    order_body,
    solve_conditions,
)
from cellwright.kb.model.conditions import Body, BodyPart, Literal
from cellwright.kb.model.domain_model import Rule
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Function,
    Term,
    Variable,
    is_ground,
    match_term,
    substitute_atom,
    substitute_term,
    term_variables,
)

Slots = list[int]
Next = Callable[[Slots], None]
Link = Callable[[Next], Next]
Values = Callable[[dict[Variable, Term]], Iterator[Sequence[Term]]]
Pairs = list[tuple[int, int]]


class RowLayout(NamedTuple):
    """Pairs of a place in a row and a place in the list: what is known before, what becomes
    known, and what that has to equal.
    """

    known: Pairs
    new: Pairs
    same: Pairs


class ConditionChain:
    """Conditions in the order in which they are added."""

    def __init__(self, tables: AtomTables) -> None:
        self.tables = tables
        self.start: Slots = []  # what is in the places at first
        self._places: dict[
            Term, int
        ] = {}  # of constants, and of variables that have values when all links are met
        self._links: list[Link] = []
        self._names = (Variable(f"_{number}") for number in count())

    def to(self, last: Next) -> Next:
        """A function that meets all conditions, and does the last thing for each way to do so."""
        for link in reversed(self._links):
            last = link(last)
        return last

    def first(self, atom: Atom) -> Callable[[Row, Slots], bool]:
        """A function that writes a row to the places, and tells whether it may match an atom.

        The chain goes on from there.
        """
        simple, inside = self._simplified(atom)
        known_places, new, same = self._layout(simple)
        self._take_apart(inside)

        def write(row: Row, slots: Slots) -> bool:
            for at, place in new:
                slots[place] = row[at]
            return all(row[at] == slots[place] for at, place in (*known_places, *same))

        return write

    def meet(self, part: BodyPart) -> None:
        """Meet a literal or a comparison.

        What is no positive literal is decided by facts that never change.
        """
        if isinstance(part, Literal) and part.positive:
            simple, inside = self._simplified(part.atom)
            table = self.tables.table(part.atom.name, len(simple))
            self._links.append(_looked_up(table, self._layout(simple)))
            self._take_apart(inside)
        else:
            new = [
                variable
                for variable in dict.fromkeys(bound_variables(part))
                if variable not in self._places
            ]

            def values(bindings: dict[Variable, Term]) -> Iterator[Sequence[Term]]:
                for solution in solve_conditions((part,), self.tables.statics, bindings):
                    yield [solution[variable] for variable in new]

            self._compute(
                [variable for variable in _part_variables(part) if variable in self._places],
                new,
                values,
            )

    def row(self, atom: Atom) -> Callable[[Slots], Row]:
        """The function that gives the arguments of an atom whose variables have values."""
        simple, _ = self._simplified(atom)
        return pick_places([place for _, place in self._layout(simple).known])

    def values(self, atom: Atom) -> Callable[[Slots], dict[Variable, Term]]:
        """The function that gives the values of those variables of an atom that have any."""
        places = {
            variable: self._places[variable]
            for variable in term_variables(atom)
            if variable in self._places
        }
        terms = self.tables.terms
        return lambda slots: {variable: terms[slots[place]] for variable, place in places.items()}

    def _simplified(self, atom: Atom) -> tuple[list[Term], list[tuple[Variable, Term]]]:
        """An atom's arguments with variables in place of compound terms, and those of which
        parts are unknown yet.
        """
        simple: list[Term] = []
        inside: list[tuple[Variable, Term]] = []
        for argument in atom.arguments:
            if argument != ANYTHING and (isinstance(argument, Variable) or is_ground(argument)):
                simple.append(argument)
                continue
            simple.append(name := next(self._names))
            if all(part in self._places for part in term_variables(argument)):
                self._put_together(name, argument)
            elif isinstance(argument, Function):
                inside.append((name, argument))
        return simple, inside

    def _put_together(self, name: Variable, pattern: Term) -> None:
        self._compute(
            list(term_variables(pattern)),
            [name],
            lambda known: iter([[substitute_term(pattern, known)]]),
        )

    def _take_apart(self, inside: Sequence[tuple[Variable, Term]]) -> None:
        """Match the values of some variables with patterns."""
        for name, pattern in inside:
            named = [
                variable
                for variable in dict.fromkeys(term_variables(pattern))
                if variable != ANYTHING
            ]
            new = [variable for variable in named if variable not in self._places]

            def values(
                known: dict[Variable, Term],
                name: Variable = name,
                pattern: Term = pattern,
                new: Sequence[Variable] = new,
            ) -> Iterator[Sequence[Term]]:
                match_bindings = match_term(pattern, known[name], known)
                if match_bindings is not None:
                    yield [match_bindings[variable] for variable in new]

            self._compute(
                [name, *(variable for variable in named if variable in self._places)], new, values
            )

    def _layout(self, simple: Sequence[Term]) -> RowLayout:
        """The places of simple arguments; from now on all have values."""
        layout, before = RowLayout([], [], []), set(self._places)
        for at, variable in enumerate(simple):
            if variable in self._places:
                (layout.known if variable in before else layout.same).append(
                    (at, self._places[variable])
                )
            else:
                constant = not isinstance(variable, Variable)
                self._places[variable] = len(self.start)
                self.start.append(self.tables.term(variable) if constant else -1)
                (layout.known if constant else layout.new).append((at, self._places[variable]))
                if constant:
                    before.add(variable)
        return layout

    def _compute(self, inputs: Sequence[Variable], new: Sequence[Variable], values: Values) -> None:
        """Go on with all values that some variables can have.

        Given ones alone decide that, so it is remembered.
        """
        terms, number = self.tables.terms, self.tables.term
        inputs = list(dict.fromkeys(inputs))
        key = pick_places([self._places[variable] for variable in inputs])
        places = [place for _, place in self._layout(new).new]

        def value_pairs(row: Row) -> list[Pairs]:
            bindings = {
                variable: terms[term_number]
                for variable, term_number in zip(inputs, row, strict=True)
            }
            return [
                list(zip(places, map(number, new_terms), strict=True))
                for new_terms in values(bindings)
            ]

        self._links.append(_remember_link(key, value_pairs))


def _part_variables(part: BodyPart) -> Iterator[Variable]:
    """The variables of a literal or a comparison."""
    terms = (part.atom,) if isinstance(part, Literal) else (part.left, part.right)  # type: ignore[union-attr]
    return (variable for term in terms for variable in term_variables(term))


def _looked_up(table: AtomTable, layout: RowLayout) -> Link:
    known_places, new, same = layout
    if not new:
        return _test_link(table, pick_places([place for _, place in known_places]))
    key = pick_places([place for _, place in known_places])
    index = table.index(tuple([at for at, _ in known_places]))

    def link(then: Next) -> Next:
        def step(slots: Slots) -> None:
            for row in index.get(key(slots), ()):
                for at, place in new:
                    slots[place] = row[at]
                if not same or all(row[at] == slots[place] for at, place in same):
                    then(slots)

        return step

    return link


def _test_link(table: AtomTable, key: Callable[[Slots], Row]) -> Link:
    has = table.has

    def link(then: Next) -> Next:
        def step(slots: Slots) -> None:
            if has(key(slots)):
                then(slots)

        return step

    return link


def _remember_link(key: Callable[[Slots], Row], values: Callable[[Row], list[Pairs]]) -> Link:
    cache: dict[Row, list[Pairs]] = {}

    def link(then: Next) -> Next:
        def step(slots: Slots) -> None:
            row = key(slots)
            rows = cache.get(row)
            if rows is None:
                rows = cache[row] = values(row)
            for pairs in rows:
                for place, value in pairs:
                    slots[place] = value
                then(slots)

        return step

    return link


class RuleInstance(NamedTuple):
    """An instance of a rule: its head, and the numbers of what it needs.

    An excluded atom that is not ground stands for all that match.
    """

    head: Row
    needs: tuple[int, ...]
    excludes: tuple[Atom, ...]


class RuleJoin:
    """One condition of a rule and the other ones. `older` are those of the others that come before
    it in the rule and can change.

    If one of these is new as well, the same instance is found there. Without a condition there are
    instances from the start.
    """

    def __init__(
        self,
        rule: Rule,
        condition: Atom | None,
        other_parts: Body,
        older: Iterable[Atom],
        tables: AtomTables,
    ) -> None:
        """`others` are in order, and nothing that can change is denied among them: the rule
        says what an instance excludes.
        """
        chain = ConditionChain(tables)
        self.head = _atom_table(rule.head, tables)
        self.table = _atom_table(condition, tables) if condition is not None else None
        self._write = chain.first(condition) if condition is not None else None
        for part in other_parts:
            chain.meet(part)
        changing = [
            p for p in rule.body if isinstance(p, Literal) and p.atom.name in tables.dynamic
        ]
        atoms = [part.atom for part in changing if part.positive]
        self._head = chain.row(rule.head)
        self._needs = [(_atom_table(atom, tables), chain.row(atom)) for atom in atoms]
        self._excludes = [(p.atom, chain.values(p.atom)) for p in changing if not p.positive]
        self._older = [(_atom_table(atom, tables), chain.row(atom)) for atom in older]
        self._run, self._start = chain.to(self._note), chain.start
        self._new: Collection[int] = ()
        self._found: list[RuleInstance] = []

    def instances(self, fresh: Sequence[Row], new: Collection[int]) -> list[RuleInstance]:
        """The instances in which the condition is one of some fresh rows; `new` are the numbers
        of all atoms that are fresh.
        """
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
        self._found.append(RuleInstance(self._head(slots), needs, excludes))


def make_joins(rule: Rule, tables: AtomTables) -> list[RuleJoin]:
    """A join for each condition of a rule that can change; if there is none, one without a
    condition.
    """
    rule = _name_variables(rule)
    body = [
        p
        for p in rule.body
        if not (isinstance(p, Literal) and not p.positive and _can_change(p, tables))
    ]
    changing = {
        at: p.atom for at, p in enumerate(body) if isinstance(p, Literal) and _can_change(p, tables)
    }
    if not changing:
        return [RuleJoin(rule, None, order_body(tuple(body), ()), (), tables)]
    return [
        RuleJoin(
            rule,
            atom,
            order_body((*body[:at], *body[at + 1 :]), term_variables(atom)),
            [atom for place, atom in changing.items() if place < at],
            tables,
        )
        for at, atom in changing.items()
    ]


def _name_variables(rule: Rule) -> Rule:
    """A rule whose positive conditions have no `_`, but a variable each time: an instance says
    all that it needs.
    """
    names = (Variable(f"_some{number}") for number in count())
    return replace(
        rule,
        body=tuple(
            Literal(_name_open(p.atom, names)) if isinstance(p, Literal) and p.positive else p
            for p in rule.body
        ),
    )


def _name_open(atom: Atom, names: Iterator[Variable]) -> Atom:
    """An atom with the next names in place of each `_`."""
    if ANYTHING not in term_variables(atom):
        return atom
    arguments: list[Term] = []
    for argument in atom.arguments:
        inside = _name_open(argument, names) if isinstance(argument, Function) else argument
        arguments.append(next(names) if argument == ANYTHING else inside)
    return Function(atom.name, tuple(arguments))


def _atom_table(atom: Atom, tables: AtomTables) -> AtomTable:
    return tables.table(atom.name, len(atom.arguments))


def _can_change(part: Literal, tables: AtomTables) -> bool:
    return part.atom.name in tables.dynamic
