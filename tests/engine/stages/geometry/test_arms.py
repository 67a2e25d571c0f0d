"""Forward and inverse kinematics of every bundled arm, and of arms made up here."""

import math

import numpy as np
import pytest

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.geometry.mechanism import Mechanism, place_batch
from cellwright.engine.stages.geometry.kinematics.arm_model import (
    ArmModel,
    carrier_poses,
    whole_turns,
    wrap_angles,
)
from cellwright.engine.stages.geometry.kinematics.inverse_kinematics import (
    InverseKinematics,
    InverseSolver,
    pose_error,
)
from cellwright.kb.model.body_shapes import Pose
from cellwright.kb.model.cell_model import Arm, Joint, JointKind
from tests.engine.stages.geometry.rigid import is_rigid

SOLVERS = {
    "manutec_r3": InverseSolver.SPHERICAL_WRIST,
    "puma_560": InverseSolver.SPHERICAL_WRIST,
    "t3_746": InverseSolver.SPHERICAL_WRIST,
    "ur5": InverseSolver.PARALLEL_AXES,
}


def worst_error(model: ArmModel, poses: Floats, q: Floats) -> float:
    return float(np.abs(pose_error(model, poses, q)).max())


def test_the_right_solver_is_read_off_the_axes(models: dict[str, ArmModel]) -> None:
    assert {name: InverseKinematics(model).solver for name, model in models.items()} == SOLVERS


def test_forward_kinematics_is_the_product_of_the_published_table(
    models: dict[str, ArmModel],
) -> None:
    """The Puma's table multiplied out here, entry by entry."""
    q = np.array([0.3, -0.4, 0.5, 0.6, 0.7, -0.8])
    a, d = [0, 0.4318, 0.0203, 0, 0, 0], [0.6718, 0, 0.15, 0.4318, 0, 0]
    alpha = np.array([90, 0, -90, 90, -90, 0]) * math.pi / 180
    T = np.eye(4)
    for i in range(6):
        ct, st, ca, sa = math.cos(q[i]), math.sin(q[i]), math.cos(alpha[i]), math.sin(alpha[i])
        T = T @ np.array(
            [
                [ct, -st * ca, st * sa, a[i] * ct],
                [st, ct * ca, -ct * sa, a[i] * st],
                [0, sa, ca, d[i]],
                [0, 0, 0, 1],
            ]
        )
    assert np.abs(models["puma_560"].flange_pose(q) - T).max() < 1e-15


def test_inverse_kinematics_of_ten_thousand_poses_is_exact_and_misses_nothing(
    model: ArmModel, rng: np.random.Generator
) -> None:
    """Every answer takes its pose, and the configuration a pose was made from is among them."""
    q = model.random(10_000, rng)
    poses = model.flange_pose(q)
    found = InverseKinematics(model).solve(poses)
    row, branch = np.nonzero(found.valid)
    assert worst_error(model, poses[row], found.q[row, branch]) < 1e-9
    missed = np.abs(wrap_angles(found.q - q[:, None])).max(axis=-1)
    assert np.where(found.valid, missed, np.inf).min(axis=1).max() < 1e-6


def test_a_pose_out_of_reach_has_no_solution(model: ArmModel) -> None:
    far = model.flange_pose(np.zeros(6))
    far[:3, 3] = 100.0
    assert not InverseKinematics(model).solve(far[None]).valid.any()


def test_singular_configurations_have_solutions_that_reach(model: ArmModel) -> None:
    special = (
        np.array(np.meshgrid(*[[0.0, math.pi / 2, -math.pi / 2, math.pi]] * 5)).reshape(5, -1).T
    )
    q = np.column_stack([np.full(len(special), 0.3), special])
    poses = model.flange_pose(q)
    found = InverseKinematics(model).solve(poses)
    assert found.valid.any(axis=1).all()
    row, branch = np.nonzero(found.valid)
    assert worst_error(model, poses[row], found.q[row, branch]) < 1e-9


def test_a_batch_answers_as_single_poses_do(model: ArmModel, rng: np.random.Generator) -> None:
    q = model.random(20, rng)
    poses = model.flange_pose(q)
    together = InverseKinematics(model).solve(poses)
    for n in range(len(q)):
        alone = InverseKinematics(model).solve(poses[n : n + 1])
        assert np.array_equal(alone.q[0], together.q[n])
        assert np.array_equal(alone.valid[0], together.valid[n])
        assert np.array_equal(model.flange_pose(q[n]), poses[n])
        assert np.abs(model.jacobian(q)[n] - model.jacobian(q[n])).max() < 1e-15


