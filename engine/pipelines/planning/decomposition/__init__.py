"""Plans made part by part: parts that follow one another are never grounded as a whole.

The parts of an inspection are its measurements, in the order of the sequencer. Each is planned in
the state that the last one leaves. The parts are joined, and the whole plan passes the gate. Where
that does not lead to a plan, the caller plans the whole problem.
"""

import time
from dataclasses import dataclass

from cellwright.engine.model.outcome import Found, GaveUp, Infeasible, Outcome, Statistics
from cellwright.engine.model.part_measurements import chooses_tools, is_shared
from cellwright.engine.pipelines.inspection.tool_tours import partition_by_tool
from cellwright.engine.pipelines.inspection.tour_demands import TourDemands
from cellwright.engine.pipelines.planning.checked_plan import LARGE_INSTANCES
from cellwright.engine.pipelines.planning.decomposition.counting import in_counted_order
from cellwright.engine.pipelines.planning.decomposition.joined_plan import join_parts, of_arms
from cellwright.engine.pipelines.planning.decomposition.measurement_order import (
    CountedTour,
    Itinerary,
    find_itinerary,
    in_best_order,
)
from cellwright.engine.pipelines.planning.decomposition.measurement_shares import (
    SharedMeasurements,
    share_measurements,
)
from cellwright.engine.pipelines.planning.decomposition.part_chain import (
    MacroMemory,
    Notebook,
    PartChain,
    PlanningPart,
    chain_of,
    start_of,
)
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.stages.grounding.instance_bounds import bound_instances
from cellwright.engine.stages.lifted.cell_domain import Situation
from cellwright.engine.stages.macros.lookup.macro_query import goal_literal
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.sequencing import TourLimits
from cellwright.kb.model.conditions import goal_parts
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function, natural_key

__all__ = [
    "CountedTour",
    "Itinerary",
    "MacroMemory",
    "Notebook",
    "PlanningPart",
    "SequencedOutcome",
    "SharedMeasurements",
    "by_sequence",
    "shares_of",
]


@dataclass(frozen=True)
class SequencedOutcome:
    """An outcome whose plan follows a sequence."""

    outcome: Outcome
    itinerary: Itinerary


def by_sequence(
    problem: Problem,
    limits: SearchLimits = SearchLimits(),
    memory: MacroMemory | None = None,
    store: str = "",
    cheap: bool = False,
) -> SequencedOutcome | None:
    """The outcome for an inspection whose measurements are put in order first; None if that leads
    to no plan.

    None as well for a problem that is no inspection. Of the orders of runs, one whose plan is the
    fastest is taken, or the `cheap` one. Raises `InvalidInput`.
    """
    started = time.perf_counter()
    if not chooses_tools(problem.domain):
        return None
    asked = TourLimits(seed=limits.seed, interrupted=limits.interrupted, sharp=False)
    line = PartChain(problem, start_of(problem), memory or Notebook(), limits)
    route = find_itinerary(problem, lambda: line, asked, store)
    if route is None:
        return None
    line.seconds["sequencing"] = time.perf_counter() - started
    started = time.perf_counter()
    route = in_counted_order(in_best_order(route, line, cheap), line, asked, cheap)
    line.seconds["start"] = time.perf_counter() - started
    outcome = _plan_itinerary(problem, route, line)
    if (
        outcome is not None and route.problem.timed and route.shared is None and not store
    ):  # a kept sequence stays as it is kept
        outcome, route = _on_time(problem, route, outcome, line, asked)
    return None if outcome is None else SequencedOutcome(outcome, route)


def shares_of(
    problem: Problem, more: TourDemands = TourDemands(), limits: TourLimits = TourLimits()
) -> SharedMeasurements | Infeasible | GaveUp | None:
    """How several arms share the measurements of a problem; None if one arm makes them all.
    Raises `InvalidInput`.
    """
    if not is_shared(problem):
        return None
    return share_measurements(
        problem, partition_by_tool(problem), more, limits, chain_of(problem, limits)
    )


def _on_time(
    problem: Problem, route: Itinerary, outcome: Outcome, line: PartChain, limits: TourLimits
) -> tuple[Outcome, Itinerary]:
    """The plan, or one along another tour if that misses fewer windows."""
    # only windows need schedules, which are slow to load
    from cellwright.engine.pipelines.planning.decomposition.time_windows import meet_windows

    def planned(other_route: Itinerary) -> Outcome | None:
        again = PartChain(problem, start_of(problem), line.memory, line.limits)
        return _plan_itinerary(problem, other_route, again)

    return meet_windows(problem, route, outcome, planned, limits)


def _plan_itinerary(problem: Problem, route: Itinerary, line: PartChain) -> Outcome | None:
    start, seconds = line.here, line.seconds
    failed = line.run(route.parts(problem))
    if failed is not None:
        return _refuse_part(line, start, route, *failed)
    started = time.perf_counter()
    goals = (goal_literal(goal) for goal in goal_parts(problem.goal))
    goal_literals = [goal for goal in goals if goal is not None]
    plan = join_parts(start, line.steps, goal_literals, of_arms(problem, route))
    seconds["joining"] = time.perf_counter() - started
    started = time.perf_counter()
    plan, wrong = PlanGate().settled(problem, plan)
    seconds["check"] = time.perf_counter() - started
    counts = {"measurements": len(route.visits), **line.counts}
    if wrong:
        return _leave_to_whole_plan(problem, wrong[0].message)
    return Found(plan, Statistics(counts, dict(seconds)))


def _refuse_part(
    line: PartChain, start: Situation, route: Itinerary, part: PlanningPart, outcome: Outcome
) -> Outcome | None:
    """Why there is no plan, if that is certain or the planner gave up: the part has no plan by
    itself either.
    """
    if isinstance(outcome, GaveUp):
        return outcome
    alone = line.alone(part, start)
    if isinstance(alone, Infeasible):
        reasons = route.partition.impossible
        impossible_texts = [
            f"{name}: {reasons[name]}" for name in sorted(reasons, key=natural_name_key)
        ]
        more_text = f"; {', '.join(impossible_texts)}" if impossible_texts and not part.name else ""
        about = f"{part.name}: " if part.name else ""
        return Infeasible(f"{about}{alone.reason}{more_text}", alone.statistics)
    return _leave_to_whole_plan(
        line.problem, f"{part.name or 'what the goals ask for beside measurements'} has no plan"
    )


def _leave_to_whole_plan(problem: Problem, why: str) -> Outcome | None:
    """What is left to say if parts do not follow one another: nothing if the whole problem can
    be planned at once.
    """
    if bound_instances(problem) <= LARGE_INSTANCES:
        return None
    reason = (
        f"in the order of the sequence {why}, and the problem is too large to be planned as a whole"
    )
    return GaveUp(reason, "memory")


def natural_name_key(name: str) -> tuple[tuple[int, int, str], ...]:
    """A sort key under which `m2` comes before `m10`."""
    return natural_key(Function(name))
