"""The unified-planning engine class: planner, anytime planner, validator, grounder, replanner."""

import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from queue import SimpleQueue
from threading import Event, Thread
from typing import IO, Any, ClassVar, Protocol

from unified_planning import model as up
from unified_planning.engines import CompilationKind, Engine, LogLevel, LogMessage, mixins
from unified_planning.engines import PlanGenerationResultStatus as Status
from unified_planning.engines.compilers.grounder import Grounder
from unified_planning.engines.results import CompilerResult, PlanGenerationResult, ValidationResult
from unified_planning.exceptions import UPUsageError
from unified_planning.plans import Plan as UpPlan
from unified_planning.plans import PlanKind, TimeTriggeredPlan

from cellwright.engine.formats.interop.up.up_conditions import Unsupported
from cellwright.engine.formats.interop.up.up_kinds import (
    SUPPORTED_KIND,
    TIMED_FEATURES,
    TIMED_KIND,
    UP_FEATURES,
)
from cellwright.engine.formats.interop.up.up_plans import (
    instance_of,
    partially_ordered,
    read_up_plan,
    sequential_plan,
    validation_result,
)
from cellwright.engine.formats.interop.up.up_problem import Translated, translate_problem
from cellwright.engine.formats.interop.up.up_timed_problems import (
    TimedTranslation,
    has_time,
    validate_timed_plan,
)
from cellwright.engine.kernels.cancellation import Interrupted, never
from cellwright.engine.model.outcome import Found, GaveUp, Infeasible, OrderCheck, Outcome
from cellwright.engine.model.temporal import NoPlanInTime
from cellwright.engine.pipelines.planning.temporal_plans import TimeEffort, plan_with_times
from cellwright.engine.stages.planning import expansions_within
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.durative import TimedPlan
from cellwright.kb.model.plan_model import Plan
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function

Solve = Callable[[Interrupted, Callable[[PlanGenerationResult], None]], PlanGenerationResult]


def deadline_after(timeout: float | None) -> Interrupted:
    """A function that returns whether `timeout` seconds have passed since this call."""
    if timeout is None:
        return never
    deadline = time.monotonic() + timeout
    return lambda: time.monotonic() >= deadline


def only_cheaper(tell: Callable[[Plan], None]) -> Callable[[Plan], None]:
    """A function that passes on only plans that are cheaper than all plans before."""
    costs: list[int] = []

    def better(plan: Plan) -> None:
        if not costs or plan.cost < min(costs):
            costs.append(plan.cost)
            tell(plan)

    return better


def stream_results(solve: Solve, interrupted: Interrupted) -> Iterator[PlanGenerationResult]:
    """The results that `solve` reports while it works, each at once, and finally the result that it
    returns.

    It works in its own thread, and is asked to stop when the results are no longer read.
    """
    results: SimpleQueue[PlanGenerationResult | Exception] = SimpleQueue()
    abandoned = Event()

    def work() -> None:
        try:
            results.put(solve(lambda: abandoned.is_set() or interrupted(), results.put))
        except Exception as error:  # raised again where the results are read
            results.put(error)

    Thread(target=work, daemon=True).start()
    try:
        while isinstance(result := results.get(), PlanGenerationResult):
            yield result
            if result.status is not Status.INTERMEDIATE:
                return
        raise result
    finally:
        abandoned.set()


class ChangingProblem(mixins.ReplannerMixin):  # type: ignore[misc]
    """The replanner part of an engine: values, goals and actions can be changed, added and
    removed.
    """

    _problem: up.Problem

    def __init__(self, problem: up.Problem, error_on_failed_checks: bool) -> None:
        mixins.ReplannerMixin.__init__(self, problem, error_on_failed_checks)

    def _update_initial_value(self, fluent: Any, value: Any) -> None:
        self._problem.set_initial_value(fluent, value)

    def _add_goal(self, goal: Any) -> None:
        self._problem.add_goal(goal)

    def _remove_goal(self, goal: Any) -> None:
        (unwanted,) = self._problem.environment.expression_manager.auto_promote(goal)
        goals = list(self._problem.goals)
        self._problem.clear_goals()
        for own_goal in goals:
            if own_goal != unwanted:
                self._problem.add_goal(own_goal)
        if unwanted not in goals:
            self._missing(f"the goal {unwanted}")

    def _add_action(self, action: up.Action) -> None:
        self._problem.add_action(action)

    def _remove_action(self, name: str) -> None:
        actions = list(self._problem.actions)
        self._problem.clear_actions()
        for action in actions:
            if action.name != name:
                self._problem.add_action(action)
        if all(action.name != name for action in actions):
            self._missing(f"the action {name}")

    def _missing(self, what: str) -> None:
        message = f"the problem does not have {what}"
        if self.skip_checks:
            return
        if self.error_on_failed_checks:
            raise UPUsageError(message)
        warnings.warn(message, stacklevel=4)


