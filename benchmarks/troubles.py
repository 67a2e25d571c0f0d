"""Random troubleshooting problems for `benchmarks/diagnosis.py`; the same seed gives the same
problem.
"""

import itertools
import math

import numpy as np

from cellwright.engine.model.troubleshooting import Action, Conclusion, Setup, Troubleshooting


def isolation(causes: int, tests: int, density: float, skewed: bool, seed: int) -> Troubleshooting:
    """Certain two-valued tests of costs 1 to 10 that tell all causes apart; each cause shows in
    a test at `density`.
    """
    chance = np.random.default_rng(seed)
    table = chance.random((tests, causes)) < density
    while len(np.unique(table, axis=1).T) < causes:  # draw again what is alike or shows nowhere
        _, first, counts = np.unique(table, axis=1, return_index=True, return_counts=True)
        alike = np.setdiff1d(np.arange(causes), first[counts == 1])
        table[:, alike] = chance.random((tests, len(alike))) < density
    actions = tuple(
        _test(f"t{i}", float(cost), row.astype(float))
        for i, (cost, row) in enumerate(zip(chance.integers(1, 11, tests), table, strict=True))
    )
    return Troubleshooting(
        _names(causes), _priors(causes, skewed, chance), actions, _each(causes, math.inf)
    )


def uncertain(causes: int, tests: int, seed: int) -> Troubleshooting:
    """Tests that each answer rightly with a probability between 0.75 and 0.98; a wrong
    conclusion costs 60.
    """
    chance = np.random.default_rng(seed)
    actions = []
    for i in range(tests):
        shows = chance.random(causes) < 0.4
        right = chance.uniform(0.75, 0.98, causes).round(2)
        actions.append(
            _test(f"t{i}", float(chance.integers(1, 11)), np.where(shows, right, 1.0 - right))
        )
    return Troubleshooting(
        _names(causes), _priors(causes, bool(seed % 2), chance), tuple(actions), _each(causes, 60.0)
    )


def unsure(causes: int, tests: int, seed: int) -> Troubleshooting:
    """Tests of two outcomes that are never sure, a repair for each cause, and a safe stop that
    costs 300.

    A third of the problems has tests that are right with 0.8 to 0.97 for some causes and show as
    much under all others, a third has tests of any quality, and in a third tests are right with 0.6
    to 0.98.
    """
    chance = np.random.default_rng(20_000 + seed)
    actions = []
    for i in range(tests):
        if seed % 3 == 0:
            shown = np.full(causes, 0.05)
            shown[chance.choice(causes, max(1, causes // 3), replace=False)] = chance.uniform(
                0.8, 0.97
            )
        elif seed % 3 == 1:
            shown = chance.uniform(0.02, 0.98, causes)
        else:
            right = chance.uniform(0.6, 0.98, causes)
            shown = np.where(chance.random(causes) < 0.5, right, 1.0 - right)
        actions.append(_test(f"t{i}", float(chance.integers(1, 11)), shown.round(2)))
    for i in range(causes):
        cured = tuple(float(i == cause) for cause in range(causes))
        rows = (cured, tuple(1.0 - each for each in cured))
        actions.append(
            Action(f"r{i}", float(chance.integers(10, 101)), ("cured", "not"), rows, frozenset({0}))
        )
    priors = _priors(causes, bool(seed % 2), chance)
    stop = Conclusion("stop", (300.0,) * causes)
    return Troubleshooting(_names(causes), priors, tuple(actions), (stop,))


def with_setup(causes: int, tests: int, conditions: int, seed: int) -> Troubleshooting:
    """As `isolation`, each test needing one or two of the conditions on or off; changing one
    costs 5 to 20.
    """
    chance = np.random.default_rng(10_000 + seed)
    problem = isolation(causes, tests, 0.4, bool(seed % 2), seed)
    prices = chance.integers(5, 21, conditions)
    needs: list[dict[int, int]] = []
    for _ in range(tests):
        chosen = chance.choice(conditions, chance.integers(1, 3), replace=False)
        needs.append({int(condition): int(chance.integers(0, 2)) for condition in chosen})
    situations = list(itertools.product((0, 1), repeat=conditions))
    after = [
        [tuple(need.get(c, s[c]) for c in range(conditions)) for need in needs] for s in situations
    ]
    costs = tuple(
        tuple(float(sum(prices[c] for c in range(conditions) if s[c] != then[c])) for then in row)
        for s, row in zip(situations, after, strict=True)
    )
    following = tuple(tuple(situations.index(then) for then in row) for row in after)
    return Troubleshooting(
        problem.causes,
        problem.priors,
        problem.actions,
        problem.conclusions,
        Setup(costs, following),
    )


def _test(name: str, cost: float, shown: np.ndarray) -> Action:
    rows = (tuple(map(float, shown)), tuple(float(1.0 - each) for each in shown))
    return Action(name, cost, ("shows", "does not"), rows)


def _names(causes: int) -> tuple[str, ...]:
    return tuple(f"c{i}" for i in range(causes))


def _each(causes: int, wrong: float) -> tuple[Conclusion, ...]:
    rows = [tuple(0.0 if i == j else wrong for j in range(causes)) for i in range(causes)]
    return tuple(Conclusion(f"it is c{i}", row) for i, row in enumerate(rows))


def _priors(causes: int, skewed: bool, chance: np.random.Generator) -> tuple[float, ...]:
    """Flat, or falling with the rank as in Zipf's law, the ranks drawn at random."""
    weights = 1.0 / chance.permutation(np.arange(1, causes + 1)) if skewed else np.ones(causes)
    return tuple(float(each) for each in weights / weights.sum())
