"""Plans for an objective: the least makespan where steps take time, else the least cost.

A search knows costs only. So several of its plans are scheduled, and the best one is the answer:
the one that costs least, and the one whose steps take least time.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from cellwright.engine.model.ground_task import GroundTask
from cellwright.engine.model.outcome import Found, GaveUp, Infeasible, Outcome, Statistics
from cellwright.engine.model.part_measurements import is_put_in_order
from cellwright.engine.model.planning_choices import PlanningObjective, SequenceChoice
from cellwright.engine.pipelines import planning
from cellwright.engine.pipelines.planning.checked_plan import (
    in_named_order,
    plan_and_ground,
    task_for,
)
from cellwright.engine.stages.grounding.instance_bounds import bound_instances
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.model.plan_model import Plan, StepId
from cellwright.kb.model.planning_problem import Problem

if TYPE_CHECKING:  # schedules take a while to load, and only plans whose steps take time have one
    from cellwright.engine.model.shop_scheduling import Timetable
    from cellwright.engine.pipelines.planning.decomposition import Itinerary, MacroMemory
    from cellwright.engine.stages.scheduling import ScheduleLimits

FEW = 12  # objects of a workflow, for which a plan is made first as well
MAX_PROVED_INSTANCES = (
    500  # instances of operators of a problem whose sequence the planner may prove to be cheapest
)


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


def plan_for_objective(
    problem: Problem,
    limits: SearchLimits = SearchLimits(),
    objective: PlanningObjective | None = None,
    order: SequenceChoice = SequenceChoice.SEQUENCE,
) -> Run:
    """A checked plan for a problem with the least that is found of an objective. Raises
    `InvalidInput`.

    Without an objective it is the makespan where steps of the plan take time, else the cost.
    Measurements are made in the order of the sequencer, unless the order is free. A plan that
    breaks a window that must be kept is not given out.
    """
    return _run_in_time(problem, _any_run(problem, limits, objective, order))


def _run_in_time(problem: Problem, run: Run) -> Run:
    """The run, if its plan keeps the windows that it must keep and the calendars."""
    if run.timetable is None or run.timetable.keeps_hours:
        return run
    return Run(_why_not_given(problem, run.timetable), None, run.itinerary)


def _why_not_given(problem: Problem, timetable: "Timetable") -> Infeasible | GaveUp:
    # only plans with windows need it
    from cellwright.engine.pipelines.planning.window_keeping import why_not_given

    return why_not_given(problem, timetable)


def _any_run(
    problem: Problem,
    limits: SearchLimits,
    objective: PlanningObjective | None,
    order: SequenceChoice,
) -> Run:
    """`plan_for_objective`, also with a plan that breaks windows."""
    cheap = objective is PlanningObjective.COST
    followed = (
        plan_sequence(problem, limits, cheap=cheap) if order is SequenceChoice.SEQUENCE else None
    )
    if followed is not None:
        return followed
    if (
        not cheap
        and order is SequenceChoice.SEQUENCE
        and (flowing := _flowing(problem, limits)) is not None
    ):
        if isinstance(flowing, Infeasible):
            return Run(flowing)
        return Run(Found(flowing.plan, flowing.statistics), flowing)
    outcome, task = plan_and_ground(problem, limits, ordered=not problem.chains)
    return _run_of_outcome(problem, task, outcome, limits, objective)


def _flowing(
    problem: Problem, limits: SearchLimits, work: "ScheduleLimits | None" = None
) -> "Timetable | Infeasible | None":
    """The timetable of many objects that are scheduled without a plan made first; None for few, and
    where that leads to none.

    Or that what is there does not suffice for all of them.
    """
    subjects = {chain.subject for chain in problem.chains}
    if len(subjects) <= FEW:
        return None
    from cellwright.engine.pipelines.planning import makespan_plans

    made = planning.by_flow(problem, work or makespan_plans.effort(limits, len(subjects)))
    return None if isinstance(made, str) else made


def plan_sequence(
    problem: Problem,
    limits: SearchLimits,
    memory: "MacroMemory | None" = None,
    store: str = "",
    cheap: bool = False,
) -> Run | None:
    """The run of an inspection in the order of its sequence; None if the problem is none, or has no
    such plan.

    Changes of tools and stations are ordered so that the plan is fast, or `cheap` first.

    MACROPs are found in `memory` and learned there, and a sequence is kept in `store`, if they are
    given.
    """
    if not is_put_in_order(problem):
        return None
    from cellwright.engine.pipelines.planning.decomposition import (
        by_sequence,  # slow to load, and only inspections need it
    )

    sequenced_outcome = by_sequence(problem, limits, memory, store, cheap)
    if sequenced_outcome is None:
        return None
    if not isinstance(sequenced_outcome.outcome, Found) or not _takes_time(
        problem, sequenced_outcome.outcome.plan
    ):
        return Run(sequenced_outcome.outcome, None, sequenced_outcome.itinerary)
    from cellwright.engine.pipelines.planning.timetable import keep_plan_order

    outcome = _prove_cheapest(problem, sequenced_outcome.outcome, limits)
    return Run(outcome, keep_plan_order(problem, outcome.plan), sequenced_outcome.itinerary)


def _prove_cheapest(problem: Problem, outcome: Found, limits: SearchLimits) -> Found:
    """The outcome for a small problem with the proof that no plan costs less, if the planner
    finds such a proof.
    """
    if bound_instances(problem) > MAX_PROVED_INSTANCES:
        return outcome
    free, _ = plan_and_ground(problem, limits)
    optimal = isinstance(free, Found) and free.optimal and free.plan.cost == outcome.plan.cost
    return replace(outcome, optimal=optimal)


def schedule_outcome(
    problem: Problem,
    outcome: Outcome,
    limits: SearchLimits,
    objective: PlanningObjective | None,
    task: GroundTask | None = None,
) -> Run:
    """`plan` for an outcome that is known already, and for its ground `task` if that is.

    Raises `InvalidInput`.
    """
    if not isinstance(outcome, Found) or not _takes_time(problem, outcome.plan):
        return Run(outcome)
    known = task or task_for(problem, outcome.plan)
    return _run_in_time(problem, _run_of_outcome(problem, known, outcome, limits, objective))


def plan_fastest(
    problem: Problem, limits: SearchLimits, work: "ScheduleLimits | None" = None
) -> "Timetable | Infeasible | GaveUp":
    """The timetable of the plan with the least makespan that is found, or why there is none. Raises
    `InvalidInput`.

    The plan of an inspection follows its sequence, and the schedule keeps this order.
    """
    started = time.perf_counter()
    followed = plan_sequence(problem, limits)
    if followed is not None:
        return _sequence_timetable(problem, followed, started)
    if (flowing := _flowing(problem, limits, work)) is not None:
        if isinstance(flowing, Infeasible):
            return flowing
        seconds = {**flowing.statistics.seconds, "in all": time.perf_counter() - started}
        return replace(flowing, statistics=Statistics(flowing.statistics.counts, seconds))
    outcome, task = plan_and_ground(problem, limits)
    if not isinstance(outcome, Found):
        return outcome
    from cellwright.engine.pipelines.planning import makespan_plans
    from cellwright.engine.stages.scheduling import ScheduleLimits

    planning = time.perf_counter() - started
    best = _with_refusal_note(
        *makespan_plans.search_least_makespan(
            problem, task, outcome, limits, work or ScheduleLimits()
        )
    )
    if not best.keeps_hours:
        return _why_not_given(problem, best)
    seconds = {
        "planning": planning,
        **best.statistics.seconds,
        "in all": time.perf_counter() - started,
    }
    return replace(best, statistics=Statistics(best.statistics.counts, seconds))


def _sequence_timetable(
    problem: Problem, followed: Run, started: float
) -> "Timetable | Infeasible | GaveUp":
    """The timetable of a plan that follows a sequence, or why there is none."""
    outcome = followed.outcome
    if not isinstance(outcome, Found):
        return outcome
    from cellwright.engine.pipelines.planning.timetable import keep_plan_order

    timetable = followed.timetable or keep_plan_order(problem, outcome.plan)
    if not timetable.keeps_hours:
        return _why_not_given(problem, timetable)
    seconds = {**outcome.statistics.seconds, "in all": time.perf_counter() - started}
    return replace(timetable, statistics=replace(outcome.statistics, seconds=seconds))


def _run_of_outcome(
    problem: Problem,
    task: GroundTask,
    outcome: Outcome,
    limits: SearchLimits,
    objective: PlanningObjective | None,
) -> Run:
    """An outcome with its timetable, and for the makespan with the best plan found from its own
    on.
    """
    if not isinstance(outcome, Found):
        return Run(outcome)
    if not _takes_time(problem, outcome.plan):
        return Run(
            replace(outcome, plan=_tidy_plan(problem, task, outcome.plan))
            if problem.chains
            else outcome
        )
    from cellwright.engine.model.shop_scheduling import Timetable
    from cellwright.engine.pipelines.planning import makespan_plans
    from cellwright.engine.pipelines.planning.timetable import own_order, time_plan

    if objective is PlanningObjective.COST:
        plan = _tidy_plan(problem, task, outcome.plan)
        timetable = own_order(problem, task, plan)
        if not timetable.keeps_hours:
            timed = time_plan(problem, task, plan)
            timetable = timed if isinstance(timed, Timetable) else timetable
        return Run(replace(outcome, plan=timetable.plan), timetable)
    best = _with_refusal_note(*makespan_plans.search_least_makespan(problem, task, outcome, limits))
    optimal = outcome.optimal and best.plan.cost == outcome.plan.cost
    return Run(replace(outcome, plan=best.plan, optimal=optimal), best)


def _with_refusal_note(best: "Timetable", refused: Infeasible | GaveUp | None) -> "Timetable":
    """The timetable; where things stay too long in it, with the reason why a plan has no other
    one.
    """
    return (
        replace(best, note=refused.reason) if not best.keeps_all and refused is not None else best
    )


def _tidy_plan(problem: Problem, task: GroundTask, plan: Plan) -> Plan:
    """The plan with its settings in their turn, and what is alike in the order in which it is
    named.
    """
    if problem.chains:
        from cellwright.engine.pipelines.planning.makespan_plans import (
            delay_settings,  # loads what cuts plans into blocks
        )

        plan = delay_settings(problem, task, plan)
    return in_named_order(problem, plan)


def _takes_time(problem: Problem, plan: Plan) -> bool:
    bound = problem.all_windows or problem.all_calendars
    return bool(bound) or any(step.duration for step in plan.steps)
