"""Inverse kinematics: closed form where the geometry allows it, damped least squares otherwise."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Truths
from cellwright.engine.kernels.geometry import inverse
from cellwright.engine.kernels.linear import matmul, norm, solve_positive_definite
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.core_threads import run_in_stretches
from cellwright.engine.stages.geometry.kinematics.arm_model import (
    ArmModel,
    carrier_poses,
    wrap_angles,
)

NEAR_AXES = 1e-9  # metres, or sines: axes that miss each other by less meet, or are parallel
PROBED_RAD = 0.7  # rad: a form must hold for this value of a joint, and for the negative one


class InverseSolver(Enum):
    """How an arm's inverse kinematics is computed."""

    SPHERICAL_WRIST = "spherical wrist"
    INTERSECTING_AXES = "two axes that meet, and a spherical wrist"
    PARALLEL_AXES = "three parallel axes"
    ITERATIVE = "damped least squares"


@dataclass(frozen=True, slots=True, eq=False)
class ClosedForm:
    """Six axes at the zero configuration: directions (6, 3), a point on each (6, 3), and the point
    the last ones share.

    With `backwards` they are those from the hand to the base, and their angles come in that order.
    """

    solver: InverseSolver
    directions: Floats
    points: Floats
    centre: Floats
    backwards: bool = False


def closed_form_of(h: Floats, o: Floats) -> ClosedForm | None:
    """The closed form of axes h (6, 3) through points o (6, 3), read from either end; None if
    they have none.
    """
    form = _form_from_base(h, o)
    if form is None:
        form = _form_from_base(np.ascontiguousarray(-h[::-1]), np.ascontiguousarray(o[::-1]))
        return replace(form, backwards=True) if form else None
    return form


def _form_from_base(h: Floats, o: Floats) -> ClosedForm | None:
    wrist = _common_point(h[3:], o[3:])
    if wrist is not None and _axes_parallel(h[1], h[2]):
        return ClosedForm(InverseSolver.SPHERICAL_WRIST, h, o, wrist)
    shoulder = _common_point(h[:2], o[:2])
    if wrist is not None and shoulder is not None:
        return ClosedForm(
            InverseSolver.INTERSECTING_AXES, h, np.array([shoulder, shoulder, *o[2:]]), wrist
        )
    hand = _common_point(h[4:], o[4:])
    if hand is not None and _axes_parallel(h[1], h[2]) and _axes_parallel(h[2], h[3]):
        return ClosedForm(InverseSolver.PARALLEL_AXES, h, o, hand)
    return None


def joint_to_hold(h: Floats, o: Floats) -> int | None:
    """The joint of seven that can be held so that the others have a closed form whatever its value;
    None if there is none.

    Of several it is the third, with which the elbow turns about the line from shoulder to wrist,
    else the last one.
    """
    for joint in (2, 6, 5, 4, 3, 1, 0):
        if all(form is not None for form in _probed_forms(h, o, joint)):
            return joint
    return None


def _probed_forms(h: Floats, o: Floats, joint: int) -> Iterator[ClosedForm | None]:
    for value in (PROBED_RAD, -PROBED_RAD):
        yield closed_form_of(*_without_joint(h, o, joint, value)[:2])


def form_with_held_joint(
    h: Floats, o: Floats, joint: int, value: float
) -> tuple[ClosedForm | None, Floats]:
    """The form of seven axes with one joint held (None if there is none), and the matrix (4, 4) to
    put behind E.

    E = A M B, where M is what the held joint does; as M B = B' M with the axes behind it displaced
    by M, A B' = E M^-1.
    """
    directions, points, M = _without_joint(h, o, joint, value)
    return closed_form_of(directions, points), transforms.inverse(M)


def _without_joint(h: Floats, o: Floats, joint: int, value: float) -> tuple[Floats, Floats, Floats]:
    R = transforms.rotation(h[joint], value)
    M = transforms.transform(R, o[joint] - matmul(R, o[joint]))
    behind = np.arange(7) > joint
    directions = np.where(behind[:, None], matmul(h, R.T), h)
    points = np.where(behind[:, None], transforms.apply(M, o), o)
    return np.delete(directions, joint, axis=0), np.delete(points, joint, axis=0), M


