"""Roadmaps that are kept over a sequence of motions: the ways found serve again, and what has
changed is looked at again.
"""

from itertools import pairwise

import numpy as np
import pytest

from cellwright.engine.model.geometry import ConvexPiece
from cellwright.engine.model.motion_values import Moved, PathQuery
from cellwright.engine.stages.geometry.collision.builtin import BuiltinChecker
from cellwright.engine.stages.geometry.collision.planning_scene import PlanningScene
from cellwright.engine.stages.motion.path_planner import plan_path
from cellwright.engine.stages.motion.roadmap import MAX_ROADMAP_NODES, KeptRoadmaps, map_nodes
from tests.engine.stages.motion.conftest import arm_among, block, finely, random_ground, touching

ENDS = np.array([[0.0, 0.0], [2.0, 0.5], [-2.0, -0.5], [2.4, -1.0]])
POST, WALL = block("post", (1.2, 1.2), (0.2, 0.2)), block("wall", (-1.2, 1.0), (0.2, 0.4))


def ground_of(blocks: list[ConvexPiece]) -> PlanningScene:
    return PlanningScene(BuiltinChecker(arm_among(blocks)))


def impatient(most: int = MAX_ROADMAP_NODES) -> KeptRoadmaps:
    """The planner finds nothing soon, so that every motion asks the roadmap."""
    return KeptRoadmaps(soon=1, most=most)


@pytest.mark.parametrize("seed", range(3))
def test_motions_are_free_and_found_where_the_planner_finds_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    roadmaps, found = impatient(), 0
    for _ in range(3):
        ground = random_ground(rng, 4)
        q = rng.uniform(-np.pi, np.pi, (80, 2))
        q = q[ground.clearance(q) > 0.02][:6]
        for start, goal in pairwise(q):
            query = PathQuery(start, goal[None], budget=3_000)
            answer, alone = roadmaps.plan(ground, query), plan_path(ground, query)
            assert isinstance(answer, Moved) or not isinstance(alone, Moved)
            if isinstance(answer, Moved):
                found += 1
                assert answer.proved
                assert np.array_equal(answer.path[[0, -1]], np.array([start, goal]))
                assert not touching(ground, finely(answer.path, 0.01)).any()
    assert found > 3


def test_a_way_back_is_known() -> None:
    ground, roadmaps = ground_of([POST]), impatient()
    there = roadmaps.plan(ground, PathQuery(ENDS[0], ENDS[1][None]))
    back = roadmaps.plan(ground, PathQuery(ENDS[1], ENDS[0][None]))
    assert isinstance(there, Moved)
    assert isinstance(back, Moved)
    assert (roadmaps.work.alone, roadmaps.work.routed) == (1, 1)
    assert back.looked < there.looked


def test_a_way_that_is_barred_later_is_not_taken() -> None:
    roadmaps = impatient()
    first = roadmaps.plan(ground_of([POST]), PathQuery(ENDS[0], ENDS[1][None]))
    assert isinstance(first, Moved)
    middle = finely(first.path, 0.01)[len(finely(first.path, 0.01)) // 2]
    # where the tip is then
    x, y = (float(f(middle[0]) + f(middle.sum())) for f in (np.cos, np.sin))
    now = ground_of([POST, block("new", (x, y), (0.1, 0.1))])
    second = roadmaps.plan(now, PathQuery(ENDS[1], ENDS[0][None]))
    assert isinstance(second, Moved)
    assert not touching(now, finely(second.path, 0.005)).any()


@pytest.mark.parametrize("seed", range(6))
def test_a_kept_roadmap_is_what_a_new_one_would_be(seed: int) -> None:
    rng, roadmaps = np.random.default_rng(seed), impatient()
    for _ in range(6):
        moved = block(
            "moved", (float(rng.uniform(0.8, 1.6)), float(rng.uniform(0.8, 1.6))), (0.2, 0.2)
        )
        ground = ground_of([moved, WALL] if rng.random() < 0.7 else [moved])
        free = ENDS[ground.clearance(ENDS) > 0.01]
        start, goal = rng.permutation(free)[:2]
        query = PathQuery(start, goal[None])
        roadmaps.plan(ground, query)
        kept = roadmaps.roadmap(ground, query)
        assert np.array_equal(kept.free, map_nodes(ground, kept.nodes, kept.edges).free)
    assert roadmaps.work.kept + roadmaps.work.seen > 0


def test_the_same_sequence_has_the_same_paths() -> None:
    def run() -> list[bytes]:
        roadmaps, said = impatient(), []
        for blocks in ([POST], [POST, WALL], [WALL], [POST, WALL]):
            for start, goal in ((ENDS[0], ENDS[1]), (ENDS[1], ENDS[3]), (ENDS[3], ENDS[2])):
                answer = roadmaps.plan(ground_of(blocks), PathQuery(start, goal[None]))
                assert isinstance(answer, Moved)
                said.append(answer.path.tobytes())
        return said

    assert run() == run()


def test_the_oldest_nodes_are_forgotten() -> None:
    ground, roadmaps = ground_of([POST, WALL]), impatient(most=6)
    for start, goal in ((0, 1), (1, 2), (2, 3), (3, 0), (0, 2), (2, 1)):
        query = PathQuery(ENDS[start], ENDS[goal][None])
        assert isinstance(roadmaps.plan(ground, query), Moved)
        assert len(roadmaps.roadmap(ground, query).nodes) <= 6


def test_what_is_found_soon_is_what_the_planner_finds() -> None:
    ground = ground_of([POST])
    query = PathQuery(ENDS[0], ENDS[1:3])
    answer, alone = KeptRoadmaps().plan(ground, query), plan_path(ground, query)
    assert isinstance(answer, Moved)
    assert isinstance(alone, Moved)
    assert np.array_equal(answer.path, alone.path)


def test_an_arm_that_stands_elsewhere_has_a_roadmap_of_its_own() -> None:
    roadmaps = impatient()
    for length_m in (1.0, 1.1):
        ground = PlanningScene(BuiltinChecker(arm_among([POST], length_m=length_m)))
        assert isinstance(roadmaps.plan(ground, PathQuery(ENDS[0], ENDS[1][None])), Moved)
    assert roadmaps.work.routed == 0
