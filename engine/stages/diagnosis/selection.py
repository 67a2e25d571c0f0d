"""Test selection: which action to take next, and the tree of all that may follow.

The choice is exact by branch and bound within a budget of expansions. If the budget does not suffice, a
rollout of two steps chooses, and there is a proven lower bound. If actions are equally good, the one declared
first is chosen. A `Selector` remembers what it has proved, so asking again after an outcome costs little.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from engine.kernels.arrays import Floats
from engine.model.troubleshooting import Advice, Conclude, Standing, Tree, Troubleshooting, Try
from engine.stages.diagnosis import arrays
from engine.stages.diagnosis.exact import Interrupted, Searcher, begun, never, searcher
from engine.stages.diagnosis.kernels import belief, rollout
from engine.stages.diagnosis.kernels.belief import Trail
from engine.stages.diagnosis.kernels.memo import Memo

EXPANSIONS = 200_000
LEAVES = 10_000  # with at most this many leaves, the rollout looks a third step ahead
RULES = rollout.RULES
TIE = 1e-9


@dataclass
class Selector:
    """Chooses actions for one problem.

    `expansions` limits the exact search for each question; 0 means no exact search.
    """

    problem: Troubleshooting
    expansions: int = EXPANSIONS
    interrupted: Interrupted = never
    exact: Searcher = field(init=False)

    def __post_init__(self) -> None:
        self.exact = searcher(self.problem, self.expansions, self.interrupted)
        self.groups = rollout.Groups(self.exact.beliefs, arrays.groups(self.problem))
        self._bases = (Memo(1 << 12, 0), Memo(1 << 12, 0), Memo(1 << 12, 0))
        self._followed: dict[int, Memo] = {}

    def start(self, situation: int = 0) -> Standing:
        """The state at the beginning: each cause with a positive prior is possible, and nothing was seen."""
        return Standing(self._trail(arrays.priors(self.problem)).possible(0), 0, situation)

    def advise(self, standing: Standing) -> Advice:
        """What to do next. Raises `ValueError` if no cause is possible."""
        weights, rest = self._state(standing)
        before = self.exact.spent
        value, proved = self.exact.value(weights, rest, math.inf, self.expansions)
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
        found = [(a, *begun(self.exact, a, weights, rest, math.inf, self.expansions)) for a in actions]
        return tuple((a, value / float(weights.sum()), exact) for a, value, exact in found)

    def weights(self, standing: Standing) -> Floats:
        """The probability of each cause together with everything observed (C,); not normalised."""
        return self._state(standing)[0]

    def observe(self, standing: Standing, action: int, outcome: int) -> Standing:
        """The state of the case after an outcome. `possible` is 0 if no cause explains the outcome."""
        weights, rest = self._state(standing)
        problem = self.exact.beliefs
        after = weights * problem.likelihoods[action, outcome]
        return self._standing(after, belief.rest_after(problem, action, outcome, rest))

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
            trail = self._trail(weights)
            action = rollout.greedy(self.exact.beliefs, self.groups, trail, 0, rest, RULES[name])
            stops = action < 0 or belief.stop(self.exact.beliefs, trail, 0) <= cost
            conclusion = self._conclusion(weights) if stops else None
            return Advice(None if stops else action, conclusion, cost / float(weights.sum()), 0.0, False)

        return choose

    def _grow(self, standing: Standing, choose: Callable[[Standing], Advice], root: float) -> Tree:
        weights = self.weights(standing)
        total = float(weights.sum())
        advice = choose(standing)
        if advice.action is None:
            conclusion = advice.conclusion
            loss = belief.stop(self.exact.beliefs, self._trail(weights), 0) / total
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
        if belief.stop(self.exact.beliefs, self._trail(weights), 0) <= limit:
            return None
        for action in self._telling(weights, rest):
            if self.exact.estimate(action, weights, rest) < limit:
                _, proved = begun(self.exact, action, weights, rest, limit, self.expansions)
                if proved:
                    return action
        raise AssertionError("no action has the optimal value")

    def _rollout(self, weights: Floats, rest: int) -> tuple[int | None, float]:
        while True:
            problem = self.exact.beliefs
            steps = 3 if problem.masks.size**3 <= LEAVES else 2
            action, cost = rollout.look_ahead(
                problem, self.groups, self._bases, self._trail(weights), 0, rest, steps, math.inf
            )
            if not any(base.full for base in self._bases):
                return (None if action < 0 else action), cost
            one, two, three = self._bases
            self._bases = (_longer(one), _longer(two), _longer(three))

    def _follow(self, weights: Floats, rest: int, rule: int) -> float:
        """The weighted cost of following a one-step rule."""
        while True:
            table = self._followed.setdefault(rule, Memo(1 << 12, 0))
            cost = rollout.follow(self.exact.beliefs, self.groups, table, self._trail(weights), 0, rest, rule)
            if not table.full:
                return cost
            self._followed[rule] = _longer(table)

    def _telling(self, weights: Floats, rest: int) -> list[int]:
        trail, actions = self._trail(weights), range(len(self.problem.actions))
        return [a for a in actions if belief.tells(self.exact.beliefs, trail, 0, a, rest)]

    def _trail(self, weights: Floats) -> Trail:
        return Trail(self.exact.beliefs, weights)

    def _others(self, weights: Floats, rest: int, chosen: int | None) -> tuple[tuple[int, float], ...]:
        total = float(weights.sum())
        telling = [action for action in self._telling(weights, rest) if action != chosen]
        costs = [(self.exact.estimate(action, weights, rest) / total, action) for action in telling]
        return tuple((action, cost) for cost, action in sorted(costs))

    def _conclusion(self, weights: Floats) -> int | None:
        losses = self.exact.beliefs.losses
        if not len(losses):
            return None
        expected = np.where(weights > 0.0, losses, 0.0) @ weights
        return int(np.argmin(expected)) if np.isfinite(expected).any() else None

    def _state(self, standing: Standing) -> tuple[Floats, int]:
        """The weights, and the second word of the key."""
        problem = self.exact.beliefs
        weights = arrays.priors(self.problem)
        weights *= (standing.possible >> np.arange(len(weights))) & 1
        rest = standing.history << problem.situations | standing.situation
        for action in np.flatnonzero(problem.widths):
            seen = (rest >> int(problem.shifts[action])) & ((1 << int(problem.widths[action])) - 1)
            if seen:
                weights = weights * problem.likelihoods[action, seen - 1]
        if not weights.any():
            raise ValueError("no cause explains what was observed")
        return weights, int(rest)

    def _standing(self, weights: Floats, rest: int) -> Standing:
        bits = self.exact.beliefs.situations
        return Standing(self._trail(weights).possible(0), rest >> bits, rest & ((1 << bits) - 1))


def _longer(base: Memo) -> Memo:
    return Memo(4 * base.length, 0)
