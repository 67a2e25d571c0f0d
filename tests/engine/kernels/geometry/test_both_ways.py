"""The kernels of geometry, compiled and interpreted, give the same figures, to the last bit
where both ask the same functions.
"""

import importlib
import math
from itertools import combinations, product
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

import cellwright.engine.kernels.geometry
from cellwright.engine.kernels.arrays import Floats, Longs
from cellwright.engine.model.geometry import ConvexPiece
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.kinematics.arm_model import ArmModel
from cellwright.engine.stages.geometry.kinematics.inverse_kinematics import (
    InverseKinematics,
    InverseSolver,
)
from cellwright.engine.stages.geometry.region_tree import boxes_around
from cellwright.engine.stages.geometry.shapes.convex_pieces import group_pairs, pack_pieces
from cellwright.kb.loader.arm_file import bundled_arms, load_arm
from tests.engine.interpreted import interpreted_package

Modules = dict[str, ModuleType]
SEEDS = range(6)
CUBE = np.array(list(product((-0.5, 0.5), repeat=3)))
PLAIN: Modules = interpreted_package(cellwright.engine.kernels.geometry)
IMPORTED: Modules = {
    name: importlib.import_module(f"{cellwright.engine.kernels.geometry.__name__}.{name}")
    for name in PLAIN
}
BOTH = (IMPORTED, PLAIN)


def any_pose(rng: np.random.Generator, spread: float) -> Floats:
    axis = rng.normal(size=3)
    R = transforms.rotation(axis / np.linalg.norm(axis), float(rng.uniform(0, math.pi)))
    return transforms.transform(R, rng.uniform(-spread, spread, 3))


def any_piece(rng: np.random.Generator, carrier: int) -> ConvexPiece:
    vertices = [
        np.zeros((1, 3)),
        np.array([[0, 0, -0.2], [0, 0, 0.2]]),
        CUBE * rng.uniform(0.1, 0.5, 3),
        rng.normal(size=(7, 3)) * 0.15,
        rng.normal(size=(4, 3)) * (0.2, 0.2, 0.0),
    ]
    kind = int(rng.integers(5))
    radius = 0.0 if kind == 2 else float(rng.uniform(0.02, 0.1))
    return ConvexPiece(
        f"piece_{carrier}", carrier, any_pose(rng, 0.4), vertices[kind], radius, box=kind == 2
    )


def a_scene(seed: int) -> SimpleNamespace:
    """Twelve pieces on four carriers, six of them standing, in three sets of carrier poses."""
    rng = np.random.default_rng(seed)
    pieces = [any_piece(rng, max(0, n - 5) % 4) for n in range(12)]
    numbers = [
        (i, j) for i, j in combinations(range(12), 2) if pieces[i].carrier != pieces[j].carrier
    ]
    poses = np.array([[np.eye(4), *(any_pose(rng, 0.6) for _ in range(3))] for _ in range(3)])[
        :, :, :3
    ]
    return SimpleNamespace(
        packed=pack_pieces(pieces),
        pairs=group_pairs(np.array(numbers), np.arange(12)),
        poses=np.ascontiguousarray(poses),
    )


def copied(modules: Modules, scene: SimpleNamespace) -> SimpleNamespace:
    """The scene in the classes of some modules."""
    p, q, layout = scene.packed, scene.pairs, modules["layout"]
    return SimpleNamespace(
        pieces=layout.Pieces(p.vertices, p.stretch, p.radius, p.carrier, p.bounds),
        pairs=layout.Pairs(q.pairs, q.groups, q.after, q.order),
    )


def a_tree(modules: Modules, boxes: Floats) -> Any:
    """A hierarchy over boxes (n, 6), from which one piece was taken and put back."""
    n, hierarchy = len(boxes), modules["hierarchy"]
    nodes, children = np.empty((2 * n - 1, 6)), np.empty((2 * n - 1, 2), np.int64)
    hierarchy.build(boxes, np.arange(n), nodes, children)
    tree = hierarchy.Hierarchy(nodes, children, 2 * n - 2)
    for change in (hierarchy.removed, hierarchy.inserted):
        more, below, root = change(tree, boxes[1], 1)
        tree = hierarchy.Hierarchy(
            np.concatenate([tree.boxes, more]), np.concatenate([tree.children, below]), root
        )
    return tree


def same(one: list[Floats | Longs], other: list[Floats | Longs]) -> bool:
    return all(a.tobytes() == b.tobytes() for a, b in zip(one, other, strict=True))


