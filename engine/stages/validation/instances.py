"""What a step is before any state is known: what it needs, holds, takes and changes, as far as its operator alone tells."""

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from cellwright.engine.stages.validation.changes import Denial, StepChange
from cellwright.engine.stages.validation.datalog import Bindings
from cellwright.engine.stages.validation.facts import Facts
from cellwright.kb.arithmetic import evaluate
from cellwright.kb.model.amounts import Amounts
from cellwright.kb.model.conditions import TRUE
from cellwright.kb.model.domain import Kind, Operator
from cellwright.kb.terms import Atom, Term, substitute

Fired = tuple[Atom, bool, bool]
"""An atom that an effect names, whether it is added, and whether as an event it comes but once."""


class Demands(NamedTuple):
    """What a step holds (None for what has no value), how long it lasts, and what it costs."""

    resources: tuple[Term | None, ...]
    duration: int
    cost: int


class Effects(NamedTuple):
    """The effects of a step, in their order: atoms that it adds, those that it denies by itself, and its events."""

    added: tuple[Atom, ...]
    denials: tuple[Denial, ...]
    events: tuple[Atom, ...]


def unconditional(operator: Operator) -> bool:
    """Whether the effects of an operator are the same in all states."""
    return all(each.condition == TRUE and not each.parameters for each in operator.effects)


def demands_of(operator: Operator, bindings: Bindings, amounts: Amounts) -> Demands:
    """The demands of a step. Raises `NoAmount`."""
    held = tuple([evaluate(substitute(each, bindings)) for each in operator.resources])
    return Demands(held, amounts.lasting(operator, bindings), amounts.of(operator.cost, bindings, 1))


def effects_of(fired: Iterable[Fired], kinds: Mapping[str, Kind]) -> Effects:
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
    return Effects(tuple(added), denials, tuple(events))


def as_named(made: Effects, state: Facts) -> StepChange:
    """What effects change where nothing follows from them."""
    adds = frozenset(made.added)
    ends = frozenset([each.pattern for each in made.denials if each.pattern in state])
    return StepChange(adds, ends, made.denials[::-1], events=made.events)