def _axes_parallel(a: Floats, b: Floats) -> bool:
    return bool(norm(np.cross(a, b)) < NEAR_AXES)


def _common_point(h: Floats, o: Floats) -> Floats | None:
    """The point on all lines, if there is exactly one: least squares over their planes."""
    across = np.eye(3) - h[:, :, None] * h[:, None, :]
    system = across.sum(axis=0)
    if np.linalg.eigvalsh(system)[0] < NEAR_AXES:
        return None
    point: Floats = solve_positive_definite(system, np.einsum("kij,kj->i", across, o))
    missed = np.linalg.norm(np.einsum("kij,kj->ki", across, point - o), axis=1)
    return point if missed.max() < NEAR_AXES else None


EXACT_BRANCH = (
    1e-10  # metres and radians: a branch that misses by more is polished, and dropped if that fails
)
RANDOM_STARTS = 48  # random configurations of one round
QUIET_ROUNDS = 3  # rounds without a new branch after which a search ends
MAX_SEARCH_ROUNDS = 24
SAME_CONFIGURATION = 1e-6  # two configurations that differ by less are one
# with so many joints a pose has finitely many branches, except for singular ones
REGULAR_JOINTS = 6


def search_branches(model: ArmModel, poses: Floats, seed: int) -> tuple[Floats, Truths]:
    """Branches (n, b, k) of poses (n, 4, 4), and which of them (n, b) reach.

    Rounds of random starts go on for each pose until some find no new branch. An arm with more
    joints than a pose has coordinates has a continuum of them: it gets one round.
    """
    rng, revolute = np.random.default_rng(seed), ~model.joints.prismatic
    n, k = len(poses), model.joints.count
    branches_of_poses: list[list[Floats]] = [[] for _ in range(n)]
    quiet = np.zeros(n, dtype=int)
    for _ in range(MAX_SEARCH_ROUNDS if k <= REGULAR_JOINTS else 1):
        rows = np.nonzero(quiet < QUIET_ROUNDS)[0]
        if not rows.size:
            break
        targets = np.repeat(poses[rows], RANDOM_STARTS, axis=0)
        candidates = polish_configurations(
            model, targets, model.random(len(targets), rng), iterations=60
        )
        valid = (pose_misses(model, targets, candidates) < EXACT_BRANCH).reshape(-1, RANDOM_STARTS)
        candidates[:, revolute] = wrap_angles(candidates[:, revolute])
        for row, q, reached in zip(
            rows, candidates.reshape(-1, RANDOM_STARTS, k), valid, strict=True
        ):
            quiet[row] += 1
            if _add_branches(branches_of_poses[row], q[reached], revolute):
                quiet[row] = 0
    most = max([1, *map(len, branches_of_poses)])
    q, valid = np.zeros((n, most, k)), np.zeros((n, most), dtype=bool)
    for pose, branches in enumerate(branches_of_poses):
        q[pose, : len(branches)] = np.array(branches).reshape(-1, k)
        valid[pose, : len(branches)] = True
    return q, valid


def _add_branches(branches: list[Floats], more: Floats, revolute: Truths) -> bool:
    """Whether some of the configurations (m, k) were not kept before; they are from now on."""
    before = len(branches)
    for q in more:
        apart = np.array([q - branch for branch in branches]).reshape(-1, len(q))
        apart[:, revolute] = wrap_angles(apart[:, revolute])
        if not (np.abs(apart).max(axis=1) < SAME_CONFIGURATION).any():
            branches.append(q)
    return len(branches) > before


def pose_error(model: ArmModel, T_base_flange: Floats, q: Floats) -> Floats:
    """What is missing from q (n, k) to the poses (n, 4, 4): metres, then a rotation vector in
    the base frame (n, 6).
    """
    reached = model.flange_pose(q)
    turn = matmul(T_base_flange[..., :3, :3], np.swapaxes(reached[..., :3, :3], -1, -2))
    step = T_base_flange[..., :3, 3] - reached[..., :3, 3]
    return np.concatenate([step, transforms.rotation_vector(turn)], axis=-1)


def pose_misses(model: ArmModel, poses: Floats, q: Floats) -> Floats:
    worst: Floats = np.abs(pose_error(model, poses, q)).max(axis=-1)
    return worst


