"""Answers about plans whose steps last as long as they like."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from cellwright.engine.model.start_rules import StartRules
from cellwright.kb.model.plan_model import StepId


@dataclass(frozen=True, slots=True)
class WindowChance:
    """With which chance a window is kept, from 0 to 1."""

    says: str
    chance: float

    def entry(self) -> dict[str, Any]:
        """The same for JSON."""
        return {"window": self.says, "chance": round(self.chance, 4)}


@dataclass(frozen=True, slots=True)
class NarrowedRange:
    """A range that would have to be narrower: of a step, what it is, and what it should be."""

    step: StepId
    operator: str
    before: tuple[int, int]
    after: tuple[int, int]

    def entry(self) -> dict[str, Any]:
        """The same for JSON."""
        return {"step": int(self.step), "range": list(self.before), "within": list(self.after)}


@dataclass(frozen=True, slots=True)
class WidenedWindow:
    """A window that would have to be wider by so many units of time."""

    says: str
    by: int

    def entry(self) -> dict[str, Any]:
        """The same for JSON."""
        return {"window": self.says, "by": self.by}


@dataclass(frozen=True, slots=True)
class RobustPlan:
    """What is known of a plan with ranges.

    `rules` are those of a policy that keeps every window whatever happens in the ranges. If there
    is none, `rules` is empty, `cycle` says in words what does not go together and `lacks` by how
    much time; `widened` is the least sum of changes of windows after which there is a policy,
    `narrowed` are the ranges within which `narrowed_rules` keep all windows: durations stay in them
    with the chance `within`. `chances` are those of windows if the plan is executed without a
    policy, `kept` that all are kept.
    """

    varying: int
    rules: StartRules = field(default_factory=dict)
    cycle: tuple[str, ...] = ()
    lacks: int = 0
    widened: tuple[WidenedWindow, ...] | None = None
    narrowed: tuple[NarrowedRange, ...] | None = None
    narrowed_rules: StartRules = field(default_factory=dict)
    within: float = 1.0
    chances: tuple[WindowChance, ...] = ()
    kept: float = 1.0
    worst_end: int = 0  # when all has ended at the latest, with the policy
    notes: tuple[str, ...] = ()
    learned: tuple[str, ...] = ()  # what ranges were learned from, in words

    @property
    def is_robust(self) -> bool:
        """Whether there is a policy."""
        return not self.cycle


def rules_entry(rules: StartRules) -> list[dict[str, Any]]:
    """Rules for JSON: what each step waits for."""

    def lags(times: Mapping[int, int]) -> list[dict[str, int]]:
        return [{"step": step, "time": time} for step, time in sorted(times.items())]

    entries = []
    for step, rule in rules.items():
        parts = {
            "not_before": rule.floor,
            "after_starts": lags(rule.starts),
            "after_ends": lags(rule.ends),
            "waits": lags(rule.waits),
        }
        entries.append({"step": step} | {name: part for name, part in parts.items() if part})
    return entries
