"""Inverse kinematics beside EAIK (Ostermeier, Külz & Althoff 2025), an independent closed-form
solver, if it is installed.
"""

import numpy as np
import pytest

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.stages.geometry.kinematics.arm_model import ArmModel, wrap_angles
from cellwright.engine.stages.geometry.kinematics.inverse_kinematics import InverseKinematics

eaik = pytest.importorskip("eaik.IK_HP", reason="a tool for comparison")


def oracle(model: ArmModel) -> "eaik.HPRobot":
    """The same arm, given by its axes at zero and the steps between them."""
    screws = InverseKinematics(model).form
    assert screws is not None
    points = np.vstack([screws.points, InverseKinematics(model).T_zero[None, :3, 3]])
    steps = np.diff(np.vstack([np.zeros(3), points]), axis=0)
    return eaik.HPRobot(screws.directions, steps)


def test_every_exact_answer_of_the_oracle_is_among_ours(
    model: ArmModel, rng: np.random.Generator
) -> None:
    robot, solver = oracle(model), InverseKinematics(model)
    q = model.random(300, rng)
    q = q[np.linalg.svd(model.jacobian(q), compute_uv=False)[:, -1] > 1e-2]
    for pose in model.flange_pose(q):
        ours = solver.solve(pose[None]).of(0)
        target = pose.copy()  # its tool does not turn at zero
        target[:3, :3] = pose[:3, :3] @ solver.T_zero[:3, :3].T
        theirs = exact(model, pose, np.array(robot.IK(target).Q).reshape(-1, 6))
        assert len(theirs)
        assert np.abs(wrap_angles(ours[:, None] - theirs)).max(axis=-1).min(axis=0).max() < 1e-5


def exact(model: ArmModel, pose: Floats, q: Floats) -> Floats:
    """The answers that take the pose; the oracle gives least-squares answers, too."""
    kept: Floats = q[np.abs(model.flange_pose(q) - pose).max(axis=(1, 2)) < 1e-8]
    return kept
