"""Which unordered steps of a plan could disturb each other: pairs in which one changes something that the other is exposed in.

Whether they do is for `interference` to say. A plan with many parallel steps has far more unordered pairs than such ones, so steps
are looked up by what they change.
"""

from bisect import bisect_left
from collections.abc import Callable, Hashable, Iterable, Iterator
from typing import NamedTuple

from engine.stages.validation.precedence import Precedence


class Touched(NamedTuple):
    """What a step changes, and in what it is exposed: it could disturb steps that are exposed in what it changes."""

    changed: frozenset[Hashable]
    exposed: frozenset[Hashable]


def pairs(order: Precedence, touched: Callable[[int], Touched]) -> Iterator[tuple[int, int]]:
    """The places of two unordered steps that could disturb each other: the later step, and the earlier one, in their order.

    `touched` is asked for the steps alone that have an unordered one.
    """
    changing: dict[Hashable, list[int]] = {}
    exposed: dict[Hashable, list[int]] = {}
    for place in order.partners():
        own = touched(place)
        first, free = order.free(place)
        near: set[int] = set()
        for known, keys in ((changing, own.exposed), (exposed, own.changed)):
            near.update(_behind(known, keys, first))
        yield from ((place, other) for other in sorted(near) if free >> (other - first) & 1)
        for known, keys in ((changing, own.changed), (exposed, own.exposed)):
            for key in keys:
                known.setdefault(key, []).append(place)


def _behind(known: dict[Hashable, list[int]], keys: Iterable[Hashable], first: int) -> Iterator[int]:
    """The places that are known for some keys, from the first one on."""
    for key in keys:
        if found := known.get(key):
            yield from found[bisect_left(found, first) :]
