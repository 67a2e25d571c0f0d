"""The best order of few visits by the cost of their whole plan: ways, changes of tool and station,
start and end.

What a plan takes from each visit to each other one is planned, as in `runs`. The order that takes
least is then a tour over these figures, so its bound counts what the plan counts, and small orders
are proved.
"""

from dataclasses import replace

import numpy as np

from cellwright.engine.model.tour_problem import Tour, TourProblem, Visit
from cellwright.engine.pipelines.planning.decomposition.measurement_order import (
    CountedTour,
    Itinerary,
    Links,
    Value,
)
from cellwright.engine.pipelines.planning.decomposition.part_chain import INFINITE_COST, PartChain
from cellwright.engine.stages.sequencing import TourLimits, sequence_tour

MOST_COUNTED = 30  # visits: from each to each other one something is planned


def in_counted_order(
    way: Itinerary, line: PartChain, limits: TourLimits, cheap: bool = False
) -> Itinerary:
    """The visits in the order that takes least, if that is less than the order so far, with what it
    takes and its bound.

    Orders that are asked for, or that several arms share, stay; so do those of more than
    `MOST_COUNTED` visits, and those of one run, whose ways tell all.
    """
    count = len(way.visits)
    if (
        way.fixed
        or way.shared
        or not 2 <= count <= MOST_COUNTED
        or len(way.runs) < 2
        or limits.interrupted()
    ):
        return way
    links = Links(way, line, cheap, {part.name: part for part in way.parts(line.problem)})
    table = [
        [links.value_between(one, other) for other in _places(count)] for one in _places(count)
    ]
    if any(each[0] >= INFINITE_COST for row in table for each in row):
        return way
    problem, scale = _problem(way, table)
    found = sequence_tour(problem, limits)
    if not isinstance(found, Tour):
        return way
    so_far = (0, *range(1, count + 1))
    taken, best = (_value(table, order) for order in (so_far, found.order))
    least = found.lower_bound // scale
    unit = "" if cheap else line.problem.domain.time_unit
    if best >= taken:
        return replace(way, counted=CountedTour(taken[0], least, unit))
    better = way.of_runs([(place - 1,) for place in found.order[1:]])
    return replace(better, counted=CountedTour(best[0], least, unit))


def _places(count: int) -> list[int | None]:
    """The start, which stands for the end, too, and all visits."""
    return [None, *range(count)]


def _problem(way: Itinerary, table: list[list[Value]]) -> tuple[TourProblem, int]:
    """The closed tour from the start over all visits and back, and by how much its first figure
    is multiplied.
    """
    scale = 1 + sum(max(second for _, second in row) for row in table)
    costs = np.array([[first * scale + second for first, second in row] for row in table], np.int64)
    np.fill_diagonal(costs, 0)
    visits = (Visit("start"), *(Visit(name) for name, _ in way.visits))
    return TourProblem(way.problem.name, visits, costs, closed=True, start=0), scale


def _value(table: list[list[Value]], order: tuple[int, ...]) -> Value:
    pairs = [table[one][other] for one, other in zip(order, (*order[1:], order[0]), strict=True)]
    return sum(first for first, _ in pairs), sum(second for _, second in pairs)
