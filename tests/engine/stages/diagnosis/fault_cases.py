"""Troubleshooting problems to try things on: at random, and the slow, plainly correct way to
solve them.
"""

import itertools
import math

import numpy as np
from hypothesis import strategies as st

from cellwright.engine.model.troubleshooting import Action, Conclusion, Setup, Troubleshooting

COSTS = st.integers(1, 10).map(float)
CHANCES = st.sampled_from((0.0, 0.1, 0.3, 0.5, 0.8, 1.0))


def each_alone(causes: int, wrong: float = math.inf) -> tuple[Conclusion, ...]:
    """One conclusion for each cause, losing `wrong` under the others."""
    rows = [tuple(0.0 if i == j else wrong for j in range(causes)) for i in range(causes)]
    return tuple(Conclusion(f"it is {i}", row) for i, row in enumerate(rows))


def names(count: int) -> tuple[str, ...]:
    """As many names of causes."""
    return tuple(f"c{i}" for i in range(count))


def certain(
    name: str, cost: float, outcomes: tuple[int, ...], ends: frozenset[int] = frozenset()
) -> Action:
    """An action whose outcome each cause fixes."""
    kinds = max(outcomes) + 1
    rows = tuple(tuple(float(found == kind) for found in outcomes) for kind in range(kinds))
    return Action(name, cost, tuple(f"o{kind}" for kind in range(kinds)), rows, ends)


def uncertain(
    name: str, cost: float, chances: tuple[float, ...], ends: frozenset[int] = frozenset()
) -> Action:
    """An action of two outcomes; the first has these probabilities."""
    return Action(name, cost, ("yes", "no"), (chances, tuple(1.0 - each for each in chances)), ends)


@st.composite
def priors(draw: st.DrawFn, causes: int) -> tuple[float, ...]:
    """Flat or skewed, summing to one."""
    counts = draw(st.lists(st.integers(1, 50), min_size=causes, max_size=causes))
    return tuple(count / sum(counts) for count in counts)


@st.composite
def setups(draw: st.DrawFn, actions: int) -> Setup:
    """Up to three situations, each action done in one of them; the way over a third one is
    never shorter.
    """
    count = draw(st.integers(1, 3))
    ways = [
        [0.0 if i == j else float(draw(st.integers(0, 8))) for j in range(count)]
        for i in range(count)
    ]
    for middle, i, j in itertools.product(range(count), repeat=3):
        ways[i][j] = min(ways[i][j], ways[i][middle] + ways[middle][j])
    where = tuple(draw(st.lists(st.integers(0, count - 1), min_size=actions, max_size=actions)))
    return Setup(tuple(tuple(row[at] for at in where) for row in ways), (where,) * count)


@st.composite
def isolations(draw: st.DrawFn, most: int = 6) -> Troubleshooting:
    """Certain tests; causes that nothing tells apart may be concluded together, and some others."""
    causes, tests = draw(st.integers(1, most)), draw(st.integers(1, most))
    row = st.lists(st.integers(0, 2), min_size=causes, max_size=causes).map(tuple)
    table = draw(st.lists(row, min_size=tests, max_size=tests))
    alike: dict[tuple[int, ...], list[int]] = {}
    for cause in range(causes):
        alike.setdefault(tuple(row[cause] for row in table), []).append(cause)
    shared = draw(st.lists(st.sets(st.integers(0, causes - 1), min_size=1), max_size=2))
    groups = [*alike.values(), *map(sorted, shared)]
    conclusions = tuple(
        Conclusion(str(group), tuple(0.0 if c in group else math.inf for c in range(causes)))
        for group in groups
    )
    actions = tuple(certain(f"t{i}", draw(COSTS), row) for i, row in enumerate(table))
    setup = draw(st.none() | setups(tests))
    return Troubleshooting(names(causes), draw(priors(causes)), actions, conclusions, setup)


@st.composite
def troubles(draw: st.DrawFn, most: int = 4) -> Troubleshooting:
    """Uncertain tests, repairs that may fail, and a question to a person that always ends the
    case.
    """
    causes = draw(st.integers(1, most))
    chances = st.lists(CHANCES, min_size=causes, max_size=causes).map(tuple)
    tests = [uncertain(f"t{i}", draw(COSTS), draw(chances)) for i in range(draw(st.integers(0, 3)))]
    ends = frozenset({0})
    repairs = [
        uncertain(f"r{i}", draw(COSTS), draw(chances), ends) for i in range(draw(st.integers(0, 2)))
    ]
    actions = tuple(tests + repairs)
    wrong = draw(st.sampled_from((5.0, 40.0)))
    conclusions = (*each_alone(causes, wrong), Conclusion("ask", (draw(COSTS) * 3,) * causes))
    setup = draw(st.none() | setups(len(actions))) if actions else None
    return Troubleshooting(names(causes), draw(priors(causes)), actions, conclusions, setup)


def brute_force(problem: Troubleshooting) -> float:
    """The least expected cost, by trying every action not done yet after every sequence of
    outcomes.
    """
    return _least(problem, np.array(problem.priors), frozenset(), 0)


def _least(
    problem: Troubleshooting, weights: np.ndarray, done: frozenset[int], situation: int
) -> float:
    best = math.inf
    for conclusion in problem.conclusions:
        best = min(
            best, sum(w * loss for w, loss in zip(weights, conclusion.losses, strict=True) if w > 0)
        )
    for index, action in enumerate(problem.actions):
        if index in done:
            continue
        cost, after = action.cost, situation
        if problem.setup:
            cost += problem.setup.costs[situation][index]
            after = problem.setup.following[situation][index]
        total = cost * float(weights.sum())
        for outcome, row in enumerate(action.likelihoods):
            seen = weights * np.array(row)
            if outcome not in action.ends and seen.any() and total < best:
                total += _least(problem, seen, done | {index}, after)
        best = min(best, total)
    return best
