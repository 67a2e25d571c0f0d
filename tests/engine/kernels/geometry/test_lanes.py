"""Lines and proofs that look at sixteen configurations side by side say what a look at each by
itself says.
"""

import math
from itertools import combinations

import numpy as np
import pytest

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.geometry import lanes
from cellwright.engine.kernels.geometry.angles import sine_cosine
from cellwright.engine.kernels.geometry.edges import free_edges
from cellwright.engine.kernels.geometry.proof import proved
from cellwright.engine.model.geometry import CollisionScene, Joints
from cellwright.engine.stages.geometry.collision.builtin import BuiltinChecker
from cellwright.engine.stages.geometry.collision.planning_scene import PlanningScene
from tests.engine.kernels.geometry.test_both_ways import PLAIN, any_piece, any_pose

STEP = 0.05
SEEDS = range(8)


def any_ground(rng: np.random.Generator) -> PlanningScene:
    """Joints of both kinds, in a tree, with pieces of all kinds on them and around."""
    count = int(rng.integers(2, 6))
    axes = rng.normal(size=(count, 3))
    axes[rng.random(count) < 0.5] = [0.0, 1.0, 0.0]
    joints = Joints(
        np.array([rng.integers(0, j + 1) for j in range(count)], dtype=np.int64),
        np.array([any_pose(rng, 0.4) for _ in range(count)]),
        axes / np.linalg.norm(axes, axis=1, keepdims=True),
        rng.random(count) < 0.3,
        np.full(count, -3.0),
        np.full(count, 3.0),
    )
    pieces = tuple(
        any_piece(rng, carrier) for carrier in [*range(count + 1), *range(count + 1), 0, 0, 0]
    )
    pairs = [
        (i, j)
        for i, j in combinations(range(len(pieces)), 2)
        if pieces[i].carrier != pieces[j].carrier
    ]
    kept = [pair for pair in pairs if rng.random() < 0.35]
    return PlanningScene(
        BuiltinChecker(
            CollisionScene(joints, pieces, np.array(kept, dtype=np.int64).reshape(-1, 2))
        )
    )


def places(a: Floats, b: Floats) -> Floats:
    """Both ends of a line, and what lies after each step."""
    steps = max(1, math.ceil(float(np.linalg.norm(b - a)) / STEP))
    return np.vstack([a, a + (np.arange(1, steps) * (1.0 / steps))[:, None] * (b - a), b])


@pytest.mark.parametrize("seed", SEEDS)
def test_a_line_is_free_exactly_where_none_of_its_places_touches(seed: int) -> None:
    rng = np.random.default_rng(seed)
    ground = any_ground(rng)
    a = rng.uniform(-3, 3, (60, ground.scene.joints.count))
    b = a + rng.normal(size=a.shape) * rng.choice([0.02, 0.3, 1.0], (60, 1))
    free = np.zeros(60, dtype=np.uint8)
    free_edges(ground.lines(STEP), a, b, free)
    plain = [not ground.collides(places(*ends)).any() for ends in zip(a, b, strict=True)]
    assert free.astype(bool).tolist() == plain


