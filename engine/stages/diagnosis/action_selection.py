"""Test selection: which test or repair comes next, by exact search or rollout; decision trees.

Values are weighted with the probability of what was seen so far.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.cancellation import Interrupted, Poll, never
from cellwright.engine.model.troubleshooting import (
    CaseAdvice,
    CaseStanding,
    Conclude,
    Tree,
    Troubleshooting,
    Try,
)
from cellwright.engine.stages.diagnosis import search_arrays
from cellwright.engine.stages.diagnosis.bracket_search import BracketSearch, expansion_ns, suits
from cellwright.engine.stages.diagnosis.kernels import belief, dense, partition, rollout
from cellwright.engine.stages.diagnosis.kernels.belief import Beliefs, Trail
from cellwright.engine.stages.diagnosis.kernels.memo import Memo
from cellwright.engine.stages.diagnosis.kernels.partition import Partition, Room

FIRST_LENGTH = 1 << 14
TABLE_STATE_COST = 8  # a state of the table costs about an eighth of an expansion
MAX_TABLE_STATES = 8_000_000


class Searcher(Protocol):
    """Values of states, remembered between questions; `rest` is the second word of the key of a
    state.
    """

    @property
    def beliefs(self) -> Beliefs:
        """The problem."""
        ...

    @property
    def spent(self) -> int:
        """Expansions so far."""
        ...

    def value(
        self, weights: Floats, rest: int, limit: float, expansions: int
    ) -> tuple[float, bool]:
        """The value of a state if it is below `limit` and the budget suffices; else a lower
        bound and False.
        """
        ...

    def estimate(self, action: int, weights: Floats, rest: int) -> float:
        """A lower bound on the cost of beginning with an action, from all that is known so far."""
        ...


def cost_of_beginning(
    search: Searcher, action: int, weights: Floats, rest: int, limit: float, expansions: int
) -> tuple[float, bool]:
    """The cost of beginning with an action and going on optimally.

    The result has the form of `Searcher.value`.
    """
    problem = search.beliefs
    total = float(
        problem.costs[search_arrays.situation_in_key(problem, rest), action] * weights.sum()
    )
    for outcome in range(problem.outcomes):
        after = weights * problem.likelihoods[action, outcome]
        if problem.ends[action, outcome] or not after.any():
            continue
        then = search_arrays.rest_after(problem, action, outcome, rest)
        rest_cost, proved = search.value(after, then, limit - total, expansions)
        total += rest_cost
        if not proved:
            return total, False
    return total, True


@dataclass
class BranchAndBound:
    """Depth-first search with bounds: over sets of causes if there is a `partition`, else over
    weights.
    """

    beliefs: Beliefs
    partition: Partition | None
    poll: Poll = field(default_factory=Poll)
    length: int = FIRST_LENGTH
    table: Memo = field(init=False)

    def __post_init__(self) -> None:
        width = self.beliefs.words if self.partition is None else self.partition.sets + 1
        self.table = Memo(self.length, 0, width)

    def value(
        self, weights: Floats, rest: int, limit: float, expansions: int
    ) -> tuple[float, bool]:
        """See `Searcher.value`."""
        last = self.spent + expansions
        while True:
            self.table.resume(last)
            cost = self._solve(weights, rest, limit)
            if (
                not self.table.full and not self.table.spent
            ):  # also if it was known when the search was stopped
                return cost, cost < limit
            if self.poll.check() or self.table.spent:
                return cost, False
            self.table = self.table.grown()

    def estimate(self, action: int, weights: Floats, rest: int) -> float:
        """See `Searcher.estimate`."""
        if self.partition is None:
            trail = Trail(self.beliefs, weights, rest)
            return belief.estimate(self.beliefs, self.table, trail, 0, action)
        room = Room(self.partition, possible_causes(weights), rest)
        return partition.estimate(self.partition, self.table, room, 0, action)

    @property
    def spent(self) -> int:
        """Expansions so far."""
        return self.table.expansions

    def _solve(self, weights: Floats, rest: int, limit: float) -> float:
        if self.partition is None:
            trail = Trail(self.beliefs, weights, rest, self.poll)
            return belief.solve(self.beliefs, self.table, trail, 0, limit)
        room = Room(self.partition, possible_causes(weights), rest, self.poll)
        return partition.solve(self.partition, self.table, room, 0, limit)


def possible_causes(weights: Floats) -> int:
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
        return 0 if self.values is None else self.values.size // TABLE_STATE_COST

    def value(
        self, weights: Floats, rest: int, limit: float, expansions: int
    ) -> tuple[float, bool]:
        """See `Searcher.value`.

        The budget is ignored here: it was checked when this search was chosen.
        """
        del expansions
        if self.values is None:
            radix = np.array(self.radix, dtype=np.int64)
            table = dense.values(
                self.beliefs, search_arrays.prior_weights(self.problem), radix, self.poll
            )
            if self.poll.check():
                return float(np.where(weights > 0.0, self.beliefs.known, 0.0) @ weights), False
            self.values = table
        situation = search_arrays.situation_in_key(self.beliefs, rest)
        cost = float(self.values[situation, self._number(weights, rest)])
        return cost, cost < limit

    def estimate(self, action: int, weights: Floats, rest: int) -> float:
        """See `Searcher.estimate`. Here it is the exact cost."""
        return cost_of_beginning(self, action, weights, rest, math.inf, 0)[0]

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
        sure = (
            self.beliefs.likelihoods[action][:, weights > 0.0].all(axis=1)
            & ~self.beliefs.ends[action]
        )
        return int(np.argmax(sure)) + 1 if sure.any() else 0


def make_searcher(
    problem: Troubleshooting, beliefs: Beliefs, expansions: int, poll: Poll
) -> Searcher:
    """The search that suits a problem. It knows no values yet."""
    sets = search_arrays.cause_set_arrays(problem, beliefs)
    states = math.prod(len(action.outcomes) + 1 for action in problem.actions) * len(beliefs.costs)
    open_ended = 2 * sum(not action.certain for action in problem.actions) >= len(problem.actions)
    if (
        sets is None
        and open_ended
        and states <= min(MAX_TABLE_STATES, TABLE_STATE_COST * expansions)
    ):
        return ValueTable(beliefs, problem, poll)
    if sets is None and suits(problem, beliefs):
        return BracketSearch(beliefs, poll)
    return BranchAndBound(beliefs, sets, poll)


MAX_EXPANSIONS_PER_CALL = 200_000
# about nanoseconds of an expansion for each pair of actions and outcomes of each
EXPANSION_NS = 4.0
# nanoseconds of an expansion that is cheap, and that a search may always take
SMALL, SHARE = 19_000.0, 3e8
BRACKETING = 9e8  # about nanoseconds that a search between bounds takes for one advice
MAX_LEAVES = 10_000  # with at most this many leaves, the rollout looks a third step ahead
MAX_OUTCOMES = 42  # with at most this many outcomes of actions, the rollout tries all of them
ROLLOUT_NS = 3e8  # about nanoseconds of one core that a rollout may take
# about nanoseconds that a rule takes for each cause and outcome of an action
CERTAIN, UNCERTAIN = 0.2, 10.0
BASE_RULES = rollout.RULES
COST_TIE = 1e-9


@dataclass
class ActionSelector:
    """Chooses actions for one problem.

    `expansions` limits the exact search for each question; 0 means no exact search. If it is None,
    the number suits the size of what is left of the problem, so that the first advice takes about a
    second. When `interrupted` returns True, every question gets the best answer so far.
    """

    problem: Troubleshooting
    expansions: int | None = None
    interrupted: Interrupted = never
    exact: Searcher = field(init=False)

    def __post_init__(self) -> None:
        beliefs, self._poll = search_arrays.belief_arrays(self.problem), Poll(self.interrupted)
        most = MAX_EXPANSIONS_PER_CALL if self.expansions is None else self.expansions
        self.exact = make_searcher(self.problem, beliefs, most, self._poll)
        self.groups = search_arrays.cause_groups(beliefs)
        self._bases = (self._memo(), self._memo(), self._memo())
        self._followed: dict[int, Memo] = {}
        # of the work of one advice: in a tree, the probability of reaching a node
        self._share = 1.0

    def start(self, situation: int = 0) -> CaseStanding:
        """The state at the beginning: each cause with a positive prior is possible, and nothing
        was seen.
        """
        return CaseStanding(
            possible_causes(search_arrays.prior_weights(self.problem)), 0, situation
        )

    def advise(self, standing: CaseStanding) -> CaseAdvice:
        """What to do next. Raises `ValueError` if no cause is possible."""
        weights, rest = self._state(standing)
        if self._poll.check():
            return self._hasty(weights, rest)
        before = self.exact.spent
        value, proved = self.exact.value(weights, rest, math.inf, self._budget(weights, rest))
        if proved:
            action, cost = self._first_best(weights, rest, value), value
        elif isinstance(self.exact, BracketSearch):
            action, cost = self._followed_bound(self.exact, weights, rest)
        else:
            action, cost = self._rollout(weights, rest)
        total = float(weights.sum())
        floor = value if proved else min(value, cost)
        conclusion = self._conclusion(weights) if action is None else None
        others = self._others(weights, rest, action)
        spent = self.exact.spent - before
        return CaseAdvice(action, conclusion, cost / total, floor / total, proved, others, spent)

    def compare(
        self, standing: CaseStanding, actions: tuple[int, ...]
    ) -> tuple[tuple[int, float, bool], ...]:
        """For each action, the expected cost of beginning with it, and whether it is exact or a
        lower bound.
        """
        weights, rest = self._state(standing)
        budget = self._budget(weights, rest)
        compared = [
            (a, *cost_of_beginning(self.exact, a, weights, rest, math.inf, budget)) for a in actions
        ]
        return tuple((a, value / float(weights.sum()), exact) for a, value, exact in compared)

    def weights(self, standing: CaseStanding) -> Floats:
        """The probability of each cause together with everything observed (C,); not normalised."""
        return self._state(standing)[0]

    def observe(self, standing: CaseStanding, action: int, outcome: int) -> CaseStanding:
        """The state of the case after an outcome.

        `possible` is 0 if no cause explains the outcome.
        """
        weights, rest = self._state(standing)
        problem = self.exact.beliefs
        after = weights * problem.likelihoods[action, outcome]
        return self._standing(after, search_arrays.rest_after(problem, action, outcome, rest))

    def tree(
        self,
        standing: CaseStanding | None = None,
        choose: Callable[[CaseStanding], CaseAdvice] | None = None,
    ) -> Tree:
        """The tree of all that may follow, with the advice of this selector or of `choose`."""
        first = self.start() if standing is None else standing
        try:
            return self._grow(first, choose or self.advise, float(self.weights(first).sum()))
        finally:
            self._share = 1.0

    def rule(self, name: str) -> Callable[[CaseStanding], CaseAdvice]:
        """A function that gives the advice of a one-step rule of `RULES`."""

        def choose(standing: CaseStanding) -> CaseAdvice:
            weights, rest = self._state(standing)
            cost = self._follow(weights, rest, BASE_RULES[name])
            trail = self._trail(weights, rest)
            action = rollout.greedy(self.exact.beliefs, self.groups, trail, 0, BASE_RULES[name])
            stops = action < 0 or self._stopping(weights) <= cost * (
                1.0 + COST_TIE
            )  # `cost` may come from another way
            conclusion = self._conclusion(weights) if stops else None
            return CaseAdvice(
                None if stops else action, conclusion, cost / float(weights.sum()), 0.0, False
            )

        return choose

    def _grow(
        self, standing: CaseStanding, choose: Callable[[CaseStanding], CaseAdvice], root: float
    ) -> Tree:
        weights = self.weights(standing)
        total = float(weights.sum())
        self._share = total / root
        advice = choose(standing)
        if advice.action is None:
            conclusion = advice.conclusion
            loss = self._stopping(weights) / total
            return Conclude(total / root, conclusion, loss)
        problem, action = self.exact.beliefs, advice.action
        branches: list[tuple[int, Tree]] = []
        for outcome in range(len(self.problem.actions[action].outcomes)):
            after = weights * problem.likelihoods[action, outcome]
            if not after.any():
                continue
            if problem.ends[action, outcome]:
                branches.append((outcome, Conclude(float(after.sum()) / root, None)))
            else:
                branches.append(
                    (outcome, self._grow(self.observe(standing, action, outcome), choose, root))
                )
        cost = float(problem.costs[standing.situation, action])
        return Try(total / root, action, cost, tuple(branches))

    def _first_best(self, weights: Floats, rest: int, value: float) -> int | None:
        """The first declared action that is optimal; None to stop. Stopping comes before every
        action.
        """
        limit = value * (1.0 + COST_TIE) + 1e-15
        if self._stopping(weights) <= limit:
            return None
        budget = self._budget(weights, rest)
        for action in self._telling(weights, rest):
            if self.exact.estimate(action, weights, rest) < limit:
                _, proved = cost_of_beginning(self.exact, action, weights, rest, limit, budget)
                if proved:
                    return action
        if isinstance(self.exact, BracketSearch):
            # no expansion was left to prove it: the upper bound, which is the value, begins so
            return self._followed_bound(self.exact, weights, rest)[0]
        raise AssertionError("no action has the optimal value")

    def _followed_bound(
        self, search: BracketSearch, weights: Floats, rest: int
    ) -> tuple[int | None, float]:
        """The action with which the upper bound begins, and this bound: going on like this
        costs no more.
        """
        _, cost, action = search.bounds(weights, rest)
        return (None, cost) if action < 0 else (action, cost)

    def _rollout(self, weights: Floats, rest: int) -> tuple[int | None, float]:
        """The first action by a lookahead over rules, and a cost that is not exceeded by going
        on like this.
        """
        steps = self._reach(weights, rest)
        while True:
            for base in self._bases:
                base.resume(0)
            trail = self._trail(weights, rest)
            action, cost = rollout.look_ahead(
                self.exact.beliefs, self.groups, self._bases, trail, 0, steps, math.inf
            )
            if self._poll.check() or not any(base.full for base in self._bases):
                break
            one, two, three = self._bases
            self._bases = (one.grown(), two.grown(), three.grown())
        return (None, cost) if action < 0 else (action, cost)

    def _hasty(self, weights: Floats, rest: int) -> CaseAdvice:
        """What a one-step rule prefers, at what the case costs at most."""
        beliefs, total = self.exact.beliefs, float(weights.sum())
        trail = Trail(beliefs, weights, rest)
        action = rollout.greedy(beliefs, self.groups, trail, 0, BASE_RULES["gain"])
        stopping, cost = self._stopping(weights), rollout.at_most(beliefs, self.groups, trail, 0)
        floor = float(np.where(weights > 0.0, beliefs.known, 0.0) @ weights)
        if action < 0 or stopping <= cost:
            return CaseAdvice(
                None, self._conclusion(weights), stopping / total, floor / total, False
            )
        return CaseAdvice(action, None, cost / total, floor / total, False)

    def _budget(self, weights: Floats, rest: int) -> int:
        """The expansions that suit what is left of the problem.

        Up to the size of 30 causes and 30 tests a search often ends within the default number.
        Beyond, the states grow with the size as well as the work on each of them.
        """
        if self.expansions is not None:
            return self.expansions
        beliefs, telling = self.exact.beliefs, len(self._telling(weights, rest))
        if isinstance(self.exact, BracketSearch):
            return int(self._share * BRACKETING / expansion_ns(beliefs)) + 1
        taken = (
            EXPANSION_NS
            * len(self.problem.actions)
            * telling
            * beliefs.outcomes**2
            * (1 + 0.3 * beliefs.sets)
        )
        if beliefs.widths.any():
            taken *= 1 + np.count_nonzero(weights) / 16
        most = max(
            MAX_EXPANSIONS_PER_CALL * min(1.0, SMALL / max(taken, 1.0)) ** 2,
            SHARE / max(taken, 1.0),
        )
        return min(MAX_EXPANSIONS_PER_CALL, int(most))

    def _reach(self, weights: Floats, rest: int) -> int:
        """Set how far the policies of the rollout go. Returns the steps of the lookahead."""
        beliefs, telling = self.exact.beliefs, self._telling(weights, rest)
        causes, actions, outcomes = (
            np.count_nonzero(weights),
            max(1, len(telling)),
            beliefs.outcomes,
        )
        open_ended = int(np.count_nonzero(beliefs.widths[telling]))
        if actions * outcomes <= MAX_OUTCOMES:
            self.groups.limit(len(self.problem.actions), 0.0)
            return 3 if (actions * outcomes) ** 3 <= MAX_LEAVES else 2
        node = len(BASE_RULES) * causes * outcomes * (CERTAIN * actions + UNCERTAIN * open_ended)
        nodes = max(min(causes, 8.0 * math.log2(causes + 1.0)), 2.0 ** min(60, open_ended))
        least = (
            0.0
            if node * nodes <= ROLLOUT_NS
            else float(weights.sum()) * min(0.25, 8.0 * node / ROLLOUT_NS)
        )
        leaves = max(1.0, ROLLOUT_NS / (node * nodes))
        width = int(math.sqrt(4.0 * leaves) / outcomes)
        steps, width = (2, width) if width > 1 else (1, max(1, int(leaves / outcomes)))
        self.groups.limit(min(width, len(self.problem.actions)), least)
        return steps

    def _follow(self, weights: Floats, rest: int, rule: int) -> float:
        """The weighted cost of following a one-step rule."""
        self.groups.limit(len(self.problem.actions), 0.0)
        while True:
            table = self._followed.setdefault(rule, self._memo())
            table.resume(0)
            trail = self._trail(weights, rest)
            cost = rollout.follow(self.exact.beliefs, self.groups, table, trail, 0, rule)
            if self._poll.check() or not table.full:
                return cost
            self._followed[rule] = table.grown()

    def available(self, standing: CaseStanding) -> list[int]:
        """The actions that are not done and may change what is believed, in the declared order."""
        return self._telling(*self._state(standing))

    def _telling(self, weights: Floats, rest: int) -> list[int]:
        trail, actions = self._trail(weights, rest), range(len(self.problem.actions))
        return [a for a in actions if belief.tells(self.exact.beliefs, trail, 0, a)]

    def _stopping(self, weights: Floats) -> float:
        """The loss of stopping now."""
        return belief.stop(self.exact.beliefs, self._trail(weights, 0), 0)

    def _trail(self, weights: Floats, rest: int) -> Trail:
        return Trail(self.exact.beliefs, weights, rest, self._poll)

    def _memo(self) -> Memo:
        return Memo(1 << 12, 0, self.exact.beliefs.words)

    def _others(
        self, weights: Floats, rest: int, chosen: int | None
    ) -> tuple[tuple[int, float], ...]:
        total = float(weights.sum())
        telling = [action for action in self._telling(weights, rest) if action != chosen]
        costs = [
            (self.exact.estimate(action, weights, rest) / total, action)
            for action in telling
            if not self._poll.check()
        ]
        return tuple((action, cost) for cost, action in sorted(costs))

    def _conclusion(self, weights: Floats) -> int | None:
        losses, slack = self.exact.beliefs.losses, self.exact.beliefs.slack
        if not len(losses):
            return None
        barred = np.isinf(losses)
        expected = np.where(barred, 0.0, losses) @ weights
        expected[barred @ weights > slack * weights.sum()] = np.inf
        return int(np.argmin(expected)) if np.isfinite(expected).any() else None

    def _state(self, standing: CaseStanding) -> tuple[Floats, int]:
        """The weights, and the second word of the key."""
        problem = self.exact.beliefs
        weights = search_arrays.prior_weights(self.problem)
        size = (len(weights) + 7) // 8
        left = standing.possible.to_bytes(size, "little")
        weights *= np.unpackbits(np.frombuffer(left, np.uint8), bitorder="little")[: len(weights)]
        rest = standing.history << problem.situations | standing.situation
        for action in np.flatnonzero(problem.widths):
            seen = (rest >> int(problem.shifts[action])) & ((1 << int(problem.widths[action])) - 1)
            if seen:
                weights = weights * problem.likelihoods[action, seen - 1]
        if not weights.any():
            raise ValueError("no cause explains what was observed")
        return weights, rest

    def _standing(self, weights: Floats, rest: int) -> CaseStanding:
        bits = self.exact.beliefs.situations
        return CaseStanding(possible_causes(weights), rest >> bits, rest & ((1 << bits) - 1))
