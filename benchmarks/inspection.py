"""Shapes and alignments from measured points whose truth is known: how often the stated uncertainty holds, and what it costs.

    python benchmarks/inspection.py [--patches N] [--alignments N] [--seed N] [--json FILE]

Patches are rendered (`inspection_patches`). Bars: 94 to 96 % of the errors lie within the stated 95 %, and the mean error is less than a
tenth of the standard deviation, over all dimensions; one dimension misses a bar only where chance does not explain it (2.6 standard
errors). An alignment has 20 datums on a
part of 5 m by 2 m that is displaced by up to 30 mm and 5 degrees; two of them are wrong by 1 to 20 mm, the others by noise of
0.1 mm. Asked to be within 0.05 mm and 0.02 degrees, it is right or refused. Exits with 1 when a bar is missed.
"""

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from inspection_patches import patches

from engine.kernels.rigid import apply, difference, transform, turned
from engine.model.fits import Alignment, Datums
from engine.model.geometry import Floats
from engine.stages.fitting.alignment import aligned, sure_enough

DATUM_NOISE_M, DATUMS, SPOILT = 1e-4, 20, 2
WITHIN_M, WITHIN_DEG = 5e-5, 0.02
COVERAGE, BIAS, CHANCE = (0.94, 0.96), 0.1, 2.6


def summary(off: list[float]) -> dict[str, float]:
    """How many errors, the share within 95 %, and their mean by the stated standard deviation."""
    within = float(np.mean(np.abs(off) < 1.96)) if off else 1.0
    return {"count": len(off), "within": round(within, 4), "bias": round(float(np.mean(off or [0.0])), 3)}


def alignments(count: int, seed: int) -> dict[str, Any]:
    """Displaced parts: how often the place is right, wrong or refused, alone and when 0.05 mm is asked for."""
    random = np.random.default_rng([seed, 99])
    centre, farthest = np.array([[0.0, 0.0, 0.0]]), [(2.5, 1.0, 0.25), (-2.5, -1.0, 0.0)]
    told = {
        "found": 0,
        "refused": 0,
        "wrong datum kept": 0,
        "asked: right": 0,
        "asked: wrong": 0,
        "asked: refused": 0,
    }
    off, began = [], time.process_time()
    for _ in range(count):
        T, datums, spoilt = displaced(random)
        found = aligned(datums)
        if not isinstance(found, Alignment):
            told["refused"] += 1
            told["asked: refused"] += 1
            continue
        told["found"] += 1
        told["wrong datum kept"] += int(found.used[spoilt].any())
        gap = apply(found.T_measured_nominal, found.centre[None]) - apply(T, found.centre[None])
        off += (gap[0] / np.sqrt(np.diag(found.covariance)[:3])).tolist()
        if isinstance(sure_enough(found, farthest, WITHIN_M), Alignment):
            metres = np.linalg.norm(apply(found.T_measured_nominal, centre) - apply(T, centre))
            turn = np.degrees(difference(found.T_measured_nominal, T)[1])
            right = metres <= WITHIN_M and turn <= WITHIN_DEG
            told["asked: right" if right else "asked: wrong"] += 1
        else:
            told["asked: refused"] += 1
    return {**told, **summary(off), "ms": round(1e3 * (time.process_time() - began) / max(1, count), 1)}


def displaced(random: np.random.Generator) -> tuple[Floats, Datums, list[int]]:
    """A displacement T (4, 4), datums measured after it, and the numbers of the wrong ones."""
    turn, shift = random.normal(size=3), random.normal(size=3)
    turn *= np.radians(random.uniform(0, 5)) / np.linalg.norm(turn)
    T = transform(turned(turn), shift * random.uniform(0, 0.03) / np.linalg.norm(shift))
    nominal = random.uniform([-2.5, -1.0, 0.0], [2.5, 1.0, 0.25], (DATUMS, 3))
    normals = np.eye(3)[np.arange(DATUMS) % 3] * random.choice([-1.0, 1.0], (DATUMS, 1))
    measured = apply(T, nominal) + random.normal(0.0, DATUM_NOISE_M, (DATUMS, 3))
    spoilt: list[int] = random.choice(DATUMS, SPOILT, replace=False).tolist()
    measured[spoilt] += normals[spoilt] * random.uniform(0.001, 0.02, (SPOILT, 1))
    names = tuple(f"d{number}" for number in range(DATUMS))
    whole = np.ones(DATUMS, bool)
    return T, Datums(names, nominal, normals, measured, np.full(DATUMS, DATUM_NOISE_M), whole), spoilt


def missed(found: dict[str, Any]) -> list[str]:
    """The bars that are missed."""
    parts = found["alignments"]
    said = [each for name, row in found["patches"].items() for each in _missed(name, row)]
    if parts["wrong datum kept"]:
        said.append(f"{parts['wrong datum kept']} alignments kept a wrong datum")
    return said


def _missed(name: str, row: dict[str, Any]) -> list[str]:
    """What a row of patches misses: all of them together without regard to chance, one dimension only beyond it."""
    chance = 0.0 if name == "all" else CHANCE
    slack, mean = chance * row["give or take"], chance / np.sqrt(row["count"])
    said = []
    if not COVERAGE[0] - slack <= row["within"] <= COVERAGE[1] + slack:
        said.append(f"{name}: {row['within']:.1%} of the errors are within the stated 95 %")
    if abs(row["bias"]) > BIAS + mean:
        said.append(f"{name}: the mean error is {row['bias']} standard deviations")
    return said


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--patches", type=int, default=5000)
    parser.add_argument("--alignments", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    found = {
        "patches": patches(asked.patches, asked.seed),
        "alignments": alignments(asked.alignments, asked.seed),
    }
    for name, row in found["patches"].items():
        print(f"{name:10} {row}")
    print("alignments", found["alignments"])
    if asked.json:
        asked.json.write_text(json.dumps(found, indent=1))
    for each in missed(found):
        print("missed:", each)
    return 1 if missed(found) else 0


if __name__ == "__main__":
    sys.exit(main())
