"""Why there is no plan: the goals that have none, what is missing, and the smallest changes that help.

Each change is proved by a plan for the changed problem.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from cellwright.engine.model.explanation import Amendment, Explanation
from cellwright.engine.model.outcome import Found, Infeasible, Outcome
from cellwright.engine.model.task import Task
from cellwright.engine.model.wording import counted
from cellwright.engine.pipelines import planning
from cellwright.engine.pipelines.explanation.advice import Advice
from cellwright.engine.pipelines.explanation.amendments import changed
from cellwright.engine.pipelines.explanation.companions import companions
from cellwright.engine.pipelines.explanation.conflicts import conflicts
from cellwright.engine.pipelines.explanation.culprits import Goal, exclusions, minimal_goals, only
from cellwright.engine.pipelines.explanation.gaps import gaps
from cellwright.engine.pipelines.explanation.ranges import out_of_range
from cellwright.engine.pipelines.explanation.space import Space
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.planning import Limits
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.plan import GOAL, Plan, StepId
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Function

__all__ = ["changed", "explain"]

TRIAL = 50_000  # expansions with one change, at most
PART = 200_000  # expansions with a part of the goals, at most


def explain(problem: Problem, limits: Limits = Limits()) -> Explanation:
    """Why a problem has no plan. Raises `InvalidInput` for a problem that does not ground."""
    outcome = planning.plan(problem, limits)
    if isinstance(outcome, Found):
        return Explanation(
            "feasible", reason=f"there is a plan of {counted(len(outcome.plan.steps), 'step')}"
        )
    if not isinstance(outcome, Infeasible):
        return Explanation("unknown", reason=outcome.reason)
    return _Inquiry(problem, limits, ground(problem)).explanation(outcome.reason)


@dataclass(frozen=True, slots=True)
class _Inquiry:
    problem: Problem
    limits: Limits
    task: Task

    def explanation(self, reason: str) -> Explanation:
        """The culprits, then what would help."""
        goals = minimal_goals(self.problem, self._has_none)
        initial = tuple(a for a in self.task.names(self.task.initial) if a.name not in ("not", "_stage"))
        space = Space.of(self.problem, initial)
        barred = out_of_range(self.problem, goals[0]) if len(goals) == 1 else ()
        excluded = barred or tuple(
            self._exclusions(goals, space)
        )  # before the long search, which a limit may end
        advice = Advice(
            space,
            self.problem,
            tuple(map(str, goals)),
            lambda each: self._planned(each, self._trial),
            self.limits.interrupted,
        )
        asked = (
            () if barred else (*companions(self.problem, goals, space, advice.planned), *advice.smallest())
        )
        changes = [self._told(change, found) for change, found in asked]
        lacking = () if barred or changes or advice.untried else tuple(gaps(only(self.problem, goals), space))
        if len(goals) > 1 or not changes:
            changes += self._drops(goals)
        return Explanation(
            "infeasible",
            tuple(map(str, goals)),
            excluded,
            tuple(changes),
            reason,
            advice.untried,
            lacking,
        )

    @property
    def _trial(self) -> Limits:
        """What may be done for one change. Few changes help."""
        return replace(self.limits, expansions=min(self.limits.expansions, TRIAL), doubtful=True)

    def _exclusions(self, goals: Sequence[Goal], space: Space) -> Iterator[str]:
        """What is never true at once: two goals, or needs of the step that would reach the only one."""
        if len(goals) > 1:
            yield from exclusions(self.problem, goals)
        elif space.reachable:
            yield from conflicts(
                self.problem,
                goals[0],
                space,
                lambda each: isinstance(self._planned(each, self._trial), Infeasible),
            )

    def _drops(self, goals: Sequence[Goal]) -> Iterator[Amendment]:
        """The goals without any one of which there is a plan. A chain is dropped whole."""
        for goal in goals:
            drop = Amendment(goal=goal.whole)
            outcome = self._planned(changed(self.problem, drop))
            if isinstance(outcome, Found):
                yield self._told(drop, outcome)

    def _planned(self, problem: Problem, limits: Limits | None = None) -> Outcome | None:
        """The answer to a variant of the problem, with a part of the goals if nothing else is said; None if it contradicts itself."""
        part = replace(self.limits, expansions=min(self.limits.expansions, PART))
        try:
            return planning.plan(problem, limits or part)
        except InvalidInput:
            return None

    def _has_none(self, problem: Problem) -> bool | None:
        """Whether a problem has no plan; None if that is not decided."""
        part = replace(
            self.limits, expansions=min(self.limits.expansions, PART), improvement=0, restarts=0, room=None
        )
        outcome = self._planned(problem, part)
        return isinstance(outcome, Infeasible) if isinstance(outcome, Found | Infeasible) else None

    def _told(self, change: Amendment, found: Found) -> Amendment:
        """The change with its proof."""
        missing = tuple(self._chain(found.plan, change))
        return replace(change, proof=len(found.plan.steps), missing=missing)

    def _chain(self, plan: Plan, change: Amendment) -> Iterator[str]:
        """From the goal down to the first step that was out of reach before, and what it needs."""
        known: frozenset[Function] = frozenset(operator.instance for operator in self.task.operators)
        first = next((step.id for step in plan.steps if step.operator not in known), None)
        if first is None or not change.edits:
            return
        operators = {step.id: step.operator for step in plan.steps}
        consumers = {link.producer: link for link in plan.links if link.condition.name != "_stage"}
        consumers |= {link.producer: link for link in plan.links if link.consumer == GOAL}
        path: list[str] = []
        step: StepId = first
        while step in consumers and step != GOAL:
            link = consumers[step]
            path.append(f"{link.condition} needs {operators[step]}")
            step = link.consumer
        yield from reversed(path)
        if len(change.edits) == 1:
            edit = change.edits[0]
            what = "is out of reach because of" if edit.added is None else "needs"
            yield f"{operators[first]} {what} {edit.fact}"