def polish_configurations(model: ArmModel, poses: Floats, q: Floats, iterations: int = 8) -> Floats:
    """Configurations (n, k) nearer to their poses, by damped least squares.

    The damping shrinks with the error, so that the last steps are Newton's (Levenberg 1944,
    Marquardt 1963; Nakamura & Hanafusa 1986 for arms); a step that makes things worse is taken back
    and damped more.
    """
    q, damping = q.copy(), np.full(len(q), 1e-4)
    error = pose_error(model, poses, q)
    for _ in range(iterations):
        open_ = np.nonzero(np.abs(error).max(axis=-1) > 1e-14)[0]
        if not open_.size:
            break
        J = model.jacobian(q[open_])
        size = np.linalg.norm(error[open_], axis=-1)
        system = matmul(np.swapaxes(J, -1, -2), J) + (damping[open_] * size**2)[
            :, None, None
        ] * np.eye(J.shape[-1])
        system += 1e-13 * np.eye(J.shape[-1])  # at a singularity nothing else keeps it regular
        step = solve_positive_definite(
            system, matmul(np.swapaxes(J, -1, -2), error[open_][..., None])[..., 0]
        )
        tried = q[open_] + np.clip(step, -0.5, 0.5)
        after = pose_error(model, poses[open_], tried)
        better = np.linalg.norm(after, axis=-1) < size
        damping[open_] = np.where(
            better, np.maximum(damping[open_] / 5, 1e-8), damping[open_] * 10 + 1e-3
        )
        q[open_[better]], error[open_[better]] = tried[better], after[better]
    return q


__all__ = ["Branches", "InverseKinematics", "InverseSolver", "polish_configurations", "pose_error"]

HELD_VALUES = 16  # values of a joint that is held, when none are given
MAX_MISS = 1e-2  # metres and radians: what misses by more is no branch, and not polished
HOMOGENEOUS_ROW = np.array([0.0, 0.0, 0.0, 1.0])  # the last row of every pose
CLOSED_SOLVERS = {
    InverseSolver.SPHERICAL_WRIST: inverse.spherical_wrist,
    InverseSolver.INTERSECTING_AXES: inverse.intersecting_axes,
    InverseSolver.PARALLEL_AXES: inverse.parallel_axes,
}
LAST_ROW = HOMOGENEOUS_ROW.tobytes()
RIGID_TOLERANCE = 1e-6  # how far a matrix may be from a rotation


