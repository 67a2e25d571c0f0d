"""Deduction over numbered atoms: what adding or denying an atom adds and denies (language reference, Meaning 3)."""

from dataclasses import dataclass

from engine.grounding.program import Vocabulary, consequence_body, numbered, rule
from engine.grounding.universe import Universe
from engine.model.task import Bits, bitset, indices
from kb.asp import Table
from kb.model.domain import Domain

Closure = tuple[Bits, Bits]


@dataclass(frozen=True, slots=True)
class Deduction:
    """Per atom: what its becoming true implies and denies, transitively; the same for its being denied."""

    implied: tuple[Bits, ...]
    denied: tuple[Bits, ...]
    implied_if_denied: tuple[Bits, ...]
    denied_if_denied: tuple[Bits, ...]

    def close(self, adds: Bits, true_before: Bits, deletes: Bits = 0) -> Closure:
        """The least fixpoint of (Add, Del) from `adds` and explicit `deletes`, which are not part of the Del returned.

        A denied or deleted atom triggers `not` rules only if it is in `true_before`.
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
        """Whether anything follows from anything."""
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
    rules: dict[str, tuple[str, int]] = {}
    kinds: dict[str, tuple[bool, bool]] = {}
    for number, operator in enumerate(domain.deductive_operators):
        if operator.trigger.atom.name in vocabulary.events:
            continue
        for place, consequence in enumerate(operator.consequences):
            name = f"_c_{number}_{place}"
            body = [
                numbered(operator.trigger.atom, "Trigger__"),
                numbered(consequence.atom, "Consequence__"),
                *consequence_body(operator, consequence),
            ]
            rules[name] = (f"#defined {name}/2. " + rule(f"{name}(Trigger__, Consequence__)", body), 2)
            kinds[name] = (operator.trigger.positive, consequence.implied)
    tables = universe.tables(rules)
    size = len(universe.atoms)

    def masks(wanted: tuple[bool, bool]) -> list[Bits]:
        found = [0] * size
        for name, table in tables.items():
            if kinds[name] == wanted:
                _collect(found, table)
        return found

    implied = _transitive(masks((True, True)))
    own_denied = masks((True, False))
    denied = [_union(own_denied, reached) for reached in implied]
    return Deduction(tuple(implied), tuple(denied), tuple(masks((False, True))), tuple(masks((False, False))))


def _collect(masks: list[Bits], table: Table) -> None:
    """OR each row's second number into the mask of its first; rows come sorted."""
    start = 0
    triggers = table[:, 0].tolist() if len(table) else []
    others = table[:, 1].tolist() if len(table) else []
    while start < len(triggers):
        end = start
        while end < len(triggers) and triggers[end] == triggers[start]:
            end += 1
        masks[triggers[start]] |= bitset(others[start:end])
        start = end


def _union(masks: list[Bits], over: Bits) -> Bits:
    found = 0
    for index in indices(over):
        found |= masks[index]
    return found


def _transitive(direct: list[Bits]) -> list[Bits]:
    """Each atom with everything it implies, itself included."""
    closed = []
    for atom, implied in enumerate(direct):
        reached, frontier = 1 << atom, implied & ~(1 << atom)
        while frontier:
            reached |= frontier
            frontier = _union(direct, frontier) & ~reached
        closed.append(reached)
    return closed
