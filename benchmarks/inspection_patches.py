"""Rendered patches whose truth is known: how far the dimensions found in range images are off, by
their stated deviations.

A tool 150 mm away scans a picture of 19 mm: 0.05 mm noise at that distance, a beam of 0.4 mm,
directions that err by 0.04 mm, 0.5 % of the pixels without an answer, ranges known modulo 150 mm.
The part lies up to some millimetres off its expected place; ranges are resolved from there. Each
image has one or two patches, and these give the dimensions.
"""

import math
import os
import sys
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from benchmarks.inspection_peers import Beside, Truth, beside, told
from benchmarks.inspection_shapes import ball, holed, plate, turning
from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import (
    apply,
    inverse,
    rotation_by_vector,
    transform,
    translation,
)
from cellwright.engine.model.geometry import Solid
from cellwright.engine.model.shape_fits import Fit, FitShape
from cellwright.engine.model.vision import PixelWindow, RangeImage
from cellwright.engine.pipelines.motion.image_dimensions import (
    DimensionRequest,
    dimensions_in_image,
)
from cellwright.engine.stages.fitting.shape_relations import relate_fits
from cellwright.engine.stages.vision.sensor_images import (
    expected_ranges,
    resolve_ranges,
    scan_solids,
)
from cellwright.kb.model.cell_model import Ranging

