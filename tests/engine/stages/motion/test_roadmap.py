"""Roadmaps: their times are between bounds, and after a change they are what a new roadmap would be."""

import numpy as np

from engine.model.geometry import Longs
from engine.model.motion import Moved, Query
from engine.stages.geometry.collision.builtin import BuiltinChecker
from engine.stages.geometry.collision.ground import Ground
from engine.stages.motion.planner import plan
from engine.stages.motion.refining import proved_and_refined, refined, time_of
from engine.stages.motion.roadmap import mapped, neighbours, repaired, travels
from engine.stages.motion.trajectory import Limits
from tests.engine.stages.motion.conftest import arm_among, block, finely, random_ground

LIMITS = Limits(np.array([1.0, 2.0]), np.array([3.0, 5.0]), np.array([40.0, 60.0]))
OWN = slice(0, 2)


def all_pairs(count: int) -> Longs:
    return np.stack(np.triu_indices(count, 1), axis=1).astype(np.int64)


def free_nodes(ground: Ground, rng: np.random.Generator, count: int) -> np.ndarray:
    q = rng.uniform(-np.pi, np.pi, (20 * count, 2))
    return q[ground.clearance(q) > 0.02][:count]


def test_times_are_those_of_free_routes_and_not_below_the_least(rng: np.random.Generator) -> None:
    ground = random_ground(rng, 4)
    nodes = free_nodes(ground, rng, 8)
    found, grown = travels(
        ground, mapped(ground, nodes, neighbours(nodes, LIMITS, 3)), all_pairs(8), LIMITS, OWN, 3_000
    )
    assert (found.time_s >= found.least_s - 1e-9).all()
    assert np.isfinite(found.time_s).any()
    for route, time in zip(found.routes, found.time_s, strict=True):
        if np.isfinite(time):
            assert not ground.collides(finely(grown.nodes[list(route)], 0.02)).any()


def test_a_repaired_roadmap_is_what_a_new_one_would_be(rng: np.random.Generator) -> None:
    stays, before, after = (
        block(*each)
        for each in (
            ("stays", (-1.0, -1.0), (0.3, 0.3)),
            ("moves", (1.2, 0.4), (0.2, 0.3)),
            ("moves", (0.3, 1.3), (0.2, 0.3)),
        )
    )
    old, new, near = (
        Ground(BuiltinChecker(arm_among(blocks)))
        for blocks in ([stays, before], [stays, after], [before, after])
    )
    nodes = rng.uniform(-np.pi, np.pi, (40, 2))
    edges = neighbours(nodes, LIMITS, 6)
    mended, looked = repaired(mapped(old, nodes, edges), new, near)
    assert np.array_equal(mended.free, mapped(new, nodes, edges).free)
    assert 0 < looked < len(edges)


def test_more_work_makes_paths_shorter_and_never_longer() -> None:
    ground = Ground(BuiltinChecker(arm_among([block("post", (1.2, 1.2), (0.2, 0.2))])))
    query = Query(np.zeros(2), np.array([[2.0, 0.5]]), bridges=0)
    first = plan(ground, query)
    assert isinstance(first, Moved)
    speeds = np.array([1.0, 2.0])
    found = refined(ground, query, first, speeds, 20_000)
    times = [time for _, time in found.course]
    assert times == sorted(times, reverse=True)
    assert times[-1] < times[0]
    assert time_of(found.found.path, speeds) == times[-1]
    sure = proved_and_refined(ground, query, first, speeds, 20_000).found
    assert sure.proved
    assert not ground.collides(finely(sure.path, 0.001)).any()
