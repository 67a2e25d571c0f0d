"""Displaced parts whose datums were measured, some of them wrongly: how often the place that is
found is right, wrong or refused.
"""

import time
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from benchmarks.inspection_patches import summary
from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import apply, difference, rotation_by_vector, transform
from cellwright.engine.model.shape_fits import Alignment, Datums
from cellwright.engine.stages.fitting.datum_alignment import (
    align_by_datums,
    count_further_looks,
    require_precision,
)

DATUM_NOISE_M, DATUMS, SPOILT = 1e-4, 20, 2
WITHIN_M, WITHIN_DEG = 5e-5, 0.02
LOOKS, PLACES = 12, [(x, y, z) for x in (-2.5, 2.5) for y in (-1.0, 1.0) for z in (0.0, 0.25)]


def alignments(count: int, seed: int) -> dict[str, Any]:
    """Displaced parts: how often the place is right, wrong or refused, alone and when 0.05 mm
    is asked for.
    """
    random = np.random.default_rng([seed, 99])
    centre, farthest = np.array([[0.0, 0.0, 0.0]]), [(2.5, 1.0, 0.25), (-2.5, -1.0, 0.0)]
    told: dict[str, Any] = {
        "found": 0,
        "refused": 0,
        "wrong datum kept": 0,
        "asked: right": 0,
        "asked: wrong": 0,
        "asked: refused": 0,
    }
    looked = Looked()
    off, began = [], time.process_time()
    centres, turns = list[float](), list[float]()
    for _ in range(count):
        T, datums, spoilt = displaced(random)
        found = align_by_datums(datums)
        if not isinstance(found, Alignment):
            told["refused"] += 1
            told["asked: refused"] += 1
            continue
        told["found"] += 1
        looked.take(found, datums, T, random)
        told["wrong datum kept"] += int(found.used[spoilt].any())
        gap = apply(found.T_measured_nominal, found.centre[None]) - apply(T, found.centre[None])
        centres.append(
            1e3 * float(np.linalg.norm(apply(found.T_measured_nominal, centre) - apply(T, centre)))
        )
        turns.append(float(np.degrees(difference(found.T_measured_nominal, T)[1])))
        off += (gap[0] / np.sqrt(np.diag(found.covariance)[:3])).tolist()
        if isinstance(require_precision(found, farthest, WITHIN_M), Alignment):
            metres = np.linalg.norm(apply(found.T_measured_nominal, centre) - apply(T, centre))
            turn = np.degrees(difference(found.T_measured_nominal, T)[1])
            right = metres <= WITHIN_M and turn <= WITHIN_DEG
            told["asked: right" if right else "asked: wrong"] += 1
        else:
            told["asked: refused"] += 1
    told |= looked.told()
    told |= {"centre mm": spread(centres), "turn degrees": spread(turns)}
    told["centre within 0.05 mm"] = round(
        float(np.mean(np.array(centres or [0.0]) <= 1e3 * WITHIN_M)), 3
    )
    return {
        **told,
        **summary(off),
        "ms": round(1e3 * (time.process_time() - began) / max(1, count), 1),
    }


@dataclass
class Looked:
    """Datums that are looked at again, until every place of the part is known to 0.05 mm (two
    standard deviations), or refused.

    A part counts as right if its middle is within 0.05 mm and its turn within 0.02 degrees. How far
    the farthest place is off is told beside it.
    """

    right: int = 0
    wrong: int = 0
    refused: int = 0
    looks: list[int] = field(default_factory=list)
    middles: list[float] = field(default_factory=list)
    farthest: list[float] = field(default_factory=list)
    turns: list[float] = field(default_factory=list)

    def take(
        self, found: Alignment, datums: Datums, T: Floats, random: np.random.Generator
    ) -> None:
        """Look again at the datums that an alignment used, and judge what comes of it."""
        once = np.full(DATUMS, DATUM_NOISE_M)
        sums, counts = datums.measured.copy(), np.ones(DATUMS)
        for _ in range(LOOKS):
            looks = count_further_looks(
                found, datums, once, PLACES, WITHIN_M, LOOKS - int(counts.max())
            )
            if not looks:
                break
            for number in (datums.names.index(name) for name in looks):
                sums[number] += apply(T, datums.nominal[number : number + 1])[0] + random.normal(
                    0.0, DATUM_NOISE_M, 3
                )
                counts[number] += 1
            mean, sigma = sums / counts[:, None], once / np.sqrt(counts)
            again = align_by_datums(replace(datums, measured=mean, sigma_m=sigma))
            if not isinstance(again, Alignment):
                looks = None
                break
            found, datums = again, replace(datums, measured=mean, sigma_m=sigma)
        if looks is None or looks:
            self.refused += 1
            return
        off = apply(found.T_measured_nominal, np.array([(0.0, 0.0, 0.0), *PLACES])) - apply(
            T, np.array([(0.0, 0.0, 0.0), *PLACES])
        )
        metres = np.linalg.norm(off, axis=1)
        turn = float(np.degrees(difference(found.T_measured_nominal, T)[1]))
        right = metres[0] <= WITHIN_M and turn <= WITHIN_DEG
        self.right, self.wrong = self.right + int(right), self.wrong + int(not right)
        self.looks.append(int(counts.sum()) - DATUMS)
        self.middles.append(1e3 * float(metres[0]))
        self.farthest.append(1e3 * float(metres[1:].max()))
        self.turns.append(turn)

    def told(self) -> dict[str, Any]:
        """What came of all."""
        counts = {
            "looked again: right": self.right,
            "looked again: wrong": self.wrong,
            "looked again: refused": self.refused,
        }
        spreads = {
            "further looks": self.looks,
            "middle then mm": self.middles,
            "farthest then mm": self.farthest,
            "turn then degrees": self.turns,
        }
        return counts | {
            name: spread([float(each) for each in values]) for name, values in spreads.items()
        }


def spread(errors: list[float]) -> dict[str, float]:
    """The median of errors, what 95 % of them do not exceed, and the greatest."""
    found = np.array(errors or [0.0])
    return {
        name: round(float(np.quantile(found, share)), 5)
        for name, share in (("median", 0.5), ("95 %", 0.95), ("most", 1.0))
    }


def displaced(random: np.random.Generator) -> tuple[Floats, Datums, list[int]]:
    """A displacement T (4, 4), datums measured after it, and the numbers of the wrong ones."""
    turn, shift = random.normal(size=3), random.normal(size=3)
    turn *= np.radians(random.uniform(0, 5)) / np.linalg.norm(turn)
    T = transform(rotation_by_vector(turn), shift * random.uniform(0, 0.03) / np.linalg.norm(shift))
    nominal = random.uniform([-2.5, -1.0, 0.0], [2.5, 1.0, 0.25], (DATUMS, 3))
    normals = np.eye(3)[np.arange(DATUMS) % 3] * random.choice([-1.0, 1.0], (DATUMS, 1))
    measured = apply(T, nominal) + random.normal(0.0, DATUM_NOISE_M, (DATUMS, 3))
    spoilt: list[int] = random.choice(DATUMS, SPOILT, replace=False).tolist()
    measured[spoilt] += normals[spoilt] * random.uniform(0.001, 0.02, (SPOILT, 1))
    names = tuple(f"d{number}" for number in range(DATUMS))
    whole = np.ones(DATUMS, bool)
    return (
        T,
        Datums(names, nominal, normals, measured, np.full(DATUMS, DATUM_NOISE_M), whole),
        spoilt,
    )
