"""Where a part is, from its datums: the rigid displacement that most of them agree with, and the wrong ones among them.

A datum on a surface tells one number, how far the surface is from where it was expected; a datum that is a point of the part
tells three. Displacements through few datums are compared by how many others agree (Fischler & Bolles 1981); the best one is
refined by least squares over all that agree.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cellwright.engine.kernels.rigid import apply, skew, transform, turned
from cellwright.engine.model.fits import Aligning, Alignment, Datums, Unaligned, unusable
from cellwright.engine.model.geometry import Floats, Longs, Truths
from cellwright.engine.model.measurement import Triple

AGREES = 3.5  # standard deviations
SAMPLES, STEPS, ROUNDS = 60, 8, 10  # sets of few datums, steps of least squares, choices of those that agree
SHARE = 0.6  # of the datums that must agree
LOOSE = 1e-7  # of the best known motion: a motion known so much worse is free
HOLDS = 0.5  # of the free motion that a point along its normal feels, of one that holds it
SETTLED = 1e-10  # of the best known motion, too: least squares that know one worse settle nothing
STILL = 1e-12  # m and rad: a smaller step is the last
SEED = 20261123


def aligned(datums: Datums) -> Aligning:
    """The displacement that the datums show, or why they show none."""
    if (reason := unusable(datums.measured, datums.sigma_m)) is not None:
        return Unaligned(reason)
    everything = np.ones(len(datums.nominal), bool)
    if (reason := _lacking(datums, everything)) is not None:
        return Unaligned(reason)
    best, agreeing = _agreed(datums)
    if agreeing.mean() < SHARE:
        wrong = tuple(name for name, agrees in zip(datums.names, agreeing, strict=True) if not agrees)
        told = f"no place of the part fits more than {agreeing.sum()} of {len(agreeing)} datums"
        return Unaligned(f"{told}: the part has another form, or measurements are wrong", wrong)
    if (reason := _lacking(datums, agreeing)) is not None:
        return Unaligned(f"{reason}, once {(~agreeing).sum()} wrong datums are left out")
    if (pair := _undecided(datums, agreeing)) is not None:
        told = f"either {pair[0]} or {pair[1]} is wrong, and no other datum tells which"
        return Unaligned(f"{told}: measure more beside them", pair)
    return _finished(datums, best, agreeing)


def sure_enough(found: Aligning, places: Sequence[Triple], within_m: float | None) -> Aligning:
    """The alignment, or why it does not tell where all these places of the part are to `within_m` (two standard deviations)."""
    if within_m is None or not isinstance(found, Alignment) or not places:
        return found
    sure = 2.0 * float(found.sigma_at(np.array(places)).max())
    if sure <= within_m:
        return found
    return Unaligned(
        f"a point of the part is known to {1e3 * sure:.3g} mm only: measure more datums, or more exactly"
    )


def information(found: Alignment, datums: Datums, sigma_m: Floats) -> Floats:
    """What one look at each datum (n, 6, 6), with a standard deviation of its own, tells of the part about the centre of the used ones."""
    moved = found.T_measured_nominal
    every = Datums(datums.names, datums.nominal, datums.normals, datums.measured, sigma_m, datums.whole)
    rows = _rows(every, moved, apply(moved, found.centre[None])[0])
    told = np.zeros((len(datums.names), 6, 6))
    np.add.at(told, rows.of, rows.by[:, :, None] * rows.by[:, None, :])
    return told


def _agreed(datums: Datums) -> tuple[Floats, Truths]:
    """The displacement T (4, 4) with which most datums agree, and those that do (n,)."""
    found = [_settled(datums, each) for each in _tried(datums)]
    return max(found, key=lambda each: (int(each[1].sum()), -_cost(datums, *each)))


def _tried(datums: Datums) -> list[Truths]:
    """Sets of datums to begin with: all, and small ones that were drawn; each settles a displacement."""
    random = np.random.default_rng(SEED)
    count = len(datums.nominal)
    least = 3 if datums.whole.all() else 6
    sets = [np.ones(count, bool)]
    scored: list[tuple[float, int, Truths]] = []
    for _ in range(SAMPLES if count > least else 0):
        chosen = np.zeros(count, bool)
        chosen[random.choice(count, least, replace=False)] = True
        if (T := _least_squares(datums, chosen)) is not None:
            off = np.minimum(_off(datums, T), AGREES)
            scored.append((float(off @ off), len(scored), _off(datums, T) <= AGREES))
    sets += [agreeing for _, _, agreeing in sorted(scored)[:3]]
    return sets


def _settled(datums: Datums, used: Truths) -> tuple[Floats, Truths]:
    """A displacement refined until the datums that agree with it stay the same."""
    T = np.eye(4)
    for _ in range(ROUNDS):
        moved = _least_squares(datums, used)
        if moved is None:
            return T, np.zeros(len(used), bool)
        T = moved
        agreeing = _off(datums, T) <= AGREES
        if (agreeing == used).all():
            break
        used = agreeing
    return T, _off(datums, T) <= AGREES


def _undecided(datums: Datums, agreeing: Truths) -> tuple[str, str] | None:
    """A datum that disagrees, and one that agrees, of which either may be wrong: without the second, the first one fits."""
    for wrong in np.flatnonzero(~agreeing):
        for other in np.flatnonzero(agreeing):
            instead = agreeing.copy()
            instead[[wrong, other]] = True, False
            T = _least_squares(datums, instead)
            if T is not None and (_off(datums, T)[instead] <= AGREES).all():
                return datums.names[wrong], datums.names[other]
    return None


def _cost(datums: Datums, T: Floats, used: Truths) -> float:
    return float((_off(datums, T)[used] ** 2).sum())


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """What datums say by their standard deviations: how far they are off (rows,), by shift and turn (rows, 6), of which (rows,)."""

    off: Floats
    by: Floats
    of: Longs


def _rows(datums: Datums, T: Floats, about: Floats | None = None) -> _Rows:
    """The rows about a point (3,), or the centre of the datums, for a part displaced by T."""
    centre = apply(T, datums.nominal.mean(axis=0, keepdims=True))[0] if about is None else about
    placed, normals = apply(T, datums.nominal), datums.normals @ T[:3, :3].T
    gap = datums.measured - placed
    surface, whole = np.flatnonzero(~datums.whole), np.flatnonzero(datums.whole)
    m = normals[surface]
    turn = np.cross(m, datums.measured[surface] - centre)
    lines = np.concatenate([-m, turn], axis=1)
    points = np.concatenate(
        [np.broadcast_to(-np.eye(3), (len(whole), 3, 3)), skew(placed[whole] - centre)], axis=2
    )
    of = np.concatenate([surface, np.repeat(whole, 3)])
    off = np.concatenate([(m * gap[surface]).sum(axis=1), gap[whole].ravel()])
    sigma = datums.sigma_m[of]
    return _Rows(off / sigma, np.concatenate([lines, points.reshape(-1, 6)]) / sigma[:, None], of)


def _off(datums: Datums, T: Floats) -> Floats:
    """How far each datum (n,) is off, by its standard deviations: along the normal, or in all."""
    rows = _rows(datums, T)
    squares = np.zeros(len(datums.nominal))
    np.maximum.at(squares, rows.of, rows.off**2)
    found: Floats = np.sqrt(squares)
    return found


def _least_squares(datums: Datums, used: Truths) -> Floats | None:
    """The displacement with the least squares over some datums, from no displacement; None where they do not settle it."""
    some, T = _some(datums, used), np.eye(4)
    if used.sum() + 2 * some.whole.sum() < 6:
        return None
    for _ in range(STEPS):
        rows = _rows(some, T)
        step, _, rank, _ = np.linalg.lstsq(rows.by, -rows.off, rcond=SETTLED)
        if rank < 6 or not np.isfinite(step).all():
            return None
        centre = apply(T, some.nominal.mean(axis=0, keepdims=True))[0]
        R = turned(np.asarray(step[3:], float))
        T = transform(R, centre - R @ centre + step[:3]) @ T
        if np.abs(step).max() < STILL:
            break
    return T


def _some(datums: Datums, used: Truths) -> Datums:
    return Datums(
        tuple(name for name, kept in zip(datums.names, used, strict=True) if kept),
        datums.nominal[used],
        datums.normals[used],
        datums.measured[used],
        datums.sigma_m[used],
        datums.whole[used],
    )


def _lacking(datums: Datums, used: Truths) -> str | None:
    """What the datums leave free, or that none is to spare; None if they hold the part and check each other."""
    some = _some(datums, used)
    if not len(some.nominal):
        return "there are no datums"
    if (free := _loosest(some)) is not None:
        return f"the datums leave {_motion(free)} free"
    if len(_rows(some, np.eye(4)).off) <= 6:
        return "no datum is to spare, so a wrong one would not be noticed: measure more"
    return None


def lacking(datums: Datums) -> str | None:
    """What datums leave free wherever they are measured, or that none is to spare; None if they hold the part and check each other."""
    return _lacking(datums, np.ones(len(datums.nominal), bool))


def holding(datums: Datums, others: Datums) -> tuple[str, ...]:
    """Of other points, those that hold the motion that the datums leave free, those that hold it best first; all if nothing is free."""
    free = _loosest(datums)
    if free is None:
        return others.names
    centre = datums.nominal.mean(axis=0)
    by = _scaled(_rows(others, np.eye(4), centre).by, _size(datums)) * others.sigma_m[:, None]
    held = np.abs(by @ free)
    order = [number for number in np.argsort(-held, kind="stable") if held[number] > HOLDS]
    return tuple(others.names[number] for number in order)


def _loosest(datums: Datums) -> Floats | None:
    """The motion (6,) that the datums leave free, turns as shifts of the farthest datum; None if they leave none."""
    by = _scaled(_rows(datums, np.eye(4)).by, _size(datums))
    values, vectors = np.linalg.eigh(by.T @ by)
    free: Floats | None = vectors[:, 0] if values[0] <= LOOSE * values[-1] else None
    return free


def _scaled(by: Floats, size: float) -> Floats:
    """Rows (n, 6) with turns in shifts at a distance."""
    scaled: Floats = by * np.array([1.0, 1.0, 1.0, *[1.0 / size] * 3])
    return scaled


def _size(datums: Datums) -> float:
    """How far (m) the farthest datum is from their centre; 1 if there is only one."""
    return float(np.linalg.norm(datums.nominal - datums.nominal.mean(axis=0), axis=1).max()) or 1.0


def _motion(vector: Floats) -> str:
    """A motion (6,) in words: mostly a shift, or mostly a turn."""
    shift, turn = vector[:3], vector[3:]
    turns = np.linalg.norm(turn) > np.linalg.norm(shift)
    axis = turn if turns else shift
    axis = axis / np.linalg.norm(axis) * (1.0 if axis[np.argmax(np.abs(axis))] > 0 else -1.0)
    told = ", ".join(f"{each + 0.0:.2f}" for each in np.round(axis, 2))
    return f"a turn about ({told})" if turns else f"a shift along ({told})"


def _finished(datums: Datums, T: Floats, used: Truths) -> Alignment:
    rows = _rows(_some(datums, used), T)
    covariance = np.asarray(np.linalg.inv(rows.by.T @ rows.by), float)
    centre = datums.nominal[used].mean(axis=0)
    chi2 = float(rows.off @ rows.off)
    return Alignment(T, centre, covariance, used, _off(datums, T), chi2, len(rows.off) - 6)
