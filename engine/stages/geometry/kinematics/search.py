"""Configurations that reach poses, by damped least squares from random ones: for arms of any kind."""

import numpy as np

from cellwright.engine.kernels.linear import matmul, solved
from cellwright.engine.model.geometry import Floats, Truths
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.kinematics.arms import ArmModel, wrapped

EXACT = 1e-10  # metres and radians: a branch that misses by more is polished, and dropped if that fails
STARTS = 48  # random configurations of one round
QUIET = 3  # rounds without a new branch after which a search ends
ROUNDS = 24
SAME = 1e-6  # two configurations that differ by less are one
REGULAR = 6  # with so many joints a pose has finitely many branches, except for singular ones


def searched(model: ArmModel, poses: Floats, seed: int) -> tuple[Floats, Truths]:
    """Branches (n, b, k) of poses (n, 4, 4), and which of them (n, b) reach.

    Rounds of random starts go on for each pose until some find no new branch. An arm with more joints than a pose has
    coordinates has a continuum of them: it gets one round.
    """
    rng, revolute = np.random.default_rng(seed), ~model.joints.prismatic
    n, k = len(poses), model.joints.count
    kept: list[list[Floats]] = [[] for _ in range(n)]
    quiet = np.zeros(n, dtype=int)
    for _ in range(ROUNDS if k <= REGULAR else 1):
        rows = np.nonzero(quiet < QUIET)[0]
        if not rows.size:
            break
        targets = np.repeat(poses[rows], STARTS, axis=0)
        found = polished(model, targets, model.random(len(targets), rng), iterations=60)
        valid = (missed(model, targets, found) < EXACT).reshape(-1, STARTS)
        found[:, revolute] = wrapped(found[:, revolute])
        for row, q, reached in zip(rows, found.reshape(-1, STARTS, k), valid, strict=True):
            quiet[row] += 1
            if _added(kept[row], q[reached], revolute):
                quiet[row] = 0
    most = max([1, *map(len, kept)])
    q, valid = np.zeros((n, most, k)), np.zeros((n, most), dtype=bool)
    for pose, branches in enumerate(kept):
        q[pose, : len(branches)] = np.array(branches).reshape(-1, k)
        valid[pose, : len(branches)] = True
    return q, valid


def _added(kept: list[Floats], more: Floats, revolute: Truths) -> bool:
    """Whether some of the configurations (m, k) were not kept before; they are from now on."""
    before = len(kept)
    for q in more:
        apart = np.array([q - each for each in kept]).reshape(-1, len(q))
        apart[:, revolute] = wrapped(apart[:, revolute])
        if not (np.abs(apart).max(axis=1) < SAME).any():
            kept.append(q)
    return len(kept) > before


def pose_error(model: ArmModel, T_base_flange: Floats, q: Floats) -> Floats:
    """What is missing from q (n, k) to the poses (n, 4, 4): metres, then a rotation vector in the base frame (n, 6)."""
    reached = model.flange_pose(q)
    turn = matmul(T_base_flange[..., :3, :3], np.swapaxes(reached[..., :3, :3], -1, -2))
    step = T_base_flange[..., :3, 3] - reached[..., :3, 3]
    return np.concatenate([step, transforms.rotation_vector(turn)], axis=-1)


def missed(model: ArmModel, poses: Floats, q: Floats) -> Floats:
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
        system = matmul(np.swapaxes(J, -1, -2), J) + (damping[open_] * size**2)[:, None, None] * np.eye(
            J.shape[-1]
        )
        system += 1e-13 * np.eye(J.shape[-1])  # at a singularity nothing else keeps it regular
        step = solved(system, matmul(np.swapaxes(J, -1, -2), error[open_][..., None])[..., 0])
        tried = q[open_] + np.clip(step, -0.5, 0.5)
        after = pose_error(model, poses[open_], tried)
        better = np.linalg.norm(after, axis=-1) < size
        damping[open_] = np.where(better, np.maximum(damping[open_] / 5, 1e-8), damping[open_] * 10 + 1e-3)
        q[open_[better]], error[open_[better]] = tried[better], after[better]
    return q
