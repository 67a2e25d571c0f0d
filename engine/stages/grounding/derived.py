"""Derived predicates are compiled away where that is small: a derived atom is replaced by its minimal supports over fluents.

A support is a set of signed atom numbers: n means "atom n is true", ~n means "atom n is false". Atoms that
depend on each other recursively form a component. The supports of a component are computed together, as a
least fixpoint of antichains. The negation of an atom is computed when its component is finished
(stratification): it is the set of minimal ways to break every support. An atom with many supports stays as it is: it is
then its own support, and `cellwright.engine.stages.grounding.layers` keeps its rules.
"""

from collections.abc import Iterable, Mapping, Sequence

from cellwright.engine.kernels.bits import Bits, indices
from cellwright.kb.graphs import components

Support = frozenset[int]
Rules = dict[int, list[tuple[int, ...]]]  # the rule bodies of each derived atom, as signed numbers
MAX_SUPPORTS = 32
LEAST = 1  # supports of an atom where others stay


class _TooMany(Exception):
    """A condition has more minimal supports than an atom may have."""


def supports_of(derived: Sequence[int], rules: Rules, negated: Iterable[int]) -> "Supports":
    """The supports of derived atoms, some of which are needed `negated`.

    If any has many, all stay but those that are just another name for a condition: then no search would gain by the others.
    """
    found = Supports(derived, rules, MAX_SUPPORTS)
    for atom in negated:
        if not found.stay:
            found.of(~atom)
    return Supports(derived, rules, LEAST) if found.stay else found


class Supports:
    """The supports of every derived atom of a problem.

    An atom is computed after the atoms that it depends on. One with more than `most` supports stays as it is, and so do more
    than `most` atoms that depend on one another. The first one that stays ends the computation, unless `most` is `LEAST`.
    """

    def __init__(self, derived: Iterable[int], rules: Rules, most: int) -> None:
        self._most = most
        self._masks = _Masks()
        self._supports: dict[int, list[Bits]] = {atom: [] for atom in derived}
        self._broken: dict[int, list[Bits]] = {}
        self.stay = False  # whether some atom stays as it is
        needs: dict[int, list[int]] = {atom: [] for atom in derived}
        for head, bodies in rules.items():
            needs[head] = [atom for body in bodies for atom in map(_atom, body) if atom in needs]
        for component in components(needs):
            if self.stay and most > LEAST:
                return
            self._close(sorted(component), rules, needs)

    def of(self, signed: int) -> list[Support]:
        """The minimal ways to make a signed atom hold. A fluent supports itself, and so does a derived atom that stays."""
        return self._masks.supports(self._of(signed))

    def combinations(self, condition: Iterable[int]) -> list[Support]:
        """The minimal ways to make every signed atom of `condition` hold; the condition itself if there are many."""
        condition = tuple(condition)
        plain = frozenset(condition)
        if not any(_atom(signed) in self._supports for signed in condition):
            return [] if any(~signed in plain for signed in plain) else [plain]
        try:
            return self._masks.supports(self._product([self._of(signed) for signed in condition]))
        except _TooMany:
            return [plain]

    def _of(self, signed: int) -> list[Bits]:
        atom = _atom(signed)
        if atom not in self._supports:
            return [self._masks.mask(signed)]
        if signed >= 0:
            return self._supports[atom]
        if atom not in self._broken:
            self._broken[atom] = self._breaking(atom)
        return self._broken[atom]

    def _close(self, component: list[int], rules: Rules, needs: Mapping[int, Sequence[int]]) -> None:
        try:
            if len(component) > self._most:  # then most of its atoms have many supports
                raise _TooMany
            self._repeat(component, rules, needs)
        except _TooMany:
            self.stay = True
            self._supports.update({atom: [self._masks.mask(atom)] for atom in component})

    def _repeat(self, component: list[int], rules: Rules, needs: Mapping[int, Sequence[int]]) -> None:
        """The least fixpoint. An atom is looked at again when one that it needs has changed."""
        users: dict[int, list[int]] = {atom: [] for atom in component}
        for atom in component:
            for each in needs[atom]:
                if each in users:
                    users[each].append(atom)
        open_ = set(component)
        while open_:
            for atom in component:
                if atom in open_:
                    open_.discard(atom)
                    found = self._supported(atom, rules)
                    if found != self._supports[atom]:
                        self._supports[atom] = found
                        open_.update(users[atom])

    def _supported(self, atom: int, rules: Rules) -> list[Bits]:
        found = list(self._supports[atom])
        for body in rules.get(atom, []):
            found.extend(self._product([self._of(signed) for signed in body]))
        return self._few(self._masks.minimal(found))

    def _breaking(self, atom: int) -> list[Bits]:
        choices = [[self._masks.mask(~signed) for signed in support] for support in self.of(atom)]
        try:
            return self._product(choices)
        except _TooMany:
            self.stay = True
            return [self._masks.mask(~atom)]

    def _product(self, choices: list[list[Bits]]) -> list[Bits]:
        found: list[Bits] = [0]
        for alternatives in choices:
            found = self._few(self._masks.minimal([one | other for one in found for other in alternatives]))
        return found

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
        kept: list[Bits] = []
        for support in sorted(set(supports), key=lambda each: (each.bit_count(), each)):
            if support & support >> 1 & self._firsts:
                continue
            if not any(smaller & support == smaller for smaller in kept):
                kept.append(support)
        return kept

    def supports(self, masks: Iterable[Bits]) -> list[Support]:
        """Supports as sets of signed atoms, in an order that does not depend on when atoms were met."""
        found = [frozenset(self._signed[place] for place in indices(each)) for each in masks]
        return sorted(found, key=lambda each: (len(each), sorted(each)))


def _atom(signed: int) -> int:
    return signed if signed >= 0 else ~signed