def test_the_jacobian_is_the_derivative_of_the_pose(
    model: ArmModel, rng: np.random.Generator
) -> None:
    q, step = model.random(20, rng), 1e-6
    J = model.jacobian(q)
    for joint in range(6):
        ahead, behind = q.copy(), q.copy()
        ahead[:, joint] += step
        behind[:, joint] -= step
        slope = pose_error(model, model.flange_pose(ahead), behind) / (2 * step)
        assert np.abs(slope - J[:, :, joint]).max() < 1e-8


def test_the_compiled_forward_kinematics_agrees_with_numpy(
    model: ArmModel, rng: np.random.Generator
) -> None:
    joints, q = model.joints, model.random(50, rng)
    out = np.empty((50, 7, 3, 4))
    place_batch(
        Mechanism(joints.parent, joints.T_parent_origin, joints.axis, joints.prismatic), q, out
    )
    assert np.abs(out - carrier_poses(joints, q)[:, :, :3]).max() < 1e-14


def test_whole_turns_within_the_limits_are_offered(models: dict[str, ArmModel]) -> None:
    found = whole_turns(models["ur5"], np.array([0.5, 0, 0, 0, 0, 0]))
    assert len(found) == 2 * 3**5
    assert models["ur5"].within_limits(found).all()
    assert len(whole_turns(models["manutec_r3"], np.array([3.0, 0, 0, 0, 0, 0]))) == 0


def arm_of(*joints: Joint) -> ArmModel:
    return ArmModel(Arm("made_up", joints, flange=(Pose((0.1, 0.0, 0.2)),)))


@pytest.mark.slow
def test_an_arm_without_a_closed_form_is_searched(rng: np.random.Generator) -> None:
    """Six axes, no three of which are parallel or meet."""
    joints = []
    for number in range(6):
        turn = (float(rng.uniform(-1.5, 1.5)), float(rng.uniform(-1.5, 1.5)), 0.0)
        joints.append(
            Joint(f"j{number}", (Pose((0.1, 0.05 * number, 0.3), turn),), lower=-3.0, upper=3.0)
        )
    model = arm_of(*joints)
    solver = InverseKinematics(model)
    assert solver.solver is InverseSolver.ITERATIVE
    poses = model.flange_pose(model.random(10, rng))
    found = solver.solve(poses)
    assert found.valid.any(axis=1).all()
    row, branch = np.nonzero(found.valid)
    assert worst_error(model, poses[row], found.q[row, branch]) < 1e-9


def test_prismatic_joints_move_along_their_axis() -> None:
    model = arm_of(
        Joint("lift", (), (0.0, 0.0, 1.0), JointKind.PRISMATIC, 0.0, 1.0),
        Joint("turn", (Pose((0.5, 0.0, 0.0)),), lower=-3.0, upper=3.0),
    )
    assert np.allclose(model.flange_pose(np.array([0.4, 0.0]))[:3, 3], [0.6, 0.0, 0.6])
    assert np.allclose(model.jacobian(np.array([0.4, 0.0]))[:, 0], [0, 0, 1, 0, 0, 0])


@pytest.mark.parametrize("oblique", [0.3, 1.1, math.pi / 2])
def test_wrists_of_any_angle_are_one_case(oblique: float, rng: np.random.Generator) -> None:
    right = math.pi / 2
    turned = [
        Pose((0.0, 0.0, 0.4), (right, 0, 0)),
        Pose((0.5, 0, 0.1)),
        Pose((0.1, 0, 0.0), (right, 0, 0)),
    ]
    wrist = [Pose((0.0, 0.0, 0.6), (oblique, 0, 0)), Pose((0, 0, 0), (-oblique, 0, 0))]
    origins = [(), *((pose,) for pose in (*turned, *wrist))]
    model = arm_of(
        *(Joint(f"j{n}", origin, lower=-3.1, upper=3.1) for n, origin in enumerate(origins))
    )
    q = model.random(500, rng)
    found = InverseKinematics(model).solve(model.flange_pose(q))
    nearest = np.where(
        found.valid, np.abs(wrap_angles(found.q - q[:, None])).max(axis=-1), np.inf
    ).min(axis=1)
    regular = np.linalg.svd(model.jacobian(q), compute_uv=False)[:, -1] > 1e-3
    assert InverseKinematics(model).solver is InverseSolver.SPHERICAL_WRIST
    assert nearest[regular].max() < 1e-6


