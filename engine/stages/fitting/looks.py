"""How often datums have to be measured again until every point of a part is known well enough.

What a datum tells of the shift and the turn of a part adds up with each look at it. The datum to look at next is the one that most reduces
the variance where the part is known least (a greedy choice for the G-optimal design; Atkinson, Donev & Tobias 2007, chapter 10).
"""

from collections.abc import Sequence

import numpy as np

from cellwright.engine.kernels.rigid import skew
from cellwright.engine.model.fits import Alignment, Datums
from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.measurement import Triple
from cellwright.engine.stages.fitting.alignment import information

SURE = 2.0  # standard deviations


def further_looks(
    found: Alignment,
    datums: Datums,
    once_m: Floats,
    places: Sequence[Triple],
    within_m: float,
    most: int,
) -> dict[str, int] | None:
    """How many more looks at each of the used datums make every place known to `within_m` (two standard deviations), by name.

    `once_m` (n,) are the standard deviations of one more look at each. None if that takes more than `most` at one of them; the looks go where
    they help most, so others do not help instead. Nothing if it is known so well already.
    """
    each = information(found, datums, once_m)
    total = np.asarray(np.linalg.inv(found.covariance), float)
    at = np.array(places, float) - found.centre
    by = np.concatenate([np.broadcast_to(np.eye(3), (len(at), 3, 3)), -skew(at)], axis=2)
    looks = np.zeros(len(datums.names), np.int64)
    may = found.used.copy()
    while True:
        variance, spread = _worst(by, total)
        if SURE * np.sqrt(variance) <= within_m:
            return {name: int(count) for name, count in zip(datums.names, looks, strict=True) if count}
        if not may.any():
            return None
        gains = np.einsum("i,nij,j->n", spread, each, spread)
        best = int(np.argmax(np.where(may, gains, -1.0)))
        looks[best] += 1
        total = total + each[best]
        may[best] = looks[best] < most


def _worst(by: Floats, total: Floats) -> tuple[float, Floats]:
    """The variance where the part is known least, in its least known direction, and by which motion (6,) of the part it comes."""
    covariance = np.linalg.inv(total)
    values, vectors = np.linalg.eigh(by @ covariance @ np.swapaxes(by, 1, 2))
    place = int(np.argmax(values[:, -1]))
    spread: Floats = covariance @ by[place].T @ vectors[place, :, -1]
    return float(values[place, -1]), spread
