"""Plans that cost less than the best one, by searches from the start: in rounds, with less greed after each plan that is found."""

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

from cellwright.engine.model.task import GroundOperator
from cellwright.engine.stages.planning.effort import Effort, OutOfRange, SearchResult
from cellwright.engine.stages.planning.improvement.rounds import Steps, cost
from cellwright.engine.stages.planning.setting import Setting

if TYPE_CHECKING:
    from cellwright.engine.stages.planning.forward.weighted import Weighted

WEIGHTS = (5, 3, 2, 1)  # how much the estimate counts, beside what a way has cost
FIRST, MOST = (
    2_000,
    4_000_000,
)  # expansions of a search in the first round; they double until they reach the most
LONG = 50_000  # expansions of a search that takes seconds
BREADTH = 100  # nodes that may be generated for each expansion
CHANCE = 1_000_003


class Pool:
    """All plans that were found, and whether the best one is proved to be cheapest."""

    def __init__(self, steps: Sequence[Steps]) -> None:
        self._plans, self.proved = list(steps), False

    def add(self, steps: Steps) -> None:
        """Take one more plan."""
        self._plans.append(steps)

    @property
    def best(self) -> Steps:
        """The cheapest one."""
        return min(self._plans, key=cost)


class Searches:
    """Weighted searches, with and without landmarks in turn, and with ties broken in another way in each round.

    A round begins with the weight at which a plan was found last. The bound is the cost of the best plan in `pool`: when all
    ways below it are followed to their ends, that plan is proved to be cheapest.
    """

    def __init__(self, setting: Setting, pool: Pool) -> None:
        self._setting, self._pool = setting, pool
        self._rounds = self._place = 0

    @property
    def ended(self) -> bool:
        """Whether further rounds are not worth their time."""
        return self._pool.proved or FIRST << self._rounds > MOST

    @property
    def long(self) -> bool:
        """Whether a search of the next round takes as long as many small ones."""
        return FIRST << self._rounds > LONG

    def round(self, interrupted: Callable[[], bool]) -> Iterator[Sequence[GroundOperator]]:
        """The plans of the next round. The caller puts them into the pool, with what makes them cheaper."""
        expansions, place = FIRST << self._rounds, max(self._place - 1, 0)
        self._rounds += 1
        while place < len(WEIGHTS) and not self._pool.proved:
            effort = Effort(expansions, interrupted, most=expansions * BREADTH)
            answer = None if effort.over() else self._search(WEIGHTS[place], effort)
            if answer is None:
                place += 1
            elif answer.steps is None:
                self._pool.proved = True
            else:
                yield answer.steps
                self._place = place = min(place + 1, len(WEIGHTS) - 1)

    def _search(self, weight: int, effort: Effort) -> SearchResult | None:
        seed = self._setting.seed * CHANCE + self._rounds - 1
        kind = self._layered if self._rounds % 2 else self._plain
        try:
            return kind.anew(weight, cost(self._pool.best)[0], seed).run(effort)
        except OutOfRange:
            return None

    @cached_property
    def _layered(self) -> "Weighted":
        from cellwright.engine.stages.planning.forward.weighted import weighted  # loads compiled kernels

        return weighted(self._setting.task, landmarks=True)

    @cached_property
    def _plain(self) -> "Weighted":
        from cellwright.engine.stages.planning.forward.weighted import weighted

        return weighted(self._setting.task)
