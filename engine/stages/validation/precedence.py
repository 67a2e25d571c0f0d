"""Which steps of a plan come before which, for plans of any length.

Steps are numbered by their place in the list. The predecessors of a step are all places below a mark, and some beyond it. In
a plan that is nearly a sequence the mark is near the step, so little is kept, and few steps can come between two others.
"""

from bisect import bisect_right
from collections.abc import Iterator

from cellwright.kb.model.plan import GOAL, START, Plan, StepId


class Precedence:
    """The order of the steps of a plan in which each step waits only for steps before it in the list."""

    def __init__(self, plan: Plan) -> None:
        self.ids = [step.id for step in plan.steps]
        self.place = {step.id: place for place, step in enumerate(plan.steps)}
        self._below: list[int] = []  # for each place: all places below this one come before it
        self._beyond: list[int] = []  # the others that come before it, as bits from there on
        for step in plan.steps:
            self._add([self.place[before] for before in step.after])
        self._least = self._suffix_minima()

    def _add(self, after: list[int]) -> None:
        """The predecessors of the next step, which waits for those at some places."""
        below = max((self._below[place] for place in after), default=0)
        bits = 0
        for place in after:
            if place >= below:
                bits |= 1 << (place - below)
            bits |= self._beyond[place] >> (below - self._below[place])
        full = (~bits & (bits + 1)).bit_length() - 1
        self._below.append(below + full)
        self._beyond.append(bits >> full)

    def _suffix_minima(self) -> list[int]:
        """For each place the least mark of it and all places after it."""
        least, found = len(self.ids), list[int]()
        for mark in reversed(self._below):
            least = min(least, mark)
            found.append(least)
        return found[::-1]

    def precedes(self, earlier: StepId, later: StepId) -> bool:
        """Whether one step comes before another one in every order."""
        return self.before(self.place[earlier], self.place[later])

    def before(self, one: int, other: int) -> bool:
        """The same for the steps at two places."""
        mark = self._below[other]
        return one < mark or bool(self._beyond[other] >> (one - mark) & 1)

    def free(self, place: int) -> tuple[int, int]:
        """The steps before a place in the list that are not ordered before it: as bits, from a first place on, which comes first."""
        mark = self._below[place]
        return mark, ~self._beyond[place] & ((1 << place - mark) - 1)

    def unordered_before(self, step: StepId) -> Iterator[int]:
        """The places of the steps earlier in the list that are not ordered before a step."""
        mark, bits = self.free(self.place[step])
        return (mark + place for place in range(bits.bit_length()) if bits >> place & 1)

    def partners(self) -> list[int]:
        """The places of the steps that are not ordered with every other one."""
        found = 0
        for place in range(len(self.ids)):
            mark, bits = self.free(place)
            if bits:
                found |= bits << mark | 1 << place
        return [place for place, bit in enumerate(bin(found)[:1:-1]) if bit == "1"]

    def between(self, producer: StepId, consumer: StepId) -> tuple[int, int]:
        """The first place, and the one after the last place, of all steps that some order puts between two steps."""
        first = 0 if producer == START else self._below[self.place[producer]]
        last = len(self.ids) if consumer == GOAL else bisect_right(self._least, self.place[consumer])
        return first, last
