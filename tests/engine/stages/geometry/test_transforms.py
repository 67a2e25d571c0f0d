import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.stages.geometry import transforms
from cellwright.kb.model.body_shapes import Pose
from tests.engine.stages.geometry.rigid import is_rigid

lengths = st.floats(-10, 10)
angles = st.floats(-math.pi, math.pi)
poses = st.builds(Pose, st.tuples(lengths, lengths, lengths), st.tuples(angles, angles, angles))
matrices = poses.map(transforms.of_pose)


def close(a: Floats, b: Floats, tolerance: float = 1e-9) -> bool:
    return bool(np.abs(a - b).max() <= tolerance)


@given(matrices, matrices, matrices)
def test_transforms_compose_associatively(a: Floats, b: Floats, c: Floats) -> None:
    assert close((a @ b) @ c, a @ (b @ c))


@given(matrices)
def test_the_inverse_undoes_a_transform_from_both_sides(a: Floats) -> None:
    assert close(transforms.inverse(a) @ a, np.eye(4))
    assert close(a @ transforms.inverse(a), np.eye(4))


@given(matrices, matrices)
def test_the_product_of_rigid_transforms_is_rigid(a: Floats, b: Floats) -> None:
    assert is_rigid(a @ b)
    assert not is_rigid(a @ np.diag([1.0, 1.0, -1.0, 1.0]))


@given(poses)
def test_a_pose_comes_back_from_its_matrix(pose: Pose) -> None:
    T = transforms.of_pose(pose)
    assert close(transforms.of_pose(transforms.to_pose(T)), T, 1e-7)


@given(matrices, st.lists(st.tuples(lengths, lengths, lengths), min_size=1, max_size=5))
def test_moving_points_keeps_their_distances(
    a: Floats, points: list[tuple[float, float, float]]
) -> None:
    before = np.array(points)
    after = transforms.apply(a, before)
    assert close(
        np.linalg.norm(after - after[0], axis=1), np.linalg.norm(before - before[0], axis=1)
    )


@given(st.tuples(lengths, lengths, lengths), st.floats(0, math.pi))
def test_a_rotation_vector_turns_into_its_rotation_and_back(
    axis: tuple[float, float, float], angle: float
) -> None:
    length = math.hypot(*axis)
    if length < 1e-3:
        return
    unit = np.array(axis) / length
    R = transforms.rotation(unit, angle)
    vector = transforms.rotation_vector(R)
    back = float(np.linalg.norm(vector))
    assert close(transforms.rotation(vector / back, back) if back > 0 else np.eye(3), R, 1e-7)


@given(matrices, matrices)
def test_batches_answer_as_single_transforms_do(a: Floats, b: Floats) -> None:
    both = np.stack([a, b])
    assert close(transforms.inverse(both)[1], transforms.inverse(b), 0)
    metres, radians = transforms.difference(both, both[::-1])
    alone = transforms.difference(a, b)
    assert math.isclose(metres[0], alone[0], abs_tol=1e-12)
    assert math.isclose(radians[0], alone[1], abs_tol=1e-12)


def test_half_a_turn_has_a_rotation_vector_of_length_pi() -> None:
    for axis in (np.array([1.0, 0, 0]), np.array([0.6, 0.8, 0]), np.array([0.0, -0.6, 0.8])):
        vector = transforms.rotation_vector(2 * np.outer(axis, axis) - np.eye(3))
        assert close(np.abs(vector), np.abs(math.pi * axis))
