"""The stages in order. What the command line does is one call of a function here."""

import time
from dataclasses import replace

from engine.grounding import ground
from engine.model.outcome import Outcome, Statistics
from engine.planning import Limits
from engine.planning import plan as plan_task
from kb.model.problem import Problem


def plan(problem: Problem, limits: Limits = Limits()) -> Outcome:
    """A checked plan for a problem, the proof that there is none, or where the search stopped. Raises `InvalidInput`."""
    started = time.perf_counter()
    task = ground(problem)
    grounded = time.perf_counter()
    outcome = plan_task(task, limits)
    finished = time.perf_counter()
    counts = {
        "operators": len(task.operators),
        "atoms": len(task.atoms),
        "mutex groups": len(task.mutex_groups),
        **outcome.statistics.counts,
    }
    seconds = {"grounding": grounded - started, "search": finished - grounded}
    return replace(outcome, statistics=Statistics(counts, seconds))
