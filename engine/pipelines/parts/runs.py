"""The runs of a tour in the order in which their plans take least time.

A tour counts a change of tools or stations as a way, and does not know where the arm stands at the start. What all of that
really takes, only plans tell. So parts are planned from the end of one run to the beginning of another, and from the start.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise, permutations, product

from cellwright.engine.pipelines.parts.chain import MUCH, Chain, Part
from cellwright.engine.pipelines.parts.itinerary import Itinerary, Run

EXACT = 4  # runs of which every order is compared; orders of more are improved step by step
MOST_WAYS = 120  # between runs that are planned
Value = tuple[int, int]
Order = tuple[Run, ...]
Turnable = Callable[[Run], bool]


def in_best_order(way: Itinerary, line: Chain, cheap: bool = False) -> Itinerary:
    """The tour, or its runs in another order and some the other way round, if the plan then lasts less.

    What lasts as long may cost less; if it is to be `cheap`, the cost comes first.
    """
    if way.fixed or way.shared is not None or not way.visits:
        return way
    parts = {part.name: part for part in way.parts(line.problem)}
    links, own = _Links(way, line, cheap, parts), way.runs
    best = _best(own, links, way.turnable)
    if best == own:
        return way
    ends, other = way.ends, way.of_runs(best)
    was, now = (line.trial(each.parts(line.problem, ends)) for each in (way, other))
    return other if (now[::-1] < was[::-1] if cheap else now < was) else way


def _best(own: Order, links: "_Links", turnable: Turnable) -> Order:
    """The best of all orders of few runs; of more, what step by step improvement ends with."""
    if len(own) <= EXACT:
        return min((own, *_all(own, turnable)), key=links.value)
    better: Order | None = own
    while better is not None:
        own, least = better, links.value(better)
        better = next((each for each in _neighbours(own, turnable) if links.below(least, each)), None)
    return own


def _all(runs: Order, turnable: Turnable) -> Iterator[Order]:
    for order in permutations(runs):
        yield from product(*((run, run[::-1]) if turnable(run) else (run,) for run in order))


def _neighbours(order: Order, turnable: Turnable) -> Iterator[Order]:
    """The orders with a stretch of runs the other way round, or in its order elsewhere."""
    count = len(order)
    for first, after in ((i, j) for i in range(count) for j in range(i + 1, count + 1)):
        stretch, rest = order[first:after], (*order[:first], *order[after:])
        turned = tuple(run[::-1] if turnable(run) else run for run in reversed(stretch))
        yield (*order[:first], *turned, *order[after:])
        for place in range(len(rest) + 1):
            if place != first:
                yield (*rest[:place], *stretch, *rest[place:])


@dataclass
class _Links:
    """What plans take from visit to visit, planned when first asked for; a visit is its place in the tour."""

    way: Itinerary
    line: Chain
    cheap: bool
    parts: Mapping[str, Part]
    known: dict[tuple[int | None, int | None], Value] = field(default_factory=dict)
    after: dict[int, Chain | None] = field(default_factory=dict)

    def value(self, order: Order) -> Value:
        """How long the ways between runs take together, from the start and to what is asked for at the end; and their cost.

        The cost comes first if the order is to be cheap.
        """
        ends = [None, *(place for run in order for place in (run[0], run[-1])), None]
        ways = [self._link(one, other) for one, other in list(pairwise(ends))[::2]]
        lasts, cost = sum(lasts for lasts, _ in ways), sum(cost for _, cost in ways)
        return (cost, lasts) if self.cheap else (lasts, cost)

    def below(self, least: Value, order: Order) -> bool:
        """Whether an order is known to take less; not if too many ways have been planned."""
        return len(self.known) < MOST_WAYS and self.value(order) < least

    def _link(self, one: int | None, other: int | None) -> Value:
        if (one, other) not in self.known:
            self.known[one, other] = self._planned(one, other)
        return self.known[one, other]

    def _planned(self, one: int | None, other: int | None) -> Value:
        part = self.parts.get("" if other is None else self.way.visits[other][0])
        if part is None:
            return 0, 0
        begin = self._after(one)
        return (MUCH, MUCH) if begin is None else begin.trial([part])

    def _after(self, visit: int | None) -> Chain | None:
        """The chain after a visit, as if it were the first of all; None if it cannot be that."""
        if visit is None:
            return self.line
        if visit not in self.after:
            part = self.parts.get(self.way.visits[visit][0])
            self.after[visit] = self.line.led([part] if part else [])
        return self.after[visit]