@dataclass(frozen=True, slots=True, eq=False)
class Branches:
    """Configurations (n, b, k), angles in (-pi, pi], and which of them (n, b) reach their pose."""

    q: Floats
    valid: Truths

    def of(self, index: int) -> Floats:
        """Those of one pose (m, k)."""
        configurations: Floats = self.q[index][self.valid[index]]
        return configurations


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
        self.redundant = joint_to_hold(self._h, self._o) if turning and len(self._h) == 7 else None
        self.form = closed_form_of(self._h, self._o) if turning and len(self._h) == 6 else None
        if self.redundant is not None:
            self.form = form_with_held_joint(self._h, self._o, self.redundant, PROBED_RAD)[0]

    @property
    def solver(self) -> InverseSolver:
        """How it is computed."""
        return self.form.solver if self.form else InverseSolver.ITERATIVE

    def solve(
        self, T_base_flange: Floats, seed: int = 0, redundancy: Floats | None = None
    ) -> Branches:
        """All branches that reach each pose (n, 4, 4), within the joint limits or not
        (`within_limits` tells).

        At a singularity one member of the continuum is returned. An arm with a joint that can be
        held (`redundant`: its number) has branches for each of the values `redundancy` (m,) of that
        joint, in rad: 16 between its limits when none are given. Without a closed form the search
        starts from random configurations until it finds no more; a branch may then be missed. What
        is no rigid pose, or no number at all, has no branches. Raises `ValueError` for arrays of
        other shapes.
        """
        poses, rigid = _finite_poses(T_base_flange)
        if self.form is None:
            poses, rigid = _rigid_poses(poses, rigid)
            branches = Branches(*search_branches(self.model, poses, seed))
        elif self.redundant is None:
            branches = self._solved(poses)
        else:
            branches = self._held(poses, self.redundant, self._values(self.redundant, redundancy))
        branches.q[~branches.valid] = 0.0
        return (
            branches
            if rigid is None or rigid.all()
            else Branches(branches.q, branches.valid & rigid[:, None])
        )

    def _values(self, joint: int, redundancy: Floats | None) -> Floats:
        """The values of the joint that is held."""
        if redundancy is not None:
            values = np.atleast_1d(np.asarray(redundancy, dtype=float))
            if values.ndim != 1 or not np.isfinite(values).all():
                raise ValueError(
                    f"the values of a joint must be (m,), of finite numbers, not {values.shape}"
                )
            return values
        joints = self.model.joints
        low, high = max(float(joints.lower[joint]), -np.pi), min(float(joints.upper[joint]), np.pi)
        return np.asarray(low + (high - low) * (np.arange(HELD_VALUES) + 0.5) / HELD_VALUES)

    def _held(self, poses: Floats, joint: int, values: Floats) -> Branches:
        branches = []
        for value in values:
            form, M = form_with_held_joint(self._h, self._o, joint, float(value))
            if form is None:  # two axes have become parallel, or meet
                continue
            q, residual = _closed_branches(
                form, np.ascontiguousarray(matmul(poses, self._T_flange_zero, M))
            )
            branches.append((np.insert(q, joint, value, axis=-1), residual))
        if not branches:
            return Branches(np.zeros((len(poses), 0, 7)), np.zeros((len(poses), 0), dtype=bool))
        q, residual = (np.concatenate(part, axis=1) for part in zip(*branches, strict=True))
        return Branches(wrap_angles(q), residual < EXACT_BRANCH)

    def _solved(self, poses: Floats) -> Branches:
        q, residual = self._closed(poses)
        near = residual > EXACT_BRANCH / 10
        near &= residual < MAX_MISS
        if np.count_nonzero(near):  # ten times as fast as `any` for a single pose
            rows = np.nonzero(near)
            q[rows] = polish_configurations(self.model, poses[rows[0]], q[rows])
            residual[rows] = pose_misses(self.model, poses[rows[0]], q[rows])
        return Branches(wrap_angles(q), residual < EXACT_BRANCH)

    def _closed(self, poses: Floats) -> tuple[Floats, Floats]:
        """Configurations (n, 8, 6) and their residuals (n, 8), infinite where there is no
        solution.
        """
        assert self.form is not None
        return _closed_branches(self.form, np.ascontiguousarray(matmul(poses, self._T_flange_zero)))


def _finite_poses(T_base_flange: Floats) -> tuple[Floats, Truths | None]:
    """The poses (n, 4, 4), the identity in the place of what is no number, and which are
    homogeneous matrices (n,); None: all.
    """
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
    return poses, (last == HOMOGENEOUS_ROW).all(axis=1)


def _rigid_poses(poses: Floats, known: Truths | None) -> tuple[Floats, Truths]:
    """The same for a search; closed forms find by themselves that a matrix is no rotation."""
    R = poses[:, :3, :3]
    off = np.abs(matmul(R, np.swapaxes(R, 1, 2)) - np.eye(3)).max(axis=(1, 2))
    rigid: Truths = (off < RIGID_TOLERANCE) & (np.linalg.det(R) > 0)
    rigid &= True if known is None else known
    return np.where(rigid[:, None, None], poses, np.eye(4)), rigid


def _closed_branches(form: ClosedForm, displaced: Floats) -> tuple[Floats, Floats]:
    """Configurations (n, 8, 6) that displace the flange by E (n, 4, 4), and their residuals (n,
    8).
    """
    if form.backwards:
        displaced = transforms.inverse(displaced)
    q, valid = np.zeros((len(displaced), 8, 6)), np.zeros((len(displaced), 8))
    residual = np.empty(valid.shape)
    solve, centre = CLOSED_SOLVERS[form.solver], tuple(form.centre.tolist())

    def look(first: int, after: int) -> None:
        rows = slice(first, after)
        batch = inverse.Batch(
            form.directions, form.points, centre, displaced[rows], q[rows], valid[rows]
        )
        solve(batch)
        inverse.residuals(batch, residual[rows])

    run_in_stretches(len(displaced), look)
    return (np.ascontiguousarray(q[..., ::-1]) if form.backwards else q), residual
