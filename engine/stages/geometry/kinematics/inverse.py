"""Inverse kinematics: closed form where the geometry allows it, damped least squares otherwise.

`solve` answers with every branch for a batch of poses. What fits which solver is read off the axes at the zero
configuration, not off a table of robots: axes 2 and 3 parallel and axes 4 to 6 through one point, or axes 2 to 4
parallel and axes 5 and 6 through one point.
"""

from dataclasses import dataclass
from enum import Enum
from itertools import product

import numpy as np

from engine.model.geometry import Floats, Truths
from engine.stages.geometry import transforms
from engine.stages.geometry.kinematics.arms import ArmModel, carrier_poses, wrapped
from engine.stages.geometry.stretches import in_stretches

EXACT = 1e-10  # metres and radians: a branch that misses by more is polished, and dropped if that fails
SEEDS = 24


class Solver(Enum):
    """How an arm's inverse kinematics is computed."""

    SPHERICAL_WRIST = "spherical wrist"
    PARALLEL_AXES = "three parallel axes"
    ITERATIVE = "damped least squares"


@dataclass(frozen=True, slots=True, eq=False)
class Screws:
    """The axes at the zero configuration: directions (k, 3), a point on each (k, 3), and the point the last ones share."""

    directions: Floats
    points: Floats
    centre: Floats
    solver: Solver
    T_zero: Floats  # the flange at the zero configuration


@dataclass(frozen=True, slots=True, eq=False)
class Branches:
    """Configurations (n, b, k), angles in (-pi, pi], and which of them (n, b) reach their pose."""

    q: Floats
    valid: Truths

    def of(self, index: int) -> Floats:
        """Those of one pose (m, k)."""
        found: Floats = self.q[index][self.valid[index]]
        return found


def screws_of(model: ArmModel) -> Screws:
    """The axes of an arm, and which solver suits them."""
    poses = carrier_poses(model.joints, np.zeros(model.joints.count))
    directions = np.einsum("kij,kj->ki", poses[1:, :3, :3], model.joints.axis)
    points = np.ascontiguousarray(poses[1:, :3, 3])
    solver, centre = _suited(directions, points, bool(model.joints.prismatic.any()))
    return Screws(directions, points, centre, solver, poses[-1] @ model.T_last_flange)


def _suited(h: Floats, o: Floats, prismatic: bool) -> tuple[Solver, Floats]:
    if h.shape[0] == 6 and not prismatic:
        wrist = _common_point(h[3:], o[3:])
        if wrist is not None and _parallel(h[1], h[2]):
            return Solver.SPHERICAL_WRIST, wrist
        hand = _common_point(h[4:], o[4:])
        if hand is not None and _parallel(h[1], h[2]) and _parallel(h[2], h[3]):
            return Solver.PARALLEL_AXES, hand
    return Solver.ITERATIVE, np.zeros(3)


def _parallel(a: Floats, b: Floats) -> bool:
    return bool(np.linalg.norm(np.cross(a, b)) < 1e-9)


def _common_point(h: Floats, o: Floats) -> Floats | None:
    """The point on all lines, if there is exactly one: least squares over their planes."""
    across = np.eye(3) - h[:, :, None] * h[:, None, :]
    system = across.sum(axis=0)
    if np.linalg.eigvalsh(system)[0] < 1e-9:
        return None
    point: Floats = np.linalg.solve(system, np.einsum("kij,kj->i", across, o))
    missed = np.linalg.norm(np.einsum("kij,kj->ki", across, point - o), axis=1)
    return point if missed.max() < 1e-9 else None


