"""Datums that are measured again: as many as needed and no more, where they help, or none if
that would not do.
"""

import numpy as np
import pytest

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.shape_fits import Alignment, Datums
from cellwright.engine.stages.fitting.datum_alignment import align_by_datums, count_further_looks

NOISE_M, PLACES = 1e-4, [(x, y, 0.0) for x in (-2.5, 2.5) for y in (-1.0, 1.0)]


def measured(counts: Floats | None = None, whole: bool = True) -> tuple[Datums, Alignment]:
    random = np.random.default_rng(3)
    nominal = random.uniform([-2.5, -1.0, 0.0], [2.5, 1.0, 0.25], (12, 3))
    normals = np.eye(3)[np.arange(12) % 3]
    once = np.full(12, NOISE_M)
    sigma = once if counts is None else once / np.sqrt(counts)
    noise = random.normal(0.0, 1.0, (12, 3)) * sigma[:, None] * 0.3
    names = tuple(f"d{n}" for n in range(12))
    datums = Datums(names, nominal, normals, nominal + noise, sigma, np.full(12, whole))
    found = align_by_datums(datums)
    assert isinstance(found, Alignment)
    return datums, found


def known_to(found: Alignment) -> float:
    return 2.0 * float(found.sigma_at(np.array(PLACES)).max())


def test_what_is_known_well_enough_needs_no_look() -> None:
    datums, found = measured()
    assert (
        count_further_looks(found, datums, datums.sigma_m, PLACES, known_to(found) * 1.001, 9) == {}
    )


@pytest.mark.parametrize("whole", [True, False])
@pytest.mark.parametrize("share", [0.9, 0.6, 0.4])
def test_after_the_further_looks_the_part_is_known_so_well(share: float, whole: bool) -> None:
    datums, found = measured(whole=whole)
    within = share * known_to(found)
    looks = count_further_looks(found, datums, datums.sigma_m, PLACES, within, 30)
    assert looks
    counts = np.array([1.0 + looks.get(name, 0) for name in datums.names])
    _, then = measured(counts, whole)
    assert known_to(then) <= 1.02 * within  # noise moves the place about which it is linear
    counts[datums.names.index(next(iter(looks)))] -= 1.0
    assert known_to(measured(counts, whole)[1]) <= known_to(found)


def test_fewer_looks_are_chosen_than_the_same_number_at_each_takes() -> None:
    datums, found = measured(whole=False)
    within = 0.6 * known_to(found)
    looks = count_further_looks(found, datums, datums.sigma_m, PLACES, within, 30)
    assert looks is not None
    each = 1
    while known_to(measured(np.full(12, 1.0 + each), whole=False)[1]) > within:
        each += 1
    assert sum(looks.values()) <= 12 * each


def test_what_no_number_of_looks_can_reach_is_refused() -> None:
    datums, found = measured()
    assert (
        count_further_looks(found, datums, datums.sigma_m, PLACES, 0.1 * known_to(found), 5) is None
    )


def test_wrong_datums_are_not_looked_at() -> None:
    datums, _ = measured()
    datums.measured[4] += 0.02
    found = align_by_datums(datums)
    assert isinstance(found, Alignment)
    assert not found.used[4]
    assert "d4" not in (
        count_further_looks(found, datums, datums.sigma_m, PLACES, 0.5 * known_to(found), 30) or {}
    )
