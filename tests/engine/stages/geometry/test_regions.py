"""The region tree answers as the flat list of its solid regions does; attaching and detaching
restore it.
"""

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.reference_distances import signed_distance
from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.geometry import ConvexPiece
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.collision.builtin import BuiltinBackend, BuiltinChecker
from cellwright.engine.stages.geometry.collision.region_checker import (
    POSE_SAMPLES,
    RegionChecker,
    decisive_pairs,
)
from cellwright.engine.stages.geometry.region_tree import (
    OutsideError,
    RegionTree,
    TreeRegion,
    declared_tree,
    nested_boxes,
)
from cellwright.engine.stages.geometry.shapes.hulls import CoveredPiece, UncoveredPoint, cover_piece
from cellwright.engine.stages.geometry.world.collision_scene import collision_scene_of
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.loader import bundled_domains
from cellwright.kb.loader.arm_file import bundled_arms, load_arm
from cellwright.kb.loader.cell import load_cell
from cellwright.kb.model.body_shapes import PlacedShape, PointSet
from cellwright.kb.model.cell_model import Body, BodyKind, Cell, MountedArm

seeds = st.integers(0, 2**32 - 1)
CUBE = np.array(list(product((-0.5, 0.5), repeat=3)))


def turned(rng: np.random.Generator, at: Floats) -> Floats:
    axis = rng.normal(size=3)
    return transforms.transform(
        transforms.rotation(axis / np.linalg.norm(axis), float(rng.uniform(0, math.pi))), at
    )


def sphere(name: str, at: Floats, radius: float) -> ConvexPiece:
    return ConvexPiece(name, 0, transforms.transform(np.eye(3), at), np.zeros((1, 3)), radius)


def box(name: str, T: Floats, size: Floats | float) -> ConvexPiece:
    return ConvexPiece(name, 0, T, CUBE * size, 0.0, box=True)


def tube(name: str, T: Floats, length: float, radius: float) -> ConvexPiece:
    return ConvexPiece(name, 0, T, np.array([[0, 0, -length / 2], [0, 0, length / 2]]), radius)


def any_piece(
    name: str, rng: np.random.Generator, spread: float = 1.0, size: float = 0.4
) -> ConvexPiece:
    T = turned(rng, rng.uniform(-spread, spread, 3))
    kind = rng.integers(4)
    if kind == 0:
        return sphere(name, T[:3, 3], float(rng.uniform(0.05, size / 2)))
    if kind == 1:
        return tube(name, T, float(rng.uniform(0.05, size)), float(rng.uniform(0.02, size / 3)))
    if kind == 2:
        return box(name, T, rng.uniform(0.05, size, 3))
    return ConvexPiece(name, 0, T, rng.normal(size=(int(rng.integers(4, 9)), 3)) * size / 3, 0.0)


def random_tree(rng: np.random.Generator, count: int = 12) -> RegionTree:
    """Bounds of every kind laid around solid pieces, some of which reach over the seam of two
    bounds.
    """
    solids = [any_piece(f"s{n}", rng) for n in range(count)]
    world = TreeRegion("everything", sphere("everything", np.zeros(3), 4.0))
    left = TreeRegion(
        "left", box("left", transforms.translation(-1.5, 0, 0), (3.0, 3.5, 3.5)), ("everything",)
    )
    right = TreeRegion(
        "right", tube("right", transforms.translation(0.7, 0, 0), 2.5, 2.2), ("everything",)
    )
    regions = [world, left, right]
    for n, piece in enumerate(solids):
        regions.append(TreeRegion(f"s{n}", piece, ("left", "right"), solid=True))
    regions += nested_boxes("heap", [any_piece("heap", rng, size=0.1) for _ in range(12)])
    return RegionTree.of(regions)


def solids(tree: RegionTree) -> list[TreeRegion]:
    return [region for region in tree.regions.values() if region.solid]