PLAN_KINDS = (
    PlanKind.SEQUENTIAL_PLAN,
    PlanKind.PARTIAL_ORDER_PLAN,
    PlanKind.TIME_TRIGGERED_PLAN,
)
LIMIT_STATUS = {"time": Status.TIMEOUT, "memory": Status.MEMOUT}


class Planner(Protocol):
    """Plans a problem. It calls `interrupted` now and then, and `improved` with every cheaper
    checked plan.
    """

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

    `prove` says whether a plan is a cheapest one; it may find a cheaper plan. `judge` checks all
    orders of a plan. `instances` returns the operator instances that can be reached.
    """

    plan: Planner
    revise: Reviser
    prove: Callable[[Problem, Found, Interrupted], Found]
    judge: Callable[[Problem, Plan], OrderCheck]
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

    A replanner starts from `problem`. The option `partial_order` gives partial-order plans instead
    of sequences. All other options are limits of the planner (`strategy`, `seed`, `expansions`,
    `improvement`).
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
        return SUPPORTED_KIND.clone()

    @staticmethod
    def supports(problem_kind: up.ProblemKind) -> bool:
        """Whether every feature is supported."""
        timed = problem_kind.has_continuous_time() or problem_kind.has_discrete_time()
        features, kind = (TIMED_FEATURES, TIMED_KIND) if timed else (UP_FEATURES, SUPPORTED_KIND)
        # the comparison below may drop features
        known = set(problem_kind.features) <= set(features)
        return known and bool(problem_kind <= kind)

    @staticmethod
    def satisfies(optimality_guarantee: mixins.OptimalityGuarantee) -> bool:
        """No guarantee of optimality is promised before the search.

        A result claims it only if it is proved.
        """
        return bool(optimality_guarantee == mixins.OptimalityGuarantee.SATISFICING)

    @staticmethod
    def ensures(anytime_guarantee: mixins.AnytimeGuarantee) -> bool:
        """Every plan costs less than the one before."""
        return bool(anytime_guarantee == mixins.AnytimeGuarantee.INCREASING_QUALITY)

    @staticmethod
    def supports_plan(plan_kind: PlanKind) -> bool:
        """Sequences, partial orders and plans with times."""
        return plan_kind in PLAN_KINDS

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
            warnings.warn(
                f"{self.name} accepts neither a heuristic nor an initial plan", stacklevel=3
            )
        return self._solve(problem, None, timeout, output_stream)

    def _solve(
        self,
        problem: up.Problem,
        heuristic: Callable[[up.State], float | None] | None = None,  # noqa: ARG002
        timeout: float | None = None,
        output_stream: IO[str] | None = None,
    ) -> PlanGenerationResult:
        late = deadline_after(timeout)
        if has_time(problem):
            return _write_result(self._timed(problem, late, timeout), output_stream)
        result = self._made(
            problem, lambda ours: self._proved(ours, self._planned(ours.ours, late, timeout), late)
        )
        return _write_result(result, output_stream)

    def _timed(
        self,
        problem: up.Problem,
        late: Interrupted,
        timeout: float | None,
        tell: Callable[[PlanGenerationResult], None] | None = None,
    ) -> PlanGenerationResult:
        """The result for a problem in time: a time-triggered plan with a small makespan.

        With `tell`, every better plan is told, and the whole timeout is used.
        """
        try:
            ours = TimedTranslation(problem)

            def improved(plan: TimedPlan) -> None:
                if tell is not None:
                    tell(self._result(Status.INTERMEDIATE, ours.plan(plan)))

            given = self._limited(timeout)
            limits = {name: given[name] for name in ("seed", "expansions") if name in given}
            thorough = tell is not None and timeout is not None
            effort = TimeEffort(late, thorough=thorough, improved=improved, **limits)
            outcome = plan_with_times(ours.task.problem, effort)
        except (Unsupported, InvalidInput) as error:
            return self._result(Status.UNSUPPORTED_PROBLEM, None, str(error))
        if isinstance(outcome, NoPlanInTime):
            unproved = LIMIT_STATUS.get(outcome.limit, Status.UNSOLVABLE_INCOMPLETELY)
            return self._result(
                Status.UNSOLVABLE_PROVEN if outcome.proved else unproved, None, outcome.reason
            )
        best = outcome.optimal and bool(problem.quality_metrics)
        return self._result(
            Status.SOLVED_OPTIMALLY if best else Status.SOLVED_SATISFICING, ours.plan(outcome.plan)
        )

    def _planned(
        self,
        problem: Problem,
        interrupted: Interrupted,
        timeout: float | None,
        improved: Callable[[Plan], None] = lambda _: None,
        thorough: bool = False,
    ) -> Outcome:
        """Make a new plan. With `thorough`, improve it until the search is interrupted."""
        options = {"thorough": thorough, **self._limited(timeout)}
        return self.stages.plan(problem, interrupted, improved, options)

    def _limited(self, timeout: float | None) -> dict[str, Any]:
        """The options. A timeout governs: without a number of expansions they are not limited
        then.
        """
        return {"expansions": expansions_within(None, timeout), **self._options}

    def _proved(self, problem: Translated, outcome: Outcome, interrupted: Interrupted) -> Outcome:
        """The outcome with a proof that it is optimal, if there is a metric and the proof does
        not take too long.
        """
        if isinstance(outcome, Found) and problem.theirs.quality_metrics:
            return self.stages.prove(problem.ours, outcome, interrupted)
        return outcome

    def _made(
        self, problem: up.Problem, make: Callable[[Translated], Outcome]
    ) -> PlanGenerationResult:
        """The result for a problem in the terms of the library, also if it is unsupported or a
        limit is reached.
        """
        try:
            ours = translate_problem(problem)
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
                return self._result(
                    LIMIT_STATUS.get(limit, Status.UNSOLVABLE_INCOMPLETELY), None, reason
                )

    def _plan(self, problem: Translated, plan: Plan) -> UpPlan:
        return (partially_ordered if self._partial_order else sequential_plan)(problem, plan)

    def _result(self, status: Status, plan: UpPlan | None, said: str = "") -> PlanGenerationResult:
        logs = [LogMessage(LogLevel.INFO, said)] if said else []
        return PlanGenerationResult(status, plan, self.name, log_messages=logs)

    def _get_solutions(
        self,
        problem: up.Problem,
        timeout: float | None = None,
        output_stream: IO[str] | None = None,
    ) -> Iterator[PlanGenerationResult]:
        """Every better plan when it is found, then the last plan again with its final status.

        With a timeout, plans are improved until the time is over.
        """

        def solve(
            stop: Interrupted, tell: Callable[[PlanGenerationResult], None]
        ) -> PlanGenerationResult:
            if has_time(problem):
                return self._timed(problem, stop, timeout, tell)

            def improved_outcome(ours: Translated) -> Outcome:
                better = only_cheaper(
                    lambda plan: tell(self._result(Status.INTERMEDIATE, self._plan(ours, plan)))
                )
                first = self._proved(ours, self._planned(ours.ours, stop, timeout, better), stop)
                if timeout is None or not isinstance(first, Found) or first.optimal:
                    return first
                last = self._planned(ours.ours, stop, timeout, better, thorough=True)
                return (
                    last if isinstance(last, Found) and last.plan.cost <= first.plan.cost else first
                )

            return self._made(problem, improved_outcome)

        for result in stream_results(solve, deadline_after(timeout)):
            yield _write_result(result, output_stream)

    def _resolve(
        self, timeout: float | None = None, output_stream: IO[str] | None = None
    ) -> PlanGenerationResult:
        late = deadline_after(timeout)
        if has_time(self._problem):
            return _write_result(self._timed(self._problem, late, timeout), output_stream)
        result = self._made(
            self._problem, lambda ours: self._proved(ours, self._revised(ours, late, timeout), late)
        )
        return _write_result(result, output_stream)

    def _revised(
        self, problem: Translated, interrupted: Interrupted, timeout: float | None
    ) -> Outcome:
        """The former plan after repair, if only initial values have changed; otherwise a new
        plan.
        """
        ours, former = problem.ours, self._former
        if former is not None and former[0].replace(ours.initial) == ours:
            compare = bool(problem.theirs.quality_metrics)
            outcome = self.stages.revise(
                *former, ours, interrupted, compare, self._limited(timeout)
            )
        else:
            outcome = self._planned(ours, interrupted, timeout)
        if isinstance(outcome, Found):
            self._former = (ours, outcome.plan)
        return outcome

    def _validate(self, problem: up.Problem, plan: UpPlan) -> ValidationResult:
        with _usage_errors(f"{self.name} cannot validate plans for this problem"):
            if isinstance(plan, TimeTriggeredPlan):
                return validate_timed_plan(TimedTranslation(problem), plan, self.name)
            ours = translate_problem(problem)
            read_plan, instances = read_up_plan(ours, plan)
            return validation_result(
                ours, instances, self.stages.judge(ours.ours, read_plan), self.name
            )

    def _compile(self, problem: up.Problem, compilation_kind: CompilationKind) -> CompilerResult:
        """Ground a problem: the library's grounder makes the actions that our grounding finds
        reachable.
        """
        chosen: dict[up.Action, list[tuple[up.FNode, ...]]] = {
            action: [] for action in problem.actions
        }
        with _usage_errors(f"{self.name} cannot ground this problem"):
            ours = translate_problem(problem)
            for operator in self.stages.instances(ours.ours):
                instance = instance_of(ours, operator)
                chosen[instance.action].append(tuple(instance.actual_parameters))
        grounding = Grounder(grounding_actions_map=chosen).compile(problem, compilation_kind)
        grounding.engine_name = self.name
        return grounding


@contextmanager
def _usage_errors(said: str) -> Iterator[None]:
    """A context that turns problems that cannot be translated or grounded into usage errors of
    the library.
    """
    try:
        yield
    except (Unsupported, InvalidInput) as error:
        raise UPUsageError(f"{said}: {error}") from None


def _write_result(result: PlanGenerationResult, stream: IO[str] | None) -> PlanGenerationResult:
    if stream is not None:
        stream.write(f"{result}\n")
    return result
