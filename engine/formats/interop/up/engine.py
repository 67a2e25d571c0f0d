"""The engine for unified-planning: planner, anytime planner, validator, grounder and replanner in one class.

This module knows the library and the model. A subclass gives it the stages that do the work.
"""

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import IO, Any, ClassVar, Protocol

from unified_planning import model as up
from unified_planning.engines import CompilationKind, Engine, LogLevel, LogMessage, mixins
from unified_planning.engines import PlanGenerationResultStatus as Status
from unified_planning.engines.compilers.grounder import Grounder
from unified_planning.engines.results import CompilerResult, PlanGenerationResult, ValidationResult
from unified_planning.exceptions import UPUsageError
from unified_planning.plans import Plan as UpPlan
from unified_planning.plans import PlanKind

from cellwright.engine.formats.interop.up.anytime import cheaper, streamed, until
from cellwright.engine.formats.interop.up.conditions import Unsupported
from cellwright.engine.formats.interop.up.kind import SUPPORTED
from cellwright.engine.formats.interop.up.plans import instance_of, partially_ordered, read, sequential
from cellwright.engine.formats.interop.up.problem import Translated, translated
from cellwright.engine.formats.interop.up.replanner import ChangingProblem
from cellwright.engine.formats.interop.up.validation import judged
from cellwright.engine.kernels.cancellation import Interrupted
from cellwright.engine.model.order import Verdict
from cellwright.engine.model.outcome import Found, GaveUp, Infeasible, Outcome
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.plan import Plan
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Function

LIMITS = {"time": Status.TIMEOUT, "memory": Status.MEMOUT}


class Planner(Protocol):
    """Plans a problem. It calls `interrupted` now and then, and `improved` with every cheaper checked plan."""

    def __call__(
        self,
        problem: Problem,
        interrupted: Interrupted,
        improved: Callable[[Plan], None],
        options: dict[str, Any],
    ) -> Outcome: ...


class Reviser(Protocol):
    """Adapts a plan to a problem with another initial state.

    With `compare`, it always compares the repaired plan with a new one.
    """

    def __call__(
        self,
        former: Problem,
        plan: Plan,
        problem: Problem,
        interrupted: Interrupted,
        compare: bool,
        options: dict[str, Any],
    ) -> Outcome: ...


@dataclass(frozen=True, slots=True)
class StageFunctions:
    """The functions that do the work.

    `prove` says whether a plan is a cheapest one; it may find a cheaper plan. `judge` checks all orders of a plan.
    `instances` returns the operator instances that can be reached.
    """

    plan: Planner
    revise: Reviser
    prove: Callable[[Problem, Found, Interrupted], Found]
    judge: Callable[[Problem, Plan], Verdict]
    instances: Callable[[Problem], tuple[Function, ...]]


