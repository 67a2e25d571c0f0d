"""What a step changes: the atoms that it adds and ends, and the denials that end them."""

from dataclasses import dataclass

from cellwright.engine.stages.validation.datalog import Bindings, solve
from cellwright.engine.stages.validation.facts import Facts
from cellwright.kb.model.conditions import Body
from cellwright.kb.model.domain import Consequence
from cellwright.kb.terms import Atom, Term, Variable, match

State = frozenset[Atom]


@dataclass(frozen=True, slots=True)
class Denial:
    """The atoms that match `pattern` under `body` become false.

    A step may not add an atom that a `deduced` denial denies. A denial without `consequence` comes from no
    deductive operator. Its pattern is one ground atom.
    """

    pattern: Atom
    body: Body = ()
    bindings: tuple[tuple[Variable, Term], ...] = ()
    consequence: Consequence | None = None
    deduced: bool = True

    def among(self, facts: Facts, statics: Facts) -> list[Atom]:
        """The atoms among `facts` that this denies."""
        if self.consequence is None:
            return [self.pattern] if self.pattern in facts else []
        return [atom for atom in facts.named(self.pattern.name) if self.matches(atom, statics)]

    def matches(self, atom: Atom, statics: Facts) -> bool:
        """Whether this denies `atom`."""
        if self.consequence is None:
            return atom == self.pattern
        if atom.name != self.pattern.name:
            return False
        found = match(self.pattern, atom, dict(self.bindings))
        if found is None or not well_typed(self.consequence, found, statics):
            return False
        return not self.body or next(solve(self.body, statics, found), None) is not None


@dataclass(frozen=True, slots=True)
class StepChange:
    """What a step does in one state: the atoms that it adds, the atoms of that state that end, and all that
    it denies.
    """

    adds: State
    ends: State
    denials: tuple[Denial, ...]
    triggered: State = frozenset()  # denied atoms whose end had consequences
    contradiction: Atom | None = None
    events: tuple[Atom, ...] = ()


def well_typed(consequence: Consequence, bindings: Bindings, statics: Facts) -> bool:
    """Whether the values that the parameters of a consequence have are of their types."""
    return all(
        statics.has_type(bindings[parameter.variable], parameter.type)
        for parameter in consequence.parameters
        if parameter.variable in bindings
    )
