"""The exact search behind one face: over sets of causes where outcomes are certain, over weights where they are not."""

from dataclasses import dataclass

import numpy as np

from engine.diagnosis import arrays
from engine.diagnosis.arrays import Floats
from engine.diagnosis.kernels import belief, partition
from engine.diagnosis.kernels.belief import Beliefs
from engine.diagnosis.kernels.memo import BUDGET, EXPANSIONS, FULL, RUNNING, SPENT, STATUS, Memo, grown, memo
from engine.diagnosis.kernels.partition import Partition
from engine.model.diagnosis import Troubleshooting

FIRST_LENGTH = 1 << 14


@dataclass
class Searcher:
    """Values of states, remembered from question to question. Costs are weighted with the mass of `weights`."""

    beliefs: Beliefs
    partition: Partition | None
    table: Memo

    def value(self, weights: Floats, rest: int, limit: float, expansions: int) -> tuple[float, bool]:
        """The value of a state, if it is below `limit` and found within the budget; else a lower bound and False."""
        counts = self.table.counts
        counts[BUDGET] = counts[EXPANSIONS] + expansions
        while True:
            self.table.counts[STATUS] = RUNNING
            found = self._solve(weights, rest, limit)
            if self.table.counts[STATUS] != FULL:
                return found, self.table.counts[STATUS] != SPENT and found < limit
            self.table = grown(self.table)

    def estimate(self, action: int, weights: Floats, rest: int) -> float:
        """A lower bound of beginning with an action, from all that has been found out."""
        causes = int(belief.possible(weights))
        if self.partition is None:
            return float(belief.estimate(self.beliefs, self.table, action, causes, weights, rest))
        return float(partition.estimate(self.partition, self.table, action, causes, rest))

    def begun(
        self, action: int, weights: Floats, rest: int, limit: float, expansions: int
    ) -> tuple[float, bool]:
        """The cost of beginning with an action and going on optimally; as `value`."""
        situation = belief.situation_of(self.beliefs, rest)
        total = float(self.beliefs.costs[situation, action] * weights.sum())
        for outcome in range(self.beliefs.masks.shape[1]):
            after = weights * self.beliefs.likelihoods[action, outcome]
            if self.beliefs.ends[action, outcome] or not after.any():
                continue
            then = belief.rest_after(self.beliefs, action, outcome, rest)
            found, proved = self.value(after, then, limit - total, expansions)
            total += found
            if not proved:
                return total, False
        return total, True

    @property
    def spent(self) -> int:
        """Expansions so far."""
        return int(self.table.counts[EXPANSIONS])

    def _solve(self, weights: Floats, rest: int, limit: float) -> float:
        if self.partition is None:
            return float(belief.solve(self.beliefs, self.table, weights, rest, limit))
        causes = int(belief.possible(weights))
        return float(partition.solve(self.partition, self.table, causes, rest, limit))


def searcher(problem: Troubleshooting) -> Searcher:
    """A searcher that knows nothing yet."""
    return Searcher(arrays.beliefs(problem), arrays.partition(problem), memo(FIRST_LENGTH, 0))


def is_tie(value: float, best: float) -> bool:
    """Whether two costs are the same but for rounding."""
    return bool(
        value == best or value <= best + 1e-9 * max(1e-9, abs(best)) or np.isclose(value, best, 1e-9, 0.0)
    )
