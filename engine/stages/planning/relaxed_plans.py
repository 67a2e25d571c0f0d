# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
"""The relaxed plan of an atom from one state, made of best supporters when it is asked for.

Plain Python, compiled with the types in `relaxed_plans.pxd`.
"""

from collections.abc import Sequence
from typing import Any

from cellwright.engine.kernels.bits import Bits, indices

UNKNOWN: Any = object()


class RelaxedPlans:
    """The relaxed plan of each atom: None if the atom is unreachable, 0 if it holds already.

    Each plan is made when it is first needed. A plan is a bitset in which every operator has as
    many bits of its own as its charge, so that the number of bits is the cost. `needs` and
    `charges` are those of the operators, `supporters` has the best operator for each atom, or -1.
    """

    def __init__(
        self, initial: Bits, needs: list[tuple[int, ...]], charges: list[int], supporters: list[int]
    ) -> None:
        self.initial = initial
        self._needs, self._charges, self._supporters = needs, charges, supporters
        self._plans: list[Any] = [UNKNOWN] * len(supporters)
        self._own: list[Bits] = [0] * len(needs)
        self._bits = 0

    def plan(self, goals: Bits) -> Bits | None:
        """The union of the goals' relaxed plans; None if a goal is unreachable."""
        union = 0
        for atom in indices(goals & ~self.initial):
            plan = self.to(atom)
            if plan is None:
                return None
            union |= plan
        return union

    def to(self, atom: int) -> Bits | None:
        """The relaxed plan of one atom.

        A loop is used instead of recursion, because chains of supporters may be deeper than
        Python's stack.
        """
        plans: list[Bits | None] = self._plans
        if plans[atom] is not UNKNOWN:
            return plans[atom]
        waiting = [atom]
        while waiting:
            last = waiting[len(waiting) - 1]
            supporter = self._supporters[last]
            if self._plans[last] is UNKNOWN and supporter < 0:
                self._plans[last] = 0 if self.initial >> last & 1 else None
            elif self._plans[last] is UNKNOWN:
                needs = self._needs[supporter]
                missing = [need for need in needs if self._plans[need] is UNKNOWN]
                if missing:
                    waiting += missing
                    continue
                self._plans[last] = self._joined(supporter, needs)
            waiting.pop()
        return plans[atom]

    def _joined(self, supporter: int, needs: Sequence[int]) -> Bits:
        """The relaxed plan that ends in the operator `supporter`.

        The operator gets its bits when it is first used.
        """
        if self._own[supporter] == 0:
            charge = self._charges[supporter]
            self._own[supporter] = ((1 << charge) - 1) << self._bits
            self._bits += charge
        union = self._own[supporter]
        for need in needs:
            union |= self._plans[need] or 0
        return union
