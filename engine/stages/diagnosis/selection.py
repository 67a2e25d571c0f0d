"""Test selection: which action to take next, and the tree of all that may follow.

The choice is exact by branch and bound within a budget of expansions. If the budget does not suffice, a
rollout of two steps chooses, and there is a proven lower bound. If actions are equally good, the one declared
first is chosen. A `Selector` remembers what it has proved, so asking again after an outcome costs little.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.cancellation import Interrupted, Poll, never
from cellwright.engine.model.troubleshooting import Advice, Conclude, Standing, Tree, Troubleshooting, Try
from cellwright.engine.stages.diagnosis import arrays
from cellwright.engine.stages.diagnosis.exact import Searcher, begun, possible, searcher
from cellwright.engine.stages.diagnosis.kernels import belief, rollout
from cellwright.engine.stages.diagnosis.kernels.belief import Trail
from cellwright.engine.stages.diagnosis.kernels.memo import Memo

EXPANSIONS = 200_000
EXPANSION = 4.0  # about nanoseconds of an expansion for each pair of actions and outcomes of each
SMALL, SHARE = 19_000.0, 3e8  # nanoseconds of an expansion that is cheap, and that a search may always take
LEAVES = 10_000  # with at most this many leaves, the rollout looks a third step ahead
FEW = 42  # with at most this many outcomes of actions, the rollout tries all of them
REACH = 3e8  # about nanoseconds of one core that a rollout may take
CERTAIN, UNCERTAIN = 0.2, 10.0  # about nanoseconds that a rule takes for each cause and outcome of an action
RULES = rollout.RULES
TIE = 1e-9


@dataclass
class Selector:
    """Chooses actions for one problem.

    `expansions` limits the exact search for each question; 0 means no exact search. If it is None, the
    number suits the size of what is left of the problem, so that the first advice takes about a second.
    When `interrupted` returns True, every question gets the best answer so far.
    """

    problem: Troubleshooting
    expansions: int | None = None
    interrupted: Interrupted = never
    exact: Searcher = field(init=False)

    def __post_init__(self) -> None:
        beliefs, self._poll = arrays.beliefs(self.problem), Poll(self.interrupted)
        most = EXPANSIONS if self.expansions is None else self.expansions
        self.exact = searcher(self.problem, beliefs, most, self._poll)
        self.groups = arrays.groups(beliefs)
        self._bases = (self._memo(), self._memo(), self._memo())
        self._followed: dict[int, Memo] = {}

    def start(self, situation: int = 0) -> Standing:
        """The state at the beginning: each cause with a positive prior is possible, and nothing was seen."""
        return Standing(possible(arrays.priors(self.problem)), 0, situation)

    def advise(self, standing: Standing) -> Advice:
        """What to do next. Raises `ValueError` if no cause is possible."""
        weights, rest = self._state(standing)
        if self._poll.check():
            return self._hasty(weights, rest)
        before = self.exact.spent
        value, proved = self.exact.value(weights, rest, math.inf, self._budget(weights, rest))
        if proved:
            action, cost = self._first_best(weights, rest, value), value
        else:
            action, cost = self._rollout(weights, rest)
        total = float(weights.sum())
        floor = value if proved else min(value, cost)
        conclusion = self._conclusion(weights) if action is None else None
        others = self._others(weights, rest, action)
        spent = self.exact.spent - before
        return Advice(action, conclusion, cost / total, floor / total, proved, others, spent)

    def compare(self, standing: Standing, actions: tuple[int, ...]) -> tuple[tuple[int, float, bool], ...]:
        """For each action, the expected cost of beginning with it, and whether it is exact or a lower bound."""
        weights, rest = self._state(standing)
        budget = self._budget(weights, rest)
        found = [(a, *begun(self.exact, a, weights, rest, math.inf, budget)) for a in actions]
        return tuple((a, value / float(weights.sum()), exact) for a, value, exact in found)

    def weights(self, standing: Standing) -> Floats:
        """The probability of each cause together with everything observed (C,); not normalised."""
        return self._state(standing)[0]

    def observe(self, standing: Standing, action: int, outcome: int) -> Standing:
        """The state of the case after an outcome. `possible` is 0 if no cause explains the outcome."""
        weights, rest = self._state(standing)
        problem = self.exact.beliefs
        after = weights * problem.likelihoods[action, outcome]
        return self._standing(after, arrays.rest_after(problem, action, outcome, rest))

    def tree(
        self, standing: Standing | None = None, choose: Callable[[Standing], Advice] | None = None
    ) -> Tree:
        """The tree of all that may follow, with the advice of this selector or of `choose`."""
        first = self.start() if standing is None else standing
        return self._grow(first, choose or self.advise, float(self.weights(first).sum()))

    def rule(self, name: str) -> Callable[[Standing], Advice]:
        """A function that gives the advice of a one-step rule of `RULES`."""

        def choose(standing: Standing) -> Advice:
            weights, rest = self._state(standing)
            cost = self._follow(weights, rest, RULES[name])
            trail = self._trail(weights, rest)
            action = rollout.greedy(self.exact.beliefs, self.groups, trail, 0, RULES[name])
            stops = action < 0 or self._stopping(weights) <= cost * (
                1.0 + TIE
            )  # `cost` may come from another way
            conclusion = self._conclusion(weights) if stops else None
            return Advice(None if stops else action, conclusion, cost / float(weights.sum()), 0.0, False)

        return choose

    def _grow(self, standing: Standing, choose: Callable[[Standing], Advice], root: float) -> Tree:
        weights = self.weights(standing)
        total = float(weights.sum())
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
                branches.append((outcome, self._grow(self.observe(standing, action, outcome), choose, root)))
        cost = float(problem.costs[standing.situation, action])
        return Try(total / root, action, cost, tuple(branches))

    def _first_best(self, weights: Floats, rest: int, value: float) -> int | None:
        """The first declared action that is optimal; None to stop. Stopping comes before every action."""
        limit = value * (1.0 + TIE) + 1e-15
        if self._stopping(weights) <= limit:
            return None
        budget = self._budget(weights, rest)
        for action in self._telling(weights, rest):
            if self.exact.estimate(action, weights, rest) < limit:
                _, proved = begun(self.exact, action, weights, rest, limit, budget)
                if proved:
                    return action
        raise AssertionError("no action has the optimal value")

    def _rollout(self, weights: Floats, rest: int) -> tuple[int | None, float]:
        """The first action by a lookahead over rules, and a cost that is not exceeded by going on like this."""
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

    def _hasty(self, weights: Floats, rest: int) -> Advice:
        """What a one-step rule prefers, at what the case costs at most."""
        beliefs, total = self.exact.beliefs, float(weights.sum())
        trail = Trail(beliefs, weights, rest)
        action = rollout.greedy(beliefs, self.groups, trail, 0, RULES["gain"])
        stopping, cost = self._stopping(weights), rollout.at_most(beliefs, self.groups, trail, 0)
        floor = float(np.where(weights > 0.0, beliefs.known, 0.0) @ weights)
        if action < 0 or stopping <= cost:
            return Advice(None, self._conclusion(weights), stopping / total, floor / total, False)
        return Advice(action, None, cost / total, floor / total, False)

    def _budget(self, weights: Floats, rest: int) -> int:
        """The expansions that suit what is left of the problem.

        Up to the size of 30 causes and 30 tests a search often ends within the default number. Beyond, the
        states grow with the size as well as the work on each of them.
        """
        if self.expansions is not None:
            return self.expansions
        beliefs, telling = self.exact.beliefs, len(self._telling(weights, rest))
        taken = (
            EXPANSION * len(self.problem.actions) * telling * beliefs.outcomes**2 * (1 + 0.3 * beliefs.sets)
        )
        if beliefs.widths.any():
            taken *= 1 + np.count_nonzero(weights) / 16
        most = max(EXPANSIONS * min(1.0, SMALL / max(taken, 1.0)) ** 2, SHARE / max(taken, 1.0))
        return min(EXPANSIONS, int(most))

    def _reach(self, weights: Floats, rest: int) -> int:
        """Set how far the policies of the rollout go. Returns the steps of the lookahead."""
        beliefs, telling = self.exact.beliefs, self._telling(weights, rest)
        causes, actions, outcomes = np.count_nonzero(weights), max(1, len(telling)), beliefs.outcomes
        open_ended = int(np.count_nonzero(beliefs.widths[telling]))
        if actions * outcomes <= FEW:
            self.groups.limit(len(self.problem.actions), 0.0)
            return 3 if (actions * outcomes) ** 3 <= LEAVES else 2
        node = len(RULES) * causes * outcomes * (CERTAIN * actions + UNCERTAIN * open_ended)
        nodes = max(min(causes, 8.0 * math.log2(causes + 1.0)), 2.0 ** min(60, open_ended))
        least = 0.0 if node * nodes <= REACH else float(weights.sum()) * min(0.25, 8.0 * node / REACH)
        leaves = max(1.0, REACH / (node * nodes))
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

    def _others(self, weights: Floats, rest: int, chosen: int | None) -> tuple[tuple[int, float], ...]:
        total = float(weights.sum())
        telling = [action for action in self._telling(weights, rest) if action != chosen]
        costs = [
            (self.exact.estimate(action, weights, rest) / total, action)
            for action in telling
            if not self._poll.check()
        ]
        return tuple((action, cost) for cost, action in sorted(costs))

    def _conclusion(self, weights: Floats) -> int | None:
        losses = self.exact.beliefs.losses
        if not len(losses):
            return None
        left = weights > 0.0
        expected = losses[:, left] @ weights[left]
        return int(np.argmin(expected)) if np.isfinite(expected).any() else None

    def _state(self, standing: Standing) -> tuple[Floats, int]:
        """The weights, and the second word of the key."""
        problem = self.exact.beliefs
        weights = arrays.priors(self.problem)
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

    def _standing(self, weights: Floats, rest: int) -> Standing:
        bits = self.exact.beliefs.situations
        return Standing(possible(weights), rest >> bits, rest & ((1 << bits) - 1))
