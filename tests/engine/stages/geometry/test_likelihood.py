"""What is left out or put first when a check looks for the first contact changes no answer."""

import numpy as np
import pytest

from cellwright.engine.stages.geometry.collision.builtin import BuiltinChecker
from cellwright.engine.stages.geometry.collision.region_checker import POSE_SAMPLES, touchable_pairs
from cellwright.engine.stages.geometry.shapes.convex_pieces import pack_with_bounds
from cellwright.engine.stages.geometry.world.collision_scene import collision_scene_of
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.loader import bundled_domains
from cellwright.kb.loader.arm_file import bundled_arms, load_arm
from cellwright.kb.loader.cell import load_cell
from cellwright.kb.model.body_shapes import Box, PlacedShape, Pose, Sphere
from cellwright.kb.model.cell_model import (
    Arm,
    Body,
    BodyKind,
    Cell,
    Joint,
    JointKind,
    Link,
    MountedArm,
    Placement,
)


def cell_of(*arms: MountedArm) -> Cell:
    at = [(x, y, z) for x in (-1.5, -0.5, 0.4, 0.9, 3.0) for y in (-0.5, 0.6) for z in (0.1, 0.9)]
    bodies = {
        f"block_{n}": Body(
            f"block_{n}",
            BodyKind.FIXTURE,
            Placement("world", Pose(p)),
            (PlacedShape(Box((0.2, 0.3, 0.2))),),
        )
        for n, p in enumerate(at)
    }
    return Cell("made_up", {f"arm_{n}": arm for n, arm in enumerate(arms)}, bodies=bodies)


def gantry() -> Arm:
    """A slide that carries a turning arm."""
    joints = (
        Joint("slide", (), (1.0, 0.0, 0.0), JointKind.PRISMATIC, -1.0, 1.0),
        Joint("turn", (Pose((0.0, 0.0, 0.3)),), lower=-3.0, upper=3.0),
    )
    links = (Link("hand", 2, (Pose((0.5, 0.0, 0.0)),), (PlacedShape(Sphere(0.1)),)),)
    return Arm("gantry", joints, links)


UR5 = load_arm(bundled_arms()["ur5"])
WORLDS = {
    "one arm": GeometricWorld.of(cell_of(MountedArm(UR5))),
    "two arms": GeometricWorld.of(
        cell_of(MountedArm(UR5), MountedArm(UR5, Placement("world", Pose((1.2, 0.0, 0.0)))))
    ),
    "an arm on a slide": GeometricWorld.of(
        cell_of(MountedArm(gantry()), MountedArm(UR5, Placement("arm_0.flange")))
    ),
    "themse": GeometricWorld.of(load_cell(bundled_domains()["themse"] / "cell.yaml")),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", WORLDS)
def test_pairs_that_are_left_out_never_touch(name: str) -> None:
    scene = collision_scene_of(WORLDS[name])
    kept = touchable_pairs(scene, pack_with_bounds(scene)[0])
    assert 0 < kept.sum() < len(kept)
    joints = scene.joints
    q = np.random.default_rng(3).uniform(joints.lower, joints.upper, (3000, joints.count))
    everything, rest = BuiltinChecker(scene), scene.pairs[~kept]
    bodies = {frozenset((scene.pieces[i].body, scene.pieces[j].body)) for i, j in rest}
    shared = {frozenset((scene.pieces[i].body, scene.pieces[j].body)) for i, j in scene.pairs[kept]}
    for one in q[:300]:
        assert not {frozenset((c.first, c.second)) for c in everything.contacts(one)} & (
            bodies - shared
        )
    assert np.array_equal(everything.collides(q), everything.clearance(q, 0.01) <= 0)


@pytest.mark.parametrize("name", WORLDS)
def test_answers_do_not_depend_on_the_size_of_the_batch(name: str) -> None:
    scene = collision_scene_of(WORLDS[name])
    joints = scene.joints
    q = np.random.default_rng(4).uniform(
        joints.lower, joints.upper, (2 * POSE_SAMPLES, joints.count)
    )
    large, small = BuiltinChecker(scene).collides(q), BuiltinChecker(scene)
    assert np.array_equal(large, np.concatenate([small.collides(part) for part in np.split(q, 8)]))


@pytest.mark.parametrize("name", WORLDS)
def test_the_pair_that_is_told_touches(name: str) -> None:
    scene = collision_scene_of(WORLDS[name])
    checker, joints = BuiltinChecker(scene), scene.joints
    q = np.random.default_rng(5).uniform(
        joints.lower, joints.upper, (POSE_SAMPLES + 100, joints.count)
    )
    told = checker.first_contacts(q)
    assert (told >= 0).any()
    for n in np.nonzero(told >= 0)[0][:100]:
        i, j = scene.pairs[told[n]]
        pair = {scene.pieces[i].body, scene.pieces[j].body}
        assert pair in [{c.first, c.second} for c in checker.contacts(q[n])]
