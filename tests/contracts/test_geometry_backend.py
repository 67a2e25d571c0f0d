"""What every geometry backend answers, whoever computes it: one suite on all that are installed."""

import importlib.util
import math

import numpy as np
import pytest

from benchmarks.reference_distances import signed_distance
from cellwright.engine import plugins
from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.geometry import CollisionScene
from cellwright.engine.ports import GeometryBackend
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.collision.region_checker import RegionChecker
from cellwright.engine.stages.geometry.kinematics.arm_model import carrier_poses
from cellwright.engine.stages.geometry.world.collision_scene import (
    collision_scene_of,
    free_scene_of,
)
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader.arm_file import bundled_arms, load_arm
from cellwright.kb.model.body_shapes import (
    Box,
    Cylinder,
    HeightField,
    PlacedShape,
    PointSet,
    Polyhedron,
    Pose,
    Shape,
    Sphere,
    Tube,
)
from cellwright.kb.model.cell_model import Body, BodyKind, Cell, MountedArm, Placement

NAMES = [
    pytest.param(
        name, marks=[] if name == "builtin" or importlib.util.find_spec(name) else pytest.mark.skip
    )
    for name in plugins.registered_names(plugins.GEOMETRY_GROUP)
]
AGREE_M = 1e-5  # what the least exact backend promises


class RegionTrees:
    """Not a backend of its own: what the built-in one does with many standing pieces."""

    name = "region trees"
    exact_depths = True

    def checker(self, scene: CollisionScene) -> RegionChecker:
        return RegionChecker(scene)

    def checker_of_few(self, scene: CollisionScene) -> RegionChecker:
        return self.checker(scene)


@pytest.fixture(params=[*NAMES, RegionTrees.name])
def backend(request: pytest.FixtureRequest) -> GeometryBackend:
    return (
        RegionTrees()
        if request.param == RegionTrees.name
        else plugins.geometry_backend(request.param)
    )


def body(
    name: str, shape: Shape, at: tuple[float, float, float], kind: BodyKind = BodyKind.FIXTURE
) -> Body:
    return Body(name, kind, Placement("world", Pose(at, (0.3, -0.2, 0.5))), (PlacedShape(shape),))


WEDGE = Polyhedron({"a": (0, 0, 0), "b": (0.3, 0, 0), "c": (0, 0.3, 0), "d": (0, 0, 0.3)})


def cell() -> Cell:
    bodies = [
        body("table", Box((2.0, 2.0, 0.1)), (0, 0, -0.35)),
        body("post", Tube(0.06, 0.5), (0.5, 0.1, 0.3)),
        body("ball", Sphere(0.1), (-0.4, 0.4, 0.5)),
        body("drum", Cylinder(0.12, 0.3), (-0.2, -0.6, 0.2)),
        body("wedge", WEDGE, (0.3, -0.5, 0.4)),
        body("dust", PointSet(((0.1, 0.5, 0.6), (0.2, 0.6, 0.5)), 0.03), (0, 0, 0)),
        body(
            "heap",
            HeightField((0.1, 0.1), ((0.1, 0.2, 0.1), (0.2, 0.3, 0.2), (0.1, 0.2, 0.1))),
            (-0.8, 0.1, 0),
        ),
        body("tool", Box((0.04, 0.08, 0.1)), (0, 0, 0.05), BodyKind.TOOL),
    ]
    arm = MountedArm(load_arm(bundled_arms()["ur5"]))
    return Cell("contract", {"ur5": arm}, bodies={each.name: each for each in bodies})


@pytest.fixture(scope="module")
def scene() -> CollisionScene:
    world = GeometricWorld.of(cell())
    return collision_scene_of(world.put("tool", "ur5.flange", transforms.translation(0, 0, 0.06)))


