"""Inverse kinematics: closed form where the geometry allows it, damped least squares otherwise.

`solve` answers with every branch for a batch of poses. What fits which solver is read off the axes at the zero
configuration, not off a table of robots. Three forms of six axes have a solution of their own: axes 2 and 3 parallel, or
axes 1 and 2 through one point, each with axes 4 to 6 through one point; and axes 2 to 4 parallel with axes 5 and 6 through
one point. An arm that has such a form when it is read from the hand to the base is solved that way round. An arm of seven
joints is solved with one of them held, if the other six have such a form: its value is a parameter of the solution.
"""

import math
from dataclasses import dataclass

import numpy as np

from cellwright.engine.kernels.geometry import inverse
from cellwright.engine.kernels.linear import matmul
from cellwright.engine.model.geometry import Floats, Truths
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.kinematics.arms import ArmModel, carrier_poses, wrapped
from cellwright.engine.stages.geometry.kinematics.forms import PROBED, Form, Solver, form_of, held, holdable
from cellwright.engine.stages.geometry.kinematics.search import EXACT, missed, polished, pose_error, searched
from cellwright.engine.stages.geometry.stretches import in_stretches

__all__ = ["Branches", "InverseKinematics", "Solver", "polished", "pose_error"]

HELD = 16  # values of a joint that is held, when none are given
NEARLY = 1e-2  # metres and radians: what misses by more is no branch, and not polished
HOMOGENEOUS = np.array([0.0, 0.0, 0.0, 1.0])  # the last row of every pose
CLOSED = {
    Solver.SPHERICAL_WRIST: inverse.spherical_wrist,
    Solver.INTERSECTING_AXES: inverse.intersecting_axes,
    Solver.PARALLEL_AXES: inverse.parallel_axes,
}
LAST_ROW = HOMOGENEOUS.tobytes()
RIGID = 1e-6  # how far a matrix may be from a rotation


@dataclass(frozen=True, slots=True, eq=False)
class Branches:
    """Configurations (n, b, k), angles in (-pi, pi], and which of them (n, b) reach their pose."""

    q: Floats
    valid: Truths

    def of(self, index: int) -> Floats:
        """Those of one pose (m, k)."""
        found: Floats = self.q[index][self.valid[index]]
        return found


class InverseKinematics:
    """The inverse kinematics of one arm; what depends on the arm alone is computed once."""

    def __init__(self, model: ArmModel) -> None:
        self.model = model
        poses = carrier_poses(model.joints, np.zeros(model.joints.count))
        self._h = np.einsum("kij,kj->ki", poses[1:, :3, :3], model.joints.axis)
        self._o = np.ascontiguousarray(poses[1:, :3, 3])
        self.T_zero = matmul(poses[-1], model.T_last_flange)  # the flange at the zero configuration
        self._T_flange_zero = transforms.inverse(self.T_zero)
        turning = not model.joints.prismatic.any()
        self.redundant = holdable(self._h, self._o) if turning and len(self._h) == 7 else None
        self.form = form_of(self._h, self._o) if turning and len(self._h) == 6 else None
        if self.redundant is not None:
            self.form = held(self._h, self._o, self.redundant, PROBED)[0]

    @property
    def solver(self) -> Solver:
        """How it is computed."""
        return self.form.solver if self.form else Solver.ITERATIVE

    def solve(self, T_base_flange: Floats, seed: int = 0, redundancy: Floats | None = None) -> Branches:
        """All branches that reach each pose (n, 4, 4), within the joint limits or not (`within_limits` tells).

        At a singularity one member of the continuum is returned. An arm with a joint that can be held (`redundant`: its
        number) has branches for each of the values `redundancy` (m,) of that joint, in rad: 16 between its limits when none
        are given. Without a closed form the search starts from random configurations until it finds no more; a branch may
        then be missed. What is no rigid pose, or no number at all, has no branches. Raises `ValueError` for arrays of other
        shapes.
        """
        poses, rigid = _finite(T_base_flange)
        if self.form is None:
            poses, rigid = _rigid(poses, rigid)
            found = Branches(*searched(self.model, poses, seed))
        elif self.redundant is None:
            found = self._solved(poses)
        else:
            found = self._held(poses, self.redundant, self._values(self.redundant, redundancy))
        found.q[~found.valid] = 0.0
        return found if rigid is None or rigid.all() else Branches(found.q, found.valid & rigid[:, None])

    def _values(self, joint: int, redundancy: Floats | None) -> Floats:
        """The values of the joint that is held."""
        if redundancy is not None:
            values = np.atleast_1d(np.asarray(redundancy, dtype=float))
            if values.ndim != 1 or not np.isfinite(values).all():
                raise ValueError(f"the values of a joint must be (m,), of finite numbers, not {values.shape}")
            return values
        joints = self.model.joints
        low, high = max(float(joints.lower[joint]), -np.pi), min(float(joints.upper[joint]), np.pi)
        return np.asarray(low + (high - low) * (np.arange(HELD) + 0.5) / HELD)

    def _held(self, poses: Floats, joint: int, values: Floats) -> Branches:
        found = []
        for value in values:
            form, M = held(self._h, self._o, joint, float(value))
            if form is None:  # two axes have become parallel, or meet
                continue
            q, residual = _closed(form, np.ascontiguousarray(matmul(poses, self._T_flange_zero, M)))
            found.append((np.insert(q, joint, value, axis=-1), residual))
        if not found:
            return Branches(np.zeros((len(poses), 0, 7)), np.zeros((len(poses), 0), dtype=bool))
        q, residual = (np.concatenate(part, axis=1) for part in zip(*found, strict=True))
        return Branches(wrapped(q), residual < EXACT)

    def _solved(self, poses: Floats) -> Branches:
        q, residual = self._closed(poses)
        near = residual > EXACT / 10
        near &= residual < NEARLY
        if np.count_nonzero(near):  # ten times as fast as `any` for a single pose
            rows = np.nonzero(near)
            q[rows] = polished(self.model, poses[rows[0]], q[rows])
            residual[rows] = missed(self.model, poses[rows[0]], q[rows])
        return Branches(wrapped(q), residual < EXACT)

    def _closed(self, poses: Floats) -> tuple[Floats, Floats]:
        """Configurations (n, 8, 6) and their residuals (n, 8), infinite where there is no solution."""
        assert self.form is not None
        return _closed(self.form, np.ascontiguousarray(matmul(poses, self._T_flange_zero)))


