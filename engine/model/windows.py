"""Windows of measurements in a plan: when they may begin, counted from where the tour of the arm begins.

The tour begins when the first measurement could begin, if it had no window of its own.
"""

from collections.abc import Iterable, Mapping, Sequence

from engine.model.measurements import measurements_of, named
from kb.model.conditions import Literal
from kb.model.plan import GOAL, START, Plan, StepId
from kb.model.problem import Problem
from kb.terms import Number, Term

Window = tuple[int, int]  # earliest and latest beginning, in the unit of the costs
LISTED = 12  # measurements that are named


def windows_of(facts: Iterable[Sequence[Term]]) -> dict[str, Window]:
    """The windows that facts give measurements, by the arguments of these facts."""
    return {
        str(name): (first.value, last.value)
        for name, first, last in facts
        if isinstance(first, Number) and isinstance(last, Number)
    }


def visits_of(problem: Problem, plan: Plan) -> dict[StepId, str]:
    """The measurement that each step makes for the goals, in the order of the plan."""
    known, measured = set(measurements_of(problem)), problem.domain.conventions.measured
    makes: dict[StepId, str] = {}
    for link in plan.links:
        if link.consumer == GOAL and link.producer != START and link.condition.name == measured:
            for name in named(Literal(link.condition), known):
                makes[link.producer] = name
    return {step.id: makes[step.id] for step in plan.steps if step.id in makes}


def missed(
    windows: Mapping[str, Window], visits: Mapping[StepId, str], starts: Mapping[StepId, int]
) -> dict[str, int]:
    """The measurements that begin outside their windows, each with when it begins after the start of the tour."""
    begin = tour_begin(windows, visits, starts)
    after = {name: starts[step] - begin for step, name in visits.items() if name in windows}
    return {name: at for name, at in after.items() if not windows[name][0] <= at <= windows[name][1]}


def tour_begin(
    windows: Mapping[str, Window], visits: Mapping[StepId, str], starts: Mapping[StepId, int]
) -> int:
    """When the tour begins, by the starts of steps: an arm that is too early for the first visit has waited for it."""
    if not visits:
        return 0
    first = min(visits, key=lambda step: starts[step])
    return max(0, starts[first] - windows.get(visits[first], (0, 0))[0])


def outside(missed: Mapping[str, int], unit: str) -> str:
    """The measurements outside their windows, in words."""
    names = [f"{name} at {at} {unit}" for name, at in list(missed.items())[:LISTED]]
    more = f" and {len(missed) - LISTED} more (--format json has all)" if len(missed) > LISTED else ""
    return f"Outside their windows, counted from the start of the tour: {', '.join(names)}{more}."


def opening(windows: Mapping[str, Window], visits: Mapping[StepId, str]) -> dict[StepId, int]:
    """How long after the start of the tour each step may begin that makes a measurement; 0 where nothing is said."""
    return {step: windows.get(name, (0, 0))[0] for step, name in visits.items()}
