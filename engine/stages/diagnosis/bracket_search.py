"""Test selection where outcomes are uncertain: a search between lower and upper bounds
(`kernels.bracket`) with the interface of the exact searches.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.cancellation import Poll
from cellwright.engine.model.troubleshooting import Troubleshooting
from cellwright.engine.stages.diagnosis import search_arrays
from cellwright.engine.stages.diagnosis.kernels import bracket
from cellwright.engine.stages.diagnosis.kernels.belief import Beliefs, Trail
from cellwright.engine.stages.diagnosis.kernels.bracket import Brackets
from cellwright.engine.stages.diagnosis.pair_bounds import RATIOS, no_pairs, pair_bounds

FIRST_STATES, FIRST_ROOM = 1 << 12, 1 << 8
CLOSE = 1e-10  # relative distance of bounds that count as equal
# causes, and outcomes of all actions, of problems for this search
MOST_CAUSES, MOST_CHILDREN = 16, 160
CHILD_NS, PAIR_NS = (
    240.0,
    12.0,
)  # about nanoseconds for a child of an expanded state, and more for two of its causes
CHILDREN = 40_000_000  # children that the table may have


@dataclass
class BracketSearch:
    """Searches from each state that is asked for; all bounds are kept between questions.

    It is a `Searcher`.
    """

    beliefs: Beliefs
    poll: Poll = field(default_factory=Poll)
    table: Brackets = field(init=False)

    def __post_init__(self) -> None:
        concave = self.beliefs.slack == 0.0 and bool(np.isfinite(self.beliefs.known).all())
        pairs = pair_bounds(self.beliefs) if concave else no_pairs()
        self.table = Brackets(
            self.beliefs, RATIOS, pairs.values, pairs.repairs, FIRST_STATES, FIRST_ROOM
        )

    @property
    def spent(self) -> int:
        """Expansions so far."""
        return int(self.table.expanded)

    def value(
        self, weights: Floats, rest: int, limit: float, expansions: int
    ) -> tuple[float, bool]:
        """See `Searcher.value`."""
        low, high, _ = self.bounds(weights, rest, limit, expansions)
        return (high, high < limit) if high - low <= CLOSE * high else (low, False)

    def bounds(
        self, weights: Floats, rest: int, limit: float = math.inf, expansions: int = 0
    ) -> tuple[float, float, int]:
        """A lower and an upper bound of the value of a state, and the action with which the upper
        one begins.

        The action is -1 to stop. Following such actions costs no more than the upper bound.
        """
        trail, last = Trail(self.beliefs, weights, rest, self.poll), self.spent + expansions
        while True:
            state = bracket.search(self.table, trail, limit, last - self.spent, CLOSE)
            if not self.table.full or not self._grow():
                break
        table = self.table
        return table.low[state], table.high[state], table.choice[state]

    def estimate(self, action: int, weights: Floats, rest: int) -> float:
        """See `Searcher.estimate`."""
        problem = self.beliefs
        total = float(
            problem.costs[search_arrays.situation_in_key(problem, rest), action] * weights.sum()
        )
        for outcome in range(problem.outcomes):
            after = weights * problem.likelihoods[action, outcome]
            if not problem.ends[action, outcome] and after.any():
                total += self.bounds(
                    after, search_arrays.rest_after(problem, action, outcome, rest)
                )[0]
        return total

    def _grow(self) -> bool:
        """Take a larger table, unless the search was stopped or the table is as large as it may
        be.
        """
        table = self.table
        if self.poll.check() or table.room * table.width > CHILDREN:
            return False
        longer = 2 * table.length if table.states + table.width > table.length else table.length
        self.table = table.grown(
            longer, 2 * table.room if table.expanded >= table.room else table.room
        )
        return True


def suits(problem: Troubleshooting, beliefs: Beliefs) -> bool:
    """Whether a problem is one for this search: many outcomes are not sure, causes and actions are
    few, and the case can always be ended.
    """
    unsure, ends = (
        sum(not action.certain for action in problem.actions),
        np.isfinite(beliefs.losses).all(axis=1),
    )
    few = beliefs.causes <= MOST_CAUSES and beliefs.actions * beliefs.outcomes <= MOST_CHILDREN
    return few and unsure > 0 and 3 * unsure >= len(problem.actions) and bool(ends.any())


def expansion_ns(beliefs: Beliefs) -> float:
    """About the nanoseconds that one expansion takes."""
    children, causes = int(beliefs.actions * beliefs.outcomes), int(beliefs.causes)
    return children * (CHILD_NS + PAIR_NS * float(causes * causes))
