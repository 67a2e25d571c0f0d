"""Derived atoms of many states: rules are instantiated once, semi-naively, over all fluents that were ever seen, and then
evaluated in each state by counting what their instances still miss.

The checker's own: it shares no code with grounding or search.
"""

from collections.abc import Collection, Iterable, Sequence, Set
from dataclasses import dataclass, field

from engine.stages.validation.datalog import Bindings, solve
from engine.stages.validation.facts import Facts
from engine.stages.validation.joins import Join, join
from kb.model.conditions import Body, Literal, StateAggregate, literals
from kb.model.domain import Rule
from kb.terms import Atom, is_ground, match, substitute_atom


@dataclass(frozen=True, slots=True, eq=False)
class Instance:
    """An instance of a rule: `head` follows where all of `needs` are true and all of `excludes` are false.

    An excluded atom that is not ground stands for all atoms that match it.
    """

    head: Atom
    needs: tuple[Atom, ...]
    excludes: tuple[Atom, ...]


@dataclass
class _Stratum:
    """The rules of predicates that depend on one another, and their instances."""

    rules: Sequence[Rule]
    counting: Sequence[Rule]  # those with aggregates, which are evaluated in each state
    heads: frozenset[str]  # the predicates
    joins: Sequence[Join]
    read: Sequence[str]  # the predicates of what instances need
    instances: list[Instance] = field(default_factory=list)
    counts: list[int] = field(default_factory=list)  # how many atoms each instance needs
    free: list[int] = field(default_factory=list)  # the instances that need none
    users: dict[Atom, list[int]] = field(default_factory=dict)
    known: set[tuple[Atom, tuple[Atom, ...], tuple[Atom, ...]]] = field(default_factory=set)

    def keep(self, made: Instance) -> None:
        """Keep an instance of a rule."""
        needs = dict.fromkeys(made.needs)
        for atom in needs:
            self.users.setdefault(atom, []).append(len(self.instances))
        if not needs:
            self.free.append(len(self.instances))
        self.counts.append(len(needs))
        self.instances.append(made)


class Derivation:
    """The rules of a domain in strata, over static facts; `dynamic` are the predicates that can change.

    A state that has atoms which no state before had makes more instances of rules.
    """

    def __init__(self, strata: Iterable[Sequence[Rule]], statics: Facts, dynamic: Collection[str]) -> None:
        self._dynamic = dynamic
        self._strata = [self._stratum(rules) for rules in strata]
        self._possible = Facts((), statics)
        self._started = False
        rules = [rule for each in self._strata for rule in (*each.rules, *each.counting)]
        heads = frozenset[str]().union(*(each.heads for each in self._strata))
        read = {literal.atom.name for rule in rules for part in rule.body for literal in literals(part)}
        self._read = sorted(read - heads)

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
        while fresh := [head for head in _counted(stratum, facts, judge) if facts.add(head)]:
            new = [head for head in fresh if self._possible.add(head)]
            for later in self._strata[place:] if new else ():
                new += self._instantiate(later, new)
            _spread(stratum, facts, judge)

    def _meet(self, state: Facts) -> None:
        """Instantiate the rules over fluents that are new."""
        names = [name for name in self._read if name in self._dynamic]
        fresh = [atom for name in names for atom in state.extent(name) if self._possible.add(atom)]
        if fresh or not self._started:
            for stratum in self._strata:
                fresh += self._instantiate(stratum, fresh)
            self._started = True

    def _instantiate(self, stratum: _Stratum, fresh: Sequence[Atom]) -> list[Atom]:
        """Make the instances that have a new atom among what they need. Returns the derived atoms that are new."""
        found: list[Atom] = []
        waiting = list(fresh)
        if not self._started:
            for rule in stratum.rules:
                body = self._static(rule.body)
                if not any(map(self._changes, body)):
                    found += self._note(stratum, rule, solve(body, self._possible, {}))
            waiting += found
        while waiting:
            by_name: dict[str, list[Atom]] = {}
            for atom in waiting:
                by_name.setdefault(atom.name, []).append(atom)
            new = frozenset(waiting)
            waiting = []
            for each in stratum.joins:
                if of_name := by_name.get(each.condition.name):
                    waiting += self._note(stratum, each.rule, each.bindings(of_name, new, self._possible))
            found += waiting
        return found

    def _note(self, stratum: _Stratum, rule: Rule, found: Iterable[Bindings]) -> list[Atom]:
        """Keep the instances of a rule under some bindings. Returns the heads that are new."""
        fresh = []
        literals = [part for part in rule.body if isinstance(part, Literal) and self._changes(part)]
        for bindings in list(found):
            head = substitute_atom(rule.head, bindings)
            needs = tuple(substitute_atom(part.atom, bindings) for part in literals if part.positive)
            excludes = tuple(substitute_atom(part.atom, bindings) for part in literals if not part.positive)
            if (head, needs, excludes) in stratum.known:
                continue
            stratum.known.add((head, needs, excludes))
            stratum.keep(Instance(head, needs, excludes))
            if self._possible.add(head):
                fresh.append(head)
        return fresh

    def _stratum(self, rules: Sequence[Rule]) -> _Stratum:
        counting = [rule for rule in rules if any(isinstance(part, StateAggregate) for part in rule.body)]
        plain = [rule for rule in rules if rule not in counting]
        heads = frozenset(rule.head.name for rule in rules)
        joins: list[Join] = []
        for rule in plain:
            body = self._static(rule.body)
            places = [place for place, part in enumerate(body) if self._changes(part)]
            joins += [join(rule, body, place, places) for place in places]
        return _Stratum(plain, counting, heads, joins, sorted({each.condition.name for each in joins}))

    def _changes(self, part: object) -> bool:
        return isinstance(part, Literal) and part.atom.name in self._dynamic

    def _static(self, body: Body) -> Body:
        """The conditions without those that something which can change be false."""
        return tuple(p for p in body if not (isinstance(p, Literal) and not p.positive and self._changes(p)))


def _counted(stratum: _Stratum, facts: Facts, judge: Facts) -> list[Atom]:
    """The heads of the rules with aggregates whose bodies are true."""
    return [
        substitute_atom(rule.head, found)
        for rule in stratum.counting
        for found in solve(rule.body, facts, {}, judge)
    ]


def _spread(stratum: _Stratum, facts: Facts, judge: Facts) -> None:
    """Add everything that follows by the instances of one stratum; `judge` decides what is false."""
    missing, waiting = stratum.counts.copy(), stratum.free.copy()
    for name in stratum.read:
        for atom in facts.extent(name):
            _meet(stratum, atom, missing, waiting)
    while waiting:
        each = stratum.instances[waiting.pop()]
        if not any(_among(atom, judge) for atom in each.excludes) and facts.add(each.head):
            _meet(stratum, each.head, missing, waiting)


def _meet(stratum: _Stratum, atom: Atom, missing: list[int], waiting: list[int]) -> None:
    """Count a true atom for the instances that need it; those that miss nothing more wait."""
    for user in stratum.users.get(atom, ()):
        missing[user] -= 1
        if not missing[user]:
            waiting.append(user)


def _among(atom: Atom, facts: Facts) -> bool:
    """Whether an atom, or one that matches it, is among facts."""
    if is_ground(atom):
        return atom in facts
    return any(match(atom, other, {}) is not None for other in facts.matching(atom))
