"""Lines of sight: nothing stands between their points, and they are no longer than the way
round by hand.
"""

from itertools import pairwise

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Truths
from cellwright.engine.stages.motion.visibility_planner import LinesOfSight, lines_of_sight


def anywhere(points: Floats) -> Truths:
    return np.ones(len(points), dtype=bool)


def box_at(
    middle: tuple[float, float, float], half: tuple[float, float, float]
) -> tuple[Floats, Floats]:
    T = np.eye(4)
    T[:3, 3] = middle
    return T, np.array(half)


def sights(*boxes: tuple[Floats, Floats]) -> LinesOfSight:
    return LinesOfSight(np.array([T for T, _ in boxes]), np.array([half for _, half in boxes]))


def test_without_a_box_in_the_way_it_is_the_straight_line() -> None:
    found = lines_of_sight(
        sights(box_at((0, 5, 0), (1, 1, 1))), np.zeros(3), np.array([3.0, 0, 0]), anywhere
    )
    assert found is not None
    assert np.array_equal(found, [[0, 0, 0], [3, 0, 0]])


def test_round_a_box_it_goes_over_the_nearest_edges() -> None:
    among = sights(box_at((2, 0, 0), (0.5, 5.0, 0.5)))
    found = lines_of_sight(among, np.zeros(3), np.array([4.0, 0, 0.1]), anywhere)
    assert found is not None
    over = 2 * np.hypot(1.5, 0.5) + 1.0
    assert np.linalg.norm(np.diff(found, axis=0), axis=1).sum() < over + 0.05
    for a, b in pairwise(found):
        assert among.first(a, b) < 0


def test_random_lines_pass_through_no_box_by_a_finer_look(rng: np.random.Generator) -> None:
    joined = 0
    for _ in range(25):
        boxes = []
        for _ in range(6):
            x, y, z = rng.uniform(0.5, 3.5), *rng.uniform(-1, 1, 2)
            boxes.append(box_at((x, y, z), tuple(rng.uniform(0.1, 0.5, 3))))
        among, start, goal = sights(*boxes), np.zeros(3), np.array([4.2, 0.0, 0.0])
        found = lines_of_sight(among, start, goal, anywhere)
        if found is None or among.inside(start).any() or among.inside(goal).any():
            continue
        joined += 1
        share = np.linspace(0, 1, 200)[:, None]
        for a, b in pairwise(found):
            assert not any(among.inside(p).any() for p in a + share * (b - a))
    assert joined > 15