def plain_distances(scene: CollisionScene, poses: Floats) -> dict[frozenset[str], float]:
    """Of every pair of bodies, by the plain reference; poses (k + 1, 4, 4)."""
    found: dict[frozenset[str], float] = {}
    for i, j in scene.pairs:
        a, b = scene.pieces[i], scene.pieces[j]
        placed = [
            transforms.apply(poses[each.carrier] @ each.T_carrier_piece, each.vertices)
            for each in (a, b)
        ]
        distance = math.inf
        if not far_apart(*placed):
            distance = signed_distance(placed[0], placed[1]) - a.radius_m - b.radius_m
        key = frozenset((a.body, b.body))
        found[key] = min(distance, found.get(key, math.inf))
    return found


def far_apart(first: Floats, second: Floats, by: float = 0.5) -> bool:
    """Whether their boxes along the world's axes are: then the plain reference need not be
    asked.
    """
    gap = np.maximum(first.min(axis=0) - second.max(axis=0), second.min(axis=0) - first.max(axis=0))
    return bool(gap.max() > by)


def configurations(scene: CollisionScene, count: int) -> Floats:
    return np.random.default_rng(5).uniform(-3, 3, (count, scene.joints.count))


def test_distances_and_depths_are_those_of_the_plain_reference(
    backend: GeometryBackend, scene: CollisionScene
) -> None:
    checker = backend.checker(scene)
    for q in configurations(scene, 3):
        plain = plain_distances(scene, carrier_poses(scene.joints, q))
        told = {
            frozenset((c.first, c.second)): c.distance_m for c in checker.contacts(q, within_m=0.2)
        }
        assert told.keys() == {pair for pair, distance in plain.items() if distance <= 0.2}
        for pair, distance in told.items():
            if distance > 0 or backend.exact_depths:
                assert math.isclose(distance, plain[pair], abs_tol=AGREE_M), pair
            else:
                assert plain[pair] < AGREE_M, pair


def test_collision_is_a_distance_of_nothing_or_less(
    backend: GeometryBackend, scene: CollisionScene
) -> None:
    checker, q = backend.checker(scene), configurations(scene, 200)
    clearance = checker.clearance(q, beyond_m=0.05)
    clear = np.abs(clearance) > AGREE_M
    assert np.array_equal(checker.collides(q)[clear], clearance[clear] <= 0)
    assert clearance.max() <= 0.05
    assert 0.1 < checker.collides(q).mean() < 0.9


def test_contacts_come_nearest_first_and_agree_with_the_clearance(
    backend: GeometryBackend, scene: CollisionScene
) -> None:
    checker = backend.checker(scene)
    for q in configurations(scene, 10):
        contacts = checker.contacts(q, within_m=0.1)
        distances = [contact.distance_m for contact in contacts]
        assert distances == sorted(distances)
        nearest = min([0.1, *distances])
        assert math.isclose(checker.clearance(q[None], beyond_m=0.1)[0], nearest, abs_tol=AGREE_M)


def test_witness_points_are_apart_by_the_distance_along_the_normal(
    backend: GeometryBackend, scene: CollisionScene
) -> None:
    checker = backend.checker(scene)
    for q in configurations(scene, 5):
        for contact in checker.contacts(q, within_m=0.1):
            gap = contact.point_second - contact.point_first
            assert np.abs(gap - contact.distance_m * contact.normal).max() < 1e-4, (
                contact.first,
                contact.second,
            )
            assert math.isclose(float(np.linalg.norm(contact.normal)), 1.0, abs_tol=1e-6)
            assert contact.depth_m == max(0.0, -contact.distance_m)


def test_a_batch_answers_as_single_configurations_do(
    backend: GeometryBackend, scene: CollisionScene
) -> None:
    checker, q = backend.checker(scene), configurations(scene, 50)
    alone = [checker.collides(each[None])[0] for each in q]
    assert checker.collides(q).tolist() == alone
    assert np.allclose(
        checker.clearance(q), [checker.clearance(each[None])[0] for each in q], atol=AGREE_M
    )


