"""Derived atoms of many states: rules instantiated once, semi-naively, over all fluents seen.

The checker's own: it shares no code with grounding or search.
"""

from collections.abc import Collection, Iterable, Sequence, Set
from dataclasses import dataclass, field

from cellwright.engine.stages.validation.atom_tables import AtomTable, AtomTables, Row
from cellwright.engine.stages.validation.checker_facts import CheckerFacts
from cellwright.engine.stages.validation.condition_joins import RuleJoin, make_joins
from cellwright.engine.stages.validation.condition_solving import solve_conditions
from cellwright.kb.model.conditions import StateAggregate, literals_in
from cellwright.kb.model.domain_model import Rule
from cellwright.kb.terms import Atom, is_ground, match_term, substitute_atom


@dataclass
class _Stratum:
    """The rules of predicates that depend on one another, and their instances.

    The head of an instance follows where all that it needs is true and all that it excludes is
    false. Atoms are numbers of `tables`.
    """

    tables: AtomTables
    counting: Sequence[Rule]  # those with aggregates, which are evaluated in each state
    heads: frozenset[str]  # the predicates
    joins: Sequence[RuleJoin]
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


class RuleDerivation:
    """The rules of a domain in strata, over static facts; `dynamic` are the predicates that can
    change.

    A state that has atoms which no state before had makes more instances of rules.
    """

    def __init__(
        self, strata: Iterable[Sequence[Rule]], statics: CheckerFacts, dynamic: Collection[str]
    ) -> None:
        self._tables = AtomTables(statics, dynamic)
        strata = [tuple(rules) for rules in strata]
        self._strata = [_make_stratum(rules, self._tables) for rules in strata]
        self._started = False
        rules = [rule for stratum in strata for rule in stratum]
        heads = frozenset[str]().union(*(stratum.heads for stratum in self._strata))
        read = {
            literal.atom.name
            for rule in rules
            for part in rule.body
            for literal in literals_in(part)
        }
        self._read = sorted(name for name in read - heads if name in dynamic)

    def add(self, state: CheckerFacts, names: Set[str] | None = None) -> None:
        """Add to a state, which has fluents only, the derived atoms that follow.

        With `names` only those of these predicates, of which all that they depend on are among
        them, or were added before.
        """
        self._meet(state)
        for place in self._places(names):
            self._fill(place, state, state)

    def bound(
        self, lower: CheckerFacts, upper: CheckerFacts, names: Set[str] | None = None
    ) -> None:
        """Add to `lower` what follows in every state between two sets of fluents, and to
        `upper` what follows in some.
        """
        self._meet(upper)
        for place in self._places(names):
            self._fill(place, lower, upper)
            self._fill(place, upper, lower)

    def _places(self, names: Set[str] | None) -> list[int]:
        """The places of the strata that have rules of some predicates."""
        every = range(len(self._strata))
        return [
            place
            for place in every
            if names is None or not names.isdisjoint(self._strata[place].heads)
        ]

    def _fill(self, place: int, facts: CheckerFacts, judge: CheckerFacts) -> None:
        """Add everything that follows by one stratum; `judge` decides what is false."""
        stratum = self._strata[place]
        _spread_facts(stratum, facts, judge)
        while fresh := [
            head for head in _aggregate_heads(stratum, facts, judge) if facts.put(head)
        ]:
            new = [number for head in fresh if (number := self._tables.told(head)) is not None]
            for later in self._strata[place:] if new else ():
                new += self._instantiate(later, new)
            _spread_facts(stratum, facts, judge)

    def _meet(self, state: CheckerFacts) -> None:
        """Instantiate the rules over fluents that are new."""
        number_of = self._tables.told
        atoms = (atom for name in self._read for atom in state.extent(name))
        fresh = [number for atom in atoms if (number := number_of(atom)) is not None]
        if fresh or not self._started:
            for stratum in self._strata:
                fresh += self._instantiate(stratum, fresh)
            self._started = True

    def _instantiate(self, stratum: _Stratum, fresh: Sequence[int]) -> list[int]:
        """Make the instances that have a new atom among what they need.

        Returns the derived atoms that are new.
        """
        numbers: list[int] = []
        waiting = list(fresh)
        if not self._started:
            for join in stratum.joins:
                if join.table is None:
                    numbers += self._note(stratum, join, (), ())
            waiting += numbers
        while waiting:
            rows: dict[AtomTable, list[Row]] = {}
            for table, row in map(self._tables.rows.__getitem__, waiting):
                rows.setdefault(table, []).append(row)
            new = frozenset(waiting)
            waiting = []
            for join_entry in stratum.joins:
                if join_entry.table in rows:
                    waiting += self._note(stratum, join_entry, rows[join_entry.table], new)
            numbers += waiting
        return numbers

    def _note(
        self, stratum: _Stratum, join: RuleJoin, fresh: Sequence[Row], new: Collection[int]
    ) -> list[int]:
        """Keep the instances of a rule that have one of some new atoms.

        Returns the heads that are new.
        """
        heads = []
        for head, needs, excludes in join.instances(fresh, new):
            number, is_new = self._tables.entered(join.head, head)
            if is_new:
                heads.append(number)
            stratum.keep(number, needs, excludes)
        return heads


def _make_stratum(rules: Sequence[Rule], tables: AtomTables) -> _Stratum:
    counting = [
        rule for rule in rules if any(isinstance(part, StateAggregate) for part in rule.body)
    ]
    stratum_joins = [
        join for rule in rules if rule not in counting for join in make_joins(rule, tables)
    ]
    read = sorted({join.table.name for join in stratum_joins if join.table is not None})
    return _Stratum(
        tables, counting, frozenset(rule.head.name for rule in rules), stratum_joins, read
    )


def _aggregate_heads(stratum: _Stratum, facts: CheckerFacts, judge: CheckerFacts) -> list[Atom]:
    """The heads of the rules with aggregates whose bodies are true."""
    return [
        substitute_atom(rule.head, bindings)
        for rule in stratum.counting
        for bindings in solve_conditions(rule.body, facts, {}, judge)
    ]


def _spread_facts(stratum: _Stratum, facts: CheckerFacts, judge: CheckerFacts) -> None:
    """Add everything that follows by the instances of one stratum; `judge` decides what is
    false.
    """
    users, tables = stratum.users, stratum.tables
    missing, waiting = stratum.counts.copy(), stratum.free.copy()
    for name in stratum.read:
        for atom in facts.extent(name):
            _count_met(users.get(tables.numbers.get(atom), ()), missing, waiting)
    done: set[int] = set()
    while waiting:
        number = waiting.pop()
        head = stratum.followers[number]
        if head not in done and not any(
            _is_among(atom, judge) for atom in stratum.excludes[number]
        ):
            done.add(head)
            if facts.put(tables.atom(head)):
                _count_met(users.get(head, ()), missing, waiting)


def _count_met(users: Iterable[int], missing: list[int], waiting: list[int]) -> None:
    """Count a true atom for the instances that need it; those that miss nothing more wait."""
    for user in users:
        missing[user] -= 1
        if not missing[user]:
            waiting.append(user)


def _is_among(atom: Atom, facts: CheckerFacts) -> bool:
    """Whether an atom, or one that matches it, is among facts."""
    if is_ground(atom):
        return atom in facts
    return any(match_term(atom, fact, {}) is not None for fact in facts.matching(atom))
