"""What may still move when relations hold, by part, as turns, slides and screws."""

from collections.abc import Sequence

import numpy as np

from cellwright.engine.model.assembly import Freedom
from cellwright.engine.model.geometry import Floats
from cellwright.engine.stages.assembly.solving import EXACT, System, free_directions, moved, solved

NEARBY = (1e-2, 1e-2, 1e-2)  # steps, in sizes of the parts and rad, that are tried away from a solution
TINY = 1e-6


def free_motions(system: System, poses: Floats, random: np.random.Generator) -> Floats:
    """A basis (6 k, f) of the motions of solutions around one (n, 4, 4).

    At a singular solution the derivatives promise more than there is. So solutions nearby are looked at, too: freedom is what
    all of them have. A solution without others nearby has none.
    """
    best = free_directions(system.lack(poses[None])[1][0])
    for step in NEARBY:
        if not best.shape[1]:
            break
        weights = random.standard_normal(best.shape[1])
        away = moved(poses[None], (best @ (weights * step / np.linalg.norm(weights)))[None])
        found, lacks = solved(system, away)
        if lacks[0] > EXACT * 100:
            continue
        if np.abs(found[0] - poses).max() < step * 1e-3:
            return np.zeros((best.shape[0], 0))
        free = free_directions(system.lack(found)[1][0])
        best = free if free.shape[1] < best.shape[1] else best
    return best


def freedoms(free: Floats, poses: Floats, parts: Sequence[str], size_m: float) -> tuple[Freedom, ...]:
    """The ways of each part, from a basis (6 k, f) of all motions. Positions come in metres."""
    found: list[Freedom] = []
    for n, part in enumerate(parts):
        own = _spanned(free[6 * n : 6 * n + 6])
        found += [_freedom(part, twist, poses[n + 1][:3, 3], size_m) for twist in _sorted(own)]
    return tuple(found)


def _spanned(rows: Floats) -> Floats:
    """An orthonormal basis (6, r) of the columns of (6, f)."""
    if not rows.shape[1]:
        return rows
    left, values, _ = np.linalg.svd(rows, full_matrices=False)
    return np.asarray(left[:, values > TINY])


def _sorted(own: Floats) -> list[Floats]:
    """Slides first, then turns, each twist (6,) with its length brought to 1."""
    if not own.shape[1]:
        return []
    _, values, rows = np.linalg.svd(own[3:])
    turning = int((values > TINY).sum())
    slides = own[:3] @ rows[turning:].T
    twists = [np.concatenate([slide, np.zeros(3)]) for slide in _plain(slides)]
    across = np.eye(3) - slides @ slides.T
    basis = _plain(own[3:] @ rows[:turning].T)
    for turn in basis:
        weights = np.linalg.pinv(own[3:], rcond=TINY) @ turn
        twists.append(np.concatenate([across @ (own[:3] @ weights), turn]))
    return twists


def _plain(vectors: Floats) -> list[Floats]:
    """Unit vectors that span the same as the columns (3, r), as near to the axes as they can be."""
    found: list[Floats] = []
    projection = vectors @ np.linalg.pinv(vectors) if vectors.shape[1] else np.zeros((3, 3))
    for _ in range(vectors.shape[1]):
        axis = int(np.argmax(np.round(np.diagonal(projection), 9)))
        unit = projection[:, axis] / np.linalg.norm(projection[:, axis])
        found.append(unit)
        projection = projection - np.outer(unit, unit)
    return found


def _freedom(part: str, twist: Floats, origin: Floats, size_m: float) -> Freedom:
    """The screw of a twist (6,) about a part's origin, which is given in sizes."""
    shift, turn = twist[:3], twist[3:]
    length = float(np.linalg.norm(turn))
    if length < TINY:
        return Freedom(part, shift / np.linalg.norm(shift), origin * size_m, float("inf"))
    axis = turn / length
    pitch = float(axis @ shift) / length
    point = origin + np.cross(axis, shift) / length
    return Freedom(part, axis, point * size_m, 0.0 if abs(pitch) < TINY else pitch * size_m)
