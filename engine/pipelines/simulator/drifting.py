"""Tools of a simulated cell whose values drift, the more they measure, until they are calibrated.

In the truth, `drift` says for a tool by how much each of its values is farther off than the one before (`per_value`, in the unit of the
measurement), which steps calibrate it (`calibrated_by`, the name of an operator), what a calibration allows (`allowance`), and which cause of the
fault base is there when it finds more than that (`cause`). With `values`, it drifts in its first so many values only, as it warms up.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from cellwright.kb.numbers import is_number
from cellwright.kb.terms import Function

KEYS = ("per_value", "calibrated_by", "allowance", "cause")
WARM = "values"


@dataclass(frozen=True, slots=True)
class Drift:
    """How a tool drifts, and how that is noticed."""

    per_value: float
    calibrated_by: str
    allowance: float
    cause: str
    values: int | None = None


@dataclass
class Drifting:
    """The tools that drift, how far off each is, and how many values it has measured."""

    tools: Mapping[str, Drift] = field(default_factory=dict)
    now: dict[str, float] = field(default_factory=dict)
    count: dict[str, int] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.tools)

    def off(self, tool: str) -> float:
        """How far a tool is off now, in the unit of its measurements."""
        return self.now.get(tool, 0.0)

    def measured(self, tool: str) -> float:
        """How far the value is off that a tool measures now; the next one is farther off."""
        found, drift = self.off(tool), self.tools.get(tool)
        if drift is not None:
            self.count[tool] = self.count.get(tool, 0) + 1
            if drift.values is None or self.count[tool] <= drift.values:
                self.now[tool] = found + drift.per_value
        return found

    def calibrates(self, step: Function) -> str | None:
        """The tool that drifts and that a step calibrates; None if there is none."""
        names = {str(each) for each in step.arguments}
        found = (
            tool for tool, each in self.tools.items() if each.calibrated_by == step.name and tool in names
        )
        return next(found, None)

    def found(self, step: Function) -> str | None:
        """The cause that a step finds: its tool is farther off than is allowed. None if all is well, or if it calibrates nothing."""
        tool = self.calibrates(step)
        if tool is None or abs(self.off(tool)) <= self.tools[tool].allowance:
            return None
        return self.tools[tool].cause

    def calibrated(self, step: Function) -> None:
        """A step was carried out: if it calibrates a tool, this is right again."""
        if (tool := self.calibrates(step)) is not None:
            self.now[tool] = 0.0


def drift_of(said: object) -> Drift | str:
    """The drift that a file tells of a tool, or what is wrong with it."""
    if not isinstance(said, dict) or sorted(map(str, set(said) - {WARM})) != sorted(KEYS):
        return f"needs {', '.join(KEYS[:-1])} and {KEYS[-1]}, and may have {WARM}"
    told: dict[str, Any] = said
    for key in ("per_value", "allowance", *([WARM] if WARM in told else [])):
        if not is_number(told[key], 1e9):
            return f"{key} is no number"
    if told["allowance"] < 0:
        return "allowance is negative"
    return Drift(
        float(told["per_value"]),
        str(told["calibrated_by"]),
        float(told["allowance"]),
        str(told["cause"]),
        int(told[WARM]) if WARM in told else None,
    )
