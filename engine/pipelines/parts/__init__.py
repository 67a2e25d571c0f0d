"""Plans made part by part: a problem that falls into parts which follow one another is never grounded as a whole.

The parts of an inspection are its measurements, in the order of the sequencer. Each is planned in the state that the last
one leaves. The parts are joined, and the whole plan passes the gate. Where that does not lead to a plan, the caller plans
the whole problem.
"""

import time
from dataclasses import dataclass

from cellwright.engine.model.measurements import chooses_tools, is_shared
from cellwright.engine.model.outcome import Found, GaveUp, Infeasible, Outcome, Statistics
from cellwright.engine.pipelines.gate import PlanGate
from cellwright.engine.pipelines.inspection import partition
from cellwright.engine.pipelines.inspection.demands import Demands
from cellwright.engine.pipelines.parts.beginning import chain_of, start_of
from cellwright.engine.pipelines.parts.chain import Chain, Part
from cellwright.engine.pipelines.parts.itinerary import Itinerary, itinerary
from cellwright.engine.pipelines.parts.joining import joined, of_arms
from cellwright.engine.pipelines.parts.memory import Memory, Notebook
from cellwright.engine.pipelines.parts.runs import in_best_order
from cellwright.engine.pipelines.parts.sharing import Shared, shared
from cellwright.engine.pipelines.planning import LARGE
from cellwright.engine.stages.grounding.limits import size
from cellwright.engine.stages.macros.lifted.situation import Situation
from cellwright.engine.stages.macros.lookup.query import goal_literal
from cellwright.engine.stages.planning import Limits
from cellwright.engine.stages.sequencing import Limits as TourLimits
from cellwright.kb.model.conditions import goal_parts
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Function, natural_key

__all__ = ["Itinerary", "Memory", "Notebook", "Part", "Sequenced", "Shared", "by_sequence", "shares_of"]


@dataclass(frozen=True)
class Sequenced:
    """An outcome whose plan follows a sequence."""

    outcome: Outcome
    itinerary: Itinerary


def by_sequence(
    problem: Problem,
    limits: Limits = Limits(),
    memory: Memory | None = None,
    store: str = "",
    cheap: bool = False,
) -> Sequenced | None:
    """The outcome for an inspection whose measurements are put in order first; None if that leads to no plan.

    None as well for a problem that is no inspection. Of the orders of runs, one whose plan is the fastest is taken, or the
    `cheap` one. Raises `InvalidInput`.
    """
    started = time.perf_counter()
    if not chooses_tools(problem.domain):
        return None
    asked = TourLimits(seed=limits.seed, interrupted=limits.interrupted, sharp=False)
    line = Chain(problem, start_of(problem), memory or Notebook(), limits)
    way = itinerary(problem, lambda: line, asked, store)
    if way is None:
        return None
    line.seconds["sequencing"] = time.perf_counter() - started
    started = time.perf_counter()
    way = in_best_order(way, line, cheap)
    line.seconds["start"] = time.perf_counter() - started
    outcome = _planned(problem, way, line)
    if (
        outcome is not None and way.problem.timed and way.shared is None and not store
    ):  # a kept sequence stays as it is kept
        outcome, way = _on_time(problem, way, outcome, line, asked)
    return None if outcome is None else Sequenced(outcome, way)


def shares_of(
    problem: Problem, more: Demands = Demands(), limits: TourLimits = TourLimits()
) -> Shared | Infeasible | GaveUp | None:
    """How several arms share the measurements of a problem; None if one arm makes them all. Raises `InvalidInput`."""
    if not is_shared(problem):
        return None
    return shared(problem, partition(problem), more, limits, chain_of(problem, limits))


def _on_time(
    problem: Problem, way: Itinerary, outcome: Outcome, line: Chain, limits: TourLimits
) -> tuple[Outcome, Itinerary]:
    """The plan, or one along another tour if that misses fewer windows."""
    # only windows need schedules, which are slow to load
    from cellwright.engine.pipelines.parts.punctual import punctual

    def planned(other: Itinerary) -> Outcome | None:
        again = Chain(problem, start_of(problem), line.memory, line.limits)
        return _planned(problem, other, again)

    return punctual(problem, way, outcome, planned, limits)


def _planned(problem: Problem, way: Itinerary, line: Chain) -> Outcome | None:
    start, seconds = line.here, line.seconds
    failed = line.run(way.parts(problem))
    if failed is not None:
        return _refused(line, start, way, *failed)
    started = time.perf_counter()
    goals = (goal_literal(goal) for goal in goal_parts(problem.goal))
    wanted = [goal for goal in goals if goal is not None]
    plan = joined(start, line.steps, wanted, of_arms(problem, way))
    seconds["joining"] = time.perf_counter() - started
    started = time.perf_counter()
    plan, wrong = PlanGate().settled(problem, plan)
    seconds["check"] = time.perf_counter() - started
    counts = {"measurements": len(way.visits), **line.counts}
    if wrong:
        return _together(problem, wrong[0].message)
    return Found(plan, Statistics(counts, dict(seconds)))


def _refused(line: Chain, start: Situation, way: Itinerary, part: Part, outcome: Outcome) -> Outcome | None:
    """Why there is no plan, if that is certain or the planner gave up: the part has no plan by itself either."""
    if isinstance(outcome, GaveUp):
        return outcome
    alone = line.alone(part, start)
    if isinstance(alone, Infeasible):
        reasons = way.partition.impossible
        known = [f"{name}: {reasons[name]}" for name in sorted(reasons, key=natural)]
        said = f"; {', '.join(known)}" if known and not part.name else ""
        about = f"{part.name}: " if part.name else ""
        return Infeasible(f"{about}{alone.reason}{said}", alone.statistics)
    return _together(line.problem, f"{part.name or 'what the goals ask for beside measurements'} has no plan")


def _together(problem: Problem, why: str) -> Outcome | None:
    """What is left to say if parts do not follow one another: nothing if the whole problem can be planned at once."""
    if size(problem) <= LARGE:
        return None
    reason = f"in the order of the sequence {why}, and the problem is too large to be planned as a whole"
    return GaveUp(reason, "memory")


def natural(name: str) -> tuple[tuple[int, int, str], ...]:
    """A sort key under which `m2` comes before `m10`."""
    return natural_key(Function(name))
