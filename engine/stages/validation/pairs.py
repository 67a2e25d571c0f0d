"""Which unordered steps of a plan could disturb each other: pairs in which one changes something that the other is exposed in.

Whether they do is for `interference` to say. A plan with many parallel steps has far more unordered pairs than such ones, so steps
are looked up by what they change.
"""

from collections.abc import Callable, Hashable, Iterable, Iterator
from typing import NamedTuple

from cellwright.engine.stages.validation.precedence import Precedence
from cellwright.kb.terms import ANYTHING, Term

Known = dict[Hashable, tuple[int, int]]
"""The places of steps for each key: the first one, and from there on all as bits."""


Region = tuple[str, Term | None]
"""Atoms of a predicate that have the same first argument; all of its atoms for ANYTHING. Or, without a name, what can be held."""


class Touched(NamedTuple):
    """What a step changes, and in what it is exposed: it could disturb steps that are exposed in what it changes."""

    changed: frozenset[Hashable]
    exposed: frozenset[Hashable]


def loose(order: Precedence, regions: Callable[[int], Iterable[Region]]) -> list[int]:
    """The places of the steps of which another one, that is not ordered with it, touches the same region.

    Steps of one region that come one after another are ordered with all others there. The regions of a step are asked for once.
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
    parallel |= {each for each in last if each[0] in whole} if whole else set()
    return [place for place, own in steps if not parallel.isdisjoint(own)]


def pairs(
    order: Precedence, places: Iterable[int], touched: Callable[[int], Touched]
) -> Iterator[tuple[int, int]]:
    """The places of two unordered steps that could disturb each other: the later step, and the earlier one, in their order.

    Steps at some places are looked at, in their order.
    """
    changing: Known = {}
    exposed: Known = {}
    for place in places:
        own = touched(place)
        first, free = order.free(place)
        if free:
            near = free & (_behind(changing, own.exposed, first) | _behind(exposed, own.changed, first))
            yield from ((place, first + at) for at in _places(near))
        _enter(changing, own.changed, place)
        _enter(exposed, own.exposed, place)


def _enter(known: Known, keys: Iterable[Hashable], place: int) -> None:
    for key in keys:
        first, bits = known.get(key, (place, 0))
        known[key] = first, bits | 1 << place - first


def _behind(known: Known, keys: Iterable[Hashable], first: int) -> int:
    """The places that are known for some keys, as bits from a first place on."""
    found = 0
    for key in keys:
        if (own := known.get(key)) is not None:
            own_first, bits = own
            found |= bits >> first - own_first if first >= own_first else bits << own_first - first
    return found


def _places(bits: int) -> Iterator[int]:
    """The places of the bits of a number that are set."""
    while bits:
        least = bits & -bits
        yield least.bit_length() - 1
        bits ^= least
