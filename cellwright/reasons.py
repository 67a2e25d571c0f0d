"""Why: why there is no plan, why a step is in a plan, and what is wrong with files."""

from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING, Any

from cellwright.answers import Answer
from cellwright.plans import Planned, plan_of
from cellwright.requests import Target, limited, load, name_of

if TYPE_CHECKING:
    from rich.console import RenderableType

    from cellwright.engine.model.explanation import Explanation, StepReason
    from cellwright.engine.pipelines.checking import CheckReport
    from cellwright.kb.diagnostics import Diagnostic


@dataclass(frozen=True, repr=False)
class Explained(Answer):
    """Why a problem has no plan, and the smallest changes that would allow one."""

    explanation: "Explanation"

    @property
    def status(self) -> str:
        """feasible, infeasible or unknown."""
        return self.explanation.status

    def data(self) -> Mapping[str, Any]:
        """Goals, exclusions and changes."""
        from cellwright.engine.formats.report.explanation import explanation_entry

        return explanation_entry(self.explanation)

    def _renderable(self) -> "RenderableType":
        from cellwright.engine.formats.report.explanation import explanation

        return explanation(self.explanation)


def explain(
    target: Target,
    *,
    goals: str = "",
    command: str = "",
    seconds: float | None = None,
    expansions: int = 1_000_000,
) -> Explained:
    """Explain why there is no plan. Each change that is offered is proved by a plan. Raises `InvalidInput`, `TimeoutError`."""
    from cellwright.engine.pipelines import explanation
    from cellwright.engine.stages.planning import Limits

    with limited(seconds) as over:
        problem = load(target, goals, command)
        return Explained(explanation.explain(problem, Limits(expansions=expansions, interrupted=over)))


@dataclass(frozen=True, repr=False)
class Reason(Answer):
    """Why a step is in a plan, and why it stands where it stands."""

    reason: "StepReason"

    @property
    def status(self) -> str:
        """ok."""
        return "ok"

    def data(self) -> Mapping[str, Any]:
        """Purposes and orders."""
        from cellwright.engine.formats.report.explanation import step_entry

        return step_entry(self.reason)

    def _renderable(self) -> "RenderableType":
        from cellwright.engine.formats.report.explanation import step_reason

        return step_reason(self.reason)


def why(plan: "Planned | str | PathLike[str]", step: int) -> Reason:
    """Explain a step of a plan by its number: what it serves, up to the goals. Raises `InvalidInput`."""
    from cellwright.engine.pipelines.explanation import steps
    from cellwright.engine.stages.grounding import ground

    problem, made, _, name = plan_of(plan)
    return Reason(steps.why(ground(problem), made, step, name))


@dataclass(frozen=True, repr=False)
class Checked(Answer):
    """Everything that is wrong with files. It counts as true if nothing is."""

    report: "CheckReport"

    def __bool__(self) -> bool:
        return not self.report.diagnostics

    @property
    def status(self) -> str:
        """ok, warnings or errors."""
        from cellwright.kb.diagnostics import errors

        found = self.report.diagnostics
        return "errors" if errors(found) else "warnings" if found else "ok"

    @property
    def diagnostics(self) -> "tuple[Diagnostic, ...]":
        """The findings, the most important first."""
        return self.report.diagnostics

    def data(self) -> Mapping[str, Any]:
        """The files that were looked at."""
        return {"checked": list(self.report.checked)}

    def _renderable(self) -> "RenderableType":
        from rich.console import Group
        from rich.text import Text

        from cellwright.engine.formats.report.findings import diagnostics, summary

        found = self.report.diagnostics
        said = Text(f"{summary(found)} in {len(self.report.checked)} files")
        return Group(diagnostics(found), said) if found else said


def check(target: Target, *, reach: bool = True) -> Checked:
    """Look for errors in a domain, its problems, cell, fault base and contact model; with `reach`, for places out of reach."""
    from cellwright.engine.pipelines import checking

    return Checked(checking.check(name_of(target), reach))
