"""The least relaxation, beside all relaxations tried one by one."""

import itertools
import random
from dataclasses import replace

from cellwright.engine.model.uncertain_times import Controllable, Relaxation, UncertainNetwork
from cellwright.engine.stages.uncertainty.controllability import check_controllability
from cellwright.engine.stages.uncertainty.least_relaxation import (
    NarrowingCost,
    narrow_links,
    relax_bounds,
    relaxed_network,
)
from tests.engine.stages.uncertainty.time_games import random_network

MOST = 7  # larger relaxations are not tried one by one


def _has_policy(network: UncertainNetwork, relaxation: Relaxation) -> bool:
    return check_controllability(relaxed_network(network, relaxation)) == Controllable()


def _least_widening(network: UncertainNetwork, marked: list[int]) -> int | None:
    for total in range(MOST + 1):
        for amounts in itertools.product(range(total + 1), repeat=len(marked)):
            changes = Relaxation(dict(zip(marked, amounts, strict=True)))
            if sum(amounts) == total and _has_policy(network, changes):
                return total
    return None


def _least_narrowing(network: UncertainNetwork) -> int | None:
    own = [
        [(up, down) for up in range(link.slack + 1) for down in range(link.slack + 1 - up)]
        for link in network.links
    ]
    amounts = [
        changes.amount
        for choice in itertools.product(*own)
        for changes in [
            Relaxation(
                {},
                {number: up for number, (up, _) in enumerate(choice)},
                {number: down for number, (_, down) in enumerate(choice)},
            )
        ]
        if _has_policy(network, changes)
    ]
    return min(amounts, default=None)


def test_no_relaxation_is_less() -> None:
    asked = 0
    for seed in range(36):
        network = random_network(seed, links=seed % 3, spare=2, longest=4)
        if check_controllability(network) == Controllable():
            continue
        chance, asked = random.Random(seed), asked + 1
        marked = [n for n in range(len(network.bounds)) if chance.random() < 0.4][:3]
        bounds = [replace(b, relaxable=n in marked) for n, b in enumerate(network.bounds)]
        network = replace(network, bounds=tuple(bounds))
        widened = relax_bounds(network)
        least = widened.amount if widened is not None and widened.amount <= MOST else None
        assert least == _least_widening(network, marked), seed
        by_unit = [tuple(range(link.slack + 1)) for link in network.links]
        narrowed = narrow_links(network, [NarrowingCost(costs, costs) for costs in by_unit])
        assert (narrowed.amount if narrowed else None) == _least_narrowing(network), seed
    assert asked > 10
