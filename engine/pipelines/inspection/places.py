"""Positions of measurements that only the cell file gives."""

from dataclasses import replace

from engine.model.measurements import measurements_of
from engine.pipelines.inspection import positions
from kb.loader.amounts import standing
from kb.model.problem import Problem
from kb.terms import Function, Number


def with_places(problem: Problem) -> Problem:
    """The problem with a `position` added for each measurement that has none but has a place in the cell.

    The position is that of the place in micrometres, in the frame of the domain's travel, else in the world. Raises
    `InvalidInput` for a bad cell.
    """
    words, names = problem.domain.conventions, measurements_of(problem)
    if not names or words.position not in problem.domain.predicates:
        return problem
    known, point = positions(problem), standing(problem.domain)
    found = {name: point(words.place(name)) for name in names if name not in known}
    facts = tuple(
        Function(words.position, (Function(name), *map(Number, at))) for name, at in found.items() if at
    )
    return replace(problem, statics=(*problem.statics, *facts)) if facts else problem
