"""The findings of the checker in the terms of unified-planning."""

from fractions import Fraction

from unified_planning.engines import LogLevel, LogMessage, ValidationResultStatus
from unified_planning.engines.results import FailedValidationReason, ValidationResult
from unified_planning.plans import ActionInstance

from cellwright.engine.formats.interop.up.problem import Translated
from cellwright.engine.model.order import Counterexample, Verdict

STATUS = {
    True: ValidationResultStatus.VALID,
    False: ValidationResultStatus.INVALID,
    None: ValidationResultStatus.UNKNOWN,
}


def judged(
    problem: Translated, instances: list[ActionInstance], verdict: Verdict, name: str
) -> ValidationResult:
    """The result for a plan whose step n is `instances[n - 1]`, given a verdict on all its orders."""
    found = verdict.counterexample
    if found is None:
        said = [] if verdict.valid else [LogMessage(LogLevel.WARNING, "too many orders to try them all")]
        values = _values(problem, instances) if verdict.valid else None
        return ValidationResult(STATUS[verdict.valid], name, said, values)
    order = [instances[step - 1] for step in found.order]
    message = LogMessage(LogLevel.INFO, _message(found, order))
    if found.at_the_goal:
        reason, culprit = FailedValidationReason.UNSATISFIED_GOALS, None
    else:
        reason, culprit = FailedValidationReason.INAPPLICABLE_ACTION, order[-1]
    return ValidationResult(STATUS[False], name, [message], None, reason, culprit)


def _message(found: Counterexample, order: list[ActionInstance]) -> str:
    said = ", ".join(map(str, order))
    if found.at_the_goal:
        return f"the goals do not hold after {said or 'no action'}"
    return f"{order[-1]} cannot be done last in this order: {said}"


def _values(problem: Translated, instances: list[ActionInstance]) -> dict[object, int | Fraction]:
    """The value of each metric for a plan. The values are sums, so they do not depend on the order."""
    values: dict[object, int | Fraction] = {}
    for metric in problem.theirs.quality_metrics:
        if metric.is_minimize_sequential_plan_length():
            values[metric] = len(instances)
        elif problem.costs is not None:
            values[metric] = sum(
                (
                    problem.costs.of(
                        each.action.name, tuple(str(p.object().name) for p in each.actual_parameters)
                    )
                    for each in instances
                ),
                Fraction(0),
            )
    return values
