"""Networks with uncertain links: verdicts of three algorithms, and cycles that replay."""

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.model.uncertain_times import (
    Controllable,
    CycleEdge,
    DerivedBound,
    DifferenceBound,
    EdgeKind,
    NegativeCycle,
    UncertainLink,
    UncertainNetwork,
)
from cellwright.engine.stages.uncertainty.controllability import check_controllability
from cellwright.engine.stages.uncertainty.cycle_replay import replay_cycle
from cellwright.engine.stages.uncertainty.edge_generation import has_policy
from tests.engine.stages.uncertainty.time_games import has_winning_policy, random_network


def _network(
    size: int,
    bounds: list[tuple[int, int, int]],
    links: list[tuple[int, int, int, int]],
) -> UncertainNetwork:
    return UncertainNetwork(
        tuple(map(str, range(size))),
        tuple(DifferenceBound(*bound) for bound in bounds),
        tuple(UncertainLink(*link) for link in links),
    )


def test_a_point_cannot_come_a_fixed_time_before_an_end_that_nobody_decides() -> None:
    network = _network(3, [(2, 1, 4), (1, 2, -4)], [(0, 1, 2, 9)])
    verdict = check_controllability(network)
    assert isinstance(verdict, NegativeCycle)
    assert replay_cycle(network, verdict) == ""


def test_a_point_may_follow_an_end_at_once() -> None:
    network = _network(3, [(1, 2, 0), (2, 1, 0)], [(0, 1, 2, 9)])
    assert check_controllability(network) == Controllable()


def test_two_links_that_must_end_together_cannot_be_made_to() -> None:
    network = _network(4, [(1, 3, 1), (3, 1, 1)], [(0, 1, 2, 9), (2, 3, 2, 9)])
    verdict = check_controllability(network)
    assert isinstance(verdict, NegativeCycle)
    assert replay_cycle(network, verdict) == ""


def test_of_random_networks_all_algorithms_say_the_same() -> None:
    verdicts = set()
    for seed in range(400):
        network = random_network(seed)
        verdict = check_controllability(network)
        verdicts.add(type(verdict))
        assert isinstance(verdict, Controllable) is has_policy(network), seed
        if isinstance(verdict, NegativeCycle):
            assert replay_cycle(network, verdict) == "", seed
    assert verdicts == {Controllable, NegativeCycle}


def test_of_small_networks_the_game_says_the_same() -> None:
    for seed in range(200):
        network = random_network(seed, links=seed % 4, spare=2, least=seed % 2, longest=4)
        verdict = check_controllability(network)
        assert isinstance(verdict, Controllable) is has_winning_policy(network), seed


@pytest.mark.slow
def test_of_many_networks_all_say_the_same() -> None:
    for seed in range(2000):
        network = random_network(1_000_000 + seed)
        verdict = check_controllability(network)
        assert isinstance(verdict, Controllable) is has_policy(network), seed
        if isinstance(verdict, NegativeCycle):
            assert replay_cycle(network, verdict) == "", seed
    for seed in range(700):
        network = random_network(seed, links=seed % 7, spare=2, least=seed % 2, longest=4)
        verdict = check_controllability(network)
        assert isinstance(verdict, Controllable) is has_winning_policy(network), seed


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10**9), st.integers(0, 4))
def test_narrower_links_and_wider_bounds_do_no_harm(seed: int, by: int) -> None:
    network = random_network(seed)
    if not isinstance(check_controllability(network), Controllable):
        return
    links = tuple(replace(link, most=max(link.least, link.most - by)) for link in network.links)
    bounds = tuple(replace(bound, most=bound.most + by) for bound in network.bounds)
    easier = replace(network, links=links, bounds=bounds)
    assert check_controllability(easier) == Controllable()


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10**9))
def test_a_cycle_of_a_network_with_a_policy_never_replays(seed: int) -> None:
    network = random_network(seed)
    verdict = check_controllability(network)
    if not isinstance(verdict, NegativeCycle):
        return
    bounds = tuple(replace(bound, most=bound.most + 50) for bound in network.bounds)
    relaxed = replace(network, bounds=bounds)
    if check_controllability(relaxed) == Controllable():
        assert replay_cycle(relaxed, verdict) != ""


def test_a_false_cycle_is_refused() -> None:
    network = _network(3, [(1, 2, 3), (2, 1, 3)], [(0, 1, 2, 9)])
    short = CycleEdge(EdgeKind.SHORTEST, 0)
    there, back = CycleEdge(EdgeKind.BOUND, 0), CycleEdge(EdgeKind.BOUND, 1)
    assert replay_cycle(network, NegativeCycle()) == "the cycle is empty"
    assert "length" in replay_cycle(network, NegativeCycle(edges=(there, back)))
    assert "closed" in replay_cycle(network, NegativeCycle(edges=(there,)))
    both = DerivedBound(0, (short, there, back))
    assert "at once" in replay_cycle(network, NegativeCycle(waits=(both,)))