def test_assumptions_are_marked(models: dict[str, ArmModel]) -> None:
    assert any("joints 4 to 6" in each for each in models["manutec_r3"].arm.assumptions)
    assert any("T3-776" in each for each in models["t3_746"].arm.assumptions)


def test_random_configurations_keep_the_limits(model: ArmModel, rng: np.random.Generator) -> None:
    assert model.within_limits(model.random(1000, rng)).all()
    assert is_rigid(model.flange_pose(model.random(10, rng)))


RIGHT = math.pi / 2
Row = tuple[float, float, float]


def arm_of_rows(*rows: Row) -> ArmModel:
    """An arm from Craig's table: alpha and a to the next axis, d along it."""
    joints = [
        Joint(f"j{n}", (Pose((a, 0, 0), (alpha, 0, 0)), Pose((0, 0, d))), lower=-3.1, upper=3.1)
        for n, (alpha, a, d) in enumerate(rows)
    ]
    return arm_of(*joints)


PANDA: tuple[Row, ...] = (
    (0, 0, 0.333),
    (-RIGHT, 0, 0),
    (RIGHT, 0, 0.316),
    (RIGHT, 0.0825, 0),
    (-RIGHT, -0.0825, 0.384),
    (RIGHT, 0, 0),
    (RIGHT, 0.088, 0.107),
)
IIWA: tuple[Row, ...] = (
    (0, 0, 0.34),
    (-RIGHT, 0, 0),
    (RIGHT, 0, 0.4),
    (RIGHT, 0, 0),
    (-RIGHT, 0, 0.4),
    (-RIGHT, 0, 0),
    (RIGHT, 0, 0.126),
)


def recall(model: ArmModel, q: Floats, **asked: Floats) -> float:
    """Of how many configurations the one that a pose was made from is found; every answer takes
    its pose.
    """
    poses = model.flange_pose(q)
    found = InverseKinematics(model).solve(poses, **asked)
    row, branch = np.nonzero(found.valid)
    assert worst_error(model, poses[row], found.q[row, branch]) < 1e-9
    apart = np.abs(wrap_angles(found.q - q[:, None])).max(axis=-1)
    return float((np.where(found.valid, apart, np.inf).min(axis=1) < 1e-6).mean())


@pytest.mark.parametrize("bend", [1e-3, 1e-6, 1e-8, -1e-8])
def test_branches_near_a_straight_wrist_are_found(
    model: ArmModel, bend: float, rng: np.random.Generator
) -> None:
    """Where the angle is nearly 0 its cosine tells nothing.

    At 1e-8 the pose itself has the other angles to 1e-8 alone.
    """
    q = model.random(2000, rng)
    q[:, 4] = bend
    assert recall(model, q) > (0.94 if abs(bend) < 1e-7 else 0.99)


def test_the_ur5_finds_its_branches_near_a_straight_wrist(models: dict[str, ArmModel]) -> None:
    assert (
        recall(
            models["ur5"], np.array([[-2.762443, 0.171536, -0.243985, -2.625903, 1e-8, 2.115797]])
        )
        == 1.0
    )


@pytest.mark.parametrize(
    "rows",
    [
        (
            (0, 0, 0.4),
            (-RIGHT, 0, 0),
            (RIGHT, 0.1, 0.5),
            (-RIGHT, -0.05, 0.1),
            (RIGHT, 0, 0),
            (-RIGHT, 0, 0),
        ),
        ((0, 0, 0.4), (-1.1, 0, 0), (0.9, 0.3, 0.1), (-RIGHT, 0.1, 0.5), (1.0, 0, 0), (-1.0, 0, 0)),
        (
            (0, 0, 0),
            (-RIGHT, 0, 0),
            (RIGHT, 0, 0),
            (0.7, 0.3, 0.2),
            (-RIGHT, 0.2, 0.5),
            (1.2, 0, 0),
        ),
    ],
    ids=["right angles", "oblique", "from the hand to the base"],
)
def test_two_axes_that_meet_and_a_spherical_wrist_have_a_closed_form(
    rows: tuple[Row, ...], rng: np.random.Generator
) -> None:
    model = arm_of_rows(*rows)
    assert InverseKinematics(model).solver is InverseSolver.INTERSECTING_AXES
    q = model.random(3000, rng)
    assert recall(model, q[np.linalg.svd(model.jacobian(q), compute_uv=False)[:, -1] > 1e-4]) == 1.0


