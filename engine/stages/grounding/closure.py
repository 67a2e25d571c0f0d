"""Deduction over numbered atoms: what follows when atoms are added or denied (language, Meaning 3)."""

from dataclasses import dataclass

from cellwright.engine.model.task import Bits, bitset, indices
from cellwright.engine.stages.grounding.consequences import consequences
from cellwright.engine.stages.grounding.program import Vocabulary
from cellwright.engine.stages.grounding.universe import Universe
from cellwright.kb.model.domain import Domain

Closure = tuple[Bits, Bits]


@dataclass(frozen=True, slots=True)
class Deduction:
    """The consequences of each atom, by atom number.

    `implied` and `denied` are what follows, over any number of rules, when the atom becomes true.
    `implied_if_denied` and `denied_if_denied` are what follows directly when the atom is denied.
    """

    implied: tuple[Bits, ...]
    denied: tuple[Bits, ...]
    implied_if_denied: tuple[Bits, ...]
    denied_if_denied: tuple[Bits, ...]

    def close(self, adds: Bits, true_before: Bits, deletes: Bits = 0) -> Closure:
        """The least fixpoint (Add, Del) of the atoms `adds` and the explicitly deleted atoms `deletes`.

        `deletes` is not part of the Del that is returned. A denied or deleted atom triggers `not` rules only
        if it is in `true_before`.
        """
        added, deleted = self._spread(adds)
        fired = 0
        while triggers := (deleted | deletes) & true_before & ~fired:
            fired |= triggers
            for atom in indices(triggers):
                deleted |= self.denied_if_denied[atom]
                more, denied = self._spread(self.implied_if_denied[atom])
                added, deleted = added | more, deleted | denied
        return added, deleted

    def has_rules(self) -> bool:
        """Whether any atom has consequences."""
        trivial = all(mask == 1 << atom for atom, mask in enumerate(self.implied))
        return not trivial or any(self.denied) or bool(self.triggers())

    def triggers(self) -> Bits:
        """The atoms whose denial has consequences."""
        pairs = zip(self.implied_if_denied, self.denied_if_denied, strict=True)
        return bitset([atom for atom, (implied, denied) in enumerate(pairs) if implied or denied])

    def _spread(self, adds: Bits) -> Closure:
        added = deleted = 0
        for atom in indices(adds):
            added |= self.implied[atom]
            deleted |= self.denied[atom]
        return added, deleted


def deduction(domain: Domain, vocabulary: Vocabulary, universe: Universe) -> Deduction:
    """The deductive operators of `domain`, evaluated over the atoms of `universe`."""
    direct = consequences(domain, vocabulary, universe)
    implied = _transitive(direct[(True, True)])
    own_denied = direct[(True, False)]
    denied = [_union(own_denied, reached) for reached in implied]
    return Deduction(
        tuple(implied), tuple(denied), tuple(direct[(False, True)]), tuple(direct[(False, False)])
    )


def _union(masks: list[Bits], over: Bits) -> Bits:
    found = 0
    for index in indices(over):
        found |= masks[index]
    return found


def _transitive(direct: list[Bits]) -> list[Bits]:
    """For each atom everything that it implies, directly or over other atoms; the atom itself is included."""
    closed = []
    for atom, implied in enumerate(direct):
        reached, frontier = 1 << atom, implied & ~(1 << atom)
        while frontier:
            reached |= frontier
            frontier = _union(direct, frontier) & ~reached
        closed.append(reached)
    return closed
