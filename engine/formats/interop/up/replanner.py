"""A problem that changes while its plan is executed."""

import warnings
from typing import Any

from unified_planning import model as up
from unified_planning.engines import mixins
from unified_planning.exceptions import UPUsageError


class ChangingProblem(mixins.ReplannerMixin):  # type: ignore[misc]
    """The replanner part of an engine: values, goals and actions can be changed, added and removed."""

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
        for each in goals:
            if each != unwanted:
                self._problem.add_goal(each)
        if unwanted not in goals:
            self._missing(f"the goal {unwanted}")

    def _add_action(self, action: up.Action) -> None:
        self._problem.add_action(action)

    def _remove_action(self, name: str) -> None:
        actions = list(self._problem.actions)
        self._problem.clear_actions()
        for each in actions:
            if each.name != name:
                self._problem.add_action(each)
        if all(each.name != name for each in actions):
            self._missing(f"the action {name}")

    def _missing(self, what: str) -> None:
        message = f"the problem does not have {what}"
        if self.skip_checks:
            return
        if self.error_on_failed_checks:
            raise UPUsageError(message)
        warnings.warn(message, stacklevel=4)
