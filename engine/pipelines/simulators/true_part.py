"""True part in a simulated cell: hidden position, sizes, and tools that err and drift.

In the truth, `drift` says for a tool by how much each of its values is farther off than the one
before (`per_value`, in the unit of the measurement), which steps calibrate it (`calibrated_by`, the
name of an operator), what a calibration allows (`allowance`), and which cause of the fault base is
there when it finds more than that (`cause`). With `values`, it drifts in its first so many values
only, as it warms up.
"""

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import apply, rotation_by_vector, transform
from cellwright.engine.model.part_measurements import MeasurementPoint
from cellwright.engine.pipelines.inspection.measurement_points import (
    METRES_PER_UNIT,
    PROFILE_KIND,
    points_of_problem,
    with_places,
)
from cellwright.engine.pipelines.inspection.nominal_values import ExpectedValue, MeasurementJudge
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from cellwright.kb.files import read_file
from cellwright.kb.json_text import parse_json
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.numbers import is_number
from cellwright.kb.terms import Function

DRIFT_KEYS = ("per_value", "calibrated_by", "allowance", "cause")
WARM_KEY = "values"


@dataclass(frozen=True, slots=True)
class ToolDrift:
    """How a tool drifts, and how that is noticed."""

    per_value: float
    calibrated_by: str
    allowance: float
    cause: str
    values: int | None = None


@dataclass
class DriftingTools:
    """The tools that drift, how far off each is, and how many values it has measured."""

    tools: Mapping[str, ToolDrift] = field(default_factory=dict)
    now: dict[str, float] = field(default_factory=dict)
    count: dict[str, int] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.tools)

    def off(self, tool: str) -> float:
        """How far a tool is off now, in the unit of its measurements."""
        return self.now.get(tool, 0.0)

    def measured(self, tool: str) -> float:
        """How far the value is off that a tool measures now; the next one is farther off."""
        offset, drift = self.off(tool), self.tools.get(tool)
        if drift is not None:
            self.count[tool] = self.count.get(tool, 0) + 1
            if drift.values is None or self.count[tool] <= drift.values:
                self.now[tool] = offset + drift.per_value
        return offset

    def calibrates(self, step: Function) -> str | None:
        """The tool that drifts and that a step calibrates; None if there is none."""
        names = {str(argument) for argument in step.arguments}
        calibrated = (
            tool
            for tool, drift in self.tools.items()
            if drift.calibrated_by == step.name and tool in names
        )
        return next(calibrated, None)

    def found(self, step: Function) -> str | None:
        """The cause that a step finds: its tool is farther off than is allowed.

        None if all is well, or if it calibrates nothing.
        """
        tool = self.calibrates(step)
        if tool is None or abs(self.off(tool)) <= self.tools[tool].allowance:
            return None
        return self.tools[tool].cause

    def calibrated(self, step: Function) -> None:
        """A step was carried out: if it calibrates a tool, this is right again."""
        if (tool := self.calibrates(step)) is not None:
            self.now[tool] = 0.0


def drift_of(said: object) -> ToolDrift | str:
    """The drift that a file tells of a tool, or what is wrong with it."""
    if not isinstance(said, dict) or sorted(map(str, set(said) - {WARM_KEY})) != sorted(DRIFT_KEYS):
        return f"needs {', '.join(DRIFT_KEYS[:-1])} and {DRIFT_KEYS[-1]}, and may have {WARM_KEY}"
    content: dict[str, Any] = said
    for key in ("per_value", "allowance", *([WARM_KEY] if WARM_KEY in content else [])):
        if not is_number(content[key], 1e9):
            return f"{key} is no number"
    if content["allowance"] < 0:
        return "allowance is negative"
    return ToolDrift(
        float(content["per_value"]),
        str(content["calibrated_by"]),
        float(content["allowance"]),
        str(content["cause"]),
        int(content[WARM_KEY]) if WARM_KEY in content else None,
    )


TRUTH_KEYS = ("shift_mm", "turn_deg", "values", "noise", "bad", "drift")
TRUTH_HINT = f"one JSON object with any of {', '.join(TRUTH_KEYS)}"
Part = Sequence[float]