class InverseKinematics:
    """The inverse kinematics of one arm; what depends on the arm alone is computed once."""

    def __init__(self, model: ArmModel) -> None:
        self.model = model
        self.screws = screws_of(model)
        self._T_flange_zero = transforms.inverse(self.screws.T_zero)

    @property
    def solver(self) -> Solver:
        """How it is computed."""
        return self.screws.solver

    def solve(self, T_base_flange: Floats, seed: int = 0) -> Branches:
        """All branches that reach each pose (n, 4, 4), within the joint limits or not (`within_limits` tells).

        At a singularity one member of the continuum is returned. Without a closed form the search starts from
        `SEEDS` random configurations; a branch may then be missed.
        """
        poses = np.ascontiguousarray(T_base_flange, dtype=float)
        if self.solver is Solver.ITERATIVE:
            return self._search(poses, seed)
        q, residual = self._closed(poses)
        rows = np.nonzero((residual > EXACT / 10) & np.isfinite(residual))
        if rows[0].size:
            q[rows] = polished(self.model, poses[rows[0]], q[rows])
            residual[rows] = _missed(self.model, poses[rows[0]], q[rows])
        return Branches(wrapped(q), residual < EXACT)

    def _closed(self, poses: Floats) -> tuple[Floats, Floats]:
        """Configurations (n, 8, 6) and their residuals (n, 8), infinite where there is no solution."""
        from engine.kernels.geometry import inverse

        screws = self.screws
        displaced = np.ascontiguousarray(poses @ self._T_flange_zero)
        q, valid = np.zeros((len(poses), 8, 6)), np.zeros((len(poses), 8))
        residual = np.empty(valid.shape)
        solve = {
            Solver.SPHERICAL_WRIST: inverse.spherical_wrist,
            Solver.PARALLEL_AXES: inverse.parallel_axes,
        }[self.solver]
        axes, points = screws.directions, screws.points
        centre = (float(screws.centre[0]), float(screws.centre[1]), float(screws.centre[2]))

        def look(first: int, after: int) -> None:
            rows = slice(first, after)
            batch = inverse.Batch(axes, points, centre, displaced[rows], q[rows], valid[rows])
            solve(batch)
            inverse.residuals(batch, residual[rows])

        in_stretches(len(poses), look)
        return q, residual

    def _search(self, poses: Floats, seed: int) -> Branches:
        rng = np.random.default_rng(seed)
        n, k = len(poses), self.model.joints.count
        starts = self.model.random(n * SEEDS, rng)
        targets = np.repeat(poses, SEEDS, axis=0)
        found = polished(self.model, targets, starts, iterations=100)
        valid = (_missed(self.model, targets, found) < EXACT).reshape(n, SEEDS)
        revolute = ~self.model.joints.prismatic
        found[:, revolute] = wrapped(found[:, revolute])
        q = found.reshape(n, SEEDS, k)
        return Branches(q, valid & _first_of_its_kind(q, valid))


def _first_of_its_kind(q: Floats, valid: Truths) -> Truths:
    """Which branches (n, b) do not repeat an earlier valid one of the same pose."""
    first = np.ones(valid.shape, dtype=bool)
    for b in range(1, q.shape[1]):
        apart = np.abs(wrapped(q[:, :b] - q[:, b : b + 1])).max(axis=-1)
        first[:, b] = ~((apart < 1e-6) & valid[:, :b]).any(axis=1)
    return first


def pose_error(model: ArmModel, T_base_flange: Floats, q: Floats) -> Floats:
    """What is missing from q (n, k) to the poses (n, 4, 4): metres, then a rotation vector in the base frame (n, 6)."""
    reached = model.flange_pose(q)
    turn = T_base_flange[..., :3, :3] @ np.swapaxes(reached[..., :3, :3], -1, -2)
    step = T_base_flange[..., :3, 3] - reached[..., :3, 3]
    return np.concatenate([step, transforms.rotation_vector(turn)], axis=-1)


def _missed(model: ArmModel, poses: Floats, q: Floats) -> Floats:
    worst: Floats = np.abs(pose_error(model, poses, q)).max(axis=-1)
    return worst


def polished(model: ArmModel, poses: Floats, q: Floats, iterations: int = 8) -> Floats:
    """Configurations (n, k) nearer to their poses, by damped least squares.

    The damping shrinks with the error, so that the last steps are Newton's (Levenberg 1944, Marquardt 1963;
    Nakamura & Hanafusa 1986 for arms); a step that makes things worse is taken back and damped more.
    """
    q, damping = q.copy(), np.full(len(q), 1e-4)
    error = pose_error(model, poses, q)
    for _ in range(iterations):
        open_ = np.nonzero(np.abs(error).max(axis=-1) > 1e-14)[0]
        if not open_.size:
            break
        J = model.jacobian(q[open_])
        size = np.linalg.norm(error[open_], axis=-1)
        system = np.swapaxes(J, -1, -2) @ J + (damping[open_] * size**2)[:, None, None] * np.eye(J.shape[-1])
        system += 1e-13 * np.eye(J.shape[-1])  # at a singularity nothing else keeps it regular
        step = np.linalg.solve(system, np.swapaxes(J, -1, -2) @ error[open_][..., None])[..., 0]
        tried = q[open_] + np.clip(step, -0.5, 0.5)
        after = pose_error(model, poses[open_], tried)
        better = np.linalg.norm(after, axis=-1) < size
        damping[open_] = np.where(better, np.maximum(damping[open_] / 5, 1e-8), damping[open_] * 10 + 1e-3)
        q[open_[better]], error[open_[better]] = tried[better], after[better]
    return q


def turns(model: ArmModel, q: Floats) -> Floats:
    """Every configuration within the joint limits that differs from q (k,) by whole turns alone (m, k)."""
    choices = []
    for index, value in enumerate(q):
        shifts = [0.0] if model.joints.prismatic[index] else [-2 * np.pi, 0.0, 2 * np.pi]
        inside = [value + s for s in shifts if model.within_limits_of(index, value + s)]
        choices.append(inside)
    return np.array(list(product(*choices))).reshape(-1, len(q))