@pytest.mark.parametrize("seed", SEEDS)
def test_rounding_decides_nothing_however_near_things_are_to_the_margin(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    ground = any_ground(rng)
    q = rng.uniform(-3, 3, (40, ground.scene.joints.count))
    for at, gap in zip(q, ground.clearance(q), strict=True):
        for off in (-1e-4, -1e-6, -1e-8, 1e-8, 1e-6, 1e-4):
            margin, free = float(gap + off), np.zeros(1, dtype=np.uint8)
            if margin >= 0.0 and gap < 1.0:
                free_edges(ground.lines(STEP, margin), at[None], at[None], free)
                assert bool(free[0]) == (off < 0)


@pytest.mark.parametrize("seed", SEEDS)
def test_what_is_proved_is_free_a_thousand_times_finer(seed: int) -> None:
    rng = np.random.default_rng(200 + seed)
    ground, found = any_ground(rng), 0
    for _ in range(20):
        a = rng.uniform(-3, 3, ground.scene.joints.count)
        path = np.array([a, a + rng.normal(size=a.shape) * 0.2])
        proof = ground.proof(0.0, 1e-4)
        if proved(proof, path):
            found += 1
            fine = path[0] + np.linspace(0, 1, 2000)[:, None] * (path[1] - path[0])
            assert not ground.collides(fine).any()
        else:
            where = path[0] + proof.where * (path[1] - path[0])
            assert ground.clearance(where[None])[0] < 0.05
    assert (
        found or ground.collides(rng.uniform(-3, 3, (50, ground.scene.joints.count))).mean() > 0.5
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_vectors_of_four_and_of_eight_look_at_the_same_and_say_the_same(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(400 + seed)
    ground, told = any_ground(rng), []
    a = rng.uniform(-3, 3, (60, ground.scene.joints.count))
    b = a + rng.normal(size=a.shape) * rng.choice([0.02, 0.3, 1.0], (60, 1))
    for wide in (lanes.WIDE, False):
        monkeypatch.setattr(lanes, "WIDE", wide)
        lines, proof, free = (
            ground.lines(STEP),
            ground.proof(0.0, 1e-3),
            np.zeros(60, dtype=np.uint8),
        )
        free_edges(lines, a, b, free)
        sure = [proved(proof, np.array(ends)) for ends in zip(a, b, strict=True)]
        told.append((free.tolist(), lines.looked, sure, proof.looked, proof.refined))
    assert told[0] == told[1]


def test_lines_and_proofs_are_the_same_without_a_compiler() -> None:
    rng = np.random.default_rng(300)
    ground = any_ground(rng)
    narrow = ground._packed(0.0)
    m, p, q = narrow.mechanism, narrow.pieces, narrow.pairs
    scene = PLAIN["lanes"].Narrow(
        PLAIN["mechanism"].Mechanism(m.parents, m.origins, m.axes, m.sliding, m.travels),
        PLAIN["layout"].Pieces(p.vertices, p.stretch, p.radius, p.carrier, p.bounds),
        PLAIN["layout"].Pairs(q.pairs, q.groups, q.after, q.order),
    )
    a = rng.uniform(-3, 3, (12, m.count))
    b = a + rng.normal(size=a.shape) * 0.3
    ours, plain = np.zeros(12, dtype=np.uint8), np.zeros(12, dtype=np.uint8)
    lines, slow = ground.lines(STEP), PLAIN["edges"].Edges(scene, STEP)
    free_edges(lines, a, b, ours)
    PLAIN["edges"].free_edges(slow, a, b, plain)
    assert ours.tolist() == plain.tolist()
    proof = PLAIN["proof"].Proof(scene, ground._reach, 0.0, 0.01)
    for path in np.stack([a, b], axis=1)[ours == 1][:3]:
        quick = ground.proof(0.0, 0.01)
        assert proved(quick, path) == PLAIN["proof"].proved(proof, path)


@pytest.mark.parametrize("value", [1e7, -1e7, math.nan, math.inf])
def test_configurations_too_large_for_single_precision_are_looked_at_in_double(
    value: float,
) -> None:
    ground = any_ground(np.random.default_rng(3))
    q = np.zeros((1, ground.scene.joints.count))
    q[0, 0] = value
    free = np.zeros(1, dtype=np.uint8)
    free_edges(ground.lines(STEP), q, q, free)
    if math.isfinite(value):
        assert bool(free[0]) != ground.collides(q)[0]


def test_sine_and_cosine_are_those_of_the_library_to_rounding() -> None:
    rng = np.random.default_rng(4)
    angles = [
        *rng.uniform(-7, 7, 5000),
        *rng.uniform(-5e6, 5e6, 5000),
        0.0,
        math.pi / 2,
        math.pi,
        1e9,
        -1e300,
    ]
    for x in angles:
        s, c = sine_cosine(float(x))
        assert abs(s - math.sin(x)) < 4e-16
        assert abs(c - math.cos(x)) < 4e-16
    assert all(math.isnan(each) for each in sine_cosine(math.nan))
