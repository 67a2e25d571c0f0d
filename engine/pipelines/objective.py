"""The plan that one would run: with the least makespan where steps take time, else with the least cost.

A search knows costs only. So several of its plans are scheduled, and the best one is the answer: the one that costs least,
and the one whose steps take least time.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING

from cellwright.engine.model.measurements import is_put_in_order
from cellwright.engine.model.outcome import Found, GaveUp, Infeasible, Outcome, Statistics
from cellwright.engine.model.task import Task
from cellwright.engine.pipelines.planning import in_the_order_named, planned, task_for
from cellwright.engine.stages.grounding.limits import size
from cellwright.engine.stages.planning import Limits
from cellwright.kb.model.plan import Plan, StepId
from cellwright.kb.model.problem import Problem

if TYPE_CHECKING:  # schedules take a while to load, and only plans whose steps take time have one
    from cellwright.engine.model.schedule import Timetable
    from cellwright.engine.pipelines.parts import Itinerary, Memory
    from cellwright.engine.stages.scheduling import ScheduleLimits

SMALL = 500  # instances of operators of a problem whose sequence the planner may prove to be cheapest


class Objective(StrEnum):
    """What a plan should have least of: cost, or makespan and then cost."""

    COST = "cost"
    MAKESPAN = "makespan"


class Order(StrEnum):
    """Who decides the order of measurements: the sequencer, or the planner alone."""

    SEQUENCE = "sequence"
    FREE = "free"


@dataclass(frozen=True, slots=True)
class Run:
    """An outcome, and when each step of its plan happens; None if no step takes any time.

    `itinerary` is the sequence of measurements that the plan follows, if it follows one.
    """

    outcome: Outcome
    timetable: "Timetable | None" = None
    itinerary: "Itinerary | None" = None

    @property
    def starts(self) -> Mapping[StepId, int] | None:
        """When each step of the plan starts; None if no step takes any time."""
        return self.timetable.starts if self.timetable else None


def plan(
    problem: Problem,
    limits: Limits = Limits(),
    objective: Objective | None = None,
    order: Order = Order.SEQUENCE,
) -> Run:
    """A checked plan for a problem with the least that is found of an objective. Raises `InvalidInput`.

    Without an objective it is the makespan where steps of the plan take time, else the cost. Measurements are made in the
    order of the sequencer, unless the order is free.
    """
    cheap = objective is Objective.COST
    followed = sequenced(problem, limits, cheap=cheap) if order is Order.SEQUENCE else None
    if followed is not None:
        return followed
    outcome, task = planned(problem, limits, ordered=not problem.chains)
    return _run(problem, task, outcome, limits, objective)


def sequenced(
    problem: Problem, limits: Limits, memory: "Memory | None" = None, store: str = "", cheap: bool = False
) -> Run | None:
    """The run of an inspection in the order of its sequence; None if the problem is none, or has no such plan.

    Changes of tools and stations are ordered so that the plan is fast, or `cheap` first.

    MACROPs are found in `memory` and learned there, and a sequence is kept in `store`, if they are given.
    """
    if not is_put_in_order(problem):
        return None
    from cellwright.engine.pipelines.parts import by_sequence  # slow to load, and only inspections need it

    found = by_sequence(problem, limits, memory, store, cheap)
    if found is None:
        return None
    if not isinstance(found.outcome, Found) or not _lasts(found.outcome.plan):
        return Run(found.outcome, None, found.itinerary)
    from cellwright.engine.pipelines.timetable import keeping

    outcome = _proved(problem, found.outcome, limits)
    return Run(outcome, keeping(problem, outcome.plan), found.itinerary)


def _proved(problem: Problem, outcome: Found, limits: Limits) -> Found:
    """The outcome for a small problem with the proof that no plan costs less, if the planner finds such a proof."""
    if size(problem) > SMALL:
        return outcome
    free, _ = planned(problem, limits)
    optimal = isinstance(free, Found) and free.optimal and free.plan.cost == outcome.plan.cost
    return replace(outcome, optimal=optimal)


def scheduled(
    problem: Problem, outcome: Outcome, limits: Limits, objective: Objective | None, task: Task | None = None
) -> Run:
    """`plan` for an outcome that is known already, and for its ground `task` if that is. Raises `InvalidInput`."""
    if not isinstance(outcome, Found) or not _lasts(outcome.plan):
        return Run(outcome)
    return _run(problem, task or task_for(problem, outcome.plan), outcome, limits, objective)


def fastest(
    problem: Problem, limits: Limits, work: "ScheduleLimits | None" = None
) -> "Timetable | Infeasible | GaveUp":
    """The timetable of the plan with the least makespan that is found, or why there is none. Raises `InvalidInput`.

    The plan of an inspection follows its sequence, and the schedule keeps this order.
    """
    started = time.perf_counter()
    followed = sequenced(problem, limits)
    if followed is not None:
        return _kept(problem, followed, started)
    outcome, task = planned(problem, limits)
    if not isinstance(outcome, Found):
        return outcome
    from cellwright.engine.pipelines import makespan
    from cellwright.engine.stages.scheduling import ScheduleLimits

    planning = time.perf_counter() - started
    best = _noted(*makespan.fastest(problem, task, outcome, limits, work or ScheduleLimits()))
    seconds = {"planning": planning, **best.statistics.seconds, "in all": time.perf_counter() - started}
    return replace(best, statistics=Statistics(best.statistics.counts, seconds))


def _kept(problem: Problem, followed: Run, started: float) -> "Timetable | Infeasible | GaveUp":
    """The timetable of a plan that follows a sequence, or why there is none."""
    outcome = followed.outcome
    if not isinstance(outcome, Found):
        return outcome
    from cellwright.engine.pipelines.timetable import keeping

    made = followed.timetable or keeping(problem, outcome.plan)
    seconds = {**outcome.statistics.seconds, "in all": time.perf_counter() - started}
    return replace(made, statistics=replace(outcome.statistics, seconds=seconds))


def _run(problem: Problem, task: Task, outcome: Outcome, limits: Limits, objective: Objective | None) -> Run:
    """An outcome with its timetable, and for the makespan with the best plan found from its own on."""
    if not isinstance(outcome, Found):
        return Run(outcome)
    if not _lasts(outcome.plan):
        return Run(replace(outcome, plan=_tidy(problem, task, outcome.plan)) if problem.chains else outcome)
    from cellwright.engine.pipelines import makespan
    from cellwright.engine.pipelines.timetable import own_order

    if objective is Objective.COST:
        plan = _tidy(problem, task, outcome.plan)
        return Run(replace(outcome, plan=plan), own_order(problem, task, plan))
    best = _noted(*makespan.fastest(problem, task, outcome, limits))
    optimal = outcome.optimal and best.plan.cost == outcome.plan.cost
    return Run(replace(outcome, plan=best.plan, optimal=optimal), best)


def _noted(best: "Timetable", refused: Infeasible | GaveUp | None) -> "Timetable":
    """The timetable; where things stay too long in it, with the reason why a plan has no other one."""
    return replace(best, note=refused.reason) if best.overstays and refused is not None else best


def _tidy(problem: Problem, task: Task, plan: Plan) -> Plan:
    """The plan with its settings in their turn, and what is alike in the order in which it is named."""
    if problem.chains:
        from cellwright.engine.pipelines.turns import in_turn  # loads what cuts plans into blocks

        plan = in_turn(problem, task, plan)
    return in_the_order_named(problem, plan)


def _lasts(plan: Plan) -> bool:
    return any(step.duration for step in plan.steps)
