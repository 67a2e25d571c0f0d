"""Plans: found, checked, repaired and explained; and all errors in the files of a domain."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from cellwright.engine.formats import report as reports
from cellwright.engine.formats.report import rich_parts
from cellwright.engine.model.outcome import Found
from cellwright.engine.model.planning_choices import PlanningObjective, SequenceChoice
from cellwright.engine.pipelines import motion as motion_room
from cellwright.engine.pipelines import planning
from cellwright.engine.plugins import geometry_backend
from cellwright.kb import loader
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, select_errors, unknown_name
from cellwright.kb.diagnostics import Source as Where
from cellwright.kb.model.plan_model import Claims
from cellwright.kb.stopping import StoppedByCaller, is_stop_wanted
from cellwright.library_base import Answer, Deadline, Name, Target, limit_seconds, load, name_of

if TYPE_CHECKING:
    from rich.console import RenderableType

    from cellwright.engine.authoring.domain_check import CheckReport
    from cellwright.engine.formats.report.plans.plan_answer import PlanAnswer
    from cellwright.engine.model.outcome import Outcome
    from cellwright.engine.model.plan_explanation import Explanation, StepReason
    from cellwright.engine.pipelines.motion.moving_plan import MovingRun
    from cellwright.engine.pipelines.planning.plan_objective import Run
    from cellwright.engine.pipelines.recovery.plan_revision import PlanRevision
    from cellwright.engine.stages.planning import SearchLimits
    from cellwright.kb.model.plan_model import Plan, StepId
    from cellwright.kb.model.planning_problem import Problem
    from cellwright.kb.terms import Atom

Strategy = Literal["auto", "backward", "forward", "landmarks", "asp", "shortest", "race"]


@dataclass(frozen=True, repr=False)
class Planned(Answer):
    """The result of planning: a plan with its times, or why there is none."""

    made: "PlanAnswer" = field(compare=False)
    store: str = ""

    @property
    def problem(self) -> "Problem":
        """The problem that was planned for."""
        return self.made.problem

    @property
    def outcome(self) -> "Outcome":
        """`Found` with a checked plan, `Infeasible` if it is proved that there is none, or
        `GaveUp`, each with a reason.
        """
        return self.made.run.outcome

    @property
    def plan(self) -> "Plan | None":
        """The plan; None if there is none."""
        return self.outcome.plan if isinstance(self.outcome, Found) else None

    @property
    def starts(self) -> "Mapping[StepId, int] | None":
        """When each step starts, in the unit of time of the domain; None if no step takes time."""
        return self.made.run.starts

    @property
    def motions(self) -> "MovingRun | None":
        """The motions of the steps, if they were asked for."""
        return self.made.moving

    @property
    def status(self) -> str:
        """optimal, found, infeasible, gave up or stopped."""
        return reports.outcome_status(self.outcome)

    @property
    def diagnostics(self) -> "tuple[Diagnostic, ...]":
        """A warning if the library could not keep what was learned."""
        return reports.library_warnings(self.made.origin, self.store)

    def data(self) -> Mapping[str, Any]:
        """The plan with its problem. Written to a file, `json()` is a plan file."""
        return reports.plan_answer_content(self.made, stats=False)

    def svg(self) -> str | None:
        """The partial order of the plan as a picture."""
        return reports.draw_plan(self.plan, self.problem) if self.plan else None

    def dot(self) -> str | None:
        """The partial order of the plan for Graphviz."""
        return reports.plan_dot(self.plan, self.problem) if self.plan else None

    def _renderable(self) -> "RenderableType":
        return reports.plan_answer_text(self.made, stats=False, folded=False)


def plan(
    target: Target,
    *,
    goals: str = "",
    command: str = "",
    objective: Literal["cost", "makespan"] | None = None,
    order: Literal["sequence", "free"] = "sequence",
    strategy: Strategy = "auto",
    anytime: bool = False,
    motion: bool = False,
    store: Name = "",
    seconds: float | None = None,
    expansions: int | None = None,
    seed: int = 0,
) -> Planned:
    """Plan for a target, in words or goals. The checker has accepted every plan that is returned.

    `objective` is what the plan shall have least of; without it the makespan where steps take time,
    else the cost. `order` says who orders measurements. With `anytime` the plan is improved until
    `seconds` are over, with `motion` every step has a path that touches nothing. `store` is a
    library of MACROPs, read and taught. Raises `InvalidInput`, `TimeoutError`.
    """
    library = fspath(store)
    with limit_seconds(seconds) as over:
        problem, limits = (
            load(target, goals, command),
            _planning_limits(over, expansions, strategy, anytime, seed),
        )
        wish, who = (
            PlanningObjective(objective) if objective else None,
            SequenceChoice(order),
        )
        if motion:
            moving = plan_motions_of(
                problem,
                lambda each: planning.plan_for_objective(each, limits, wish, who),
                seed,
                library,
            )
            return Planned(reports.PlanAnswer(moving.run, moving.problem, moving=moving), library)
        run, origin = planning.plan_with_library(
            problem, limits, wish, who, library, folded=False, stays=True
        )
    return Planned(reports.PlanAnswer(run, problem, origin), library)


def _planning_limits(
    over: Deadline, expansions: int | None, strategy: str, thorough: bool, seed: int
) -> "SearchLimits":
    from cellwright.engine.stages.planning import RACE, STRATEGIES, SearchLimits, expansions_within

    if strategy not in (*STRATEGIES, RACE):
        raise InvalidInput(
            [unknown_name("strategy", strategy, {*STRATEGIES, RACE}, Source("strategy"))]
        )
    most = expansions_within(expansions, over.seconds)
    return SearchLimits(most, interrupted=over, thorough=thorough, strategy=strategy, seed=seed)


def plan_motions_of(problem: "Problem", planned: Any, seed: int, store: str) -> "MovingRun":
    """The plan in which every step moves; `planned` makes the `Run` of a problem."""

    def in_time(each: "Problem") -> "Run":
        run: Run = planned(each)
        if is_stop_wanted():
            raise StoppedByCaller
        return run

    return motion_room.plan_with_poses(
        problem, loader.cell_of_problem(problem), geometry_backend(), in_time, seed, store
    ).moving


def plan_of(source: "Planned | str | PathLike[str]") -> "tuple[Problem, Plan, Claims | None, str]":
    """The problem and the plan of an answer or a plan file, and what the file claims.

    Raises `InvalidInput`.
    """
    if not isinstance(source, Planned):
        return *planning.claimed_in(Path(source)), fspath(source)
    if source.plan is None:
        reason = source.outcome.reason  # type: ignore[union-attr]
        raise InvalidInput(
            [Diagnostic(Where(source.problem.name), "K404", "there is no plan", reason)]
        )
    return source.problem, source.plan, Claims(dict(source.starts or {})), source.problem.name


@dataclass(frozen=True, repr=False)
class Verdict(Answer):
    """What the independent checker says of a plan. It counts as true if the plan is right."""

    plan: "Plan"
    found: "tuple[Diagnostic, ...]"
    cost: str = "0"

    def __bool__(self) -> bool:
        return not self.found

    @property
    def status(self) -> str:
        """valid or invalid."""
        return "invalid" if self.found else "valid"

    @property
    def diagnostics(self) -> "tuple[Diagnostic, ...]":
        """Everything that is wrong."""
        return self.found

    def data(self) -> Mapping[str, Any]:
        """How many steps and causal links were looked at."""
        return {"steps": len(self.plan.steps), "links": len(self.plan.links)}

    def _renderable(self) -> "RenderableType":
        summary_text = rich_parts.Text(
            f"{self.status}: {len(self.plan.steps)} steps, cost {self.cost}"
        )
        return (
            rich_parts.Group(summary_text, reports.diagnostics_text(self.found))
            if self.found
            else summary_text
        )


def validate(plan: "Planned | str | PathLike[str]", problem: Target | None = None) -> Verdict:
    """Check a plan, or a plan file, with the independent checker: against its own problem or
    another one.

    Raises `InvalidInput` for a file that is no plan.
    """
    from cellwright.engine.model.task_costs import cost_text
    from cellwright.engine.pipelines.planning.plan_files import check_plan

    own, made, claims, name = plan_of(plan)
    asked = own if problem is None else load(problem)
    found = tuple(check_plan(asked, made, name, claims))
    return Verdict(made, found, cost_text(made.cost, asked.domain))


@dataclass(frozen=True, repr=False)
class Revised(Answer):
    """A plan that was repaired or replaced after the world had changed."""

    revision: "PlanRevision"
    follows: "tuple[tuple[Atom, bool], ...]"

    @property
    def outcome(self) -> "Outcome":
        """The new plan, or why there is none."""
        return self.revision.outcome

    @property
    def status(self) -> str:
        """As of a plan."""
        return reports.outcome_status(self.outcome)

    def data(self) -> Mapping[str, Any]:
        """The new plan, and what of the old one was kept, dropped and added."""
        plan = reports.outcome_entry(self.outcome, self.revision.problem)
        return {**plan, "revision": reports.revision_entry(self.revision, self.follows)}

    def svg(self) -> str | None:
        """The partial order of the new plan as a picture."""
        outcome = self.outcome
        return (
            reports.draw_plan(outcome.plan, self.revision.problem)
            if isinstance(outcome, Found)
            else None
        )

    def _renderable(self) -> "RenderableType":
        return reports.revision_text(self.revision, self.follows)


def revise(
    plan: "Planned | str | PathLike[str]",
    *,
    done: str = "",
    holds: str = "",
    gone: str = "",
    lost: str = "",
    both: bool = False,
    seconds: float | None = None,
    expansions: int | None = None,
    seed: int = 0,
) -> Revised:
    """Repair a plan for what was observed, or replan, whichever is cheaper; with `both`, always try
    both.

    `done` are steps ("1..4, 7"), `holds` and `gone` facts, `lost` tools and resources. Raises
    `InvalidInput`, `TimeoutError`.
    """
    from cellwright.engine.pipelines.recovery.observations import revised_now
    from cellwright.engine.pipelines.recovery.replanning import plan_in_sequence
    from cellwright.engine.stages.planning import SearchLimits, expansions_within

    with limit_seconds(seconds) as over:
        problem, old_plan, _, _ = plan_of(plan)
        limits = SearchLimits(expansions_within(expansions, seconds), interrupted=over, seed=seed)
        return Revised(
            *revised_now(
                problem, old_plan, (done, holds, gone, lost), limits, both, plan_in_sequence
            )
        )


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
        return reports.explanation_entry(self.explanation)

    def _renderable(self) -> "RenderableType":
        return reports.explanation_text(self.explanation)


def explain(
    target: Target,
    *,
    goals: str = "",
    command: str = "",
    seconds: float | None = None,
    expansions: int | None = None,
) -> Explained:
    """Explain why there is no plan.

    Each change that is offered is proved by a plan. Raises `InvalidInput`, `TimeoutError`.
    """
    from cellwright.engine.pipelines import explanation
    from cellwright.engine.stages.planning import SearchLimits, expansions_within

    with limit_seconds(seconds) as over:
        problem = load(target, goals, command)
        limits = SearchLimits(expansions_within(expansions, seconds), interrupted=over)
        return Explained(explanation.explain_infeasibility(problem, limits))


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
        return reports.step_entry(self.reason)

    def _renderable(self) -> "RenderableType":
        return reports.step_reason(self.reason)


def why(plan: "Planned | str | PathLike[str]", step: int) -> Reason:
    """Explain a step of a plan by its number: what it serves, up to the goals.

    Raises `InvalidInput`.
    """
    from cellwright.engine.pipelines.explanation import step_purposes
    from cellwright.engine.stages.grounding import ground

    problem, explained_plan, _, name = plan_of(plan)
    return Reason(step_purposes.explain_step(ground(problem), explained_plan, step, name))


@dataclass(frozen=True, repr=False)
class Checked(Answer):
    """Everything that is wrong with files. It counts as true if nothing is."""

    report: "CheckReport"

    def __bool__(self) -> bool:
        return not self.report.diagnostics

    @property
    def status(self) -> str:
        """ok, warnings or errors."""
        diagnostics = self.report.diagnostics
        return "errors" if select_errors(diagnostics) else "warnings" if diagnostics else "ok"

    @property
    def diagnostics(self) -> "tuple[Diagnostic, ...]":
        """The findings, the most important first."""
        return self.report.diagnostics

    def data(self) -> Mapping[str, Any]:
        """The files that were looked at."""
        return {"checked": list(self.report.checked)}

    def _renderable(self) -> "RenderableType":
        found_diagnostics = self.report.diagnostics
        summary_text = rich_parts.Text(
            f"{reports.diagnostics_summary(found_diagnostics)} in {len(self.report.checked)} files"
        )
        return (
            rich_parts.Group(reports.diagnostics_text(found_diagnostics), summary_text)
            if found_diagnostics
            else summary_text
        )


def check(target: Target, *, reach: bool = True) -> Checked:
    """Look for errors in a domain, its problems, cell, fault base and contact model; with
    `reach`, for places out of reach.
    """
    from cellwright.engine.authoring import domain_check

    return Checked(domain_check.check_domain_files(name_of(target), reach))
