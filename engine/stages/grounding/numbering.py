"""Numbers for signed atoms.

A negative condition on atom p becomes a positive condition on the complementary atom `not(p)`.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

from engine.model.task import Bits, ConditionalEffect, GroundOperator, bitset, indices


@dataclass
class Numbering:
    """The numbers of atoms and complementary atoms.

    Fluents keep their numbers. The complementary atom of a fluent gets a number from `size` on when it is
    first needed.
    """

    size: int
    complements: dict[int, int] = field(default_factory=dict)
    _negated: Bits = 0

    def bits(self, support: Iterable[int]) -> Bits:
        """The bitset of a set of signed numbers."""
        return bitset([signed if signed >= 0 else self.complement(~signed) for signed in support])

    def complement(self, atom: int) -> int:
        """The number of the complementary atom of `atom`."""
        number = self.complements.get(atom)
        if number is None:
            number = self.complements[atom] = self.size + len(self.complements)
            self._negated |= 1 << atom
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