def far(first: ConvexPiece, second: ConvexPiece, by: float) -> bool:
    """Whether balls around the frames of two pieces are: then the plain reference need not be
    asked.
    """
    reach = [
        float(np.linalg.norm(each.vertices, axis=1).max()) + each.radius_m
        for each in (first, second)
    ]
    apart = float(np.linalg.norm(first.T_carrier_piece[:3, 3] - second.T_carrier_piece[:3, 3]))
    return apart > sum(reach) + by


def distance(first: ConvexPiece, second: ConvexPiece) -> float:
    """By the plain reference."""
    placed = [transforms.apply(each.T_carrier_piece, each.vertices) for each in (first, second)]
    return signed_distance(*placed) - first.radius_m - second.radius_m


def flat(tree: RegionTree, query: ConvexPiece, within: float = 0.0) -> dict[str, float]:
    """The nearest of each body by the flat list."""
    found: dict[str, float] = {}
    for region in solids(tree):
        apart = math.inf if far(query, region.piece, within) else distance(query, region.piece)
        if apart <= within:
            found[region.piece.body] = min(apart, found.get(region.piece.body, math.inf))
    return found


def at(tree: RegionTree, points: Floats, radius: float = 0.0) -> list[tuple[str, ...]]:
    """What is hit by a ball around each of the points (n, 3)."""
    return tree.hits([sphere("", point, radius) for point in points])


