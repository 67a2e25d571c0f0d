# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""Plain dynamic programming over all sequences of outcomes, for problems with few actions.

A state is a number in a mixed radix: digit a is 0 while action a is not done, else its outcome plus
one. An action only makes the number larger, so one downward pass reaches every successor before the
state itself.
"""

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs, real, whole
from cellwright.engine.kernels.cancellation import Poll
from cellwright.engine.stages.diagnosis.kernels.belief import Beliefs, Trail, stop


class States:
    """The values (K, N) of all states in all situations; N is the product of `radix` (A,).

    Digits and places (A,) are those of one state.
    """

    def __init__(self, problem: Beliefs, prior: Floats, radix: Longs, poll: Poll) -> None:
        """Raises `ValueError` unless each action has a radix from 1 to the number of outcomes
        plus one.
        """
        if (
            radix.shape != (problem.actions,)
            or not ((radix >= 1) & (radix <= problem.outcomes + 1)).all()
        ):
            raise ValueError(
                f"a radix of 1 to {problem.outcomes + 1} was expected for each action, not {radix}"
            )
        places = np.cumprod(np.concatenate([np.ones(1, np.int64), radix]))
        self.problem, self.count = problem, int(radix.prod())
        self.found = np.zeros((len(problem.costs), self.count))
        self.prior, self.trail = real(prior), Trail(problem, prior, 0, poll)
        self.radix, self.place = whole(radix), whole(places)
        self.digits = whole(np.zeros(problem.actions, np.int64))
        self.values, self.weights = real(self.found), real(np.zeros(problem.causes))

    def _enter(self, number: int) -> None:
        """Set digits and weights to those of a state."""
        problem = self.problem
        for cause in range(problem.causes):
            self.weights[cause] = self.prior[cause]
        for action in range(problem.actions):
            digit = number % self.radix[action]
            number = number // self.radix[action]
            self.digits[action] = digit
            if digit:
                for cause in range(problem.causes):
                    self.weights[cause] *= problem._likelihoods[action, digit - 1, cause]
        self.trail.enter(self.weights)

    def _going(self, situation: int, number: int, action: int, going: float) -> float:
        """The cost of an action; `going` is the cost without what comes after it."""
        problem = self.problem
        after = problem._following[situation, action]
        for outcome in range(self.radix[action] - 1):
            if not problem._ends[action, outcome]:
                going += self.values[after, number + (outcome + 1) * self.place[action]]
        return going

    def fill(self) -> None:
        """Compute every value, from the last state to the first."""
        problem = self.problem
        for number in range(self.count - 1, -1, -1):
            if self.trail.poll.due(problem.actions * problem.causes):
                break
            self._enter(number)
            total, stopping = self.trail.mass(0), stop(problem, self.trail, 0)
            for situation in range(problem.changes):
                best = stopping if total > 0.0 else 0.0
                for action in range(problem.actions):
                    going = problem._costs[situation, action] * total
                    if self.digits[action] == 0 and going < best:
                        best = min(best, self._going(situation, number, action, going))
                self.values[situation, number] = best


def values(problem: Beliefs, prior: Floats, radix: Longs, poll: Poll) -> Floats:
    """The weighted cost of every state in every situation (K, N); N is the product of `radix` (A,).

    If the search is stopped, the values are of no use.
    """
    states = States(problem, prior, radix, poll)
    states.fill()
    return states.found
