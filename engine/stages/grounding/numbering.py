"""Numbers for signed atoms.

A negative condition on atom p becomes a positive condition on the complementary atom `not(p)`. So does one on a derived atom
that is not replaced by its definition.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

from cellwright.engine.model.task import Bits, ConditionalEffect, GroundOperator, bitset, indices

DERIVED = (
    1 << 29
)  # the first number of a derived atom, which gets a bit only if needed; clingo's numbers have 32 bits


@dataclass
class Numbering:
    """The numbers of atoms and complementary atoms.

    Fluents keep their numbers. The complementary atom of a fluent, a derived atom and its complementary atom get numbers from
    `size` on when they are first needed; `added` has them by their signed numbers.
    """

    size: int
    complements: dict[int, int] = field(default_factory=dict)
    added: dict[int, int] = field(default_factory=dict)
    _negated: Bits = 0

    def bits(self, support: Iterable[int]) -> Bits:
        """The bitset of a set of signed numbers."""
        return bitset([each if 0 <= each < DERIVED else self.number(each) for each in support])

    def number(self, signed: int) -> int:
        """The number of a signed atom."""
        if 0 <= signed < DERIVED:
            return signed
        number = self.added.get(signed)
        if number is None:
            number = self.added[signed] = self.size + len(self.added)
            if -DERIVED <= signed < 0:
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


def complemented(operator: GroundOperator, numbering: Numbering) -> GroundOperator:
    """The operator with effects on complementary atoms.

    All complementary atoms must have their numbers already.
    """
    if not numbering.complements:
        return operator
    adds, deletes = numbering.kept(operator.adds, operator.deletes)
    if adds == operator.adds and deletes == operator.deletes and not operator.conditional:
        return operator
    conditional = tuple(_completed(effect, operator.adds, numbering) for effect in operator.conditional)
    return replace(operator, adds=adds, deletes=deletes, conditional=conditional)


def _completed(effect: ConditionalEffect, added: Bits, numbering: Numbering) -> ConditionalEffect:
    """The conditional effect with its effects on complementary atoms.

    It does not delete what the operator adds unconditionally.
    """
    adds, deletes = numbering.kept(effect.adds, effect.deletes & ~added)
    return ConditionalEffect(effect.condition, adds, deletes, numbering.complements_of(effect.adds))