class UpEngine(
    Engine,  # type: ignore[misc]
    mixins.OneshotPlannerMixin,  # type: ignore[misc]
    mixins.AnytimePlannerMixin,  # type: ignore[misc]
    mixins.PlanValidatorMixin,  # type: ignore[misc]
    mixins.CompilerMixin,  # type: ignore[misc]
    ChangingProblem,
):
    """An engine with five operation modes.

    A replanner starts from `problem`. The option `partial_order` gives partial-order plans instead of sequences. All other
    options are limits of the planner (`strategy`, `seed`, `expansions`, `improvement`).
    """

    stages: ClassVar[StageFunctions]

    def __init__(
        self,
        problem: up.Problem | None = None,
        error_on_failed_checks: bool = True,
        partial_order: bool = False,
        **options: Any,
    ) -> None:
        Engine.__init__(self)
        mixins.OneshotPlannerMixin.__init__(self)
        mixins.CompilerMixin.__init__(self, CompilationKind.GROUNDING)
        self._partial_order, self._options = partial_order, options
        self._former: tuple[Problem, Plan] | None = None  # the last answer of a replanner
        if problem is not None:
            ChangingProblem.__init__(self, problem, error_on_failed_checks)

    @property
    def name(self) -> str:
        """The name of the engine in its results."""
        return "cellwright"

    @staticmethod
    def supported_kind() -> up.ProblemKind:
        """Classical planning with truth values and objects."""
        return SUPPORTED.clone()

    @staticmethod
    def supports(problem_kind: up.ProblemKind) -> bool:
        """Whether every feature is supported."""
        return bool(problem_kind <= SUPPORTED)

    @staticmethod
    def satisfies(optimality_guarantee: mixins.OptimalityGuarantee) -> bool:
        """No guarantee of optimality is promised before the search. A result claims it only if it is proved."""
        return bool(optimality_guarantee == mixins.OptimalityGuarantee.SATISFICING)

    @staticmethod
    def ensures(anytime_guarantee: mixins.AnytimeGuarantee) -> bool:
        """Every plan costs less than the one before."""
        return bool(anytime_guarantee == mixins.AnytimeGuarantee.INCREASING_QUALITY)

    @staticmethod
    def supports_plan(plan_kind: PlanKind) -> bool:
        """Sequences and partial orders."""
        return plan_kind in (PlanKind.SEQUENTIAL_PLAN, PlanKind.PARTIAL_ORDER_PLAN)

    @staticmethod
    def supports_compilation(compilation_kind: CompilationKind) -> bool:
        """Grounding."""
        return bool(compilation_kind == CompilationKind.GROUNDING)

    @staticmethod
    def resulting_problem_kind(
        problem_kind: up.ProblemKind,
        compilation_kind: CompilationKind | None = None,  # noqa: ARG004
    ) -> up.ProblemKind:
        """The same kind, which is the best estimate before grounding."""
        return problem_kind.clone()

    def _solve_with_params(
        self,
        problem: up.Problem,
        heuristic: Callable[[up.State], float | None] | None = None,
        timeout: float | None = None,
        output_stream: IO[str] | None = None,
        warm_start_plan: UpPlan | None = None,
        **_: Any,
    ) -> PlanGenerationResult:
        if heuristic is not None or warm_start_plan is not None:
            warnings.warn(f"{self.name} accepts neither a heuristic nor an initial plan", stacklevel=3)
        return self._solve(problem, None, timeout, output_stream)

    def _solve(
        self,
        problem: up.Problem,
        heuristic: Callable[[up.State], float | None] | None = None,  # noqa: ARG002
        timeout: float | None = None,
        output_stream: IO[str] | None = None,
    ) -> PlanGenerationResult:
        late = until(timeout)
        result = self._made(problem, lambda ours: self._proved(ours, self._planned(ours.ours, late), late))
        return _written(result, output_stream)

    def _planned(
        self,
        problem: Problem,
        interrupted: Interrupted,
        improved: Callable[[Plan], None] = lambda _: None,
        thorough: bool = False,
    ) -> Outcome:
        """Make a new plan. With `thorough`, improve it until the search is interrupted."""
        return self.stages.plan(problem, interrupted, improved, {"thorough": thorough, **self._options})

    def _proved(self, problem: Translated, outcome: Outcome, interrupted: Interrupted) -> Outcome:
        """The outcome with a proof that it is optimal, if there is a metric and the proof does not take too long."""
        if isinstance(outcome, Found) and problem.theirs.quality_metrics:
            return self.stages.prove(problem.ours, outcome, interrupted)
        return outcome

    def _made(self, problem: up.Problem, make: Callable[[Translated], Outcome]) -> PlanGenerationResult:
        """The result for a problem in the terms of the library, also if it is unsupported or a limit is reached."""
        try:
            ours = translated(problem)
            return self._told(ours, make(ours))
        except (Unsupported, InvalidInput) as error:
            return self._result(Status.UNSUPPORTED_PROBLEM, None, str(error))
        except MemoryError:
            return self._result(Status.MEMOUT, None, "out of memory")

    def _told(self, problem: Translated, outcome: Outcome) -> PlanGenerationResult:
        match outcome:
            case Found(plan, optimal=optimal):
                best = optimal and bool(problem.theirs.quality_metrics)
                status = Status.SOLVED_OPTIMALLY if best else Status.SOLVED_SATISFICING
                return self._result(status, self._plan(problem, plan))
            case Infeasible(reason):
                return self._result(Status.UNSOLVABLE_PROVEN, None, reason)
            case GaveUp(reason, limit):
                return self._result(LIMITS.get(limit, Status.UNSOLVABLE_INCOMPLETELY), None, reason)

    def _plan(self, problem: Translated, plan: Plan) -> UpPlan:
        return (partially_ordered if self._partial_order else sequential)(problem, plan)

    def _result(self, status: Status, plan: UpPlan | None, said: str = "") -> PlanGenerationResult:
        logs = [LogMessage(LogLevel.INFO, said)] if said else []
        return PlanGenerationResult(status, plan, self.name, log_messages=logs)

    def _get_solutions(
        self, problem: up.Problem, timeout: float | None = None, output_stream: IO[str] | None = None
    ) -> Iterator[PlanGenerationResult]:
        """Every better plan when it is found, then the last plan again with its final status.

        With a timeout, plans are improved until the time is over.
        """

        def solve(stop: Interrupted, tell: Callable[[PlanGenerationResult], None]) -> PlanGenerationResult:
            def made(ours: Translated) -> Outcome:
                better = cheaper(lambda plan: tell(self._result(Status.INTERMEDIATE, self._plan(ours, plan))))
                first = self._proved(ours, self._planned(ours.ours, stop, better), stop)
                if timeout is None or not isinstance(first, Found) or first.optimal:
                    return first
                last = self._planned(ours.ours, stop, better, thorough=True)
                return last if isinstance(last, Found) and last.plan.cost <= first.plan.cost else first

            return self._made(problem, made)

        for result in streamed(solve, until(timeout)):
            yield _written(result, output_stream)

    def _resolve(
        self, timeout: float | None = None, output_stream: IO[str] | None = None
    ) -> PlanGenerationResult:
        late = until(timeout)
        result = self._made(self._problem, lambda ours: self._proved(ours, self._revised(ours, late), late))
        return _written(result, output_stream)

    def _revised(self, problem: Translated, interrupted: Interrupted) -> Outcome:
        """The former plan after repair, if only initial values have changed; otherwise a new plan."""
        ours, former = problem.ours, self._former
        if former is not None and former[0].replace(ours.initial) == ours:
            compare = bool(problem.theirs.quality_metrics)
            outcome = self.stages.revise(*former, ours, interrupted, compare, self._options)
        else:
            outcome = self._planned(ours, interrupted)
        if isinstance(outcome, Found):
            self._former = (ours, outcome.plan)
        return outcome

    def _validate(self, problem: up.Problem, plan: UpPlan) -> ValidationResult:
        with _refusing(f"{self.name} cannot validate plans for this problem"):
            ours = translated(problem)
            made, instances = read(ours, plan)
            return judged(ours, instances, self.stages.judge(ours.ours, made), self.name)

    def _compile(self, problem: up.Problem, compilation_kind: CompilationKind) -> CompilerResult:
        """Ground a problem: the library's grounder makes the actions that our grounding finds reachable."""
        chosen: dict[up.Action, list[tuple[up.FNode, ...]]] = {action: [] for action in problem.actions}
        with _refusing(f"{self.name} cannot ground this problem"):
            ours = translated(problem)
            for operator in self.stages.instances(ours.ours):
                instance = instance_of(ours, operator)
                chosen[instance.action].append(tuple(instance.actual_parameters))
        made = Grounder(grounding_actions_map=chosen).compile(problem, compilation_kind)
        made.engine_name = self.name
        return made


@contextmanager
def _refusing(said: str) -> Iterator[None]:
    """A context that turns problems that cannot be translated or grounded into usage errors of the library."""
    try:
        yield
    except (Unsupported, InvalidInput) as error:
        raise UPUsageError(f"{said}: {error}") from None


def _written(result: PlanGenerationResult, stream: IO[str] | None) -> PlanGenerationResult:
    if stream is not None:
        stream.write(f"{result}\n")
    return result
