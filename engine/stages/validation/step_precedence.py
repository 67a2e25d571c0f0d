"""Precedence of the steps of a plan, and unordered pairs of steps that could disturb each other.

Steps are numbered by their place in the list. The predecessors of a step are all places below a
mark, and some beyond it. In a plan that is nearly a sequence the mark is near the step, so little
is kept, and few steps can come between two others.
"""

from bisect import bisect_right
from collections.abc import Callable, Hashable, Iterable, Iterator
from typing import NamedTuple

from cellwright.kb.model.plan_model import GOAL_STEP, INITIAL_STEP, Plan, StepId
from cellwright.kb.terms import ANYTHING, Term


class StepPrecedence:
    """The order of the steps of a plan in which each step waits only for steps before it in the
    list.
    """

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
        least, minima = len(self.ids), list[int]()
        for mark in reversed(self._below):
            least = min(least, mark)
            minima.append(least)
        return minima[::-1]

    def precedes(self, earlier: StepId, later: StepId) -> bool:
        """Whether one step comes before another one in every order."""
        return self.before(self.place[earlier], self.place[later])

    def before(self, first: int, second: int) -> bool:
        """The same for the steps at two places."""
        mark = self._below[second]
        return first < mark or bool(self._beyond[second] >> (first - mark) & 1)

    def free(self, place: int) -> tuple[int, int]:
        """The steps before a place in the list that are not ordered before it: as bits, from a
        first place on, which comes first.
        """
        mark = self._below[place]
        return mark, ~self._beyond[place] & ((1 << place - mark) - 1)

    def unordered_before(self, step: StepId) -> Iterator[int]:
        """The places of the steps earlier in the list that are not ordered before a step."""
        mark, bits = self.free(self.place[step])
        return (mark + place for place in range(bits.bit_length()) if bits >> place & 1)

    def partners(self) -> list[int]:
        """The places of the steps that are not ordered with every other one."""
        partners = 0
        for place in range(len(self.ids)):
            mark, bits = self.free(place)
            if bits:
                partners |= bits << mark | 1 << place
        return [place for place, bit in enumerate(bin(partners)[:1:-1]) if bit == "1"]

    def between(self, producer: StepId, consumer: StepId) -> tuple[int, int]:
        """The first place, and the one after the last place, of all steps that some order puts
        between two steps.
        """
        first = 0 if producer == INITIAL_STEP else self._below[self.place[producer]]
        last = (
            len(self.ids)
            if consumer == GOAL_STEP
            else bisect_right(self._least, self.place[consumer])
        )
        return first, last


Known = dict[Hashable, tuple[int, int]]
"""The places of steps for each key: the first one, and from there on all as bits."""


Region = tuple[str, Term | None]
"""Atoms of a predicate that have the same first argument; all of its atoms for ANYTHING.

Or, without a name, what can be held.
"""


class TouchedKeys(NamedTuple):
    """What a step changes, and in what it is exposed: it could disturb steps that are exposed
    in what it changes.
    """

    changed: frozenset[Hashable]
    exposed: frozenset[Hashable]


def unordered_places(
    order: StepPrecedence, regions: Callable[[int], Iterable[Region]]
) -> list[int]:
    """The places of the steps of which another one, that is not ordered with it, touches the same
    region.

    Steps of one region that come one after another are ordered with all others there. The regions
    of a step are asked for once.
    """
    last: dict[Region, int] = {}
    parallel: set[Region] = set()
    whole: set[str] = set()
    steps = [(place, frozenset(regions(place))) for place in order.partners()]
    for place, own in steps:
        for region in own:
            before = last.get(region)
            if before is not None and not order.before(before, place):
                parallel.add(region)
            last[region] = place
            if region[1] is ANYTHING:
                whole.add(region[0])
    parallel |= {region for region in last if region[0] in whole} if whole else set()
    return [place for place, own in steps if not parallel.isdisjoint(own)]


def disturbing_pairs(
    order: StepPrecedence, places: Iterable[int], touched: Callable[[int], TouchedKeys]
) -> Iterator[tuple[int, int]]:
    """The places of two unordered steps that could disturb each other: the later step, and the
    earlier one, in their order.

    Steps at some places are looked at, in their order.
    """
    changing: Known = {}
    exposed: Known = {}
    for place in places:
        own = touched(place)
        first, free = order.free(place)
        if free:
            near = free & (
                _places_behind(changing, own.exposed, first)
                | _places_behind(exposed, own.changed, first)
            )
            yield from ((place, first + at) for at in _bit_places(near))
        _enter_place(changing, own.changed, place)
        _enter_place(exposed, own.exposed, place)


def _enter_place(known: Known, keys: Iterable[Hashable], place: int) -> None:
    for key in keys:
        first, bits = known.get(key, (place, 0))
        known[key] = first, bits | 1 << place - first


def _places_behind(known: Known, keys: Iterable[Hashable], first: int) -> int:
    """The places that are known for some keys, as bits from a first place on."""
    later_places = 0
    for key in keys:
        if (own := known.get(key)) is not None:
            own_first, bits = own
            later_places |= (
                bits >> first - own_first if first >= own_first else bits << own_first - first
            )
    return later_places


def _bit_places(bits: int) -> Iterator[int]:
    """The places of the bits of a number that are set."""
    while bits:
        least = bits & -bits
        yield least.bit_length() - 1
        bits ^= least
