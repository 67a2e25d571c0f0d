"""The exact searches behind one interface: over sets of causes if all outcomes are certain, else over
weights.

Values are weighted with the probability of what was seen so far.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from engine.kernels.arrays import Floats
from engine.model.troubleshooting import Troubleshooting
from engine.stages.diagnosis import arrays
from engine.stages.diagnosis.kernels import belief, dense, partition
from engine.stages.diagnosis.kernels.belief import Beliefs, Trail
from engine.stages.diagnosis.kernels.memo import Memo
from engine.stages.diagnosis.kernels.partition import Partition, Room

FIRST_LENGTH = 1 << 14
CHEAPER = 8  # a state of the table costs about an eighth of an expansion
MOST_STATES = 8_000_000


SLICE = 20_000  # expansions between two checks whether to stop
Interrupted = Callable[[], bool]


def never() -> bool:
    """Never interrupt."""
    return False


class Searcher(Protocol):
    """Values of states, remembered between questions; `rest` is the second word of the key of a state."""

    @property
    def beliefs(self) -> Beliefs:
        """The problem."""
        ...

    @property
    def spent(self) -> int:
        """Expansions so far."""
        ...

    def value(self, weights: Floats, rest: int, limit: float, expansions: int) -> tuple[float, bool]:
        """The value of a state if it is below `limit` and the budget suffices; else a lower bound and False."""
        ...

    def estimate(self, action: int, weights: Floats, rest: int) -> float:
        """A lower bound on the cost of beginning with an action, from all that is known so far."""
        ...


def begun(
    search: Searcher, action: int, weights: Floats, rest: int, limit: float, expansions: int
) -> tuple[float, bool]:
    """The cost of beginning with an action and going on optimally.

    The result has the form of `Searcher.value`.
    """
    problem = search.beliefs
    total = float(problem.costs[belief.situation_of(problem, rest), action] * weights.sum())
    for outcome in range(problem.masks.shape[1]):
        after = weights * problem.likelihoods[action, outcome]
        if problem.ends[action, outcome] or not after.any():
            continue
        then = belief.rest_after(problem, action, outcome, rest)
        found, proved = search.value(after, then, limit - total, expansions)
        total += found
        if not proved:
            return total, False
    return total, True


@dataclass
class BranchAndBound:
    """Depth-first search with bounds: over sets of causes if there is a `partition`, else over weights."""

    beliefs: Beliefs
    partition: Partition | None
    interrupted: Interrupted = never
    table: Memo = field(default_factory=lambda: Memo(FIRST_LENGTH, 0))

    def value(self, weights: Floats, rest: int, limit: float, expansions: int) -> tuple[float, bool]:
        """See `Searcher.value`."""
        last = self.spent + expansions
        while True:
            self.table.resume(min(last, self.spent + SLICE))
            found = self._solve(weights, rest, limit)
            if self.table.full:
                self.table = self.table.grown()
            elif not self.table.spent:
                return found, found < limit
            elif self.spent >= last or self.interrupted():
                return found, False

    def estimate(self, action: int, weights: Floats, rest: int) -> float:
        """See `Searcher.estimate`."""
        trail = Trail(self.beliefs, weights)
        causes = trail.possible(0)
        if self.partition is None:
            return belief.estimate(self.beliefs, self.table, trail, 0, action, causes, rest)
        room = Room(self.partition)
        return partition.estimate(self.partition, self.table, room, action, causes, rest)

    @property
    def spent(self) -> int:
        """Expansions so far."""
        return self.table.expansions

    def _solve(self, weights: Floats, rest: int, limit: float) -> float:
        trail = Trail(self.beliefs, weights)
        if self.partition is None:
            return belief.solve(self.beliefs, self.table, trail, 0, rest, limit)
        room = Room(self.partition)
        return partition.solve(self.partition, self.table, room, 0, trail.possible(0), rest, limit)


@dataclass
class ValueTable:
    """A table of the values of all states, computed at the first question."""

    beliefs: Beliefs
    problem: Troubleshooting
    values: Floats | None = None

    @property
    def radix(self) -> tuple[int, ...]:
        """For each action, the number of its outcomes plus one."""
        return tuple(len(action.outcomes) + 1 for action in self.problem.actions)

    @property
    def spent(self) -> int:
        """The work done, in expansions."""
        return 0 if self.values is None else self.values.size // CHEAPER

    def value(self, weights: Floats, rest: int, limit: float, expansions: int) -> tuple[float, bool]:
        """See `Searcher.value`. The budget is ignored here: it was checked when this search was chosen."""
        del expansions
        if self.values is None:
            radix = np.array(self.radix, dtype=np.int64)
            self.values = dense.values(self.beliefs, arrays.priors(self.problem), radix)
        situation = belief.situation_of(self.beliefs, rest)
        found = float(self.values[situation, self._number(weights, rest)])
        return found, found < limit

    def estimate(self, action: int, weights: Floats, rest: int) -> float:
        """See `Searcher.estimate`. Here it is the exact cost."""
        return begun(self, action, weights, rest, math.inf, 0)[0]

    def _number(self, weights: Floats, rest: int) -> int:
        """The number of the state with these weights.

        An action whose outcome is already sure counts as done.
        """
        number, place = 0, 1
        for index, radix in enumerate(self.radix):
            number += place * self._digit(index, weights, rest)
            place *= radix
        return number

    def _digit(self, action: int, weights: Floats, rest: int) -> int:
        width = int(self.beliefs.widths[action])
        if width:
            return (rest >> int(self.beliefs.shifts[action])) & ((1 << width) - 1)
        sure = self.beliefs.likelihoods[action][:, weights > 0.0].all(axis=1) & ~self.beliefs.ends[action]
        return int(np.argmax(sure)) + 1 if sure.any() else 0


def searcher(problem: Troubleshooting, expansions: int, interrupted: Interrupted = never) -> Searcher:
    """The search that suits a problem. It knows no values yet."""
    beliefs, sets = arrays.beliefs(problem), arrays.partition(problem)
    states = math.prod(len(action.outcomes) + 1 for action in problem.actions) * len(beliefs.costs)
    open_ended = 2 * sum(not action.certain for action in problem.actions) >= len(problem.actions)
    if sets is None and open_ended and states <= min(MOST_STATES, CHEAPER * expansions):
        return ValueTable(beliefs, problem)
    return BranchAndBound(beliefs, sets, interrupted)
