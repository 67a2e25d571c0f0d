"""Translates unified-planning problems with times (durative actions, timed effects) by way of PDDL,
and their plans back.
"""

import tempfile
from fractions import Fraction
from pathlib import Path

from unified_planning import model as up
from unified_planning.engines import LogLevel, LogMessage, ValidationResultStatus
from unified_planning.engines.results import FailedValidationReason, ValidationResult
from unified_planning.io import PDDLWriter
from unified_planning.plans import ActionInstance, TimeTriggeredPlan

from cellwright.engine.formats.interop.pddl.durative import TemporalTask, read_temporal
from cellwright.engine.formats.interop.up.up_kinds import TIMED_FEATURES, refuse_other_kinds
from cellwright.engine.pipelines.planning.temporal_plans import check_timed_plan
from cellwright.kb.model.durative import TimedPlan, TimedStep
from cellwright.kb.terms import Function

GOAL_CODE = "K502"  # of a goal that does not hold at the end


class TimedTranslation:
    """A problem in time in our model, and its plans in the terms of the library."""

    def __init__(self, problem: up.Problem) -> None:
        """Raises `Unsupported` or `InvalidInput` for what is not supported."""
        refuse_other_kinds(problem, TIMED_FEATURES)
        self.theirs, self.writer = problem, PDDLWriter(problem)
        self.task = self._read()

    def _read(self) -> TemporalTask:
        with tempfile.TemporaryDirectory() as folder:
            domain, task = Path(folder, "domain.pddl"), Path(folder, "problem.pddl")
            self.writer.write_domain(str(domain))
            self.writer.write_problem(str(task))
            return read_temporal(domain, task)

    def plan(self, plan: TimedPlan) -> TimeTriggeredPlan:
        """A plan in time in the terms of the library."""
        steps = [
            (step.start, self._instance(step.action), self._length(step)) for step in plan.steps
        ]
        return TimeTriggeredPlan(steps, self.theirs.environment)

    def read_plan(self, plan: TimeTriggeredPlan) -> TimedPlan:
        """A plan of the library in our model."""
        steps = [
            TimedStep(Fraction(start), self._function(instance), Fraction(length or 0))
            for start, instance, length in plan.timed_actions
        ]
        return TimedPlan(tuple(sorted(steps, key=lambda step: step.start)))

    def _function(self, instance: ActionInstance) -> Function:
        names, written = self.task.names, self.writer.get_pddl_name
        objects = (
            Function(names.of("object", written(each.object()).lower()))
            for each in instance.actual_parameters
        )
        return Function(names.of("operator", written(instance.action).lower()), tuple(objects))

    def _length(self, step: TimedStep) -> Fraction | None:
        instantaneous = {
            action.name for action in self.task.problem.actions if action.instantaneous
        }
        return None if step.action.name in instantaneous else step.duration

    def _instance(self, action: Function) -> ActionInstance:
        names = self.task.names
        theirs = self.writer.get_item_named(names.original("operator", action.name))
        objects = (
            self.writer.get_item_named(names.original("object", str(each)))
            for each in action.arguments
        )
        expressions = self.theirs.environment.expression_manager
        return ActionInstance(theirs, tuple(map(expressions.ObjectExp, objects)))


def has_time(problem: up.Problem) -> bool:
    """Whether a problem of the library has durations or timed effects."""
    return bool(problem.kind.has_continuous_time() or problem.kind.has_discrete_time())


def validate_timed_plan(
    ours: TimedTranslation, plan: TimeTriggeredPlan, name: str
) -> ValidationResult:
    """The verdict of the checker of time: each broken condition is a message, and the first says
    why the plan fails.
    """
    wrong = check_timed_plan(ours.task.problem, ours.read_plan(plan), "plan")
    if not wrong:
        return ValidationResult(ValidationResultStatus.VALID, name, [], None)
    said = [LogMessage(LogLevel.INFO, str(each)) for each in wrong]
    reason = (
        FailedValidationReason.UNSATISFIED_GOALS
        if wrong[0].code == GOAL_CODE
        else FailedValidationReason.INAPPLICABLE_ACTION
    )
    return ValidationResult(ValidationResultStatus.INVALID, name, said, None, reason)
