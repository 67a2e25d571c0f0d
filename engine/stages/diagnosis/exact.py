"""The exact searches behind one interface: over sets of causes if all outcomes are certain, else over
weights.

Values are weighted with the probability of what was seen so far.
"""

import math
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.cancellation import Poll
from cellwright.engine.model.troubleshooting import Troubleshooting
from cellwright.engine.stages.diagnosis import arrays
from cellwright.engine.stages.diagnosis.kernels import belief, dense, partition
from cellwright.engine.stages.diagnosis.kernels.belief import Beliefs, Trail
from cellwright.engine.stages.diagnosis.kernels.memo import Memo
from cellwright.engine.stages.diagnosis.kernels.partition import Partition, Room

FIRST_LENGTH = 1 << 14
CHEAPER = 8  # a state of the table costs about an eighth of an expansion
MOST_STATES = 8_000_000


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
    total = float(problem.costs[arrays.situation_of(problem, rest), action] * weights.sum())
    for outcome in range(problem.outcomes):
        after = weights * problem.likelihoods[action, outcome]
        if problem.ends[action, outcome] or not after.any():
            continue
        then = arrays.rest_after(problem, action, outcome, rest)
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
    poll: Poll = field(default_factory=Poll)
    length: int = FIRST_LENGTH
    table: Memo = field(init=False)

    def __post_init__(self) -> None:
        width = self.beliefs.words if self.partition is None else self.partition.sets + 1
        self.table = Memo(self.length, 0, width)

    def value(self, weights: Floats, rest: int, limit: float, expansions: int) -> tuple[float, bool]:
        """See `Searcher.value`."""
        last = self.spent + expansions
        while True:
            self.table.resume(last)
            found = self._solve(weights, rest, limit)
            if (
                not self.table.full and not self.table.spent
            ):  # also if it was known when the search was stopped
                return found, found < limit
            if self.poll.check() or self.table.spent:
                return found, False
            self.table = self.table.grown()

    def estimate(self, action: int, weights: Floats, rest: int) -> float:
        """See `Searcher.estimate`."""
        if self.partition is None:
            trail = Trail(self.beliefs, weights, rest)
            return belief.estimate(self.beliefs, self.table, trail, 0, action)
        room = Room(self.partition, possible(weights), rest)
        return partition.estimate(self.partition, self.table, room, 0, action)

    @property
    def spent(self) -> int:
        """Expansions so far."""
        return self.table.expansions

    def _solve(self, weights: Floats, rest: int, limit: float) -> float:
        if self.partition is None:
            trail = Trail(self.beliefs, weights, rest, self.poll)
            return belief.solve(self.beliefs, self.table, trail, 0, limit)
        room = Room(self.partition, possible(weights), rest, self.poll)
        return partition.solve(self.partition, self.table, room, 0, limit)


def possible(weights: Floats) -> int:
    """The causes of positive weight as a set: bit c stands for cause c."""
    return int.from_bytes(np.packbits(weights > 0.0, bitorder="little").tobytes(), "little")


@dataclass
class ValueTable:
    """A table of the values of all states, computed at the first question."""

    beliefs: Beliefs
    problem: Troubleshooting
    poll: Poll = field(default_factory=Poll)
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
            made = dense.values(self.beliefs, arrays.priors(self.problem), radix, self.poll)
            if self.poll.check():
                return float(np.where(weights > 0.0, self.beliefs.known, 0.0) @ weights), False
            self.values = made
        situation = arrays.situation_of(self.beliefs, rest)
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


def searcher(problem: Troubleshooting, beliefs: Beliefs, expansions: int, poll: Poll) -> Searcher:
    """The search that suits a problem. It knows no values yet."""
    sets = arrays.partition(problem, beliefs)
    states = math.prod(len(action.outcomes) + 1 for action in problem.actions) * len(beliefs.costs)
    open_ended = 2 * sum(not action.certain for action in problem.actions) >= len(problem.actions)
    if sets is None and open_ended and states <= min(MOST_STATES, CHEAPER * expansions):
        return ValueTable(beliefs, problem, poll)
    return BranchAndBound(beliefs, sets, poll)
