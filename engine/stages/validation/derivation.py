"""Derived atoms of many states: rules are instantiated once, semi-naively, over all fluents that were ever seen, and then
evaluated in each state by counting what their instances still miss.

The checker's own: it shares no code with grounding or search.
"""

from collections.abc import Collection, Iterable, Sequence, Set
from dataclasses import dataclass, field

from cellwright.engine.stages.validation.datalog import solve
from cellwright.engine.stages.validation.facts import Facts
from cellwright.engine.stages.validation.joins import Join, joins
from cellwright.engine.stages.validation.tables import Row, Table, Tables
from cellwright.kb.model.conditions import StateAggregate, literals
from cellwright.kb.model.domain import Rule
from cellwright.kb.terms import Atom, is_ground, match, substitute_atom


@dataclass
class _Stratum:
    """The rules of predicates that depend on one another, and their instances.

    The head of an instance follows where all that it needs is true and all that it excludes is false. Atoms are numbers of `tables`.
    """

    tables: Tables
    counting: Sequence[Rule]  # those with aggregates, which are evaluated in each state
    heads: frozenset[str]  # the predicates
    joins: Sequence[Join]
    read: Sequence[str]  # the predicates of what instances need
    followers: list[int] = field(default_factory=list)  # the head of each instance
    counts: list[int] = field(default_factory=list)  # how many atoms each instance needs
    excludes: list[tuple[Atom, ...]] = field(default_factory=list)
    free: list[int] = field(default_factory=list)  # the instances that need none
    users: dict[int | None, list[int]] = field(default_factory=dict)
    known: set[tuple[int, tuple[int, ...], tuple[Atom, ...]]] = field(default_factory=set)

    def keep(self, head: int, needs: tuple[int, ...], excludes: tuple[Atom, ...]) -> None:
        """Keep an instance of a rule, once."""
        if (head, needs, excludes) in self.known:
            return
        self.known.add((head, needs, excludes))
        distinct = dict.fromkeys(needs)
        for atom in distinct:
            self.users.setdefault(atom, []).append(len(self.counts))
        if not distinct:
            self.free.append(len(self.counts))
        self.followers.append(head)
        self.counts.append(len(distinct))
        self.excludes.append(excludes)


