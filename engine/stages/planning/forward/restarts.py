"""Short forward searches, each with ties broken by chance in another way, which are given up soon.

How long a greedy search takes often depends on a few early choices among equals: most runs that fail take very long, and most that
succeed are short. Then many short runs are the better bet (Gomes, Selman & Kautz 1998). Their lengths are those of Luby,
Sinclair & Zuckerman 1993, which need not know how long a good run is.
"""

from collections.abc import Callable, Sequence

from cellwright.engine.stages.planning.effort import Effort, SearchResult
from cellwright.engine.stages.planning.forward.search import Forward

SHORTEST = 500  # expansions


class Restarts:
    """Runs of several searches in turn; each run begins anew. It can be resumed."""

    def __init__(self, searches: Sequence[Callable[[], Forward]], seed: int = 0) -> None:
        self._searches, self._seed = searches, seed
        self._runs = self._left = 0
        self._search: Forward | None = None

    def run(self, effort: Effort) -> SearchResult | None:
        """Searches until there is an answer or the effort is spent, which is None."""
        while not effort.spent():
            search = self._search if self._search is not None and self._left > 0 else self._again()
            part = effort.part(self._left)
            answer = search.run(part)
            self._left -= part.expanded - effort.expanded
            effort.add(part)
            if answer is not None:
                return answer
        return None

    def _again(self) -> Forward:
        """The next run."""
        self._runs += 1
        self._left = SHORTEST * luby(self._runs)
        search = self._searches[self._runs % len(self._searches)]()
        self._search = search.again(self._seed * 1_000_003 + self._runs)
        return self._search


def luby(number: int) -> int:
    """1, 1, 2, 1, 1, 2, 4, 1, 1, 2, 1, 1, 2, 4, 8 and so on, from number 1 on."""
    power = number.bit_length()
    return 1 << power - 1 if number == (1 << power) - 1 else luby(number - (1 << power - 1) + 1)
