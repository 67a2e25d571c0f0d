"""Finds the ground operators of a task that belong to given instances of operators."""

from collections.abc import Iterable, Mapping

from engine.model.task import Bits, GroundOperator, Task, progress
from kb.terms import Function

Instances = Mapping[Function, list[GroundOperator]]


def instances(task: Task) -> Instances:
    """The ground operators of each instance. They differ in supports and in the stages that they reach."""
    found: dict[Function, list[GroundOperator]] = {}
    for operator in task.operators:
        found.setdefault(operator.instance, []).append(operator)
    return found


def replayed(known: Instances, state: Bits, steps: Iterable[Function]) -> list[GroundOperator] | None:
    """The ground operators of instances that are applied one after another from a state; None if one cannot
    be applied.

    If several ground operators fit an instance, the one that reaches most stages is taken, because reaching a
    stage early is never worse.
    """
    found = []
    for instance in steps:
        fitting = [each for each in known.get(instance, ()) if not each.preconditions & ~state]
        if not fitting:
            return None
        best = max(fitting, key=lambda each: (each.adds & ~state).bit_count())
        found.append(best)
        state = progress(state, best)
    return found


def reached_goals(task: Task, state: Bits) -> Bits | None:
    """The alternative of the goals that holds in a state."""
    return next((goal for goal in task.goals if not goal & ~state), None)