class Derivation:
    """The rules of a domain in strata, over static facts; `dynamic` are the predicates that can change.

    A state that has atoms which no state before had makes more instances of rules.
    """

    def __init__(self, strata: Iterable[Sequence[Rule]], statics: Facts, dynamic: Collection[str]) -> None:
        self._tables = Tables(statics, dynamic)
        strata = [tuple(rules) for rules in strata]
        self._strata = [_stratum(rules, self._tables) for rules in strata]
        self._started = False
        rules = [rule for each in strata for rule in each]
        heads = frozenset[str]().union(*(each.heads for each in self._strata))
        read = {literal.atom.name for rule in rules for part in rule.body for literal in literals(part)}
        self._read = sorted(name for name in read - heads if name in dynamic)

    def add(self, state: Facts, names: Set[str] | None = None) -> None:
        """Add to a state, which has fluents only, the derived atoms that follow.

        With `names` only those of these predicates, of which all that they depend on are among them, or were added before.
        """
        self._meet(state)
        for place in self._places(names):
            self._fill(place, state, state)

    def bound(self, lower: Facts, upper: Facts, names: Set[str] | None = None) -> None:
        """Add to `lower` what follows in every state between two sets of fluents, and to `upper` what follows in some."""
        self._meet(upper)
        for place in self._places(names):
            self._fill(place, lower, upper)
            self._fill(place, upper, lower)

    def _places(self, names: Set[str] | None) -> list[int]:
        """The places of the strata that have rules of some predicates."""
        every = range(len(self._strata))
        return [each for each in every if names is None or not names.isdisjoint(self._strata[each].heads)]

    def _fill(self, place: int, facts: Facts, judge: Facts) -> None:
        """Add everything that follows by one stratum; `judge` decides what is false."""
        stratum = self._strata[place]
        _spread(stratum, facts, judge)
        while fresh := [head for head in _counted(stratum, facts, judge) if facts.put(head)]:
            new = [number for head in fresh if (number := self._tables.told(head)) is not None]
            for later in self._strata[place:] if new else ():
                new += self._instantiate(later, new)
            _spread(stratum, facts, judge)

    def _meet(self, state: Facts) -> None:
        """Instantiate the rules over fluents that are new."""
        told = self._tables.told
        atoms = (atom for name in self._read for atom in state.extent(name))
        fresh = [number for atom in atoms if (number := told(atom)) is not None]
        if fresh or not self._started:
            for stratum in self._strata:
                fresh += self._instantiate(stratum, fresh)
            self._started = True

    def _instantiate(self, stratum: _Stratum, fresh: Sequence[int]) -> list[int]:
        """Make the instances that have a new atom among what they need. Returns the derived atoms that are new."""
        found: list[int] = []
        waiting = list(fresh)
        if not self._started:
            for each in stratum.joins:
                if each.table is None:
                    found += self._note(stratum, each, (), ())
            waiting += found
        while waiting:
            rows: dict[Table, list[Row]] = {}
            for table, row in map(self._tables.rows.__getitem__, waiting):
                rows.setdefault(table, []).append(row)
            new = frozenset(waiting)
            waiting = []
            for each in stratum.joins:
                if each.table in rows:
                    waiting += self._note(stratum, each, rows[each.table], new)
            found += waiting
        return found

    def _note(self, stratum: _Stratum, join: Join, fresh: Sequence[Row], new: Collection[int]) -> list[int]:
        """Keep the instances of a rule that have one of some new atoms. Returns the heads that are new."""
        heads = []
        for head, needs, excludes in join.instances(fresh, new):
            number, is_new = self._tables.entered(join.head, head)
            if is_new:
                heads.append(number)
            stratum.keep(number, needs, excludes)
        return heads


def _stratum(rules: Sequence[Rule], tables: Tables) -> _Stratum:
    counting = [rule for rule in rules if any(isinstance(part, StateAggregate) for part in rule.body)]
    found = [each for rule in rules if rule not in counting for each in joins(rule, tables)]
    read = sorted({each.table.name for each in found if each.table is not None})
    return _Stratum(tables, counting, frozenset(rule.head.name for rule in rules), found, read)


def _counted(stratum: _Stratum, facts: Facts, judge: Facts) -> list[Atom]:
    """The heads of the rules with aggregates whose bodies are true."""
    return [
        substitute_atom(rule.head, found)
        for rule in stratum.counting
        for found in solve(rule.body, facts, {}, judge)
    ]


def _spread(stratum: _Stratum, facts: Facts, judge: Facts) -> None:
    """Add everything that follows by the instances of one stratum; `judge` decides what is false."""
    users, tables = stratum.users, stratum.tables
    missing, waiting = stratum.counts.copy(), stratum.free.copy()
    for name in stratum.read:
        for atom in facts.extent(name):
            _meet(users.get(tables.numbers.get(atom), ()), missing, waiting)
    done: set[int] = set()
    while waiting:
        each = waiting.pop()
        head = stratum.followers[each]
        if head not in done and not any(_among(atom, judge) for atom in stratum.excludes[each]):
            done.add(head)
            if facts.put(tables.atom(head)):
                _meet(users.get(head, ()), missing, waiting)


def _meet(users: Iterable[int], missing: list[int], waiting: list[int]) -> None:
    """Count a true atom for the instances that need it; those that miss nothing more wait."""
    for user in users:
        missing[user] -= 1
        if not missing[user]:
            waiting.append(user)


def _among(atom: Atom, facts: Facts) -> bool:
    """Whether an atom, or one that matches it, is among facts."""
    if is_ground(atom):
        return atom in facts
    return any(match(atom, other, {}) is not None for other in facts.matching(atom))
