"""A plain dynamic program over beliefs, to hold test selection against: every set of outcomes seen,
backwards.

It shares nothing with the engine. A state has one digit for each action: 0 while the action is not
done, else its outcome plus one; the last outcome of a repair ends the case and has no digit. The
value of a state is the least expected cost from there, times the probability of what was seen.
"""

import numpy as np
from numpy.typing import NDArray

from cellwright.engine.model.troubleshooting import Troubleshooting

Floats = NDArray[np.float64]


def least_cost(problem: Troubleshooting) -> float:
    """The least expected cost of a problem without set-up.

    Every digit more makes the table two or three times as long.
    """
    rows = [
        [
            np.array(row)
            for outcome, row in enumerate(action.likelihoods)
            if outcome not in action.ends
        ]
        for action in problem.actions
    ]
    weights, done = np.array([problem.priors]), np.zeros(1, np.int64)
    places = []
    for kinds in rows:  # the digit of this action is more significant than all before it
        places.append(len(weights))
        weights = np.concatenate([weights, *(weights * row for row in kinds)])
        done = np.concatenate([done, *(done + 1 for _ in kinds)])
    masses = weights.sum(axis=1)
    losses = np.array([conclusion.losses for conclusion in problem.conclusions])
    value: Floats = (weights @ losses.T).min(axis=1)
    numbers = np.arange(len(weights))
    for count in range(len(rows) - 1, -1, -1):
        level = numbers[done == count]
        for action, kinds, place in zip(problem.actions, rows, places, strict=True):
            open_ = level[level // place % (len(kinds) + 1) == 0]
            going = action.cost * masses[open_]
            for outcome in range(len(kinds)):
                going += value[open_ + (outcome + 1) * place]
            value[open_] = np.minimum(value[open_], going)
    return float(value[0])