def _finite(T_base_flange: Floats) -> tuple[Floats, Truths | None]:
    """The poses (n, 4, 4), the identity in the place of what is no number, and which are homogeneous matrices (n,); None: all."""
    poses = np.ascontiguousarray(T_base_flange, dtype=float)
    if poses.ndim != 3 or poses.shape[1:] != (4, 4):
        raise ValueError(f"poses must be (n, 4, 4), not {poses.shape}")
    if not math.isfinite(np.vdot(poses, poses)):
        poses = poses.copy()
        endless = ~np.isfinite(poses).all(axis=(1, 2))
        poses[endless] = np.eye(4)
        poses[endless, 3, 3] = 0.0
    last = poses[:, 3]
    if last.tobytes() == LAST_ROW * len(poses):  # the usual case, seen quickly
        return poses, None
    return poses, (last == HOMOGENEOUS).all(axis=1)


def _rigid(poses: Floats, known: Truths | None) -> tuple[Floats, Truths]:
    """The same for a search; closed forms find by themselves that a matrix is no rotation."""
    R = poses[:, :3, :3]
    off = np.abs(matmul(R, np.swapaxes(R, 1, 2)) - np.eye(3)).max(axis=(1, 2))
    rigid: Truths = (off < RIGID) & (np.linalg.det(R) > 0)
    rigid &= True if known is None else known
    return np.where(rigid[:, None, None], poses, np.eye(4)), rigid


def _closed(form: Form, displaced: Floats) -> tuple[Floats, Floats]:
    """Configurations (n, 8, 6) that displace the flange by E (n, 4, 4), and their residuals (n, 8)."""
    if form.backwards:
        displaced = transforms.inverse(displaced)
    q, valid = np.zeros((len(displaced), 8, 6)), np.zeros((len(displaced), 8))
    residual = np.empty(valid.shape)
    solve, centre = CLOSED[form.solver], tuple(form.centre.tolist())

    def look(first: int, after: int) -> None:
        rows = slice(first, after)
        batch = inverse.Batch(form.directions, form.points, centre, displaced[rows], q[rows], valid[rows])
        solve(batch)
        inverse.residuals(batch, residual[rows])

    in_stretches(len(displaced), look)
    return (np.ascontiguousarray(q[..., ::-1]) if form.backwards else q), residual
