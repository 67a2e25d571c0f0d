"""The stages in order. What the command line does is one call of a function here."""

import time
from dataclasses import replace

from engine.grounding import ground
from engine.model.outcome import Found, Outcome, Statistics
from engine.planning import Limits
from engine.planning import plan as plan_task
from engine.validation import validate
from kb.diagnostics import Diagnostic
from kb.model.problem import Problem


class InternalError(Exception):
    """The engine made a plan that its own checker refuses: a bug. Carries the checker's findings."""

    def __init__(self, diagnostics: list[Diagnostic]) -> None:
        super().__init__("the checker refuses the plan:\n" + "\n".join(map(str, diagnostics)))


def plan(problem: Problem, limits: Limits = Limits()) -> Outcome:
    """A checked plan for a problem, the proof that there is none, or where the search stopped. Raises `InvalidInput`."""
    started = time.perf_counter()
    task = ground(problem)
    grounded = time.perf_counter()
    outcome = plan_task(task, limits)
    finished = time.perf_counter()
    if isinstance(outcome, Found):
        wrong = validate(problem, outcome.plan)
        if wrong:
            raise InternalError(wrong)
    checked = time.perf_counter()
    counts = {
        "operators": len(task.operators),
        "atoms": len(task.atoms),
        "mutex groups": len(task.mutex_groups),
        **outcome.statistics.counts,
    }
    seconds = {"grounding": grounded - started, "search": finished - grounded, "check": checked - finished}
    return replace(outcome, statistics=Statistics(counts, seconds))
