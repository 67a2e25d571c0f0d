"""Pose of a part from its datums, wrong datums among them, and how many more looks are needed.

A datum on a surface tells one number, how far the surface is from where it was expected; a datum
that is a point of the part tells three. Displacements through few datums are compared by how many
others agree (Fischler & Bolles 1981); the best one is refined by least squares over all that agree.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs, Truths
from cellwright.engine.kernels.rigid import apply, rotation_by_vector, skew, transform
from cellwright.engine.model.part_measurements import Triple
from cellwright.engine.model.shape_fits import (
    Aligning,
    Alignment,
    Datums,
    Unaligned,
    why_unfittable,
)

AGREEING_SIGMAS = 3.5  # standard deviations
MAX_SAMPLED_SETS, MAX_ALIGNMENT_STEPS, MAX_AGREEMENT_ROUNDS = (
    60,
    8,
    10,
)  # sets of few datums, steps of least squares, choices of those that agree
MIN_AGREEING_SHARE = 0.6  # of the datums that must agree
LOOSE_MOTION = 1e-7  # of the best known motion: a motion known so much worse is free
# of the free motion that a point along its normal feels, of one that holds it
HOLDS_MOTION_SHARE = 0.5
# of the best known motion, too: least squares that know one worse settle nothing
SETTLED_MOTION = 1e-10
LAST_STEP = 1e-12  # m and rad: a smaller step is the last
DATUM_SEED = 20261123


def align_by_datums(datums: Datums) -> Aligning:
    """The displacement that the datums show, or why they show none."""
    if (reason := why_unfittable(datums.measured, datums.sigma_m)) is not None:
        return Unaligned(reason)
    everything = np.ones(len(datums.nominal), bool)
    if (reason := _lacking_datums(datums, everything)) is not None:
        return Unaligned(reason)
    best, agreeing = _agreeing_displacement(datums)
    if agreeing.mean() < MIN_AGREEING_SHARE:
        wrong = tuple(
            name for name, agrees in zip(datums.names, agreeing, strict=True) if not agrees
        )
        few_agree = (
            f"no place of the part fits more than {agreeing.sum()} of {len(agreeing)} datums"
        )
        return Unaligned(
            f"{few_agree}: the part has another form, or measurements are wrong", wrong
        )
    if (reason := _lacking_datums(datums, agreeing)) is not None:
        return Unaligned(f"{reason}, once {(~agreeing).sum()} wrong datums are left out")
    if (pair := _undecided_datums(datums, agreeing)) is not None:
        few_agree = f"either {pair[0]} or {pair[1]} is wrong, and no other datum tells which"
        return Unaligned(f"{few_agree}: measure more beside them", pair)
    return _finish_alignment(datums, best, agreeing)


def require_precision(
    alignment: Aligning, places: Sequence[Triple], within_m: float | None
) -> Aligning:
    """The alignment, or why it does not tell where all these places of the part are to
    `within_m` (two standard deviations).
    """
    if within_m is None or not isinstance(alignment, Alignment) or not places:
        return alignment
    sure = 2.0 * float(alignment.sigma_at(np.array(places)).max())
    if sure <= within_m:
        return alignment
    return Unaligned(
        f"a point of the part is known to {1e3 * sure:.3g} mm only: measure more datums, or "
        "more exactly"
    )


def datum_information(alignment: Alignment, datums: Datums, sigma_m: Floats) -> Floats:
    """What one look at each datum (n, 6, 6), with a standard deviation of its own, tells of the
    part about the centre of the used ones.
    """
    moved = alignment.T_measured_nominal
    every = Datums(
        datums.names, datums.nominal, datums.normals, datums.measured, sigma_m, datums.whole
    )
    rows = _datum_rows(every, moved, apply(moved, alignment.centre[None])[0])
    told = np.zeros((len(datums.names), 6, 6))
    np.add.at(told, rows.of, rows.by[:, :, None] * rows.by[:, None, :])
    return told


def _agreeing_displacement(datums: Datums) -> tuple[Floats, Truths]:
    """The displacement T (4, 4) with which most datums agree, and those that do (n,)."""
    settled = [_settle_displacement(datums, datum_set) for datum_set in _starting_sets(datums)]
    return max(
        settled,
        key=lambda candidate: (int(candidate[1].sum()), -_alignment_cost(datums, *candidate)),
    )


def _starting_sets(datums: Datums) -> list[Truths]:
    """Sets of datums to begin with: all, and small ones that were drawn; each settles a
    displacement.
    """
    random = np.random.default_rng(DATUM_SEED)
    count = len(datums.nominal)
    least = 3 if datums.whole.all() else 6
    sets = [np.ones(count, bool)]
    scored: list[tuple[float, int, Truths]] = []
    for _ in range(MAX_SAMPLED_SETS if count > least else 0):
        chosen = np.zeros(count, bool)
        chosen[random.choice(count, least, replace=False)] = True
        if (T := _least_squares(datums, chosen)) is not None:
            off = np.minimum(_datum_deviations(datums, T), AGREEING_SIGMAS)
            scored.append(
                (float(off @ off), len(scored), _datum_deviations(datums, T) <= AGREEING_SIGMAS)
            )
    sets += [agreeing for _, _, agreeing in sorted(scored)[:3]]
    return sets


def _settle_displacement(datums: Datums, used: Truths) -> tuple[Floats, Truths]:
    """A displacement refined until the datums that agree with it stay the same."""
    T = np.eye(4)
    for _ in range(MAX_AGREEMENT_ROUNDS):
        moved = _least_squares(datums, used)
        if moved is None:
            return T, np.zeros(len(used), bool)
        T = moved
        agreeing = _datum_deviations(datums, T) <= AGREEING_SIGMAS
        if (agreeing == used).all():
            break
        used = agreeing
    return T, _datum_deviations(datums, T) <= AGREEING_SIGMAS


def _undecided_datums(datums: Datums, agreeing: Truths) -> tuple[str, str] | None:
    """A datum that disagrees, and one that agrees, of which either may be wrong: without the
    second, the first one fits.
    """
    for wrong in np.flatnonzero(~agreeing):
        for second in np.flatnonzero(agreeing):
            instead = agreeing.copy()
            instead[[wrong, second]] = True, False
            T = _least_squares(datums, instead)
            if T is not None and (_datum_deviations(datums, T)[instead] <= AGREEING_SIGMAS).all():
                return datums.names[wrong], datums.names[second]
    return None


def _alignment_cost(datums: Datums, T: Floats, used: Truths) -> float:
    return float((_datum_deviations(datums, T)[used] ** 2).sum())


@dataclass(frozen=True, slots=True, eq=False)
class _DatumRows:
    """What datums say by their standard deviations: how far they are off (rows,), by shift and
    turn (rows, 6), of which (rows,).
    """

    off: Floats
    by: Floats
    of: Longs


def _datum_rows(datums: Datums, T: Floats, about: Floats | None = None) -> _DatumRows:
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
    return _DatumRows(
        off / sigma, np.concatenate([lines, points.reshape(-1, 6)]) / sigma[:, None], of
    )


def _datum_deviations(datums: Datums, T: Floats) -> Floats:
    """How far each datum (n,) is off, by its standard deviations: along the normal, or in all."""
    rows = _datum_rows(datums, T)
    squares = np.zeros(len(datums.nominal))
    np.maximum.at(squares, rows.of, rows.off**2)
    deviations: Floats = np.sqrt(squares)
    return deviations


def _least_squares(datums: Datums, used: Truths) -> Floats | None:
    """The displacement with the least squares over some datums, from no displacement; None
    where they do not settle it.
    """
    some, T = _select_datums(datums, used), np.eye(4)
    if used.sum() + 2 * some.whole.sum() < 6:
        return None
    for _ in range(MAX_ALIGNMENT_STEPS):
        rows = _datum_rows(some, T)
        step, _, rank, _ = np.linalg.lstsq(rows.by, -rows.off, rcond=SETTLED_MOTION)
        if rank < 6 or not np.isfinite(step).all():
            return None
        centre = apply(T, some.nominal.mean(axis=0, keepdims=True))[0]
        R = rotation_by_vector(np.asarray(step[3:], float))
        T = transform(R, centre - R @ centre + step[:3]) @ T
        if np.abs(step).max() < LAST_STEP:
            break
    return T


def _select_datums(datums: Datums, used: Truths) -> Datums:
    return Datums(
        tuple(name for name, in_use in zip(datums.names, used, strict=True) if in_use),
        datums.nominal[used],
        datums.normals[used],
        datums.measured[used],
        datums.sigma_m[used],
        datums.whole[used],
    )


def _lacking_datums(datums: Datums, used: Truths) -> str | None:
    """What the datums leave free, or that none is to spare; None if they hold the part and
    check each other.
    """
    some = _select_datums(datums, used)
    if not len(some.nominal):
        return "there are no datums"
    if (free := _loosest_motion(some)) is not None:
        return f"the datums leave {_motion_in_words(free)} free"
    if len(_datum_rows(some, np.eye(4)).off) <= 6:
        return "no datum is to spare, so a wrong one would not be noticed: measure more"
    return None


def lacking_datums(datums: Datums) -> str | None:
    """What datums leave free wherever they are measured, or that none is to spare; None if they
    hold the part and check each other.
    """
    return _lacking_datums(datums, np.ones(len(datums.nominal), bool))


def datums_that_hold(datums: Datums, candidates: Datums) -> tuple[str, ...]:
    """Of other points, those that hold the motion that the datums leave free, those that hold
    it best first; all if nothing is free.
    """
    free = _loosest_motion(datums)
    if free is None:
        return candidates.names
    centre = datums.nominal.mean(axis=0)
    by = (
        _scale_rows(_datum_rows(candidates, np.eye(4), centre).by, _datum_radius(datums))
        * candidates.sigma_m[:, None]
    )
    moved = np.abs(by @ free)
    order = [
        number for number in np.argsort(-moved, kind="stable") if moved[number] > HOLDS_MOTION_SHARE
    ]
    return tuple(candidates.names[number] for number in order)


def _loosest_motion(datums: Datums) -> Floats | None:
    """The motion (6,) that the datums leave free, turns as shifts of the farthest datum; None
    if they leave none.
    """
    by = _scale_rows(_datum_rows(datums, np.eye(4)).by, _datum_radius(datums))
    values, vectors = np.linalg.eigh(by.T @ by)
    free: Floats | None = vectors[:, 0] if values[0] <= LOOSE_MOTION * values[-1] else None
    return free


def _scale_rows(by: Floats, size: float) -> Floats:
    """Rows (n, 6) with turns in shifts at a distance."""
    scaled: Floats = by * np.array([1.0, 1.0, 1.0, *[1.0 / size] * 3])
    return scaled


def _datum_radius(datums: Datums) -> float:
    """How far (m) the farthest datum is from their centre; 1 if there is only one."""
    return float(np.linalg.norm(datums.nominal - datums.nominal.mean(axis=0), axis=1).max()) or 1.0


def _motion_in_words(vector: Floats) -> str:
    """A motion (6,) in words: mostly a shift, or mostly a turn."""
    shift, turn = vector[:3], vector[3:]
    turns = np.linalg.norm(turn) > np.linalg.norm(shift)
    axis = turn if turns else shift
    axis = axis / np.linalg.norm(axis) * (1.0 if axis[np.argmax(np.abs(axis))] > 0 else -1.0)
    direction = ", ".join(f"{component + 0.0:.2f}" for component in np.round(axis, 2))
    return f"a turn about ({direction})" if turns else f"a shift along ({direction})"


def _finish_alignment(datums: Datums, T: Floats, used: Truths) -> Alignment:
    rows = _datum_rows(_select_datums(datums, used), T)
    covariance = np.asarray(np.linalg.inv(rows.by.T @ rows.by), float)
    centre = datums.nominal[used].mean(axis=0)
    chi2 = float(rows.off @ rows.off)
    return Alignment(
        T, centre, covariance, used, _datum_deviations(datums, T), chi2, len(rows.off) - 6
    )


SURE_SIGMAS = 2.0  # standard deviations


def count_further_looks(
    alignment: Alignment,
    datums: Datums,
    once_m: Floats,
    places: Sequence[Triple],
    within_m: float,
    most: int,
) -> dict[str, int] | None:
    """How many more looks at each of the used datums make every place known to `within_m` (two
    standard deviations), by name.

    `once_m` (n,) are the standard deviations of one more look at each. None if that takes more than
    `most` at one of them; the looks go where they help most, so others do not help instead. Nothing
    if it is known so well already.
    """
    per_look = datum_information(alignment, datums, once_m)
    total = np.asarray(np.linalg.inv(alignment.covariance), float)
    at = np.array(places, float) - alignment.centre
    by = np.concatenate([np.broadcast_to(np.eye(3), (len(at), 3, 3)), -skew(at)], axis=2)
    looks = np.zeros(len(datums.names), np.int64)
    may = alignment.used.copy()
    while True:
        variance, spread = _worst_known_motion(by, total)
        if SURE_SIGMAS * np.sqrt(variance) <= within_m:
            return {
                name: int(count) for name, count in zip(datums.names, looks, strict=True) if count
            }
        if not may.any():
            return None
        gains = np.einsum("i,nij,j->n", spread, per_look, spread)
        best = int(np.argmax(np.where(may, gains, -1.0)))
        looks[best] += 1
        total = total + per_look[best]
        may[best] = looks[best] < most


def _worst_known_motion(by: Floats, total: Floats) -> tuple[float, Floats]:
    """The variance where the part is known least, in its least known direction, and by which
    motion (6,) of the part it comes.
    """
    covariance = np.linalg.inv(total)
    values, vectors = np.linalg.eigh(by @ covariance @ np.swapaxes(by, 1, 2))
    place = int(np.argmax(values[:, -1]))
    spread: Floats = covariance @ by[place].T @ vectors[place, :, -1]
    return float(values[place, -1]), spread
