"""Policies: who follows one breaks no bound, however long the links last."""

import random
from collections.abc import Sequence

import pytest

from cellwright.engine.model.uncertain_times import (
    DifferenceBound,
    DispatchableNetwork,
    UncertainLink,
    UncertainNetwork,
)
from cellwright.engine.stages.uncertainty.controllability import find_policy
from tests.engine.stages.uncertainty.time_games import random_network


def _times(
    network: UncertainNetwork, policy: DispatchableNetwork, durations: Sequence[int]
) -> dict[int, int]:
    """When each point comes if each comes as soon as the policy allows."""
    ends, times = {link.end: number for number, link in enumerate(network.links)}, dict[int, int]()
    for point in policy.order:
        if point in ends:
            number = ends[point]
            times[point] = times[network.links[number].start] + durations[number]
            continue
        lower = [times[b.later] - b.most for b in policy.bounds if b.earlier == point]
        for wait in policy.waits:
            if wait.waiting == point:
                begun = times[network.links[wait.link].start]
                lower.append(begun + min(wait.time, durations[wait.link]))
        times[point] = max(lower, default=0)
    return times


def _follows(seeds: range, runs: int) -> tuple[int, int]:
    policies, with_waits = 0, 0
    for seed in seeds:
        network = random_network(seed)
        policy = find_policy(network)
        if not isinstance(policy, DispatchableNetwork):
            continue
        policies += 1
        with_waits += bool(policy.waits)
        chance = random.Random(seed)
        for _ in range(runs):
            drawn = [
                chance.choice((link.least, link.most, chance.randint(link.least, link.most)))
                for link in network.links
            ]
            times = _times(network, policy, drawn)
            broken = [b for b in network.bounds if times[b.later] - times[b.earlier] > b.most]
            assert not broken, (seed, drawn)
    return policies, with_waits


def test_who_follows_a_policy_breaks_no_bound() -> None:
    policies, with_waits = _follows(range(120), 5)
    assert policies > 20
    assert with_waits


@pytest.mark.slow
def test_who_follows_many_policies_breaks_no_bound() -> None:
    assert _follows(range(3000), 10)[0] > 800


def test_a_step_waits_for_an_end_or_for_a_time() -> None:
    """What begins at point 2 lasts 5 to 8, and must not end more than 6 before or 5 after 1 ends:
    it is begun when the first link has ended, or at a time at which it has to be.
    """
    network = UncertainNetwork(
        ("0", "end", "begin", "ready"),
        (DifferenceBound(3, 1, 6), DifferenceBound(1, 3, 10)),
        (UncertainLink(0, 1, 2, 20), UncertainLink(2, 3, 5, 8)),
    )
    policy = find_policy(network)
    assert isinstance(policy, DispatchableNetwork)
    assert [(wait.waiting, wait.link, wait.time) for wait in policy.waits] == [(2, 0, 9)]