SIDE, AWAY_M, MISPLACED_M = 48, 0.15, 0.001
TOOL = Ranging(
    "laser", SIDE, SIDE, math.radians(7.3), 0.3, 5e-5, AWAY_M, 0.0027, 0.00027, dropouts=0.005
)
WHOLE = PixelWindow(0, 0, SIDE, SIDE)
LEFT, RIGHT = PixelWindow(0, 0, SIDE // 2, SIDE), PixelWindow(SIDE // 2, 0, SIDE, SIDE)
# pixels that a patch keeps off an expected edge: the part lies elsewhere by some millimetres
CLEAR = 8
BEFORE, AFTER = (
    PixelWindow(0, 0, SIDE // 2 - CLEAR, SIDE),
    PixelWindow(SIDE // 2 + CLEAR, 0, SIDE, SIDE),
)
Placed = list[tuple[Solid, Floats]]
Error = tuple[float, float]  # an error and its stated standard deviation


@dataclass(frozen=True)
class Case:
    """A part before the tool, what is asked of its picture, and the errors of what was found,
    by dimension.
    """

    placed: Placed
    asked: list[DimensionRequest]
    errors: Callable[[Mapping[str, Fit]], dict[str, Error]]
    truth: Truth = field(default_factory=dict)


def leaning(random: np.random.Generator, most: float = 0.3) -> Floats:
    """A pose (4, 4) in front of the tool, leaning and a little aside."""
    aside = random.uniform(-1.0, 1.0, 3) * [0.001, 0.001, 0.004]
    return transform(
        rotation_by_vector(random.uniform(-most, most, 3)), aside + np.array([0.0, 0.0, AWAY_M])
    )


def plane_case(random: np.random.Generator) -> Case:
    """Where a plane is, and how it leans."""
    T = leaning(random)

    def errors(found: Mapping[str, Fit]) -> dict[str, Error]:
        fit = found["a"]
        off = float(T[:3, 2] @ (fit.origin - T[:3, 3]))
        lean = fit.T_world_shape[:3, :3].T @ T[:3, 2]
        lean = lean * np.sign(lean[2])
        return {
            "position of a plane": (off, fit.deviation("z")),
            "lean of a plane": (float(lean[0]), fit.deviation("tilt_x")),
        }

    def off(point: Floats, normal: Floats) -> float:
        return float(normal @ (point - T[:3, 3])) * float(np.sign(normal @ T[:3, 2]))

    return Case(
        [(plate(), T)], [DimensionRequest("a", FitShape.PLANE, WHOLE)], errors, {"plane": off}
    )


def size(
    name: str, truth: float, parameter: str
) -> Callable[[Mapping[str, Fit]], dict[str, Error]]:
    """The error of one size of the only fit."""

    def errors(found: Mapping[str, Fit]) -> dict[str, Error]:
        fit = found["a"]
        value = fit.angle_rad if parameter == "angle" else fit.radius_m
        return {name: (value - truth, fit.deviation(parameter))}

    return errors


def sphere_case(random: np.random.Generator) -> Case:
    """How wide a ball is, and where its middle is."""
    radius, T = random.uniform(0.006, 0.015), leaning(random)
    T = T @ translation(0, 0, radius)
    diameter = size("diameter of a sphere", radius, "radius")

    def errors(found: Mapping[str, Fit]) -> dict[str, Error]:
        local = apply(inverse(found["a"].T_world_shape), T[:3, 3][None])[0]
        return {
            **diameter(found),
            "position of a sphere": (float(local[0]), found["a"].deviation("x")),
        }

    return Case([(ball(radius), T)], [DimensionRequest("a", FitShape.SPHERE, WHOLE)], errors)


def round_case(random: np.random.Generator, shape: FitShape) -> Case:
    """How wide a cylinder is, or how fast a cone widens."""
    radius = random.uniform(0.006, 0.012)
    angle = random.uniform(0.2, 0.5) if shape is FitShape.CONE else 0.0
    lying = transform(rotation_by_vector(np.array([0.0, -np.pi / 2, 0.0])), (0.0, 0.0, radius))
    T = (
        leaning(random, 0.2)
        @ lying
        @ transform(rotation_by_vector(np.array([0.0, angle, 0.0])), (0.0, 0.0, 0.0))
    )
    parameter, told = (
        ("angle", "angle of a cone") if angle else ("radius", "diameter of a cylinder")
    )
    return Case(
        [(turning(radius, angle), T)],
        [DimensionRequest("a", shape, WHOLE)],
        size(told, angle if angle else radius, parameter),
    )


def hole_case(random: np.random.Generator) -> Case:
    """How wide a hole is, and where; what is behind it is seen, or nothing is."""
    radius, T = random.uniform(0.003, 0.006), leaning(random)
    placed = [(holed(radius), T)]
    if random.random() < 0.5:
        placed.append((plate(0.2, 0.2), translation(0, 0, AWAY_M + random.uniform(0.015, 0.03))))
    diameter = size("diameter of a hole", radius, "radius")

    def errors(found: Mapping[str, Fit]) -> dict[str, Error]:
        local = apply(inverse(found["a"].T_world_shape), T[:3, 3][None])[0]
        side = int(random.integers(2))
        return {
            **diameter(found),
            "position of a hole": (float(local[side]), found["a"].deviation("xy"[side])),
        }

    return Case(placed, [DimensionRequest("a", FitShape.CIRCLE, WHOLE)], errors, {"radius": radius})


def step_case(random: np.random.Generator) -> Case:
    """How high a step is."""
    height, T = random.uniform(0.0005, 0.01), leaning(random, 0.2)
    low = T @ translation(0.05, 0, height)
    high = T @ translation(-0.05, 0, 0)

    def errors(found: Mapping[str, Fit]) -> dict[str, Error]:
        told = relate_fits(found["a"], found["b"])[0]
        return {"height of a step": (told.value - height, told.sigma)}

    asked = [
        DimensionRequest("a", FitShape.PLANE, BEFORE),
        DimensionRequest("b", FitShape.PLANE, AFTER),
    ]
    return Case([(plate(0.05, 0.05), high), (plate(0.05, 0.05), low)], asked, errors)


def turn_case(random: np.random.Generator) -> Case:
    """The angle between two planes that meet in a roof or a crease."""
    half, T = random.uniform(0.1, 0.4) * random.choice([-1.0, 1.0]), leaning(random, 0.2)
    sides = []
    for side in (-1.0, 1.0):
        about = transform(rotation_by_vector(np.array([0.0, side * half, 0.0])), (0.0, 0.0, 0.0))
        sides.append((plate(0.02, 0.05), T @ about @ translation(side * 0.02, 0, 0)))

    def errors(found: Mapping[str, Fit]) -> dict[str, Error]:
        told = next(each for each in relate_fits(found["a"], found["b"]) if each.what == "angle")
        return {"angle between planes": (told.value - 2 * abs(half), told.sigma)}

    return Case(
        sides,
        [
            DimensionRequest("a", FitShape.PLANE, BEFORE),
            DimensionRequest("b", FitShape.PLANE, AFTER),
        ],
        errors,
    )


def balls_case(random: np.random.Generator) -> Case:
    """How far apart two balls are."""
    centres = [
        np.array([x, random.uniform(-0.001, 0.001), AWAY_M + 0.004]) for x in (-0.005, 0.005)
    ]
    radii = random.uniform(0.0035, 0.0045, 2)
    placed = [(ball(r), translation(*at)) for r, at in zip(radii, centres, strict=True)]
    apart = float(np.linalg.norm(centres[0] - centres[1]))

    def errors(found: Mapping[str, Fit]) -> dict[str, Error]:
        told = relate_fits(found["a"], found["b"])[0]
        return {"distance of two spheres": (told.value - apart, told.sigma)}

    return Case(
        placed,
        [
            DimensionRequest("a", FitShape.SPHERE, LEFT),
            DimensionRequest("b", FitShape.SPHERE, RIGHT),
        ],
        errors,
    )


CASES: dict[str, Callable[[np.random.Generator], Case]] = {
    "plane": plane_case,
    "sphere": sphere_case,
    "cylinder": lambda random: round_case(random, FitShape.CYLINDER),
    "cone": lambda random: round_case(random, FitShape.CONE),
    "hole": hole_case,
    "step": step_case,
    "turn": turn_case,
    "spheres": balls_case,
}


def pictured(case: Case, random: np.random.Generator) -> RangeImage:
    """The resolved image of a case, whose part lies elsewhere than expected."""
    off = translation(*random.normal(0.0, MISPLACED_M, 3))
    finer = 9 if any(each.shape is FitShape.CIRCLE for each in case.asked) else 5
    scan = scan_solids(case.placed, TOOL, int(random.integers(2**31)), finer)
    found = resolve_ranges(
        scan, expected_ranges([(each, off @ T) for each, T in case.placed], TOOL), 2 * MISPLACED_M
    )
    assert isinstance(found, RangeImage)
    return found


class One(NamedTuple):
    """The errors of one image, None where a shape was refused; the number of its patches;
    milliseconds; what peers find.
    """

    errors: dict[str, Error] | None
    patches: int
    ms: float
    peers: list[Beside]


def one(name: str, number: int, seed: int) -> One:
    """One image of a kind, measured."""
    began = time.process_time()
    random = np.random.default_rng([seed, list(CASES).index(name), number])
    case = CASES[name](random)
    image = pictured(case, random)
    found = dimensions_in_image(image, case.asked)
    fits = {key: each for key, each in found.fits.items() if isinstance(each, Fit)}
    errors = case.errors(fits) if len(fits) == len(found.fits) else None
    spent = 1e3 * (time.process_time() - began)
    return One(errors, len(case.asked), spent, beside(image, case.asked, found, case.truth))


def some(work: tuple[str, range, int]) -> list[One]:
    """The same for images of one kind."""
    name, numbers, seed = work
    return [one(name, number, seed) for number in numbers]


def patches(count: int, seed: int) -> dict[str, Any]:
    """The errors of at least `count` rendered patches by dimension, and how many patches were
    refused.
    """
    rounds = math.ceil(count / (len(CASES) + 3))  # three kinds have two patches each
    work = [
        (name, range(n, min(n + 25, rounds)), seed) for name in CASES for n in range(0, rounds, 25)
    ]
    with ProcessPoolExecutor(min(2, os.cpu_count() or 1)) as pool:
        found = list(pool.map(some, work))
    off: dict[str, list[Error]] = {}
    refused, made, spent = 0, 0, 0.0
    images = [each for part in found for each in part]
    for each in images:
        made, spent = made + each.patches, spent + each.ms
        refused += each.patches if each.errors is None else 0
        for name, error in (each.errors or {}).items():
            off.setdefault(name, []).append(error)
    rows = {name: told_of(each) for name, each in off.items()}
    every = [each for errors in off.values() for each in errors]
    whole = {**told_of(every), "patches": made, "refused": refused, "ms": round(spent / made)}
    return {**rows, "all": whole, "peers": told([peer for each in images for peer in each.peers])}


def told_of(errors: list[Error]) -> dict[str, float]:
    """The number, the share of errors within 95 %, its standard error, and the mean and the
    scatter by the stated deviation.
    """
    off = np.array([error / sigma for error, sigma in errors])
    within = float((np.abs(off) < 1.96).mean())
    return {
        "count": len(off),
        "within": round(within, 4),
        "give or take": round(math.sqrt(0.95 * 0.05 / len(off)), 4),
        "bias": round(float(off.mean()), 3),
        "scatter": round(float(off.std()), 3),
        "median": round(float(np.median(off)), 3),
    }


def summary(off: list[float]) -> dict[str, float]:
    """How many errors, the share within 95 %, and their mean by the stated standard deviation."""
    within = float(np.mean(np.abs(off) < 1.96)) if off else 1.0
    return {
        "count": len(off),
        "within": round(within, 4),
        "bias": round(float(np.mean(off or [0.0])), 3),
    }


def main() -> int:
    """Print the errors of rendered patches: python benchmarks/inspection_patches.py [NUMBER]."""
    for name, row in patches(int(sys.argv[1]) if len(sys.argv) > 1 else 5000, 1).items():
        print(f"{name:24} {row}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