@pytest.mark.parametrize("entry", [np.nan, np.inf, -np.inf])
def test_what_is_no_number_counts_as_a_collision(
    backend: GeometryBackend, scene: CollisionScene, entry: float
) -> None:
    checker, q = backend.checker(scene), configurations(scene, 6)
    before = checker.collides(q), checker.clearance(q)
    q[2, 3] = entry
    after = checker.collides(q), checker.clearance(q)
    others = np.arange(6) != 2
    assert after[0][2]
    assert after[1][2] == -np.inf
    assert np.array_equal(before[0][others], after[0][others])
    assert np.array_equal(before[1][others], after[1][others])
    with pytest.raises(ValueError, match="not a finite number"):
        checker.contacts(q[2])
    free = free_scene_of(GeometricWorld.of(cell()), "tool")
    pose = np.eye(4)[None].copy()
    pose[0, 1, 3] = entry
    assert backend.checker(free).collides(pose).tolist() == [True]


def test_arrays_of_another_width_are_refused(
    backend: GeometryBackend, scene: CollisionScene
) -> None:
    for checked, shape in (
        (scene, (2, 5)),
        (scene, (2, 7)),
        (scene, (6,)),
        (free_scene_of(GeometricWorld.of(cell()), "tool"), (2, 3, 4)),
    ):
        checker = backend.checker(checked)
        for ask in (checker.collides, checker.clearance):
            with pytest.raises(ValueError, match="must be"):
                ask(np.zeros(shape))
        with pytest.raises(ValueError, match="must be"):
            checker.contacts(np.zeros(shape[1:]))


def test_an_empty_batch_has_an_empty_answer(
    backend: GeometryBackend, scene: CollisionScene
) -> None:
    checker = backend.checker(scene)
    assert checker.collides(np.zeros((0, 6))).shape == (0,)
    assert checker.clearance(np.zeros((0, 6))).shape == (0,)


def test_a_body_flies_free(backend: GeometryBackend) -> None:
    scene = free_scene_of(GeometricWorld.of(cell()), "tool")
    checker = backend.checker(scene)
    poses = np.stack([transforms.translation(0, 0, z) for z in (2.0, -0.35)])
    assert checker.collides(poses).tolist() == [False, True]
    deepest = checker.contacts(poses[1])[0]
    assert {deepest.first, deepest.second} == {"tool", "table"}
    plain = plain_distances(scene, np.stack([np.eye(4), poses[1]]))
    assert plain[frozenset({"tool", "table"})] < 0
    if backend.exact_depths:
        assert math.isclose(
            deepest.distance_m, plain[frozenset({"tool", "table"})], abs_tol=AGREE_M
        )


def test_what_is_affixed_collides_where_it_is_carried(backend: GeometryBackend) -> None:
    world = GeometricWorld.of(cell())
    q = np.array([0.3, -1.0, 1.2, -0.5, -1.5, 0.0])
    far = world.put("tool", "world", transforms.translation(5, 5, 5))
    flange = far.moved("ur5", q).pose("world", "ur5.flange")
    on_ball = transforms.inverse(flange) @ world.pose("world", "ball")
    carried = far.put("tool", "ur5.flange", on_ball)
    hit = [
        any(
            {"tool", "ball"} == {c.first, c.second}
            for c in backend.checker(collision_scene_of(each)).contacts(q)
        )
        for each in (far, carried)
    ]
    assert hit == [False, True]


def test_nothing_to_check_is_free(backend: GeometryBackend) -> None:
    lonely = Cell("lonely", bodies={"ball": body("ball", Sphere(0.1), (0, 0, 0), BodyKind.PART)})
    checker = backend.checker(free_scene_of(GeometricWorld.of(lonely), "ball"))
    assert not checker.collides(np.eye(4)[None]).any()
    assert checker.clearance(np.eye(4)[None], 0.5).tolist() == [0.5]
    assert checker.contacts(np.eye(4)) == ()


def test_an_unknown_backend_is_refused_with_what_there_is() -> None:
    with pytest.raises(InvalidInput, match="builtin"):
        plugins.geometry_backend("bultin")
