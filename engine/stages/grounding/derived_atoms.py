"""Derived atoms: replaced by minimal supports over fluents, or kept as axioms of the task.

A support is a set of signed atom numbers: n means "atom n is true", ~n means "atom n is false".
Atoms that depend on each other recursively form a component. The supports of a component are
computed together, as a least fixpoint of antichains. The negation of an atom is computed when its
component is finished (stratification): it is the set of minimal ways to break every support. An
atom with many supports stays as it is: it is then its own support, and
`cellwright.engine.stages.grounding.derived_atoms` keeps its rules.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence

from cellwright.engine.kernels.bits import Bits, indices
from cellwright.engine.model.ground_axioms import Axioms, GroundAxiom
from cellwright.engine.stages.grounding.numbered_atoms import FIRST_DERIVED_NUMBER, Numbering
from cellwright.kb.graphs import strong_components

Support = frozenset[int]
Rules = dict[int, list[tuple[int, ...]]]  # the rule bodies of each derived atom, as signed numbers
MAX_SUPPORTS = 32
MIN_SUPPORTS = 1  # supports of an atom where others stay


class _TooMany(Exception):
    """A condition has more minimal supports than an atom may have."""


def supports_of(derived: Sequence[int], rules: Rules, negated: Iterable[int]) -> "Supports":
    """The supports of derived atoms, some of which are needed `negated`.

    If any has many, all stay but those that are just another name for a condition: then no search
    would gain by the others.
    """
    supports = Supports(derived, rules, MAX_SUPPORTS)
    for atom in negated:
        if not supports.stay:
            supports.of(~atom)
    return Supports(derived, rules, MIN_SUPPORTS) if supports.stay else supports


class Supports:
    """The supports of every derived atom of a problem.

    An atom is computed after the atoms that it depends on. One with more than `most` supports stays
    as it is, and so do more than `most` atoms that depend on one another. The first one that stays
    ends the computation, unless `most` is `LEAST`.
    """

    def __init__(self, derived: Iterable[int], rules: Rules, most: int) -> None:
        self._most = most
        self._masks = _Masks()
        self._supports: dict[int, list[Bits]] = {atom: [] for atom in derived}
        self._broken: dict[int, list[Bits]] = {}
        self.stay = False  # whether some atom stays as it is
        needs: dict[int, list[int]] = {atom: [] for atom in derived}
        for head, bodies in rules.items():
            needs[head] = [
                atom for body in bodies for atom in map(_unsigned_atom, body) if atom in needs
            ]
        for component in strong_components(needs):
            if self.stay and most > MIN_SUPPORTS:
                return
            self._close(sorted(component), rules, needs)

    def of(self, signed: int) -> list[Support]:
        """The minimal ways to make a signed atom hold.

        A fluent supports itself, and so does a derived atom that stays.
        """
        return self._masks.supports(self._of(signed))

    def combinations(self, condition: Iterable[int]) -> list[Support]:
        """The minimal ways to make every signed atom of `condition` hold; the condition itself
        if there are many.
        """
        condition = tuple(condition)
        plain = frozenset(condition)
        if not any(_unsigned_atom(signed) in self._supports for signed in condition):
            return [] if any(~signed in plain for signed in plain) else [plain]
        try:
            return self._masks.supports(self._product([self._of(signed) for signed in condition]))
        except _TooMany:
            return [plain]

    def _of(self, signed: int) -> list[Bits]:
        atom = _unsigned_atom(signed)
        if atom not in self._supports:
            return [self._masks.mask(signed)]
        if signed >= 0:
            return self._supports[atom]
        if atom not in self._broken:
            self._broken[atom] = self._breaking(atom)
        return self._broken[atom]

    def _close(
        self, component: list[int], rules: Rules, needs: Mapping[int, Sequence[int]]
    ) -> None:
        try:
            if len(component) > self._most:  # then most of its atoms have many supports
                raise _TooMany
            self._repeat(component, rules, needs)
        except _TooMany:
            self.stay = True
            self._supports.update({atom: [self._masks.mask(atom)] for atom in component})

    def _repeat(
        self, component: list[int], rules: Rules, needs: Mapping[int, Sequence[int]]
    ) -> None:
        """The least fixpoint. An atom is looked at again when one that it needs has changed."""
        users: dict[int, list[int]] = {atom: [] for atom in component}
        for atom in component:
            for need in needs[atom]:
                if need in users:
                    users[need].append(atom)
        open_ = set(component)
        while open_:
            for atom in component:
                if atom in open_:
                    open_.discard(atom)
                    new_supports = self._supported(atom, rules)
                    if new_supports != self._supports[atom]:
                        self._supports[atom] = new_supports
                        open_.update(users[atom])

    def _supported(self, atom: int, rules: Rules) -> list[Bits]:
        supports = list(self._supports[atom])
        for body in rules.get(atom, []):
            supports.extend(self._product([self._of(signed) for signed in body]))
        return self._few(self._masks.minimal(supports))

    def _breaking(self, atom: int) -> list[Bits]:
        choices = [[self._masks.mask(~signed) for signed in support] for support in self.of(atom)]
        try:
            return self._product(choices)
        except _TooMany:
            self.stay = True
            return [self._masks.mask(~atom)]

    def _product(self, choices: list[list[Bits]]) -> list[Bits]:
        product: list[Bits] = [0]
        for alternatives in choices:
            product = self._few(
                self._masks.minimal(
                    [support | alternative for support in product for alternative in alternatives]
                )
            )
        return product

    def _few(self, supports: list[Bits]) -> list[Bits]:
        if len(supports) > self._most:
            raise _TooMany
        return supports


class _Masks:
    """Supports as bits: each atom that was met has two of them, for true and for false."""

    def __init__(self) -> None:
        self._places: dict[int, int] = {}
        self._signed: list[int] = []  # by bit
        self._firsts = 0  # the lower bits of all atoms

    def mask(self, signed: int) -> Bits:
        """A signed atom as a support."""
        place = self._places.get(signed)
        if place is None:
            place = self._places[signed] = len(self._signed)
            self._places[~signed] = place + 1
            self._signed += [signed, ~signed]
            self._firsts |= 1 << place
        return 1 << place

    def minimal(self, supports: list[Bits]) -> list[Bits]:
        """The consistent supports that contain no smaller consistent support, smallest first."""
        minimal_masks: list[Bits] = []
        for support in sorted(set(supports), key=lambda mask: (mask.bit_count(), mask)):
            if support & support >> 1 & self._firsts:
                continue
            if not any(smaller & support == smaller for smaller in minimal_masks):
                minimal_masks.append(support)
        return minimal_masks

    def supports(self, masks: Iterable[Bits]) -> list[Support]:
        """Supports as sets of signed atoms, in an order that does not depend on when atoms were
        met.
        """
        supports = [frozenset(self._signed[place] for place in indices(mask)) for mask in masks]
        return sorted(supports, key=lambda support: (len(support), sorted(support)))


def _unsigned_atom(signed: int) -> int:
    return signed if signed >= 0 else ~signed


def layer_axioms(
    rules: Rules, numbering: Numbering, compares: Callable[[int], bool]
) -> Axioms | None:
    """The axioms of all derived atoms that have numbers, and of those that they depend on; None if
    there are none.

    Where an atom has to be false, all that breaks its rules gets numbers, too. An atom that
    `compares` quantities has no rules.
    """
    waiting = [signed for signed in numbering.added if _is_derived(signed)]
    if not waiting:
        return None
    seen = set(waiting)
    while waiting:
        signed = waiting.pop()
        needed = _needed_atoms(signed, rules)
        numbering.bits(needed)
        more = {atom: None for atom in needed if _is_derived(atom) and atom not in seen}
        seen.update(more)
        waiting += more
    ruled = [
        atom
        for signed in numbering.added
        if _is_derived(signed) and not compares(atom := _axiom_atom(signed))
    ]
    return _assemble_axioms(rules, numbering, set(ruled)) if ruled else None


def _needed_atoms(signed: int, rules: Rules) -> list[int]:
    """What has to have a number because a derived atom has to be true, or false."""
    if signed >= 0:
        return [atom for body in rules.get(signed, ()) for atom in body]
    return [~signed, *(~atom for body in rules.get(~signed, ()) for atom in body)]


def _assemble_axioms(rules: Rules, numbering: Numbering, kept_atoms: set[int]) -> Axioms:
    numbers = {atom: numbering.number(atom) for atom in sorted(kept_atoms)}
    needs = {
        atom: [
            _axiom_atom(e)
            for body in rules.get(atom, ())
            for e in body
            if _axiom_atom(e) in kept_atoms
        ]
        for atom in numbers
    }
    axiom_list: list[GroundAxiom] = []
    layers: dict[int, int] = {}
    for layer, component in enumerate(strong_components(needs)):
        for atom in sorted(component):
            layers[numbers[atom]] = layer
            axiom_list += [
                GroundAxiom(numbers[atom], numbering.bits(body)) for body in rules.get(atom, ())
            ]
    return Axioms(
        numbering.size + len(numbering.added),
        tuple(dict.fromkeys(axiom_list)),
        layers,
        _complement_numbers(numbering),
    )


def _complement_numbers(numbering: Numbering) -> Mapping[int, int]:
    return {
        numbering.number(~signed): number
        for signed, number in list(numbering.added.items())
        if signed < 0
    }


def _is_derived(signed: int) -> bool:
    return _axiom_atom(signed) >= FIRST_DERIVED_NUMBER


def _axiom_atom(signed: int) -> int:
    return signed if signed >= 0 else ~signed
