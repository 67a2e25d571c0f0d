"""Parts aligned by datums: wrong ones are found, errors are as large as stated, and what cannot
be told is refused.
"""

from dataclasses import replace

import numpy as np
import pytest

from cellwright.engine.kernels.arrays import Floats, Longs
from cellwright.engine.kernels.rigid import apply, rotation_by_vector, transform
from cellwright.engine.model.shape_fits import Alignment, Datums, Unaligned
from cellwright.engine.stages.fitting.datum_alignment import (
    align_by_datums,
    datums_that_hold,
    lacking_datums,
    require_precision,
)

SIGMA_M = 1e-4


def displaced(random: np.random.Generator) -> Floats:
    """A displacement of up to 30 mm and 5 degrees."""
    turn, shift = random.normal(size=3), random.normal(size=3)
    turn *= np.radians(random.uniform(0, 5)) / np.linalg.norm(turn)
    return transform(
        rotation_by_vector(turn), shift * random.uniform(0, 0.03) / np.linalg.norm(shift)
    )


def measured(
    random: np.random.Generator, T: Floats, count: int = 24, whole: bool = False
) -> Datums:
    """Datums all over a part of 5 m by 2 m, measured where the beam meets their surfaces, or as
    points of the part.
    """
    nominal = random.uniform([-2.5, -1.0, 0.0], [2.5, 1.0, 0.5], (count, 3))
    normals = np.eye(3)[np.arange(count) % 3] * random.choice([-1.0, 1.0], (count, 1))
    points = apply(T, nominal) + random.normal(0.0, SIGMA_M, (count, 3))
    if not whole:
        slide = random.uniform(-0.02, 0.02, (count, 3))
        now = normals @ T[:3, :3].T
        points += slide - now * (slide * now).sum(axis=1, keepdims=True)
    names = tuple(f"m{number}" for number in range(count))
    return Datums(names, nominal, normals, points, np.full(count, SIGMA_M), np.full(count, whole))


@pytest.mark.slow
@pytest.mark.parametrize("whole", [True, False])
def test_wrong_datums_are_found_and_errors_are_as_stated(whole: bool) -> None:
    random, errors, refused = np.random.default_rng(11), [], 0
    for _ in range(20):
        T = displaced(random)
        datums = measured(random, T, whole=whole)
        wrong = random.choice(24, 2, replace=False)
        datums.measured[wrong] += datums.normals[wrong] * random.uniform(0.002, 0.02, (2, 1))
        found = align_by_datums(datums)
        if isinstance(found, Unaligned):
            refused += 1
            continue
        assert not found.used[wrong].any()
        assert found.used.sum() >= 21
        off = apply(found.T_measured_nominal, found.centre[None]) - apply(T, found.centre[None])
        errors.append(off[0] / np.sqrt(np.diag(found.covariance)[:3]))
    assert refused <= 2
    assert np.mean(np.abs(errors) < 1.96) >= 0.85
    assert 0.7 < np.std(errors) < 1.4


def test_without_noise_the_displacement_is_exact() -> None:
    random = np.random.default_rng(2)
    T = displaced(random)
    datums = measured(random, T)
    now = datums.normals @ T[:3, :3].T
    gap = datums.measured - apply(T, datums.nominal)
    exact = datums.measured - now * (gap * now).sum(axis=1, keepdims=True)
    found = align_by_datums(replace(datums, measured=exact))
    assert isinstance(found, Alignment)
    assert found.T_measured_nominal == pytest.approx(T, abs=1e-9)


def test_points_are_surer_amid_the_datums_than_far_away() -> None:
    found = align_by_datums(measured(np.random.default_rng(4), np.eye(4)))
    assert isinstance(found, Alignment)
    near, far = found.sigma_at(np.stack([found.centre, found.centre + np.array([30.0, 0.0, 0.0])]))
    assert near < SIGMA_M < far
    assert isinstance(require_precision(found, [(0.0, 0.0, 0.0)], 1e-3), Alignment)
    refused = require_precision(found, [(0.0, 0.0, 0.0)], 1e-6)
    assert isinstance(refused, Unaligned)
    assert "known to" in refused.reason


def test_what_the_datums_leave_free_is_told() -> None:
    datums = measured(np.random.default_rng(5), np.eye(4))
    along_x = np.flatnonzero(datums.normals[:, 0])
    keep = np.setdiff1d(np.arange(24), along_x)
    found = align_by_datums(_only(datums, keep))
    assert isinstance(found, Unaligned)
    assert found.reason == "the datums leave a shift along (1.00, 0.00, 0.00) free"


def test_two_datums_that_contradict_each_other_are_undecided() -> None:
    datums = measured(np.random.default_rng(6), np.eye(4))
    along_x = np.flatnonzero(datums.normals[:, 0])
    two = _only(datums, np.setdiff1d(np.arange(24), along_x[2:]))
    two.measured[two.names.index(f"m{along_x[0]}"), 0] += 0.5
    found = align_by_datums(two)
    assert isinstance(found, Unaligned)
    assert "is wrong, and no other datum tells which" in found.reason
    assert set(found.off) == {f"m{along_x[0]}", f"m{along_x[1]}"}


def test_a_wrong_datum_among_as_few_as_hold_the_part_would_not_be_noticed() -> None:
    found = align_by_datums(_only(measured(np.random.default_rng(6), np.eye(4)), np.arange(6)))
    assert isinstance(found, Unaligned)
    assert "no datum is to spare" in found.reason


def test_what_cannot_be_calculated_with_is_told() -> None:
    datums = measured(np.random.default_rng(9), np.eye(4))
    exact = align_by_datums(replace(datums, sigma_m=np.zeros(24)))
    datums.measured[3, 0] = np.nan
    lost, none = align_by_datums(datums), align_by_datums(_only(datums, np.arange(0)))
    assert isinstance(exact, Unaligned)
    assert "more than 0" in exact.reason
    assert isinstance(lost, Unaligned)
    assert "not a number" in lost.reason
    assert isinstance(none, Unaligned)
    assert none.reason == "there are no datums"


def test_a_part_of_another_form_is_refused() -> None:
    random = np.random.default_rng(8)
    datums = measured(random, np.eye(4))
    datums.measured[::2] += random.normal(0.0, 0.01, (12, 3))
    found = align_by_datums(datums)
    assert isinstance(found, Unaligned)
    assert "no place of the part fits more than" in found.reason
    assert set(found.off) <= set(datums.names)


def _only(datums: Datums, kept: Longs) -> Datums:
    return Datums(
        tuple(datums.names[number] for number in kept),
        datums.nominal[kept],
        datums.normals[kept],
        datums.measured[kept],
        datums.sigma_m[kept],
        datums.whole[kept],
    )


@pytest.mark.parametrize("axis", range(3))
def test_points_that_hold_what_is_free_are_named(axis: int) -> None:
    random = np.random.default_rng(axis)
    every = measured(random, np.eye(4), 30)
    along = np.eye(3)[np.arange(30) % 3]
    every = replace(every, normals=along)
    flat = along[:, axis] == 0
    some, others = _only(every, np.flatnonzero(flat)), _only(every, np.flatnonzero(~flat))
    assert "free" in (lacking_datums(some) or "")
    named = datums_that_hold(some, others)
    assert named
    first = _only(every, np.flatnonzero(flat | np.isin(np.array(every.names), named[:1])))
    assert "free" not in (lacking_datums(first) or "")
    assert datums_that_hold(every, others) == others.names
