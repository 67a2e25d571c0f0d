"""Derived predicates are compiled away where that is small: a derived atom is replaced by its minimal supports over fluents.

A support is a set of signed atom numbers: n means "atom n is true", ~n means "atom n is false". Atoms that
depend on each other recursively form a component. The supports of a component are computed together, as a
least fixpoint of antichains. The negation of an atom is computed when its component is finished
(stratification): it is the set of minimal ways to break every support. An atom with many supports stays as it is: it is
then its own support, and `engine.stages.grounding.layers` keeps its rules.
"""

from collections.abc import Iterable, Sequence

from kb.graphs import components

Support = frozenset[int]
Rules = dict[int, list[tuple[int, ...]]]  # the rule bodies of each derived atom, as signed numbers
MAX_SUPPORTS = 64
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

    An atom is computed after the atoms that it depends on. One with more than `most` supports stays as it is. The first one
    that stays ends the computation, unless `most` is `LEAST`.
    """

    def __init__(self, derived: Iterable[int], rules: Rules, most: int) -> None:
        self._most = most
        self._supports: dict[int, list[Support]] = {atom: [] for atom in derived}
        self._broken: dict[int, list[Support]] = {}
        self.stay = False  # whether some atom stays as it is
        needs: dict[int, list[int]] = {atom: [] for atom in derived}
        for head, bodies in rules.items():
            needs[head] = [atom for body in bodies for atom in map(_atom, body) if atom in needs]
        for component in components(needs):
            if self.stay and most > LEAST:
                return
            self._close(sorted(component), rules)

    def of(self, signed: int) -> list[Support]:
        """The minimal ways to make a signed atom hold. A fluent supports itself, and so does a derived atom that stays."""
        atom = _atom(signed)
        if atom not in self._supports:
            return [frozenset([signed])]
        if signed >= 0:
            return self._supports[atom]
        if atom not in self._broken:
            self._broken[atom] = self._breaking(atom)
        return self._broken[atom]

    def combinations(self, condition: Iterable[int]) -> list[Support]:
        """The minimal ways to make every signed atom of `condition` hold; the condition itself if there are many."""
        condition = tuple(condition)
        plain = frozenset(condition)
        if not any(_atom(signed) in self._supports for signed in condition):
            return [] if any(~signed in plain for signed in plain) else [plain]
        try:
            return self._product([self.of(signed) for signed in condition])
        except _TooMany:
            return [plain]

    def _close(self, component: list[int], rules: Rules) -> None:
        try:
            changed = True
            while changed:
                changed = False
                for atom in component:
                    found = self._supported(atom, rules)
                    if found != self._supports[atom]:
                        self._supports[atom], changed = found, True
        except _TooMany:
            self.stay = True
            self._supports.update({atom: [frozenset([atom])] for atom in component})

    def _supported(self, atom: int, rules: Rules) -> list[Support]:
        found = list(self._supports[atom])
        for body in rules.get(atom, []):
            found.extend(self._product([self.of(signed) for signed in body]))
        return self._few(_minimal(found))

    def _breaking(self, atom: int) -> list[Support]:
        choices = [[frozenset([~signed]) for signed in sorted(support)] for support in self._supports[atom]]
        try:
            return self._product(choices)
        except _TooMany:
            self.stay = True
            return [frozenset([~atom])]

    def _product(self, choices: list[list[Support]]) -> list[Support]:
        found: list[Support] = [frozenset()]
        for alternatives in choices:
            found = self._few(_minimal([one | other for one in found for other in alternatives]))
        return found

    def _few(self, supports: list[Support]) -> list[Support]:
        if len(supports) > self._most:
            raise _TooMany
        return supports


def _atom(signed: int) -> int:
    return signed if signed >= 0 else ~signed


def _minimal(supports: list[Support]) -> list[Support]:
    """The consistent supports that contain no smaller consistent support, smallest first."""
    kept: list[Support] = []
    for support in sorted(set(supports), key=lambda each: (len(each), sorted(each))):
        consistent = not any(~signed in support for signed in support)
        if consistent and not any(smaller <= support for smaller in kept):
            kept.append(support)
    return kept
