"""Poses of parts with which equations hold, from many starts at once.

The steps are those of Levenberg and Marquardt. Their damping is the squared lack, so that they converge quadratically also
where freedom remains (Yamashita & Fukushima 2001). Positions count in the size of the parts all through this module.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cellwright.engine.kernels.rigid import turned
from cellwright.engine.model.assembly import Relation
from cellwright.engine.model.geometry import Floats
from cellwright.engine.stages.assembly.equations import in_order, lack

ROUNDS = 80
STALLED = 8  # rounds in which what is lacking must shrink by a tenth, or the search ends
EXACT = 1e-11  # what an equation may lack and still hold
RANK = 1e-7  # of the largest singular value: what is less is nothing


@dataclass(frozen=True, slots=True, eq=False)
class System:
    """Relations between numbered parts, of which the first is the base and stands still. `size_m` is the unit of lengths."""

    relations: tuple[Relation, ...]
    numbers: Mapping[str, int]
    size_m: float

    def only(self, relations: Sequence[Relation]) -> "System":
        """The same parts with other relations."""
        return System(tuple(relations), self.numbers, self.size_m)

    def lack(self, poses: Floats) -> tuple[Floats, Floats]:
        """What all relations lack (B, m), and its derivatives (B, m, 6 k) by the k parts that move."""
        values, derivatives = [np.zeros((len(poses), 0))], [np.zeros((len(poses), 0, 6 * poses.shape[1]))]
        for relation in self.relations:
            one, other = (self.numbers[each.part] for each in in_order(relation))
            value, by = lack(relation, poses, (one, other), self.size_m)
            values.append(value)
            derivatives.append(by)
        return np.concatenate(values, axis=1), np.concatenate(derivatives, axis=1)[:, :, 6:]


def moved(poses: Floats, steps: Floats) -> Floats:
    """Poses (B, n, 4, 4) after displacements and turns (B, 6 k) of the parts behind the first."""
    found = poses.copy()
    step = steps.reshape(len(poses), -1, 6)
    found[:, 1:, :3, 3] += step[..., :3]
    found[:, 1:, :3, :3] = turned(step[..., 3:]) @ found[:, 1:, :3, :3]
    return found


def solved(system: System, starts: Floats, one: bool = False) -> tuple[Floats, Floats]:
    """Poses (B, n, 4, 4) from starts of the same shape, and what the worst equation lacks at each (B,).

    With `one` it ends at the first solution.
    """
    poses, scale = starts, np.ones(len(starts))
    before: Floats = np.full(len(starts), np.inf)
    value, by = system.lack(poses)
    if not value.shape[1] or not by.shape[2]:
        return poses, np.abs(value).max(axis=1, initial=0.0)
    for round_ in range(ROUNDS):
        square = np.einsum("bm,bm->b", value, value)
        if np.sqrt(square.min() if one else square.max()) < EXACT:
            break
        if round_ % STALLED == STALLED - 1:
            if not ((square < 0.9 * before) & (square > EXACT**2)).any():
                break
            before = square
        step = _step(value, by, scale * np.minimum(square, 1.0))
        tried = moved(poses, step)
        new, new_by = system.lack(tried)
        better = np.einsum("bm,bm->b", new, new) < square
        scale = np.clip(np.where(better, scale / 4, scale * 4), 1e-8, 1e12)
        poses = np.where(better[:, None, None, None], tried, poses)
        value, by = np.where(better[:, None], new, value), np.where(better[:, None, None], new_by, by)
    poses = _polished(system, poses)
    return poses, np.abs(system.lack(poses)[0]).max(axis=1)


def _step(value: Floats, by: Floats, damping: Floats) -> Floats:
    """Steps (B, 6 k) that lessen the lack."""
    transposed = np.swapaxes(by, 1, 2)
    normal = transposed @ by + (damping + 1e-15)[:, None, None] * np.eye(by.shape[2])
    found: Floats = -np.asarray(np.linalg.solve(normal, transposed @ value[..., None]), dtype=float)[..., 0]
    return found


def _polished(system: System, poses: Floats) -> Floats:
    """The poses after two steps of Newton that go no farther than they must, where these help."""
    for _ in range(2):
        value, by = system.lack(poses)
        step = -(np.linalg.pinv(by, rcond=RANK) @ value[..., None])[..., 0]
        near = np.abs(step).max(axis=1) < 1e-3
        tried = moved(poses, np.where(near[:, None], step, 0.0))
        better = np.abs(system.lack(tried)[0]).max(axis=1) < np.abs(value).max(axis=1)
        poses = np.where(better[:, None, None, None], tried, poses)
    return poses


def free_directions(by: Floats) -> Floats:
    """An orthonormal basis (6 k, f) of the motions that derivatives (m, 6 k) do not notice."""
    if not len(by):
        return np.eye(by.shape[1])
    _, values, rows = np.linalg.svd(by)
    rank = int((values > RANK * max(1.0, values[0])).sum()) if len(values) else 0
    found: Floats = rows[rank:].T
    return found


def towards(system: System, preferred: System, poses: Floats, rounds: int = 60) -> Floats:
    """Poses (n, 4, 4) that stay solutions and come as near to the preferred relations as the first ones allow."""
    best, least = poses, _square(preferred, poses)
    for _ in range(rounds):
        free = free_directions(system.lack(best[None])[1][0])
        value, by = (each[0] for each in preferred.lack(best[None]))
        if not free.shape[1] or least < EXACT**2:
            break
        step = -free @ (np.linalg.pinv(by @ free, rcond=RANK) @ value)
        found = _halved(system, preferred, best, step, least)
        if found is None or _square(preferred, found) > least * (1 - 1e-12):
            break
        best, least = found, _square(preferred, found)
    return best


def _halved(system: System, preferred: System, poses: Floats, step: Floats, least: float) -> Floats | None:
    """The solution after a step, or after a half, a quarter and so on, that lacks less; None if none does."""
    for half in range(12):
        found, lacks = solved(system, moved(poses[None], (step / 2**half)[None]))
        if lacks[0] < EXACT * 100 and _square(preferred, found[0]) < least:
            best: Floats = found[0]
            return best
    return None


def _square(system: System, poses: Floats) -> float:
    value = system.lack(poses[None])[0][0]
    return float(value @ value)
