"""The order in which a plan makes its measurements, as a picture of the part."""

import re
from functools import lru_cache
from typing import Any
from xml.sax.saxutils import quoteattr, unescape

import numpy as np

from cellwright.engine.faces.monitor.choosing import mentions
from cellwright.engine.faces.monitor.motions import Target
from cellwright.engine.formats.report.tour_svg import picture
from cellwright.engine.model.measurements import measurements_of
from cellwright.engine.model.tour import Tour, TourProblem, Visit
from cellwright.engine.pipelines.execution.records import read_atom
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader.cell import cell_of
from cellwright.kb.model.conventions import Conventions
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Number

MICRO = 1e-6
VISIT = re.compile(r'<circle class="visit"([^>]*)><title>(.*?)</title>')
LIT = 'style="filter: drop-shadow(0 0 4px #d02090); stroke: #d02090; stroke-width: 4"'
Spot = tuple[float, float, float]


def sequence_picture(target: Target, plan: dict[str, Any]) -> str | None:
    """The SVG; None if the plan measures nothing whose place is known."""
    words, spots = _measured_places(target)
    visits = []
    steps = {each["id"]: each for each in plan.get("steps", ())}
    for number in plan.get("order", ()):
        step = steps[number]
        for fact in map(read_atom, step.get("adds", ())):
            if fact.name == words.measured and (place := str(fact.arguments[-1])) in spots:
                name, at = spots[place]
                visits.append(Visit(name, at, str(fact.arguments[0])))
    if len(visits) < 2:
        return None
    order, ways = tuple(range(len(visits))), np.zeros((len(visits), len(visits)), dtype=np.int64)
    return picture(Tour(order, 0, 0), TourProblem("sequence", tuple(visits), ways, closed=False))


def pickable(drawn: str, chosen: str) -> str:
    """The picture with dots that a click chooses; those that belong to what is chosen have a rim."""

    def step(found: re.Match[str]) -> str:
        name = unescape(found[2].partition(": ")[2])
        rim = f' {LIT} data-chosen="yes"' if chosen and mentions([name], [chosen]) else ""
        told = f'class="visit step" tabindex="0" role="button" data-step={quoteattr(name)}{rim}'
        return f"<circle {told}{found[1]}><title>{found[2]}</title>"

    return VISIT.sub(step, drawn)


@lru_cache(16)
def _measured_places(target: Target) -> tuple[Conventions, dict[str, tuple[str, Spot]]]:
    """The domain's words; and for each place the measurement that is made there, with its point in metres."""
    from cellwright.engine.pipelines.planning import problem_of

    try:
        problem = problem_of(*target)
    except InvalidInput:
        return Conventions(), {}
    words, spots = problem.domain.conventions, {**_of_cell(problem, target[0]), **_of_problem(problem)}
    return words, {words.place(name): (name, at) for name, at in spots.items()}


def _of_problem(problem: Problem) -> dict[str, Spot]:
    found = {}
    for fact in problem.statics:
        numbers = [each.value * MICRO for each in fact.arguments[1:] if isinstance(each, Number)]
        if fact.name == problem.domain.conventions.position and len(numbers) == 3:
            found[str(fact.arguments[0])] = (numbers[0], numbers[1], numbers[2])
    return found


def _of_cell(problem: Problem, target: str) -> dict[str, Spot]:
    try:
        places = cell_of(target).places
    except InvalidInput:
        return {}
    words = problem.domain.conventions
    named = {name: places.get(words.place(name)) for name in measurements_of(problem)}
    return {name: place.placement.pose.position_m for name, place in named.items() if place is not None}
