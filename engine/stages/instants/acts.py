"""The starts and ends of the steps of a plan with times: what each reads and changes, and which
exclude each other.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction

from cellwright.engine.stages.instants.condition_values import (
    Bindings,
    Moments,
    NoValue,
    numbers_in,
)
from cellwright.kb.model.conditions import Literal
from cellwright.kb.model.durative import (
    DurativeAction,
    Moment,
    NumericChange,
    TimedChange,
    TimedEffect,
    TimedStep,
)
from cellwright.kb.terms import Atom, Function, Term, Variable, substitute_atom

ADDITIVE = ("increase", "decrease")


@dataclass
class Act:
    """A step of a plan with its action.

    `held` says which conditions of effects have held so far.
    """

    number: int
    step: TimedStep
    action: DurativeAction
    bindings: dict[Variable, Term]
    held: dict[tuple[int, int, Moment], bool] = field(default_factory=dict)

    def __str__(self) -> str:
        return f"step {self.number} {self.step.action}"

    def choices(self, moments: Moments) -> Iterator[tuple[int, int, TimedEffect, Bindings]]:
        """Each effect with each binding of its own parameters, and their places."""
        for place, effect in enumerate(self.action.effects):
            for number, own in enumerate(moments.bindings(effect.parameters, self.bindings)):
                yield place, number, effect, own

    def notice(self, moments: Moments, moment: Moment) -> None:
        """Note whether the conditions of effects hold at a moment."""
        for place, number, effect, own in self.choices(moments):
            for timed in effect.when:
                if timed.moment is moment:
                    key = (place, number, moment)
                    holds = moments.broken(timed.condition, own, self.step.duration) is None
                    self.held[key] = self.held.get(key, True) and holds

    def happens(self, place: int, number: int, effect: TimedEffect) -> bool:
        """Whether all conditions of an effect have held at their moments."""
        return all(self.held.get((place, number, timed.moment), True) for timed in effect.when)


@dataclass
class Instant:
    """What one start, end or timed change reads and does."""

    time: Fraction
    act: Act | None
    moment: Moment
    atoms_read: set[Atom] = field(default_factory=set)
    numbers_read: set[Function] = field(default_factory=set)
    adds: set[Atom] = field(default_factory=set)
    deletes: set[Atom] = field(default_factory=set)
    updates: list[tuple[str, Function, Fraction]] = field(default_factory=list)
    lacks: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        if self.act is None:
            return "a timed change"
        if self.act.action.instantaneous:
            return str(self.act)
        return f"the {'start' if self.moment is Moment.START else 'end'} of {self.act}"

    def conflict(self, other: "Instant") -> str:
        """What two instants exclude each other by (definition 12 of PDDL 2.1); empty if they
        may be together.
        """
        for one, two in ((self, other), (other, self)):
            touched = one.atoms_read & (two.adds | two.deletes) or one.adds & two.deletes
            if touched:
                return str(min(touched, key=str))
            changed = {number for _, number, _ in two.updates}
            if numbers := one.numbers_read & changed:
                return str(min(numbers, key=str))
        mine = {number for kind, number, _ in self.updates if kind not in ADDITIVE}
        theirs = {number for kind, number, _ in other.updates if kind not in ADDITIVE}
        all_mine, all_theirs = ({number for _, number, _ in each.updates} for each in (self, other))
        both = (mine & all_theirs) | (theirs & all_mine)
        return str(min(both, key=str)) if both else ""


def instant_of(act: Act, moment: Moment, time: Fraction, moments: Moments) -> Instant:
    """One end of a step in a state: what it reads and does there."""
    instant = Instant(time, act, moment)
    for timed in act.action.conditions:
        if timed.moment is moment:
            _note(instant, moments.read(timed.condition, act.bindings))
    for limit in act.action.limits if moment is Moment.START else ():
        instant.numbers_read.update(numbers_in(limit.amount, act.bindings))
    for place, number, effect, own in act.choices(moments):
        for timed in (each for each in effect.when if each.moment is moment):
            _note(instant, moments.read(timed.condition, own))
        if effect.moment is moment and act.happens(place, number, effect):
            _change(instant, effect.change, own, moments, act.step.duration)
    return instant


def timed_instant(changes: list[TimedChange], moments: Moments) -> Instant:
    """What happens by itself at one time."""
    instant = Instant(changes[0].at, None, Moment.START)
    for change in changes:
        _change(instant, change.change, {}, moments, Fraction(0))
    return instant


def _note(instant: Instant, read: Iterator[tuple[str, Function]]) -> None:
    for kind, ground in read:
        (instant.atoms_read if kind == "atom" else instant.numbers_read).add(ground)


def _change(
    instant: Instant,
    change: Literal | NumericChange,
    own: Bindings,
    moments: Moments,
    duration: Fraction,
) -> None:
    if isinstance(change, Literal):
        atom = substitute_atom(change.atom, own)
        (instant.adds if change.positive else instant.deletes).add(atom)
        return
    instant.numbers_read.update(numbers_in(change.amount, own))
    ground = substitute_atom(change.fluent, own)
    try:
        instant.updates.append((change.kind, ground, moments.amount(change.amount, own, duration)))
    except NoValue as lack:
        instant.lacks.append(str(lack))