@pytest.mark.slow
@settings(max_examples=12, deadline=None)
@given(seeds)
def test_points_and_segments_are_answered_as_by_the_flat_list(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tree = random_tree(rng)
    points = rng.uniform(-1.2, 1.2, (20, 3))
    for point, hits in zip(points, at(tree, points), strict=True):
        assert hits == tuple(sorted(flat(tree, sphere("", point, 0.0))))
    for start, end in rng.uniform(-1.5, 1.5, (5, 2, 3)):
        radius = float(rng.choice([0.0, 0.05]))
        query = ConvexPiece("", 0, np.eye(4), np.stack([start, end]), radius)
        assert tree.hits([query]) == [tuple(sorted(flat(tree, query)))]


@settings(max_examples=25, deadline=None)
@given(seeds)
def test_a_body_that_flies_free_is_answered_as_by_the_flat_list(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tree, pieces = random_tree(rng), [any_piece("gripper", rng, 0.1) for _ in range(2)]
    T = turned(rng, rng.uniform(-1, 1, 3))
    placed = [
        ConvexPiece("gripper", 0, T @ each.T_carrier_piece, each.vertices, each.radius_m)
        for each in pieces
    ]
    assert tree.hits(placed) == [tuple(sorted(flat(tree, each))) for each in placed]
    within = 0.1
    plain: dict[str, float] = {}
    for each in placed:
        for name, apart in flat(tree, each, within).items():
            plain[name] = min(apart, plain.get(name, math.inf))
    told = {contact.second: contact.distance_m for contact in tree.contacts(pieces, T, within)}
    assert told.keys() == plain.keys()
    assert all(math.isclose(told[name], plain[name], abs_tol=1e-8) for name in plain)


@settings(max_examples=25, deadline=None)
@given(seeds)
def test_attaching_what_was_detached_restores_the_tree(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tree = random_tree(rng)
    name = str(rng.choice(list(tree.regions)))
    rest, taken = tree.detached(name)
    assert {each.name for each in taken} == {name, *tree.below(name)}
    assert not {each.name for each in taken} & rest.regions.keys()
    again = rest.attached(taken)
    assert dict(again.regions) == dict(tree.regions)
    assert dict(again.covers) == dict(tree.covers)
    points = rng.uniform(-1.2, 1.2, (20, 3))
    assert at(again, points) == at(tree, points)


@settings(max_examples=25, deadline=None)
@given(seeds)
def test_detaching_what_was_attached_restores_the_tree(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tree = random_tree(rng)
    part = nested_boxes(
        "part", [any_piece("part", rng, 0.3, 0.2) for _ in range(6)], ("everything",)
    )
    rest, taken = tree.attached(part).detached("part")
    assert (dict(rest.regions), dict(rest.covers)) == (dict(tree.regions), dict(tree.covers))
    assert {each.name for each in taken} == {each.name for each in part}


@settings(max_examples=15, deadline=None)
@given(seeds)
def test_a_region_that_was_moved_is_hit_where_it_is_now(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tree, T = random_tree(rng), turned(rng, rng.uniform(-0.5, 0.5, 3))
    moved = tree.moved("heap", T)
    points = rng.uniform(-1.0, 1.0, (20, 3))
    only, was = moved.detached("everything")[0], tree.detached("everything")[0]
    assert at(only, transforms.apply(T, points), 0.05) == at(was, points, 0.05)
    back = moved.moved("heap", transforms.inverse(T))
    assert at(back, points) == at(tree, points)


def test_the_union_of_parents_or_of_ancestors_may_cover_a_region() -> None:
    root = TreeRegion("root", box("root", np.eye(4), 4.0))
    parts = [
        TreeRegion(name, box(name, transforms.translation(x, 0, 0), (1.0, 1.0, 1.0)), ("root",))
        for name, x in (("west", -0.5), ("east", 0.5))
    ]
    across = box("across", np.eye(4), (1.6, 0.3, 0.3))
    seam = RegionTree.of([root, *parts, TreeRegion("across", across, ("west", "east"), True)])
    assert seam.covers["across"].names == ("west", "east")
    assert 0 < seam.covers["across"].slack_m < 0.1
    one = RegionTree.of([root, *parts, TreeRegion("across", across, ("west",), True)])
    assert one.covers["across"].names == ("west", "root")
    for tree in (seam, one):
        assert at(tree, np.array([[0.0, 0, 0], [0.79, 0, 0], [0.81, 0, 0]])) == [
            ("across",),
            ("across",),
            (),
        ]


def test_a_region_that_reaches_out_of_its_ancestors_is_refused_at_a_point_of_it() -> None:
    root = TreeRegion("root", sphere("root", np.zeros(3), 1.0))
    out = box("out", transforms.translation(0.9, 0, 0), 0.3)
    with pytest.raises(OutsideError) as error:
        RegionTree.of([root, TreeRegion("out", out, ("root",), True)])
    assert distance(sphere("", error.value.point, 0.0), out) <= 1e-9
    assert np.linalg.norm(error.value.point) > 1.0


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(seeds)
def test_what_is_covered_has_no_point_outside_and_a_hole_is_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    piece, others = (
        any_piece("piece", rng, 0.2),
        [any_piece(f"o{n}", rng, 0.4, 1.5) for n in range(4)],
    )
    answer = cover_piece(piece, others)
    corners = transforms.apply(piece.T_carrier_piece, piece.vertices)
    weights = rng.dirichlet(np.ones(len(corners)), 40)
    ball = rng.normal(size=(40, 3))
    points = weights @ corners + piece.radius_m * ball / np.linalg.norm(ball, axis=1, keepdims=True)

    def away(point: Floats) -> float:
        return min(distance(sphere("", point, 0.0), other) for other in others)

    if isinstance(answer, CoveredPiece):
        assert max(map(away, points)) <= answer.slack_m + 1e-9
    else:
        assert isinstance(answer, UncoveredPoint)
        assert distance(sphere("", answer.point, 0.0), piece) <= 0
        assert away(answer.point) > 0


def test_what_does_not_fit_is_refused() -> None:
    tree = RegionTree.of([TreeRegion("root", sphere("root", np.zeros(3), 1.0), solid=True)])
    small = sphere("small", np.zeros(3), 0.1)
    with pytest.raises(ValueError, match="already"):
        tree.attached([TreeRegion("root", small)])
    with pytest.raises(ValueError, match="no parent 'roof'"):
        tree.attached([TreeRegion("small", small, ("roof",))])
    with pytest.raises(ValueError, match="own ancestor"):
        tree.attached(
            [TreeRegion("small", small, ("other",)), TreeRegion("other", small, ("small",))]
        )
    with pytest.raises(ValueError, match="does not stand"):
        tree.attached(
            [TreeRegion("moving", ConvexPiece("moving", 1, np.eye(4), np.zeros((1, 3)), 0.1))]
        )
    with pytest.raises(KeyError):
        tree.detached("small")


def test_a_tree_without_regions_is_never_hit() -> None:
    tree = RegionTree.of([])
    assert at(tree, np.zeros((2, 3))) == [(), ()]
    assert tree.contacts([sphere("ball", np.zeros(3), 0.1)], np.eye(4), 1.0) == ()


@pytest.mark.parametrize("name", ["themse", "bulkhead"])
def test_regions_of_the_bundled_cells_lie_in_their_parents(name: str) -> None:
    tree, outside = declared_tree(
        GeometricWorld.of(load_cell(bundled_domains()[name] / "cell.yaml"))
    )
    assert tree.regions
    assert not outside


@pytest.mark.parametrize("name", ["themse", "bulkhead"])
def test_arm_configurations_are_answered_as_by_the_flat_list(name: str) -> None:
    """Self-collision and cell at once."""
    world = GeometricWorld.of(load_cell(bundled_domains()[name] / "cell.yaml"))
    scene = collision_scene_of(world)
    q = next(iter(world.models.values())).random(1000, np.random.default_rng(7))
    by_tree, by_list = RegionChecker(scene), BuiltinChecker(scene)
    assert by_list.collides(q).any()
    assert np.array_equal(by_tree.collides(q), by_list.collides(q))
    q[7] = np.nan
    assert np.array_equal(by_tree.collides(q), by_list.collides(q))
    q[7] = 0.0
    assert 0.02 < by_list.collides(q).mean() < 0.95
    assert np.abs(by_tree.clearance(q[:100], 0.3) - by_list.clearance(q[:100], 0.3)).max() < 1e-9
    for one in q[:10]:
        told = [
            [(c.first, c.second, c.distance_m) for c in each.contacts(one, 0.1)]
            for each in (by_tree, by_list)
        ]
        names = [{frozenset(contact[:2]): contact[2] for contact in each} for each in told]
        assert names[0].keys() == names[1].keys()
        assert all(math.isclose(names[0][pair], names[1][pair], abs_tol=1e-9) for pair in names[0])


def test_many_standing_pieces_become_a_tree() -> None:
    dust = PointSet(tuple(map(tuple, np.random.default_rng(1).uniform(-1, 1, (200, 3)))), 0.01)
    body = Body("dust", BodyKind.FIXTURE, shapes=(PlacedShape(dust),))
    scene = collision_scene_of(
        GeometricWorld.of(
            Cell(
                "dusty", {"ur5": MountedArm(load_arm(bundled_arms()["ur5"]))}, bodies={"dust": body}
            )
        )
    )
    checker = BuiltinBackend().checker(scene)
    assert isinstance(checker, RegionChecker)
    q = np.random.default_rng(2).uniform(-3, 3, (500, 6))
    assert np.array_equal(checker.collides(q), BuiltinChecker(scene).collides(q))


def scattered(rng: np.random.Generator, count: int) -> list[TreeRegion]:
    return [
        TreeRegion(f"s{n}", any_piece(f"s{n}", rng, 2.0, 0.2), solid=True) for n in range(count)
    ]


@settings(max_examples=10, deadline=None)
@given(seeds)
def test_a_tree_changed_step_by_step_answers_as_one_made_at_once(seed: int) -> None:
    """Also the trees on the way, which share their arrays, and two that go on from one."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-2, 2, (40, 3))
    trees = [RegionTree.of(scattered(rng, 150))]
    for step in range(40):
        tree = trees[-1] if step % 9 else trees[step // 2]
        name, kind = str(rng.choice(list(tree.regions))), rng.integers(3)
        if kind == 0:
            trees.append(tree.moved(name, turned(rng, rng.uniform(-0.5, 0.5, 3))))
        elif kind == 1:
            trees.append(tree.detached(name)[0])
        else:
            trees.append(
                tree.attached(
                    [TreeRegion(f"n{step}", any_piece(f"n{step}", rng, 2.0, 0.2), solid=True)]
                )
            )
    for tree in trees[:: len(trees) // 6]:
        again = RegionTree.of(tree.regions.values())
        assert at(tree, points, 0.1) == at(again, points, 0.1)


def test_a_change_of_one_region_writes_rows_for_the_way_to_it_alone() -> None:
    tree = RegionTree.of(scattered(np.random.default_rng(3), 2000))
    once = tree.moved("s7", transforms.translation(0.1, 0, 0))
    twice = once.moved("s8", transforms.translation(0.1, 0, 0))
    assert twice.index.boxes is once.index.boxes
    assert twice.index.nodes - once.index.nodes < 60
    assert twice.index.count == once.index.count + 1


@pytest.mark.parametrize("spread", [0.5, 3.0, 6.0])
def test_two_thousand_scattered_bodies_are_answered_as_pairs_are(spread: float) -> None:
    rng = np.random.default_rng(4)
    world = GeometricWorld.of(Cell("bare", {"ur5": MountedArm(load_arm(bundled_arms()["ur5"]))}))
    own = collision_scene_of(world)
    standing = [any_piece(f"s{n}", rng, spread, 0.1) for n in range(2000)]
    moving = [n for n, piece in enumerate(own.pieces) if piece.carrier]
    cross = np.array(list(product(moving, range(len(own.pieces), len(own.pieces) + 2000))))
    scene = replace(own, pieces=(*own.pieces, *standing), pairs=np.concatenate([own.pairs, cross]))
    q = world.models["ur5"].random(POSE_SAMPLES + 100, rng)
    by_tree, by_list = RegionChecker(scene), BuiltinChecker(scene)
    assert np.array_equal(by_tree.collides(q), by_list.collides(q))
    assert np.array_equal(by_tree.collides(q[:200]), by_list.collides(q[:200]))
    assert np.abs(by_tree.clearance(q[:60]) - by_list.clearance(q[:60])).max() < 1e-9


def test_what_is_no_number_is_neither_attached_nor_asked_for() -> None:
    tree = RegionTree.of([TreeRegion("root", sphere("root", np.zeros(3), 1.0), solid=True)])
    for bad in (sphere("bad", np.array([np.nan, 0, 0]), 1.0), sphere("bad", np.zeros(3), np.inf)):
        with pytest.raises(ValueError, match="not a finite number"):
            tree.attached([TreeRegion("bad", bad)])
        with pytest.raises(ValueError, match="not a finite number"):
            tree.contacts([bad], np.eye(4))
    with pytest.raises(ValueError, match="not a finite number"):
        at(tree, np.array([[0.0, np.nan, 0.0]]))


def test_what_is_tried_first_is_what_settles_most_of_the_poses_that_are_left() -> None:
    """One pair touches in 500 of 512 poses; a second one only in those; a third one in eight of
    the rest.
    """
    poses = [(np.arange(500), (2, 7)), (np.arange(400), (3, 1)), (np.arange(498, 508), (0, 4))]
    hits = np.concatenate([np.column_stack([n, np.full((len(n), 2), pair)]) for n, pair in poses])
    assert decisive_pairs(hits).tolist() == [[2, 7], [0, 4]]
    assert decisive_pairs(hits[:0]).shape == (0, 2)
    rare = np.column_stack(
        [np.arange(POSE_SAMPLES), np.arange(POSE_SAMPLES), np.arange(POSE_SAMPLES)]
    )
    assert decisive_pairs(rare).shape == (0, 2)
