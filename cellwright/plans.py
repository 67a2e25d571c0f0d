"""Plans: found, checked, repaired."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from cellwright.answers import Answer
from cellwright.requests import Deadline, Name, Target, limited, load, name_of

if TYPE_CHECKING:
    from rich.console import RenderableType

    from cellwright.engine.formats.report.planned import Made
    from cellwright.engine.model.outcome import Outcome
    from cellwright.engine.pipelines.moves.planning import Moving
    from cellwright.engine.pipelines.objective import Run
    from cellwright.engine.pipelines.revision import PlanRevision
    from cellwright.engine.stages.planning import Limits
    from cellwright.kb.diagnostics import Diagnostic
    from cellwright.kb.model.plan import Claims, Plan, StepId
    from cellwright.kb.model.problem import Problem
    from cellwright.kb.terms import Atom

Strategy = Literal["auto", "backward", "forward", "landmarks", "asp", "shortest", "race"]


@dataclass(frozen=True, repr=False)
class Planned(Answer):
    """The result of planning: a plan with its times, or why there is none."""

    made: "Made" = field(compare=False)
    store: str = ""

    @property
    def problem(self) -> "Problem":
        """The problem that was planned for."""
        return self.made.problem

    @property
    def outcome(self) -> "Outcome":
        """`Found` with a checked plan, `Infeasible` if it is proved that there is none, or `GaveUp`, each with a reason."""
        return self.made.run.outcome

    @property
    def plan(self) -> "Plan | None":
        """The plan; None if there is none."""
        from cellwright.engine.model.outcome import Found

        return self.outcome.plan if isinstance(self.outcome, Found) else None

    @property
    def starts(self) -> "Mapping[StepId, int] | None":
        """When each step starts, in the unit of time of the domain; None if no step takes time."""
        return self.made.run.starts

    @property
    def motions(self) -> "Moving | None":
        """The motions of the steps, if they were asked for."""
        return self.made.moving

    @property
    def status(self) -> str:
        """optimal, found, infeasible, gave up or stopped."""
        from cellwright.engine.formats.report import json

        return json.status(self.outcome)

    @property
    def diagnostics(self) -> "tuple[Diagnostic, ...]":
        """A warning if the library could not keep what was learned."""
        from cellwright.engine.formats.report.planned import losses

        return losses(self.made.origin, self.store)

    def data(self) -> Mapping[str, Any]:
        """The plan with its problem. Written to a file, `json()` is a plan file."""
        from cellwright.engine.formats.report.planned import document

        return document(self.made, stats=False)

    def svg(self) -> str | None:
        """The partial order of the plan as a picture."""
        from cellwright.engine.formats.report import svg

        return svg.plan(self.plan, self.problem) if self.plan else None

    def dot(self) -> str | None:
        """The partial order of the plan for Graphviz."""
        from cellwright.engine.formats.report import dot

        return dot.plan(self.plan, self.problem) if self.plan else None

    def _renderable(self) -> "RenderableType":
        from cellwright.engine.formats.report.planned import text

        return text(self.made, stats=False, folded=False)


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
    expansions: int = 1_000_000,
    seed: int = 0,
) -> Planned:
    """Plan for a target, in words or goals. The checker has accepted every plan that is returned.

    `objective` is what the plan shall have least of; without it the makespan where steps take time, else the cost. `order`
    says who orders measurements. With `anytime` the plan is improved until `seconds` are over, with `motion` every step has
    a path that touches nothing. `store` is a library of MACROPs, read and taught. Raises `InvalidInput`, `TimeoutError`.
    """
    from cellwright.engine.formats.report.planned import Made
    from cellwright.engine.pipelines.objective import Objective, Order
    from cellwright.engine.pipelines.recall import planned

    library = fspath(store)
    with limited(seconds) as over:
        problem, limits = load(target, goals, command), _limits(over, expansions, strategy, anytime, seed)
        wish, who = Objective(objective) if objective else None, Order(order)
        if motion:
            from cellwright.engine.pipelines.objective import plan as planned_alone

            moving = moved(
                name_of(target), problem, lambda each: planned_alone(each, limits, wish, who), seed, library
            )
            return Planned(Made(moving.run, moving.problem, moving=moving), library)
        run, origin = planned(problem, limits, wish, who, library, folded=False, stays=True)
    return Planned(Made(run, problem, origin), library)


def _limits(over: Deadline, expansions: int, strategy: str, thorough: bool, seed: int) -> "Limits":
    from cellwright.engine.stages.planning import RACE, STRATEGIES, Limits
    from cellwright.kb.diagnostics import InvalidInput, Source, unknown_name

    if strategy not in (*STRATEGIES, RACE):
        raise InvalidInput([unknown_name("strategy", strategy, {*STRATEGIES, RACE}, Source("strategy"))])
    return Limits(expansions, interrupted=over, thorough=thorough, strategy=strategy, seed=seed)


def moved(target: str, problem: "Problem", planned: Any, seed: int, store: str) -> "Moving":
    """The plan in which every step moves; `planned` makes the `Run` of a problem."""
    from cellwright.engine.pipelines.poses.planning import plan_with_poses
    from cellwright.engine.plugins import geometry_backend
    from cellwright.kb.loader.cell import cell_of
    from cellwright.kb.stopping import Stopped, wanted

    def in_time(each: "Problem") -> "Run":
        run: Run = planned(each)
        if wanted():
            raise Stopped
        return run

    return plan_with_poses(problem, cell_of(target), geometry_backend(), in_time, seed, store).moving


def plan_of(source: "Planned | str | PathLike[str]") -> "tuple[Problem, Plan, Claims | None, str]":
    """The problem and the plan of an answer or a plan file, and what the file claims. Raises `InvalidInput`."""
    from cellwright.kb.diagnostics import Diagnostic, InvalidInput
    from cellwright.kb.diagnostics import Source as Where

    if not isinstance(source, Planned):
        from cellwright.engine.pipelines.plan_files import claimed_in

        return *claimed_in(Path(source)), fspath(source)
    if source.plan is None:
        raise InvalidInput(
            [Diagnostic(Where(source.problem.name), "K404", "there is no plan", source.outcome.reason)]  # type: ignore[union-attr]
        )
    from cellwright.kb.model.plan import Claims

    return source.problem, source.plan, Claims(dict(source.starts or {})), source.problem.name


@dataclass(frozen=True, repr=False)
class Verdict(Answer):
    """What the independent checker says of a plan. It counts as true if the plan is right."""

    plan: "Plan"
    found: "tuple[Diagnostic, ...]"

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
        from rich.console import Group
        from rich.text import Text

        from cellwright.engine.formats.report.findings import diagnostics

        said = Text(f"{self.status}: {len(self.plan.steps)} steps, cost {self.plan.cost}")
        return Group(said, diagnostics(self.found)) if self.found else said


def validate(plan: "Planned | str | PathLike[str]", problem: Target | None = None) -> Verdict:
    """Check a plan, or a plan file, with the independent checker: against its own problem or another one.

    Raises `InvalidInput` for a file that is no plan.
    """
    from cellwright.engine.pipelines.plan_files import check_plan

    own, made, claims, name = plan_of(plan)
    asked = own if problem is None else load(problem)
    return Verdict(made, tuple(check_plan(asked, made, name, claims)))


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
        from cellwright.engine.formats.report import json

        return json.status(self.outcome)

    def data(self) -> Mapping[str, Any]:
        """The new plan, and what of the old one was kept, dropped and added."""
        from cellwright.engine.formats.report import json
        from cellwright.engine.formats.report.revised import entry

        plan = json.outcome(self.outcome, self.revision.problem)
        return {**plan, "revision": entry(self.revision, self.follows)}

    def svg(self) -> str | None:
        """The partial order of the new plan as a picture."""
        from cellwright.engine.formats.report import svg
        from cellwright.engine.model.outcome import Found

        found = self.outcome
        return svg.plan(found.plan, self.revision.problem) if isinstance(found, Found) else None

    def _renderable(self) -> "RenderableType":
        from cellwright.engine.formats.report.revised import text

        return text(self.revision, self.follows)


def revise(
    plan: "Planned | str | PathLike[str]",
    *,
    done: str = "",
    holds: str = "",
    gone: str = "",
    lost: str = "",
    both: bool = False,
    seconds: float | None = None,
    expansions: int = 1_000_000,
    seed: int = 0,
) -> Revised:
    """Repair a plan for what was observed, or replan, whichever is cheaper; with `both`, always try both.

    `done` are steps ("1..4, 7"), `holds` and `gone` facts, `lost` tools and resources. Raises `InvalidInput`, `TimeoutError`.
    """
    from cellwright.engine.pipelines.revision.now import revised_now
    from cellwright.engine.pipelines.troubleshooting.recovery import in_sequence
    from cellwright.engine.stages.planning import Limits

    with limited(seconds) as over:
        problem, made, _, _ = plan_of(plan)
        limits = Limits(expansions, interrupted=over, seed=seed)
        return Revised(*revised_now(problem, made, (done, holds, gone, lost), limits, both, in_sequence))
