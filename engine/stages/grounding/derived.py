"""Derived predicates are compiled away: each derived atom is replaced by its minimal supports over fluents.

A support is a set of signed atom numbers: n means "atom n is true", ~n means "atom n is false". Atoms that
depend on each other recursively form a component. The supports of a component are computed together, as a
least fixpoint of antichains. The negation of an atom is computed when its component is finished
(stratification): it is the set of minimal ways to break every support.
"""

from collections.abc import Iterable, Mapping

from kb.graphs import components

Support = frozenset[int]
Rules = Mapping[int, list[tuple[int, ...]]]  # the rule bodies of each derived atom, as signed numbers
MAX_SUPPORTS = 512


class TooManySupports(Exception):
    """A condition has more minimal supports than `MAX_SUPPORTS`."""


class Supports:
    """The supports of every derived atom of a problem.

    An atom is computed after the atoms that it depends on.
    """

    def __init__(self, derived: Iterable[int], rules: Rules) -> None:
        self._supports: dict[int, list[Support]] = {atom: [] for atom in derived}
        self._broken: dict[int, list[Support]] = {}
        self._overflowing: dict[int, None] = {}
        needs: dict[int, list[int]] = {atom: [] for atom in derived}
        for head, bodies in rules.items():
            needs[head] = [atom for body in bodies for atom in map(_atom, body) if atom in needs]
        for component in components(needs):
            self._close(sorted(component), rules)

    @property
    def overflowing(self) -> list[int]:
        """The derived atoms with more than `MAX_SUPPORTS` minimal supports or ways to break them.

        `of` returns no supports for such an atom.
        """
        return list(self._overflowing)

    def of(self, signed: int) -> list[Support]:
        """The minimal ways to make a signed atom hold. A fluent supports itself."""
        atom = _atom(signed)
        if atom not in self._supports:
            return [frozenset([signed])]
        if signed >= 0:
            return self._supports[atom]
        if atom not in self._broken:
            self._broken[atom] = self._breaking(atom)
        return self._broken[atom]

    def combinations(self, condition: Iterable[int]) -> list[Support]:
        """The minimal ways to make every signed atom of `condition` hold."""
        condition = tuple(condition)
        if not any(_atom(signed) in self._supports for signed in condition):
            support = frozenset(condition)
            return [] if any(~signed in support for signed in support) else [support]
        return self._product([self.of(signed) for signed in condition])

    def _close(self, component: list[int], rules: Rules) -> None:
        changed = True
        while changed:
            changed = False
            for atom in component:
                if atom in self._overflowing:
                    continue
                try:
                    found = self._supported(atom, rules)
                except TooManySupports:
                    found = self._overflow(atom)
                if found != self._supports[atom]:
                    self._supports[atom], changed = found, True

    def _supported(self, atom: int, rules: Rules) -> list[Support]:
        found = list(self._supports[atom])
        for body in rules.get(atom, []):
            found.extend(self._product([self.of(signed) for signed in body]))
        return _few(_minimal(found))

    def _overflow(self, atom: int) -> list[Support]:
        self._overflowing[atom] = None
        return []

    def _breaking(self, atom: int) -> list[Support]:
        choices = [[frozenset([~signed]) for signed in sorted(support)] for support in self._supports[atom]]
        try:
            return self._product(choices)
        except TooManySupports:
            return self._overflow(atom)

    def _product(self, choices: list[list[Support]]) -> list[Support]:
        found: list[Support] = [frozenset()]
        for alternatives in choices:
            found = _few(_minimal([one | other for one in found for other in alternatives]))
        return found


def _atom(signed: int) -> int:
    return signed if signed >= 0 else ~signed


def _few(supports: list[Support]) -> list[Support]:
    if len(supports) > MAX_SUPPORTS:
        raise TooManySupports
    return supports


def _minimal(supports: list[Support]) -> list[Support]:
    """The consistent supports that contain no smaller consistent support, smallest first."""
    kept: list[Support] = []
    for support in sorted(set(supports), key=lambda each: (len(each), sorted(each))):
        consistent = not any(~signed in support for signed in support)
        if consistent and not any(smaller <= support for smaller in kept):
            kept.append(support)
    return kept
