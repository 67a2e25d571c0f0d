"""Looks facts up by the arguments that are known, and goes on with each that matches."""

from collections.abc import Callable
from typing import NamedTuple

from cellwright.engine.stages.validation.facts import Facts
from cellwright.engine.stages.validation.scope import Scope
from cellwright.engine.stages.validation.sums import Slots
from cellwright.kb.terms import ANYTHING, Atom, Term, Variable, is_ground

Next = Callable[[Facts, Slots], bool]
"""Goes on with what is known; tells whether to stop."""
Link = Callable[[Next], Next]
Matching = Callable[[Facts, Slots], list[Atom]]
Pairs = list[tuple[int, int]]


class Unprepared(Exception):
    """A condition is of a kind that is not prepared."""


class Pattern(NamedTuple):
    """What facts are looked up: the places of arguments that are known and of those that become known, and equal arguments."""

    name: str
    arity: int
    known: Pairs
    new: Pairs
    same: Pairs
    own: int | None  # the place of the fact itself


def looked_up(atom: Atom, scope: Scope) -> Link:
    """Each fact that matches an atom, in the order of `Facts.matching`. Raises `Unprepared` for patterns inside arguments."""
    known, new, same = Pairs(), dict[Term, int](), Pairs()
    for at, each in enumerate(atom.arguments):
        if each in new:
            same.append((at, new[each]))
        elif is_ground(each) or each in scope.places:
            known.append((at, scope.place(each)))
        elif not isinstance(each, Variable):
            raise Unprepared
        elif each != ANYTHING:
            new[each] = at
    places = [(at, scope.place(each)) for each, at in new.items()]
    own = scope.place(atom) if ANYTHING not in atom.arguments else None
    pattern = Pattern(atom.name, len(atom.arguments), known, places, same, own)
    return _matched(pattern, scope.kept((pattern.name, pattern.arity, tuple(known), tuple(same))))


def _matched(pattern: Pattern, kept: int | None) -> Link:
    matching, new, own = _matching(pattern), pattern.new, pattern.own
    if kept is not None:
        matching = _once(matching, kept)

    def link(go_on: Next) -> Next:
        def step(facts: Facts, slots: Slots) -> bool:
            for atom in matching(facts, slots):
                for at, place in new:
                    slots[place] = atom.arguments[at]
                if own is not None:
                    slots[own] = atom
                if go_on(facts, slots):
                    return True
            return False

        return step

    return link


def _matching(pattern: Pattern) -> Matching:
    """The function that gives the facts that match."""
    name, arity, known, _, same, _ = pattern

    def found(facts: Facts, slots: Slots) -> list[Atom]:
        wanted = [(at, slots[place]) for at, place in known]
        if not wanted:
            atoms = [each for each in facts.having(name, wanted) if len(each.arguments) == arity]
        else:
            at, value = wanted[0]
            atoms = [
                each
                for each in facts.having(name, wanted)
                if len(own := each.arguments) == arity and (own[at] is value or own[at] == value)
            ]
        for at, value in wanted[1:]:
            atoms = [each for each in atoms if each.arguments[at] == value]
        for at, other in same:
            atoms = [each for each in atoms if each.arguments[at] == each.arguments[other]]
        return atoms

    return found


def _once(matching: Matching, kept: int) -> Matching:
    """The same, which looks once for all conditions of a step that ask for it."""

    def once(facts: Facts, slots: Slots) -> list[Atom]:
        if slots[kept] is None:
            slots[kept] = matching(facts, slots)
        return slots[kept]  # type: ignore[no-any-return]

    return once
