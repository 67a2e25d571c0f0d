"""Roadmaps: their times are between bounds, and after a change they are what a new roadmap
would be.
"""

from dataclasses import replace

import numpy as np
import pytest

from cellwright.engine.kernels.arrays import Longs
from cellwright.engine.model.geometry import ConvexPiece
from cellwright.engine.model.motion_values import Moved, PathQuery
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.collision.builtin import BuiltinChecker
from cellwright.engine.stages.geometry.collision.planning_scene import PlanningScene
from cellwright.engine.stages.motion.path_planner import plan_path
from cellwright.engine.stages.motion.path_refinement import (
    path_time_s,
    refine_and_prove,
    refine_path,
)
from cellwright.engine.stages.motion.roadmap import (
    map_nodes,
    nearest_node_pairs,
    repair_roadmap,
    travel_times,
)
from cellwright.engine.stages.motion.timed_paths import JointLimits
from tests.engine.stages.motion.conftest import arm_among, block, finely, random_ground

LIMITS = JointLimits(np.array([1.0, 2.0]), np.array([3.0, 5.0]), np.array([40.0, 60.0]))
OWN = slice(0, 2)


def all_pairs(count: int) -> Longs:
    return np.stack(np.triu_indices(count, 1), axis=1).astype(np.int64)


def free_nodes(ground: PlanningScene, rng: np.random.Generator, count: int) -> np.ndarray:
    q = rng.uniform(-np.pi, np.pi, (20 * count, 2))
    return q[ground.clearance(q) > 0.02][:count]


def test_times_are_those_of_free_routes_and_not_below_the_least(rng: np.random.Generator) -> None:
    ground = random_ground(rng, 4)
    nodes = free_nodes(ground, rng, 8)
    found, grown = travel_times(
        ground,
        map_nodes(ground, nodes, nearest_node_pairs(nodes, LIMITS, 3)),
        all_pairs(8),
        LIMITS,
        OWN,
        3_000,
    )
    assert (found.time_s >= found.least_s - 1e-9).all()
    assert np.isfinite(found.time_s).any()
    for route, time in zip(found.routes, found.time_s, strict=True):
        if np.isfinite(time):
            assert not ground.collides(finely(grown.nodes[list(route)], 0.02)).any()


def changed(rng: np.random.Generator, pieces: list[ConvexPiece]) -> list[ConvexPiece]:
    """Some of the blocks elsewhere, gone, new, or in the hand of the arm."""
    found = []
    for each in pieces:
        kind = rng.choice(["stays", "stays", "moves", "goes", "held"])
        if kind == "held":
            held = transforms.translation(float(rng.uniform(0.5, 1.2)), 0.0, 0.0)
            found.append(
                replace(each, carrier=2, T_carrier_piece=held, vertices=0.3 * each.vertices)
            )
        elif kind != "goes":
            found.append(each if kind == "stays" else anywhere(rng, each.body))
    return [*found, anywhere(rng, "new")] if rng.random() < 0.4 else found


def anywhere(rng: np.random.Generator, name: str) -> ConvexPiece:
    angle, away = rng.uniform(-np.pi, np.pi), rng.uniform(0.7, 2.2)
    size = rng.uniform(0.1, 0.4, 2)
    return block(name, (away * np.cos(angle), away * np.sin(angle)), (size[0], size[1]))


def ground_of(blocks: list[ConvexPiece]) -> PlanningScene:
    return PlanningScene(BuiltinChecker(arm_among(blocks)))


@pytest.mark.parametrize("seed", range(12))
def test_a_roadmap_repaired_over_many_changes_is_what_a_new_one_would_be(seed: int) -> None:
    rng = np.random.default_rng(seed)
    blocks = [anywhere(rng, f"block {n}") for n in range(5)]
    ground, nodes = ground_of(blocks), rng.uniform(-np.pi, np.pi, (30, 2))
    margin_m = float(rng.choice([0.0, 0.02]))
    edges = nearest_node_pairs(nodes, LIMITS, 6)
    kept, looked = map_nodes(ground, nodes, edges, margin_m=margin_m), 0
    for _ in range(8):
        blocks = changed(rng, blocks)
        before, ground = ground, ground_of(blocks)
        kept, again = repair_roadmap(kept, before, ground)
        looked += again
        assert np.array_equal(kept.free, map_nodes(ground, nodes, edges, margin_m=margin_m).free)
    assert looked < 8 * len(edges)


def test_what_has_not_changed_is_not_looked_at_again(rng: np.random.Generator) -> None:
    blocks = [block("stays", (-1.0, -1.0), (0.3, 0.3)), block("moves", (1.2, 0.4), (0.2, 0.3))]
    moved = [blocks[0], block("moves", (0.3, 1.3), (0.2, 0.3))]
    nodes = rng.uniform(-np.pi, np.pi, (40, 2))
    edges = nearest_node_pairs(nodes, LIMITS, 6)
    kept = map_nodes(ground_of(blocks), nodes, edges)
    assert repair_roadmap(kept, ground_of(blocks), ground_of(blocks[::-1]))[1] == 0
    assert 0 < repair_roadmap(kept, ground_of(blocks), ground_of(moved))[1] < len(edges)


def test_a_change_beside_the_start_of_an_edge_is_seen() -> None:
    nodes = np.array([[0.0, 0.0], [1.5, 0.0]])
    edges = np.array([[0, 1]])
    thin = block("thin", (1.9, -0.045), (0.1, 0.02))
    kept = map_nodes(ground_of([]), nodes, edges)
    mended, _ = repair_roadmap(kept, ground_of([]), ground_of([thin]))
    assert kept.free.all()
    assert np.array_equal(mended.free, map_nodes(ground_of([thin]), nodes, edges).free)


def test_where_the_joints_have_changed_everything_is_looked_at_again(
    rng: np.random.Generator,
) -> None:
    blocks = [anywhere(rng, f"block {n}") for n in range(3)]
    nodes = rng.uniform(-np.pi, np.pi, (20, 2))
    edges = nearest_node_pairs(nodes, LIMITS, 4)
    longer = PlanningScene(BuiltinChecker(arm_among(blocks, length_m=1.2)))
    mended, looked = repair_roadmap(
        map_nodes(ground_of(blocks), nodes, edges), ground_of(blocks), longer
    )
    assert looked == len(edges)
    assert np.array_equal(mended.free, map_nodes(longer, nodes, edges).free)


def test_more_work_makes_paths_shorter_and_never_longer() -> None:
    ground = PlanningScene(BuiltinChecker(arm_among([block("post", (1.2, 1.2), (0.2, 0.2))])))
    query = PathQuery(np.zeros(2), np.array([[2.0, 0.5]]), bridges=0)
    first = plan_path(ground, query)
    assert isinstance(first, Moved)
    speeds = np.array([1.0, 2.0])
    found = refine_path(ground, query, first, speeds, 20_000)
    times = [time for _, time in found.course]
    assert times == sorted(times, reverse=True)
    assert times[-1] < times[0]
    assert path_time_s(found.found.path, speeds) == times[-1]
    sure = refine_and_prove(ground, query, first, speeds, 20_000).found
    assert sure.proved
    assert not ground.collides(finely(sure.path, 0.001)).any()