@pytest.mark.parametrize(
    "rows",
    [
        (
            (0, 0, 0.4),
            (-1.2, 0.15, 0.1),
            (0.8, 0.4, 0.1),
            (-RIGHT, 0.1, 0.5),
            (RIGHT, 0, 0),
            (-RIGHT, 0, 0),
        ),
        (
            (0, 0, 0.3),
            (1.1, 0.2, 0.1),
            (-0.8, 0.35, 0.15),
            (0.9, 0.1, 0.4),
            (-1.2, 0.08, 0.1),
            (1.0, 0.05, 0.1),
        ),
    ],
    ids=["spherical wrist", "general"],
)
@pytest.mark.parametrize("count", [6, pytest.param(20, marks=pytest.mark.slow)])
def test_a_search_misses_hardly_any_branch(
    rows: tuple[Row, ...], count: int, rng: np.random.Generator
) -> None:
    model = arm_of_rows(*rows)
    assert InverseKinematics(model).solver is InverseSolver.ITERATIVE
    assert recall(model, model.random(count, rng)) == 1.0


@pytest.mark.parametrize(("rows", "joint"), [(PANDA, 6), (IIWA, 2)], ids=["panda", "iiwa"])
def test_the_redundancy_of_seven_joints_is_a_parameter(
    rows: tuple[Row, ...], joint: int, rng: np.random.Generator
) -> None:
    model = arm_of_rows(*rows)
    solver = InverseKinematics(model)
    assert solver.redundant == joint
    q = model.random(300, rng)
    for one in q[:100]:
        assert recall(model, one[None], redundancy=one[joint : joint + 1]) == 1.0
    free = solver.solve(model.flange_pose(q))
    assert free.valid.any(axis=1).mean() > 0.9
    assert worst_error(model, model.flange_pose(q[:1]), free.of(0)) < 1e-9
    few = solver.solve(model.flange_pose(q), redundancy=np.array([0.3, -0.4]))
    assert set(np.unique(few.q[few.valid][:, joint].round(9))) <= {0.3, -0.4}
    with pytest.raises(ValueError, match="values of a joint"):
        solver.solve(model.flange_pose(q), redundancy=np.array([np.nan]))


@pytest.mark.parametrize("entry", [np.nan, np.inf, -np.inf])
def test_what_is_no_number_has_no_branches_and_keeps_no_limits(
    model: ArmModel, entry: float
) -> None:
    q = np.zeros((2, 6))
    poses = model.flange_pose(q + 0.3)
    poses[1, 0, 3] = entry
    found = InverseKinematics(model).solve(poses)
    assert found.valid[0].any()
    assert not found.valid[1].any()
    assert np.isfinite(found.q).all()
    q[1, 3] = entry
    assert model.within_limits(q).tolist() == [bool(model.within_limits(q[0])), False]


def test_what_is_no_rigid_pose_has_no_branches(model: ArmModel) -> None:
    pose = model.flange_pose(np.full(6, 0.3))
    for factor in (np.diag([2.0, 2, 2, 1]), np.diag([1.0, 1, -1, 1]), np.diag([1.0, 1, 1, 2])):
        assert not InverseKinematics(model).solve((pose @ factor)[None]).valid.any()


def test_arrays_of_another_width_are_refused(model: ArmModel) -> None:
    for wrong in (np.zeros((3, 5)), np.zeros((3, 7)), np.zeros(0)):
        for ask in (model.flange_pose, model.jacobian, model.within_limits):
            with pytest.raises(ValueError, match="6 joints need"):
                ask(wrong)
    for shape in ((4, 4), (2, 3, 4), (2, 5, 4), (2, 4, 3)):
        with pytest.raises(ValueError, match="poses must be"):
            InverseKinematics(model).solve(np.zeros(shape))


@pytest.mark.parametrize("name", ["manutec_r3", "puma_560"])
def test_published_limits_lie_around_the_arm_that_is_stretched_upward(
    models: dict[str, ArmModel], name: str
) -> None:
    """Shoulder and elbow may turn as far to the one side as to the other, and the elbow never
    folds wholly.
    """
    model = models[name]
    lower, upper = model.joints.lower, model.joints.upper
    straight = np.zeros(6)
    straight[1:3] = (lower[1:3] + upper[1:3]) / 2
    heights = model.flange_pose(model.random(5_000, np.random.default_rng(0)))[:, 2, 3]
    assert model.flange_pose(straight)[2, 3] > heights.max() - 0.02
    assert upper[2] - lower[2] < 2 * math.pi
