"""What a condition rests on in a state: the fluents that make it true, through the rules of derived predicates.

A condition is asked for, and rules answer it: only what it needs is looked at. That a state is completed with all its derived
atoms first (`with_derived`) is needed only for rules that build on themselves, or that leave an argument open.
"""

from collections.abc import Iterable, Iterator

from cellwright.engine.stages.macros.lifted.bodies import Bindings, satisfiable, solve
from cellwright.engine.stages.macros.lifted.facts import Facts
from cellwright.engine.stages.macros.lifted.world import CellDomain, holds, with_derived
from cellwright.kb.model.conditions import Body, Literal
from cellwright.kb.terms import Atom, Function, is_ground, match, substitute_atom


class _Open(Exception):
    """A derived atom with an open argument is asked for."""


def support(body: Body, world: CellDomain, facts: Facts, bindings: Bindings) -> tuple[Atom, ...] | None:
    """The fluents that make a body true in a state, as `not(...)` where they must be false; None if it is not true.

    Where rules build on themselves, only the fluents that the body names itself are told.
    """
    if not world.schemas.is_recursive():
        try:
            return _first(body, world, facts, bindings)
        except _Open:
            pass
    if not holds(body, world, with_derived(world, facts), bindings):
        return None
    named = tuple(p for p in body if world.schemas.is_dynamic(p) and not world.schemas.rests_on_rules((p,)))
    return _first(named, world, facts, bindings)


def _first(body: Body, world: CellDomain, facts: Facts, bindings: Bindings) -> tuple[Atom, ...] | None:
    """What the first binding that makes a body true rests on."""
    literals = [part for part in body if isinstance(part, Literal) and world.schemas.is_dynamic(part)]
    static = tuple(part for part in body if part not in literals)
    derived = tuple(each for each in literals if world.schemas.is_derived(each.atom))
    held = tuple(each for each in literals if each.positive and each not in derived)
    absent = tuple(each for each in literals if not each.positive and each not in derived)
    for first in solve(held, facts, bindings):
        for found in solve(static, world.statics, first):
            if not satisfiable(absent, facts, found):
                continue
            below = _through_rules(derived, world, facts, found)
            if below is not None:
                return (*_atoms(held, found), *_negated(_atoms(absent, found)), *below)
    return None


def _through_rules(
    derived: Iterable[Literal], world: CellDomain, facts: Facts, bindings: Bindings
) -> tuple[Atom, ...] | None:
    """What derived conditions rest on together; None if one of them is not as it should be."""
    together: list[Atom] = []
    for each in derived:
        atom = substitute_atom(each.atom, bindings)
        if not is_ground(atom):
            raise _Open
        proof = _proof(atom, world, facts)
        if (proof is None) == each.positive:
            return None
        together += proof or ()
    return tuple(together)


def _proof(atom: Atom, world: CellDomain, facts: Facts) -> tuple[Atom, ...] | None:
    for rule in world.schemas.rules:
        if rule.head.name == atom.name and (bound := match(rule.head, atom, {})) is not None:
            found = _first(rule.body, world, facts, dict(bound))
            if found is not None:
                return found
    return None


def _atoms(literals: Iterable[Literal], bindings: Bindings) -> Iterator[Atom]:
    return (substitute_atom(each.atom, bindings) for each in literals)


def _negated(atoms: Iterable[Atom]) -> Iterator[Atom]:
    return (Function("not", (atom,)) for atom in atoms)
