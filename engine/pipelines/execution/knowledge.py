"""What a run knows beside its problem file: facts that were found out before it began, and the real times of steps.

The journal keeps them with the run, so that it goes on with them after a stop.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from cellwright.engine.pipelines.execution.records import read_atom
from cellwright.kb.model.problem import Problem

FACTS, TIMES = "facts", "times"


def added_knowledge(told: Problem, known: Problem) -> dict[str, Any]:
    """What is known of a problem beside what was told, for the journal; nothing if that is all."""
    before = set(told.statics)
    facts = [str(fact) for fact in known.statics if fact not in before]
    times = [
        [str(step), lasts] for step, lasts in known.durations.items() if told.durations.get(step) != lasts
    ]
    return {**({FACTS: facts} if facts else {}), **({TIMES: times} if times else {})}


def with_knowledge(problem: Problem, entry: Mapping[str, Any]) -> Problem:
    """The problem with what a journal's entry knows beside it."""
    facts = tuple(map(read_atom, entry.get(FACTS, ())))
    times = {read_atom(step): int(lasts) for step, lasts in entry.get(TIMES, ())}
    if not facts and not times:
        return problem
    return replace(problem, statics=(*problem.statics, *facts), durations={**problem.durations, **times})
