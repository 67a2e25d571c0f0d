"""Visits that several arms share: agreement with all ways to share them, and laws for more of
them.
"""

import itertools
import random

import numpy as np
import pytest

from cellwright.engine.model.tour_problem import (
    SharedProblem,
    Shares,
    TourProblem,
    Visit,
    busy_with,
)
from cellwright.engine.stages.sequencing import arm_shares
from cellwright.engine.stages.sequencing.arm_shares import share_visits


def drawn(seed: int, count: int, arms: int = 2) -> SharedProblem:
    """Points in a strip; each arm reaches those near its middle.

    Both make each in a time of their own.
    """
    random_ = random.Random(seed)
    where = [(random_.uniform(0.0, 100.0), random_.uniform(0.0, 30.0)) for _ in range(count)]
    tours = {}
    for n in range(arms):
        middle, reach = 100.0 * (n + 0.5) / arms, 70.0 / arms
        own = [k for k, (x, _) in enumerate(where) if abs(x - middle) <= reach]
        points = np.array([where[k] for k in own]).reshape(-1, 2)
        ways = np.ceil(np.linalg.norm(points[:, None] - points[None], axis=2)).astype(np.int64)
        visits = tuple(Visit(f"v{k}", duration=random_.randint(3, 9)) for k in own)
        tours[f"arm_{n}"] = TourProblem("drawn", visits, ways, closed=False)
    return SharedProblem(tours)


def least_makespan(problem: SharedProblem) -> int:
    """By all ways to share the visits, each arm in all orders."""
    names = sorted({visit.name for each in problem.tours.values() for visit in each.visits})
    place = {
        arm: {v.name: n for n, v in enumerate(each.visits)} for arm, each in problem.tours.items()
    }
    best = 1 << 60
    for way in itertools.product(*([arm for arm in place if name in place[arm]] for name in names)):
        most = 0
        for arm, each in problem.tours.items():
            own = [place[arm][name] for name, by in zip(names, way, strict=True) if by == arm]
            most = max(most, min(busy_with(each, order) for order in itertools.permutations(own)))
        best = min(best, most)
    return best


def check(problem: SharedProblem, found: Shares) -> None:
    """Every visit once, by an arm that can make it, and the times are those of the orders."""
    names = sorted({visit.name for each in problem.tours.values() for visit in each.visits})
    assert sorted(name for own in found.orders.values() for name in own) == names
    for arm, own in found.orders.items():
        place = {v.name: n for n, v in enumerate(problem.tours[arm].visits)}
        assert found.busy[arm] == busy_with(problem.tours[arm], tuple(place[name] for name in own))
    assert found.lower_bound <= found.makespan


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("arms", [2, 3])
def test_few_visits_are_shared_as_well_as_can_be(seed: int, arms: int) -> None:
    problem = drawn(seed, 6, arms)
    found = share_visits(problem)
    assert isinstance(found, Shares)
    check(problem, found)
    assert found.makespan == found.lower_bound == least_makespan(problem)


@pytest.mark.parametrize("seed", range(12))
def test_insertion_and_changes_come_near_the_best(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = drawn(seed, 10)
    best = share_visits(problem)
    monkeypatch.setattr(arm_shares, "MAX_EXACT_SHARED_VISITS", 0)
    found = share_visits(problem)
    assert isinstance(best, Shares)
    assert isinstance(found, Shares)
    check(problem, found)
    assert found.lower_bound <= best.makespan <= found.makespan <= 1.1 * best.makespan


def test_many_visits_are_shared_evenly() -> None:
    problem = drawn(1, 120)
    found = share_visits(problem)
    assert isinstance(found, Shares)
    check(problem, found)
    assert max(found.busy.values()) - min(found.busy.values()) <= 0.02 * found.makespan
    assert found.makespan <= 1.25 * found.lower_bound


def test_an_arm_that_reaches_nothing_has_no_share() -> None:
    far = TourProblem("drawn", (), np.zeros((0, 0), np.int64), closed=False)
    problem = SharedProblem({**drawn(2, 8, 1).tours, "far": far})
    found = share_visits(problem)
    assert isinstance(found, Shares)
    assert found.orders["far"] == ()
    check(problem, found)


def test_visits_in_order_stay_in_order_within_a_share() -> None:
    plain = drawn(3, 20)
    tours = {}
    for arm, each in plain.tours.items():
        place = {visit.name: n for n, visit in enumerate(each.visits)}
        pairs = [
            (place[a], place[b])
            for a, b in (("v4", "v1"), ("v9", "v3"))
            if a in place and b in place
        ]
        tours[arm] = TourProblem(
            each.name, each.visits, each.travel, False, precedence=tuple(pairs)
        )
    found = share_visits(SharedProblem(tours))
    assert isinstance(found, Shares)
    check(plain, found)
    for own in found.orders.values():
        for a, b in (("v4", "v1"), ("v9", "v3")):
            if a in own and b in own:
                assert own.index(a) < own.index(b)