@pytest.mark.parametrize("seed", SEEDS)
def test_checks_of_scenes_are_the_same_both_ways(seed: int) -> None:
    scene, found = a_scene(seed), []
    for modules in BOTH:
        own, checks = copied(modules, scene), modules["checks"]
        first, hits = np.empty(3, np.int64), np.zeros(len(scene.pairs.groups), np.int64)
        checks.first_contacts(scene.poses, own.pieces, own.pairs, first)
        checks.count_hits(scene.poses, own.pieces, own.pairs, hits)
        least, pair, witness = np.empty(3), np.empty(3, np.int64), np.empty((3, 9))
        checks.nearest_pairs(scene.poses, own.pieces, own.pairs, 1.0, least, pair, witness)
        pairs = scene.pairs.pairs
        each, points = np.empty(len(pairs)), np.zeros((len(pairs), 9))
        checks.near_pairs(scene.poses[:1], own.pieces, pairs, 0.3, each, points)
        found.append([first, hits, least, pair, witness, each, points])
    assert same(*found)


@pytest.mark.parametrize("seed", SEEDS)
def test_walks_down_a_tree_are_the_same_both_ways(seed: int) -> None:
    scene, found = a_scene(seed), []
    standing = pack_pieces([any_piece(np.random.default_rng(seed + n), 0) for n in range(12)])
    boxes = boxes_around(standing.bounds)
    for modules in BOTH:
        own, regions = copied(modules, scene).pieces, modules["regions"]
        tree = a_tree(modules, boxes)
        still = modules["layout"].Pieces(
            standing.vertices, standing.stretch, standing.radius, standing.carrier, standing.bounds
        )
        every = np.zeros((500, 3), np.int64)
        near, hits, least = np.zeros((200, 2), np.int64), np.zeros(3, bool), np.empty(3)
        count = regions.near_pieces(still, still, tree, 0.1, near)
        pairs, skip = np.array([[6, 7], [8, 9]]), np.eye(12, dtype=bool)
        regions.first_hits(scene.poses, own, still, tree, pairs, skip, np.full((2, 2), -1), hits)
        all_of = modules["sampling"].all_hits(scene.poses, own, still, tree, pairs, skip, every)
        regions.nearest_hits(scene.poses, own, still, tree, pairs, skip, 1.0, least)
        found.append(
            [tree.boxes, tree.children, np.array([count, all_of]), near, every, hits, least]
        )
    assert same(*found)


def test_carriers_are_the_same_both_ways() -> None:
    joints = ArmModel(load_arm(bundled_arms()["ur5"])).joints
    q, found = np.random.default_rng(1).uniform(-3, 3, (5, joints.count)), []
    slides = np.arange(joints.count) == 2
    for modules in BOTH:
        poses = np.empty((5, joints.count + 1, 3, 4))
        mechanism = modules["mechanism"]
        made = mechanism.Mechanism(joints.parent, joints.T_parent_origin, joints.axis, slides)
        mechanism.place_batch(made, q, poses)
        found.append([poses])
    assert same(*found)


@pytest.mark.parametrize("name", sorted(bundled_arms()))
def test_inverse_kinematics_is_the_same_both_ways(name: str) -> None:
    """But for the last bits: C and Python round the length of a vector otherwise (`hypot`)."""
    model = ArmModel(load_arm(bundled_arms()[name]))
    solver, found = InverseKinematics(model), []
    form = solver.form
    assert form is not None
    poses = model.flange_pose(model.random(6, np.random.default_rng(2)))
    poses = np.ascontiguousarray(poses @ np.linalg.inv(solver.T_zero))
    for modules in BOTH:
        inverse = modules["inverse"]
        q, valid, residual = np.zeros((6, 8, 6)), np.zeros((6, 8)), np.empty((6, 8))
        batch = inverse.Batch(form.directions, form.points, form.centre, poses, q, valid)
        solve = (
            inverse.parallel_axes
            if form.solver is InverseSolver.PARALLEL_AXES
            else inverse.spherical_wrist
        )
        solve(batch)
        inverse.residuals(batch, residual)
        found.append((q, valid, residual))
    (q, valid, residual), (plain_q, plain_valid, plain_residual) = found
    assert np.array_equal(valid, plain_valid)
    assert np.abs(q - plain_q).max() < 1e-7
    ends = np.isfinite(residual)
    assert np.array_equal(ends, np.isfinite(plain_residual))
    assert np.abs(residual[ends] - plain_residual[ends]).max() < 1e-7
