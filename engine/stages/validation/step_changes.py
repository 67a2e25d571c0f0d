"""Changes of a step in the checker: what its operator alone tells, and what follows by
deduction.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

from cellwright.engine.stages.validation.checker_facts import CheckerFacts
from cellwright.engine.stages.validation.condition_solving import Bindings, solve_conditions
from cellwright.kb.arithmetic import evaluate_term
from cellwright.kb.model.conditions import ALWAYS_TRUE, Body, Literal
from cellwright.kb.model.domain_model import Consequence, DeductiveOperator, Kind, Operator
from cellwright.kb.model.operator_amounts import Amounts
from cellwright.kb.terms import (
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

State = frozenset[Atom]


@dataclass(frozen=True, slots=True)
class Denial:
    """The atoms that match `pattern` under `body` become false.

    A step may not add an atom that a `deduced` denial denies. A denial without `consequence` comes
    from no deductive operator. Its pattern is one ground atom.
    """

    pattern: Atom
    body: Body = ()
    bindings: tuple[tuple[Variable, Term], ...] = ()
    consequence: Consequence | None = None
    deduced: bool = True

    def among(self, facts: CheckerFacts, statics: CheckerFacts) -> list[Atom]:
        """The atoms among `facts` that this denies."""
        if self.consequence is None:
            return [self.pattern] if self.pattern in facts else []
        values = dict(self.bindings)
        known = [
            (place, term)
            for place, argument in enumerate(self.pattern.arguments)
            if is_ground(term := substitute_term(argument, values))
        ]
        return [
            atom for atom in facts.having(self.pattern.name, known) if self.matches(atom, statics)
        ]

    def matches(self, atom: Atom, statics: CheckerFacts) -> bool:
        """Whether this denies `atom`."""
        if self.consequence is None:
            return atom == self.pattern
        if atom.name != self.pattern.name:
            return False
        match_bindings = match_term(self.pattern, atom, dict(self.bindings))
        if match_bindings is None or not well_typed(self.consequence, match_bindings, statics):
            return False
        return (
            not self.body
            or next(solve_conditions(self.body, statics, match_bindings), None) is not None
        )


@dataclass(frozen=True, slots=True)
class CheckedChange:
    """What a step does in one state: the atoms that it adds, the atoms of that state that end, and
    all that it denies.
    """

    adds: State
    ends: State
    denials: tuple[Denial, ...]
    triggered: State = frozenset()  # denied atoms whose end had consequences
    contradiction: Atom | None = None
    events: tuple[Atom, ...] = ()


def well_typed(consequence: Consequence, bindings: Bindings, statics: CheckerFacts) -> bool:
    """Whether the values that the parameters of a consequence have are of their types."""
    return all(
        statics.has_type(bindings[parameter.variable], parameter.type)
        for parameter in consequence.parameters
        if parameter.variable in bindings
    )


Fired = tuple[Atom, bool, bool]
"""An atom that an effect names, whether it is added, and whether as an event it comes but once."""


class StepDemands(NamedTuple):
    """What a step holds (None for what has no value), how long it lasts, and what it costs."""

    resources: tuple[Term | None, ...]
    duration: int
    cost: int


class StepEffects(NamedTuple):
    """The effects of a step, in their order: atoms that it adds, those that it denies by
    itself, and its events.
    """

    added: tuple[Atom, ...]
    denials: tuple[Denial, ...]
    events: tuple[Atom, ...]


def has_unconditional_effects(operator: Operator) -> bool:
    """Whether the effects of an operator are the same in all states."""
    return all(
        effect.condition == ALWAYS_TRUE and not effect.parameters for effect in operator.effects
    )


def demands_of(operator: Operator, bindings: Bindings, amounts: Amounts) -> StepDemands:
    """The demands of a step. Raises `NoAmount`."""
    resources = tuple(
        [evaluate_term(substitute_term(resource, bindings)) for resource in operator.resources]
    )
    return StepDemands(
        resources, amounts.lasting(operator, bindings), amounts.of(operator.cost, bindings, 1)
    )


def effects_of(fired: Iterable[Fired], kinds: Mapping[str, Kind]) -> StepEffects:
    """Effects from atoms in the order in which they are named."""
    added: list[Atom] = []
    explicit: list[Atom] = []
    events: list[Atom] = []
    for atom, adds, once in fired:
        if kinds.get(atom.name) is Kind.EVENT:
            if atom not in events or not once:
                events.append(atom)
        else:
            (added if adds else explicit).append(atom)
    denials = tuple([Denial(atom, deduced=False) for atom in explicit if atom not in added])
    return StepEffects(tuple(added), denials, tuple(events))


def as_named(step_effects: StepEffects, state: CheckerFacts) -> CheckedChange:
    """What effects change where nothing follows from them."""
    adds = frozenset(step_effects.added)
    ends = frozenset([denial.pattern for denial in step_effects.denials if denial.pattern in state])
    return CheckedChange(adds, ends, step_effects.denials[::-1], events=step_effects.events)


MAX_REMEMBERED_ATOMS = 1 << 14  # atoms, and steps

K = TypeVar("K")
V = TypeVar("V")


class AtomConsequences(NamedTuple):
    """What is added, and what is denied."""

    added: tuple[Atom, ...]
    denied: tuple[Denial, ...]

    def __bool__(self) -> bool:
        return bool(self.added or self.denied)


class StaticDeductions:
    """The deductive operators of a domain, over static facts.

    `where` replaces bodies that clingo has evaluated.
    """

    def __init__(
        self,
        operators: Iterable[DeductiveOperator],
        statics: CheckerFacts,
        where: Mapping[Body, Body],
    ) -> None:
        self._triggers: dict[tuple[str, bool], list[DeductiveOperator]] = defaultdict(list)
        for operator in operators:
            self._triggers[operator.trigger.atom.name, operator.trigger.positive].append(operator)
        self._statics, self._where = statics, where
        self._known: dict[tuple[Atom, bool], AtomConsequences] = {}
        self.none = not self._triggers

    def of(self, atom: Atom, positive: bool) -> AtomConsequences:
        """What follows if an atom is added, or else ends, directly."""
        key = atom, positive
        consequences = self._known.get(key)
        return (
            consequences
            if consequences is not None
            else remember_value(self._known, key, self._follows(atom, positive))
        )

    def _follows(self, atom: Atom, positive: bool) -> AtomConsequences:
        added: list[Atom] = []
        denied: list[Denial] = []
        for deductive in self._triggers.get((atom.name, positive), ()):
            bindings = match_term(deductive.trigger.atom, atom, {})
            if bindings is None:
                continue
            for consequence in deductive.consequences:
                body = (*deductive.body, *consequence.body)
                body = self._where.get(body, body)
                if consequence.implied:
                    added += self._implied(consequence, body, bindings)
                elif well_typed(consequence, bindings, self._statics):
                    denied.append(
                        Denial(consequence.atom, body, tuple(bindings.items()), consequence)
                    )
        return AtomConsequences(tuple(added), tuple(denied))

    def _implied(self, consequence: Consequence, body: Body, bindings: Bindings) -> Iterator[Atom]:
        open_ = {
            variable for variable in term_variables(consequence.atom) if variable not in bindings
        }
        typed = tuple(
            Literal(Function(p.type, (p.variable,)))
            for p in consequence.parameters
            if p.variable in open_
        )
        for solution in solve_conditions((*typed, *body), self._statics, bindings):
            if well_typed(consequence, solution, self._statics):
                yield substitute_atom(consequence.atom, solution)


def remember_value(known: dict[K, V], key: K, value: V) -> V:
    """A value that is remembered from now on. When too many are, all are forgotten."""
    if len(known) >= MAX_REMEMBERED_ATOMS:
        known.clear()
    known[key] = value
    return value
