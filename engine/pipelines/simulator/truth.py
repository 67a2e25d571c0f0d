"""What is true of the part in a simulated cell, and nobody knows: where it lies, what its sizes are, how tools err.

A file in JSON says so; here with remarks:

    shift_mm: [12, -7, 3]          # where the part lies beside its model, turned about the origin of its frame first
    turn_deg: [0.4, 0, -2]         # a rotation vector
    values: {m1: 6350.2, m2: -31}  # true thicknesses, and how far surfaces are from where the model has them, in the unit of the measurement
    noise: {us_probe: 8}           # standard deviations, by tool
    bad: {m17: 95}                 # what is added to the first value of a measurement
    drift: {probe: {...}}          # tools whose values drift until they are calibrated: see `drifting`

A profile tells where the beam along the normal, from where the arm believes the point to be, meets the surface, which is flat there.
"""

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cellwright.engine.kernels.rigid import apply, transform, turned
from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.measurement import MeasurementPoint
from cellwright.engine.pipelines.measuring import Expected, Measuring
from cellwright.engine.pipelines.points import METRES, PROFILE, points, with_places
from cellwright.engine.pipelines.simulator.drifting import Drift, Drifting, drift_of
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from cellwright.kb.files import read_file
from cellwright.kb.json_text import parsed
from cellwright.kb.model.problem import Problem
from cellwright.kb.numbers import is_number
from cellwright.kb.terms import Function

KEYS = ("shift_mm", "turn_deg", "values", "noise", "bad", "drift")
HINT = f"one JSON object with any of {', '.join(KEYS)}"
Part = Sequence[float]


@dataclass
class Truth:
    """The hidden truth of one part and the tools that measure it. Lengths of places are in metres."""

    problem: Problem
    T: Floats = field(default_factory=lambda: np.eye(4))
    values: Mapping[str, float] = field(default_factory=dict)
    noise: Mapping[str, float] = field(default_factory=dict)
    bad: Mapping[str, float] = field(default_factory=dict)
    seed: int = 0
    drifting: Drifting = field(default_factory=Drifting)

    def __post_init__(self) -> None:
        self._measuring = Measuring(self.problem)
        self._points = {point.name: point for point in points(with_places(self.problem))}
        self._times: dict[str, int] = {}

    def value(self, step: Function, part: Part = ()) -> str | None:
        """What a step measures, as a term; None if it measures nothing. `part` is where the arm believes the part to lie."""
        asked = self._measuring.expected(step)
        if asked is None:
            return None
        time = self._times[asked.of] = self._times.get(asked.of, 0) + 1
        chance = random.Random(f"{self.seed} {asked.of} {asked.quantity} {asked.tool} {time}")
        found = self._true(asked, part) + chance.gauss(0.0, self.noise.get(asked.tool, 0.0))
        found += self.bad.get(asked.of, 0.0) if time == 1 else 0.0
        found += self.drifting.measured(asked.tool)
        return str(round(found)) if asked.unit in ("um", "nm") else f'"{found:.4f}"'

    def _true(self, asked: Expected, part: Part) -> float:
        point = self._points.get(asked.of)
        if point is None or point.kind != PROFILE or asked.unit not in METRES:
            return self.values.get(asked.of, asked.about)
        off_m = self.values.get(asked.of, 0.0) * METRES[asked.unit]
        return (asked.nominal or 0.0) + self._met(point, off_m, believed(part)) / METRES[asked.unit]

    def _met(self, point: MeasurementPoint, off_m: float, T: Floats) -> float:
        """How far (m) along the believed normal the true surface is from the believed point."""
        p, n = np.array([point.position]), np.array(point.normal)
        now, along = self.T[:3, :3] @ n, T[:3, :3] @ n
        gap = now @ (apply(self.T, p)[0] - apply(T, p)[0]) + off_m
        return float(gap / (now @ along))


def believed(part: Part) -> Floats:
    """A displacement (4, 4) from the twelve numbers of its first three rows; none stands for no displacement."""
    found: Floats = (
        np.vstack([np.array(part, float).reshape(3, 4), [0.0, 0.0, 0.0, 1.0]]) if part else np.eye(4)
    )
    return found


def read_truth(file: str, problem: Problem, seed: int) -> Truth:
    """The truth in a file. Raises `InvalidInput`."""
    try:
        said = parsed(read_file(Path(file)).text)
    except ValueError as error:
        raise _refused(file, f"not JSON: {error}") from None
    if not isinstance(said, dict) or (strange := sorted(set(said) - set(KEYS))):
        told = f"unknown key '{strange[0]}'" if isinstance(said, dict) else "no JSON object"
        raise _refused(file, told)
    shift, turn = (
        np.array(_numbers(file, said, key, 3) or (0.0, 0.0, 0.0)) for key in ("shift_mm", "turn_deg")
    )
    maps = {key: _mapped(file, said, key) for key in ("values", "noise", "bad")}
    drifting = Drifting(_drifts(file, said, problem))
    T = transform(turned(np.radians(turn)), 1e-3 * shift)
    return Truth(problem, T, seed=seed, drifting=drifting, **maps)


def _drifts(file: str, said: Mapping[str, Any], problem: Problem) -> dict[str, Drift]:
    told, found = said.get("drift", {}), dict[str, Drift]()
    if not isinstance(told, dict):
        raise _refused(file, "`drift` does not say of each tool how it drifts")
    operators = [each.name for each in problem.domain.operators]
    for tool, entry in told.items():
        drift = drift_of(entry)
        if isinstance(drift, str):
            raise _refused(file, f"`drift` of {tool}: {drift}")
        if drift.calibrated_by not in operators:
            raise InvalidInput([unknown_name("operator", drift.calibrated_by, operators, Source(file))])
        found[str(tool)] = drift
    return found


def _numbers(file: str, said: Mapping[str, Any], key: str, count: int) -> tuple[float, ...]:
    found = said.get(key, [])
    if (
        not isinstance(found, list)
        or not all(is_number(each, 1e9) for each in found)
        or len(found) not in (0, count)
    ):
        raise _refused(file, f"`{key}` is no list of {count} numbers")
    return tuple(map(float, found))


def _mapped(file: str, said: Mapping[str, Any], key: str) -> dict[str, float]:
    found = said.get(key, {})
    if not isinstance(found, dict) or not all(is_number(each, 1e12) for each in found.values()):
        raise _refused(file, f"`{key}` gives no number to each name")
    return {str(name): float(each) for name, each in found.items()}


def _refused(file: str, message: str) -> InvalidInput:
    return InvalidInput([Diagnostic(Source(file), "K413", message, HINT)])
