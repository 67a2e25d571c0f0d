"""Plain dynamic programming over every sequence of outcomes, for problems where few actions make that affordable.

A state is a number in a mixed radix: digit a is 0 while action a is not done, else its outcome plus one. Doing something
only makes the number larger, so that one pass downwards meets every successor first.
"""

import numpy as np

from engine.stages.diagnosis.kernels import compiled
from engine.stages.diagnosis.kernels.belief import Beliefs, stop
from engine.stages.diagnosis.kernels.memo import Floats, Longs


@compiled
def weights_of(problem: Beliefs, prior: Floats, radix: Longs, number: int, digits: Longs) -> Floats:
    """The weights in a state; its digits are written to `digits` (A,)."""
    weights = prior.copy()
    for action in range(radix.shape[0]):
        digits[action] = number % radix[action]
        number //= radix[action]
        if digits[action]:
            weights = weights * problem.likelihoods[action, digits[action] - 1]
    return weights


@compiled
def values(problem: Beliefs, prior: Floats, radix: Longs) -> Floats:
    """The weighted cost of every state in every situation (K, N), N the product of `radix` (A,)."""
    situations, actions = problem.costs.shape
    place = np.ones(actions + 1, np.int64)
    for action in range(actions):
        place[action + 1] = place[action] * radix[action]
    found = np.zeros((situations, place[actions]))
    digits = np.zeros(actions, np.int64)
    for number in range(place[actions] - 1, -1, -1):
        weights = weights_of(problem, prior, radix, number, digits)
        total, stopping = weights.sum(), stop(problem, weights)
        for situation in range(situations):
            best = stopping if total > 0.0 else 0.0
            for action in range(actions):
                going = problem.costs[situation, action] * total
                if digits[action] == 0 and going < best:
                    after = problem.following[situation, action]
                    for outcome in range(radix[action] - 1):
                        if not problem.ends[action, outcome]:
                            going += found[after, number + (outcome + 1) * place[action]]
                    best = min(best, going)
            found[situation, number] = best
    return found