@dataclass
class PartTruth:
    """The hidden truth of one part and the tools that measure it.

    Lengths of places are in metres.
    """

    problem: Problem
    T: Floats = field(default_factory=lambda: np.eye(4))
    values: Mapping[str, float] = field(default_factory=dict)
    noise: Mapping[str, float] = field(default_factory=dict)
    bad: Mapping[str, float] = field(default_factory=dict)
    seed: int = 0
    drifting: DriftingTools = field(default_factory=DriftingTools)

    def __post_init__(self) -> None:
        self._measuring = MeasurementJudge(self.problem)
        self._points = {point.name: point for point in points_of_problem(with_places(self.problem))}
        self._times: dict[str, int] = {}

    def value(self, step: Function, part: Part = ()) -> str | None:
        """What a step measures, as a term; None if it measures nothing. `part` is where the arm
        believes the part to lie.
        """
        asked = self._measuring.expected(step)
        if asked is None:
            return None
        time = self._times[asked.of] = self._times.get(asked.of, 0) + 1
        chance = random.Random(f"{self.seed} {asked.of} {asked.quantity} {asked.tool} {time}")
        measured = self._true(asked, part) + chance.gauss(0.0, self.noise.get(asked.tool, 0.0))
        measured += self.bad.get(asked.of, 0.0) if time == 1 else 0.0
        measured += self.drifting.measured(asked.tool)
        return str(round(measured)) if asked.unit in ("um", "nm") else f'"{measured:.4f}"'

    def _true(self, asked: ExpectedValue, part: Part) -> float:
        point = self._points.get(asked.of)
        if point is None or point.kind != PROFILE_KIND or asked.unit not in METRES_PER_UNIT:
            return self.values.get(asked.of, asked.about)
        off_m = self.values.get(asked.of, 0.0) * METRES_PER_UNIT[asked.unit]
        return (asked.nominal or 0.0) + self._met(
            point, off_m, displacement_of(part)
        ) / METRES_PER_UNIT[asked.unit]

    def _met(self, point: MeasurementPoint, off_m: float, T: Floats) -> float:
        """How far (m) along the believed normal the true surface is from the believed point."""
        p, n = np.array([point.position]), np.array(point.normal)
        now, along = self.T[:3, :3] @ n, T[:3, :3] @ n
        gap = now @ (apply(self.T, p)[0] - apply(T, p)[0]) + off_m
        return float(gap / (now @ along))


def displacement_of(part: Part) -> Floats:
    """A displacement (4, 4) from the twelve numbers of its first three rows; none stands for no
    displacement.
    """
    displacement: Floats = (
        np.vstack([np.array(part, float).reshape(3, 4), [0.0, 0.0, 0.0, 1.0]])
        if part
        else np.eye(4)
    )
    return displacement


def read_truth(file: str, problem: Problem, seed: int) -> PartTruth:
    """The truth in a file. Raises `InvalidInput`."""
    try:
        content = parse_json(read_file(Path(file)).text)
    except ValueError as error:
        raise _truth_error(file, f"not JSON: {error}") from None
    if not isinstance(content, dict) or (strange := sorted(set(content) - set(TRUTH_KEYS))):
        reason = f"unknown key '{strange[0]}'" if isinstance(content, dict) else "no JSON object"
        raise _truth_error(file, reason)
    shift, turn = (
        np.array(_read_numbers(file, content, key, 3) or (0.0, 0.0, 0.0))
        for key in ("shift_mm", "turn_deg")
    )
    maps = {key: _read_values(file, content, key) for key in ("values", "noise", "bad")}
    drifting = DriftingTools(_read_drifts(file, content, problem))
    T = transform(rotation_by_vector(np.radians(turn)), 1e-3 * shift)
    return PartTruth(problem, T, seed=seed, drifting=drifting, **maps)


def _read_drifts(file: str, said: Mapping[str, Any], problem: Problem) -> dict[str, ToolDrift]:
    entries, drifts = said.get("drift", {}), dict[str, ToolDrift]()
    if not isinstance(entries, dict):
        raise _truth_error(file, "`drift` does not say of each tool how it drifts")
    operators = [operator.name for operator in problem.domain.operators]
    for tool, entry in entries.items():
        drift = drift_of(entry)
        if isinstance(drift, str):
            raise _truth_error(file, f"`drift` of {tool}: {drift}")
        if drift.calibrated_by not in operators:
            raise InvalidInput(
                [unknown_name("operator", drift.calibrated_by, operators, Source(file))]
            )
        drifts[str(tool)] = drift
    return drifts


def _read_numbers(file: str, said: Mapping[str, Any], key: str, count: int) -> tuple[float, ...]:
    numbers = said.get(key, [])
    if (
        not isinstance(numbers, list)
        or not all(is_number(number, 1e9) for number in numbers)
        or len(numbers) not in (0, count)
    ):
        raise _truth_error(file, f"`{key}` is no list of {count} numbers")
    return tuple(map(float, numbers))


def _read_values(file: str, said: Mapping[str, Any], key: str) -> dict[str, float]:
    values = said.get(key, {})
    if not isinstance(values, dict) or not all(is_number(value, 1e12) for value in values.values()):
        raise _truth_error(file, f"`{key}` gives no number to each name")
    return {str(name): float(value) for name, value in values.items()}


def _truth_error(file: str, message: str) -> InvalidInput:
    return InvalidInput([Diagnostic(Source(file), "K413", message, TRUTH_HINT)])
