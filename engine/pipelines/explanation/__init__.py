"""Explains why a problem has no plan: its unreachable goals, what is missing, changes that help.

Each change is proved by a plan for the changed problem.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

from cellwright.engine.model.ground_task import GroundTask
from cellwright.engine.model.noun_wording import count_noun
from cellwright.engine.model.outcome import Found, Infeasible, Outcome
from cellwright.engine.model.plan_explanation import Amendment, Explanation
from cellwright.engine.model.window_breaches import WindowBreach
from cellwright.engine.pipelines.explanation.amendments import apply_amendment
from cellwright.engine.pipelines.explanation.blocked_steps import (
    conflicting_needs,
    missing_operators,
    out_of_range,
)
from cellwright.engine.pipelines.explanation.companion_events import find_companions
from cellwright.engine.pipelines.explanation.helpful_changes import ChangeSearch
from cellwright.engine.pipelines.explanation.missing_amounts import refill
from cellwright.engine.pipelines.explanation.possible_facts import ProblemSpace
from cellwright.engine.pipelines.explanation.standing_obstacles import obstacle_reasons
from cellwright.engine.pipelines.explanation.unreachable_goals import (
    GoalOrStage,
    exclusive_goals,
    minimal_goals,
    with_goals_only,
)
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.planning.shortage import shortages
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.plan_model import GOAL_STEP, Plan, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function

__all__ = ["apply_amendment", "explain_infeasibility"]

MAX_TRIAL_EXPANSIONS = 50_000  # expansions with one change, at most
MAX_PART_EXPANSIONS = 200_000  # expansions with a part of the goals, at most

Proved = tuple[Amendment, Found]
"""A change, and the plan with it."""


def explain_infeasibility(problem: Problem, limits: SearchLimits = SearchLimits()) -> Explanation:
    """Why a problem has no plan. Raises `InvalidInput` for a problem that does not ground."""
    outcome = checked_plan.plan_problem(problem, limits)
    if isinstance(outcome, Found) and (reason := _window_in_the_way(problem, limits)):
        return reason
    if isinstance(outcome, Found):
        return Explanation(
            "feasible", reason=f"there is a plan of {count_noun(len(outcome.plan.steps), 'step')}"
        )
    if not isinstance(outcome, Infeasible):
        return Explanation("unknown", reason=outcome.reason)
    return _InfeasibilityInquiry(problem, limits, ground(problem)).explanation(outcome.reason)


def _window_in_the_way(problem: Problem, limits: SearchLimits) -> Explanation | None:
    """Why no plan keeps windows and calendars, though there are plans; None if one keeps them."""
    if not problem.all_windows and not problem.all_calendars:
        return None
    # loads what schedules
    from cellwright.engine.pipelines.planning.plan_objective import plan_for_objective
    from cellwright.engine.pipelines.planning.window_keeping import with_prices

    outcome = plan_for_objective(problem, limits).outcome
    if isinstance(outcome, Found):
        return None
    status = "infeasible" if isinstance(outcome, Infeasible) else "unknown"
    run = plan_for_objective(with_prices(problem), limits)
    if not isinstance(run.outcome, Found) or run.timetable is None:
        return Explanation(status, reason=outcome.reason)
    return Explanation(
        status,
        reason=outcome.reason,
        relaxed=tuple(_widest(problem, run.timetable.breaches)),
        relaxed_steps=len(run.outcome.plan.steps),
    )


def _widest(problem: Problem, breaches: Sequence[WindowBreach]) -> Iterator[str]:
    """For each window that must be kept, in words, where it is broken most."""
    for window in (window for window in problem.all_windows if window.is_hard):
        own = [breach for breach in breaches if replace(breach.window, price=None) == window]
        if own:
            worst = replace(max(own, key=lambda breach: breach.amount), window=window)
            more = f"; and {len(own) - 1} more of this window" if len(own) > 1 else ""
            yield worst.text(problem.domain.time_unit) + more


@dataclass(frozen=True, slots=True)
class _InfeasibilityInquiry:
    problem: Problem
    limits: SearchLimits
    task: GroundTask
    # parts of the goals for which a limit was reached
    undecided: list[Problem] = field(default_factory=list)

    def explanation(self, reason: str) -> Explanation:
        """The culprits, then what would help."""
        goals = minimal_goals(self.problem, self._has_none)
        initial = tuple(
            a for a in self.task.names(self.task.initial) if a.name not in ("not", "_stage")
        )
        space = ProblemSpace.of(self.problem, initial)
        barred = out_of_range(self.problem, goals[0]) if len(goals) == 1 else ()
        lacking = () if barred else shortages(ground(with_goals_only(self.problem, goals)))
        excluded = (
            barred or tuple(map(str, lacking)) or tuple(self._exclusions(goals, space))
        )  # before the long search, which a limit may end
        advice = ChangeSearch(
            space,
            self.problem,
            tuple(map(str, goals)),
            lambda variant: self._planned(variant, self._trial),
            self.limits.interrupted,
        )
        asked = () if barred else self._refilled() or self._advised(goals, space, advice)
        changes = [self._told(change, amendment_plan) for change, amendment_plan in asked]
        settled = barred or changes or advice.untried
        absent = (
            () if settled else tuple(missing_operators(with_goals_only(self.problem, goals), space))
        )
        if len(goals) > 1 or not changes:
            changes += self._drops(goals)
        return Explanation(
            "infeasible",
            tuple(map(str, goals)),
            excluded,
            tuple(changes),
            reason,
            advice.untried,
            absent,
            not self.undecided,
            tuple(obstacle_reasons(self.problem, self.task, changes)),
        )

    def _refilled(self) -> tuple[Proved, ...]:
        """The change of amounts that is just enough for all goals, if there is a plan then."""
        change = refill(self.problem, shortages(self.task))
        outcome = self._planned(apply_amendment(self.problem, change)) if change else None
        return ((change, outcome),) if change and isinstance(outcome, Found) else ()

    def _advised(
        self, goals: Sequence[GoalOrStage], space: ProblemSpace, advice: ChangeSearch
    ) -> tuple[Proved, ...]:
        """The events to ask for and the facts to change that are searched for."""
        return (*find_companions(self.problem, goals, space, advice.planned), *advice.smallest())

    @property
    def _trial(self) -> SearchLimits:
        """What may be done for one change. Few changes help."""
        return replace(
            self.limits, expansions=min(self.limits.expansions, MAX_TRIAL_EXPANSIONS), doubtful=True
        )

    def _exclusions(self, goals: Sequence[GoalOrStage], space: ProblemSpace) -> Iterator[str]:
        """What is never true at once: two goals, or needs of the step that would reach the only
        one.
        """
        if len(goals) > 1:
            yield from exclusive_goals(self.problem, goals)
        elif space.reachable:
            yield from conflicting_needs(
                self.problem,
                goals[0],
                space,
                lambda variant: isinstance(self._planned(variant, self._trial), Infeasible),
            )

    def _drops(self, goals: Sequence[GoalOrStage]) -> Iterator[Amendment]:
        """The goals without any one of which there is a plan. A chain is dropped whole."""
        for goal in goals:
            drop = Amendment(goal=goal.whole)
            outcome = self._planned(apply_amendment(self.problem, drop))
            if isinstance(outcome, Found):
                yield self._told(drop, outcome)

    def _planned(self, problem: Problem, limits: SearchLimits | None = None) -> Outcome | None:
        """The answer to a variant of the problem, with a part of the goals if nothing else is
        said; None if it contradicts itself.
        """
        part = replace(self.limits, expansions=min(self.limits.expansions, MAX_PART_EXPANSIONS))
        try:
            return checked_plan.plan_problem(problem, limits or part)
        except InvalidInput:
            return None

    def _has_none(self, problem: Problem) -> bool | None:
        """Whether a problem has no plan; None if that is not decided."""
        part = replace(
            self.limits,
            expansions=min(self.limits.expansions, MAX_PART_EXPANSIONS),
            improvement=0,
            restarts=0,
            room=None,
        )
        outcome = self._planned(problem, part)
        if isinstance(outcome, Found | Infeasible):
            return isinstance(outcome, Infeasible)
        self.undecided.append(problem)
        return None

    def _told(self, change: Amendment, proving: Found) -> Amendment:
        """The change with its proof."""
        missing = tuple(self._chain(proving.plan, change))
        return replace(change, proof=len(proving.plan.steps), missing=missing)

    def _chain(self, plan: Plan, change: Amendment) -> Iterator[str]:
        """From the goal down to the first step that was out of reach before, and what it needs."""
        reachable_operators: frozenset[Function] = frozenset(
            operator.instance for operator in self.task.operators
        )
        first = next(
            (step.id for step in plan.steps if step.operator not in reachable_operators), None
        )
        if first is None or not change.edits:
            return
        operators = {step.id: step.operator for step in plan.steps}
        consumers = {link.producer: link for link in plan.links if link.condition.name != "_stage"}
        consumers |= {link.producer: link for link in plan.links if link.consumer == GOAL_STEP}
        path: list[str] = []
        step: StepId = first
        while step in consumers and step != GOAL_STEP:
            link = consumers[step]
            path.append(f"{link.condition} needs {operators[step]}")
            step = link.consumer
        yield from reversed(path)
        if len(change.edits) == 1:
            edit = change.edits[0]
            relation = "is out of reach because of" if edit.added is None else "needs"
            yield f"{operators[first]} {relation} {edit.fact}"
