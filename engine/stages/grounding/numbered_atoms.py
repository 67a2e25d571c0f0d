"""Numbered atoms: the reachable atoms of a problem, their signed numbers, and tables of numbers.

A negative condition on atom p becomes a positive condition on the complementary atom `not(p)`. So
does one on a derived atom that is not replaced by its definition.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

from cellwright.engine.kernels.bits import Bits, bitset, indices
from cellwright.engine.model.ground_task import ConditionalEffect, GroundOperator
from cellwright.engine.stages.grounding.grounding_program import (
    ChangingPredicates,
    numbered_literal,
)
from cellwright.kb.asp import Grounder
from cellwright.kb.asp.integer_tables import IntegerTable
from cellwright.kb.terms import Atom, Function, Term

FIRST_DERIVED_NUMBER = (
    1 << 29
    # the first number of a derived atom, which gets a bit only if needed; clingo's numbers have 32
    # bits
)


@dataclass
class Numbering:
    """The numbers of atoms and complementary atoms.

    Fluents keep their numbers. The complementary atom of a fluent, a derived atom and its
    complementary atom get numbers from `size` on when they are first needed; `added` has them by
    their signed numbers.
    """

    size: int
    complements: dict[int, int] = field(default_factory=dict)
    added: dict[int, int] = field(default_factory=dict)
    _negated: Bits = 0

    def bits(self, support: Iterable[int]) -> Bits:
        """The bitset of a set of signed numbers."""
        return bitset(
            [atom if 0 <= atom < FIRST_DERIVED_NUMBER else self.number(atom) for atom in support]
        )

    def number(self, signed: int) -> int:
        """The number of a signed atom."""
        if 0 <= signed < FIRST_DERIVED_NUMBER:
            return signed
        number = self.added.get(signed)
        if number is None:
            number = self.added[signed] = self.size + len(self.added)
            if -FIRST_DERIVED_NUMBER <= signed < 0:
                self.complements[~signed] = number
                self._negated |= 1 << ~signed
        return number

    def complements_of(self, atoms: Bits) -> Bits:
        """The complementary atoms of those atoms that have one."""
        return bitset([self.complements[atom] for atom in indices(atoms & self._negated)])

    def kept(self, adds: Bits, deletes: Bits) -> tuple[Bits, Bits]:
        """The added and deleted atoms, with the effects on complementary atoms.

        An added atom deletes its complementary atom, and a deleted atom adds it.
        """
        if not (adds | deletes) & self._negated:
            return adds, deletes
        return adds | self.complements_of(deletes & ~adds), deletes | self.complements_of(adds)


def complement_effects(operator: GroundOperator, numbering: Numbering) -> GroundOperator:
    """The operator with effects on complementary atoms.

    All complementary atoms must have their numbers already.
    """
    if not numbering.complements:
        return operator
    adds, deletes = numbering.kept(operator.adds, operator.deletes)
    if adds == operator.adds and deletes == operator.deletes and not operator.conditional:
        return operator
    conditional = tuple(
        _complete_effect(effect, operator.adds, numbering) for effect in operator.conditional
    )
    return replace(operator, adds=adds, deletes=deletes, conditional=conditional)


def _complete_effect(
    effect: ConditionalEffect, added: Bits, numbering: Numbering
) -> ConditionalEffect:
    """The conditional effect with its effects on complementary atoms.

    It does not delete what the operator adds unconditionally.
    """
    adds, deletes = numbering.kept(effect.adds, effect.deletes & ~added)
    return ConditionalEffect(effect.condition, adds, deletes, numbering.complements_of(effect.adds))


class Universe:
    """The atoms that can become true, ordered by number, and the terms in operator headers.

    `atoms` are the fluents. `derived` are the derived atoms; their numbers begin at `DERIVED`.
    """

    def __init__(
        self, grounder: Grounder, vocabulary: ChangingPredicates, invented: dict[str, int]
    ) -> None:
        self._grounder = grounder
        self.atoms: list[Atom] = []
        self.derived: list[Atom] = []
        predicates = vocabulary.domain.predicates
        arities = {
            name: len(predicates[name].arguments)
            for name in predicates
            if vocabulary.is_dynamic(name)
        }
        for name, arity in {**arities, **invented}.items():
            predicate_atoms = grounder.atoms(f"_r_{name}", arity)
            part = self.derived if name in vocabulary.derived else self.atoms
            part.extend(
                sorted((Function(name, arguments) for arguments in predicate_atoms), key=str)
            )
        self.index: dict[Atom, int] = {atom: number for number, atom in enumerate(self.atoms)}
        self.index.update(
            (atom, FIRST_DERIVED_NUMBER + number) for number, atom in enumerate(self.derived)
        )
        facts = (f"{numbered_fact(atom, number)}." for atom, number in self.index.items())
        declared = (
            f"#defined _i_{name}/{arity + 1}." for name, arity in {**arities, **invented}.items()
        )
        grounder.ground("\n".join((*declared, *facts)))
        self.terms: list[Term] = []
        self._derived = vocabulary.derived

    def facts(self, name: str, arity: int) -> list[tuple[Term, ...]]:
        """The arguments of every fact of a static predicate."""
        return self._grounder.atoms(name, arity)

    def derive(self, atom: Atom) -> int:
        """The number of one more derived atom."""
        self.derived.append(atom)
        return FIRST_DERIVED_NUMBER + len(self.derived) - 1

    def atom(self, number: int) -> Atom:
        """The fluent or derived atom that has a number."""
        return (
            self.derived[number - FIRST_DERIVED_NUMBER]
            if number >= FIRST_DERIVED_NUMBER
            else self.atoms[number]
        )

    def names(self, bits: Bits) -> tuple[Atom, ...]:
        """The fluents in a bitset."""
        return tuple(self.atoms[number] for number in indices(bits))

    def is_derived(self, atom: Atom) -> bool:
        """Whether the atom's predicate is derived."""
        return atom.name in self._derived

    def name_terms(self, rules: Iterable[str]) -> None:
        """Numbers the terms that `rules` collect in `_arg`, as facts `_a(term, number)`."""
        self._grounder.ground("\n".join(rules))
        self.terms = [arguments[0] for arguments in self._grounder.atoms("_arg", 1)]
        self._grounder.ground(
            "\n".join(f"_a({term},{number})." for number, term in enumerate(self.terms))
        )

    def tables(self, rules: dict[str, tuple[str, int]]) -> dict[str, IntegerTable]:
        """The rows of each predicate.

        `rules` has the text of its rules and its arity; they are grounded first.
        """
        self._grounder.ground("\n".join(text for text, _ in rules.values()))
        return self._grounder.tables({name: arity for name, (_, arity) in rules.items()})

    def number(self, rules: Iterable[str], arities: Mapping[str, int]) -> None:
        """Grounds rules and numbers the true atoms of each predicate p.

        The numbers are facts `p_number(arguments, number)`.
        """
        if not arities:
            return
        self._grounder.ground("\n".join(rules))
        facts = [f"#defined {name}_number/{arity + 1}." for name, arity in arities.items()]
        for name, arity in arities.items():
            for number, key in enumerate(sorted(self._grounder.atoms(name, arity), key=str)):
                facts.append(f"{name}_number({', '.join(map(str, (*key, number)))}).")
        self._grounder.ground("\n".join(facts))


def numbered_fact(atom: Atom, number: int) -> str:
    """The text of the fact `_i_p(arguments, number)` for a ground atom."""
    return (
        numbered_literal(atom, "N").replace(", N)", f", {number})")
        if atom.arguments
        else f"_i_{atom.name}({number})"
    )
