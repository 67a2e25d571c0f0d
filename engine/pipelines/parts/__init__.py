"""Plans made part by part: a problem that falls into parts which follow one another is never grounded as a whole.

The parts of an inspection are its measurements, in the order of the sequencer. Each is planned in the state that the last
one leaves. The parts are joined, and the whole plan passes the gate. Where that does not lead to a plan, the caller plans
the whole problem.
"""

import time
from collections import Counter
from dataclasses import dataclass

from engine.model.outcome import Found, GaveUp, Infeasible, Outcome, Statistics
from engine.pipelines.gate import PlanGate
from engine.pipelines.parts.chain import Chain
from engine.pipelines.parts.itinerary import Itinerary, Part, itinerary
from engine.pipelines.parts.joining import joined
from engine.pipelines.parts.memory import Memory, Notebook
from engine.stages.grounding.initial import initial_state
from engine.stages.grounding.limits import require_affordable_statics
from engine.stages.grounding.program import Vocabulary
from engine.stages.macros.lifted.situation import Situation
from engine.stages.macros.lifted.world import CellDomain
from engine.stages.macros.lookup.query import goal_literal
from engine.stages.planning import Limits
from engine.stages.sequencing import Limits as TourLimits
from kb.diagnostics import InvalidInput
from kb.model.conditions import goal_parts
from kb.model.problem import Problem

__all__ = ["Itinerary", "Memory", "Notebook", "Part", "Sequenced", "by_sequence"]


@dataclass(frozen=True)
class Sequenced:
    """An outcome whose plan follows a sequence."""

    outcome: Outcome
    itinerary: Itinerary


def by_sequence(
    problem: Problem, limits: Limits = Limits(), memory: Memory | None = None, store: str = ""
) -> Sequenced | None:
    """The outcome for an inspection whose measurements are put in order first; None if that leads to no plan.

    None as well for a problem that is no inspection. Raises `InvalidInput`.
    """
    started = time.perf_counter()
    require_affordable_statics(problem)
    way = itinerary(problem, TourLimits(seed=limits.seed, interrupted=limits.interrupted), store)
    if way is None:
        return None
    sequencing = time.perf_counter() - started
    outcome = _planned(problem, way, limits, memory or Notebook(), Counter(sequencing=sequencing))
    return None if outcome is None else Sequenced(outcome, way)


def _planned(
    problem: Problem, way: Itinerary, limits: Limits, memory: Memory, seconds: Counter[str]
) -> Outcome | None:
    started = time.perf_counter()
    start = _start(problem)
    seconds["state"] = time.perf_counter() - started
    line = Chain(problem, start, memory, limits, seconds=seconds)
    failed = line.run((*way.parts, *way.rest))
    if failed is not None:
        return _refused(way, *failed)
    started = time.perf_counter()
    goals = (goal_literal(goal) for goal in goal_parts(problem.goal))
    plan = joined(start, line.steps, [goal for goal in goals if goal is not None])
    seconds["joining"] = time.perf_counter() - started
    started = time.perf_counter()
    plan, wrong = PlanGate().settled(problem, plan)
    seconds["check"] = time.perf_counter() - started
    counts = {"measurements": len(way.visits), **line.counts}
    return None if wrong else Found(plan, Statistics(counts, dict(seconds)))


def _start(problem: Problem) -> Situation:
    state, contradicted = initial_state(problem, Vocabulary(problem.domain))
    if contradicted:
        raise InvalidInput(contradicted)
    return Situation.of(CellDomain(problem), state)


def _refused(way: Itinerary, part: Part, outcome: Outcome) -> Outcome | None:
    """Why there is no plan, if that is certain: what a part needs can never be, or the time is up."""
    if isinstance(outcome, GaveUp):
        return outcome
    if isinstance(outcome, Infeasible) and way.partition.impossible and not part.name:
        said = "; ".join(f"{name}: {why}" for name, why in way.partition.impossible.items())
        return Infeasible(f"{outcome.reason} ({said})", outcome.statistics)
    return None
