"""From which station each measurement is made: from as few as reach them all, chosen before the tour.

Stations are few, and a change of station takes longer than any way at one. So the smallest set of stations that serves all
measurements is found first; a measurement that several of them serve belongs to the one that comes first in the set.
"""

from collections.abc import Mapping
from itertools import combinations

from cellwright.kb.model.amounts import Facts
from cellwright.kb.model.conventions import Conventions
from cellwright.kb.terms import Number

MOST = 12  # stations of which every set is tried; of more, the one that serves most of the rest is taken next


def stations_of(facts: Facts, words: Conventions) -> tuple[dict[str, str], dict[tuple[str, str], int]]:
    """The station of each measurement that needs one, and the cost of each change of stations, as a way in micrometres."""
    served: dict[str, set[str]] = {}
    for station, name in facts(words.serves, 2):
        served.setdefault(str(station), set()).add(str(name))
    chosen = chosen_stations(served)
    stations = {name: station for station in reversed(chosen) for name in sorted(served[station])}
    ways = ((str(a), str(b), way) for a, b, way in facts(words.shift, 3))
    return stations, {(a, b): way.value for a, b, way in ways if isinstance(way, Number)}


def chosen_stations(served: Mapping[str, set[str]]) -> tuple[str, ...]:
    """The fewest stations that together serve all that any serves, in order of their names."""
    everything, names = set().union(*served.values()), sorted(served)
    if len(names) > MOST:
        return _one_by_one(served, everything)
    for count in range(len(names) + 1):
        for some in combinations(names, count):
            if set().union(*(served[each] for each in some)) == everything:
                return some
    return tuple(names)


def _one_by_one(served: Mapping[str, set[str]], everything: set[str]) -> tuple[str, ...]:
    found: list[str] = []
    left = set(everything)
    while left:
        best = max(sorted(served), key=lambda each: len(served[each] & left))
        found.append(best)
        left -= served[best]
    return tuple(sorted(found))
