"""Where the part lies by its measured datums, means of values, and a problem with moved points."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import apply
from cellwright.engine.model.part_measurements import MeasurementPoint
from cellwright.engine.model.shape_fits import Datums
from cellwright.engine.pipelines.inspection.measurement_points import (
    METRES_PER_UNIT,
    PROFILE_KIND,
    points_of_problem,
    with_places,
)
from cellwright.kb.model.measured_results import COVERAGE_FACTOR, Measured
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function, Number

AGREEING_VALUE_SIGMAS = 3.0  # standard deviations between two values of the same feature


def value_sigma(measured: Measured) -> float:
    """The standard deviation of a value; 0 if nobody said."""
    return (measured.uncertainty or 0.0) / COVERAGE_FACTOR


def agreeing_sets(values: Sequence[Measured]) -> tuple[tuple[int, ...], ...]:
    """The largest sets of values that agree with each other; several if none is the largest.

    Without uncertainty the last counts.
    """
    if len(values) == 1 or not all(map(value_sigma, values)):
        return ((len(values) - 1,),)
    groups = set[tuple[int, ...]]()
    order = sorted(range(len(values)), key=lambda index: values[index].value)
    for place, first in enumerate(order):
        span = [first]
        for other_index in order[place + 1 :]:
            wide = AGREEING_VALUE_SIGMAS * math.hypot(
                value_sigma(values[first]), value_sigma(values[other_index])
            )
            if values[other_index].value - values[first].value <= wide:
                span.append(other_index)
        groups.add(tuple(sorted(span)))
    most = max(map(len, groups))
    return tuple(sorted(group for group in groups if len(group) == most))


def weighted_mean(values: Sequence[Measured], chosen: Sequence[int]) -> tuple[float, float]:
    """The mean of some values, weighed by their standard deviations, and the standard deviation
    of it; 0 if none is known.
    """
    some = [values[index] for index in chosen]
    if not all(map(value_sigma, some)):
        return some[-1].value, 0.0
    weights = [1.0 / value_sigma(value) ** 2 for value in some]
    total = sum(weights)
    return sum(w * value.value for w, value in zip(weights, some, strict=True)) / total, total**-0.5


@dataclass(frozen=True, slots=True, eq=False)
class PartAlignment:
    """Where a part was found to lie, as a displacement (4, 4) of its model, and since when its
    points were measured there.

    `centre` (3,) and `covariance` (6, 6) say how sure that is, as in `Alignment`. `wrong` are
    datums that disagree, `datums` is how many agree.
    """

    T: Floats
    since_ms: int
    centre: Floats
    covariance: Floats
    wrong: tuple[str, ...] = ()
    datums: int = 0

    def sigma_along(self, place: Floats, normal: Floats) -> float:
        """The standard deviation of where a point (3,) of the part is, along a direction (3,)."""
        by = np.concatenate([normal, np.cross(place - self.centre, normal)])
        return float(np.sqrt(max(0.0, float(by @ self.covariance @ by))))


def lying_of(content: Mapping[str, Any], since_ms: int) -> PartAlignment:
    """Where the part lies, as the record of an alignment says."""
    T = np.vstack([np.array(content["part"], float).reshape(3, 4), [0.0, 0.0, 0.0, 1.0]])
    sure = (np.array(content["centre"], float), np.array(content["covariance"], float))
    return PartAlignment(T, since_ms, *sure, tuple(content["wrong"]), int(content.get("datums", 0)))


def lying_in(
    alignments: Iterable[tuple[Mapping[str, Any], int]],
) -> tuple[PartAlignment | None, str]:
    """Where the part lies by the last of some records with their times, if one says so; and why
    its datums fit nowhere, if the last says that.
    """
    alignment, refused = None, ""
    for content, at_ms in alignments:
        alignment = lying_of(content, at_ms) if content["part"] else alignment
        refused = str(content.get("why", ""))
    return alignment, refused


def known_profiles(problem: Problem) -> dict[str, MeasurementPoint]:
    """The profiles of a problem whose places are known, by name."""
    return {
        point.name: point
        for point in points_of_problem(with_places(problem))
        if point.kind == PROFILE_KIND
    }


def datum_points(problem: Problem) -> dict[str, MeasurementPoint]:
    """The profiles of a problem that are datums, by name."""
    profiles_known = known_profiles(problem)
    steps = {name: point for name, point in profiles_known.items() if point.step}
    return steps or profiles_known


def alignment_asked(problem: Problem) -> tuple[str, ...]:
    """The measurements in the alignment's steps, in their order; none if the problem asks for
    no alignment.
    """
    words = problem.domain.conventions
    told_pairs = (
        (str(f.arguments[0]), f.arguments[1]) for f in problem.statics if f.name == words.alignment
    )
    steps = sorted((step.value, name) for name, step in told_pairs if isinstance(step, Number))
    return tuple(name for _, name in steps)


def datums_of_points(
    deviations: Sequence[tuple[MeasurementPoint, float]], sigma_m: Sequence[float]
) -> Datums:
    """Points with how far (m) along its normal the surface lies from each, and the standard
    deviation of that.
    """
    nominal, normals = (
        np.array([getattr(p, attribute) for p, _ in deviations])
        for attribute in ("position", "normal")
    )
    measured = nominal + normals * np.array([off for _, off in deviations])[:, None]
    names = tuple(point.name for point, _ in deviations)
    return Datums(
        names, nominal, normals, measured, np.array(sigma_m, float), np.zeros(len(deviations), bool)
    )


def measured_datums(problem: Problem, measured: Sequence[Measured]) -> Datums | None:
    """The datums of the alignment's steps, each with the mean of its values that agree; None if
    one is missing, or nobody said how sure it is.
    """
    asked, points_known = alignment_asked(problem), datum_points(problem)
    values = dict[str, list[Measured]]()
    for measured_value in measured:
        values.setdefault(measured_value.of, []).append(measured_value)
    points_found, sigma = list[tuple[MeasurementPoint, float]](), list[float]()
    for name in asked:
        if name not in points_known:
            continue
        own = values.get(name, [])
        if not own or not own[-1].uncertainty or own[-1].unit not in METRES_PER_UNIT:
            return None
        value, sure = weighted_mean(own, max(agreeing_sets(own), key=max))
        points_found.append(
            (points_known[name], (value - (own[-1].nominal or 0.0)) * METRES_PER_UNIT[own[-1].unit])
        )
        sigma.append(sure * METRES_PER_UNIT[own[-1].unit])
    return datums_of_points(points_found, sigma) if points_found else None


def once_m(measured: Sequence[Measured], names: Sequence[str]) -> Floats:
    """The standard deviations (n,) in metres of one more value of each of some measurements, as
    of its last one.
    """
    last = {value.of: value for value in measured}
    return np.array([value_sigma(last[name]) * METRES_PER_UNIT[last[name].unit] for name in names])


def aligned_within_m(problem: Problem) -> float | None:
    """How well every measured point has to be known once the part is aligned: two standard
    deviations, in metres; None if nobody says.
    """
    words = problem.domain.conventions
    limits_told = [
        fact.arguments[0] for fact in problem.statics if fact.name == words.aligned_within
    ]
    numbers = [term.value for term in limits_told if isinstance(term, Number)]
    return 1e-6 * min(numbers) if numbers else None


def deviation_m(measured: Measured) -> float:
    """How far (m) beyond its nominal value a value is."""
    return (measured.value - (measured.nominal or 0.0)) * METRES_PER_UNIT[measured.unit]


def displace_problem(problem: Problem, T: Floats) -> Problem:
    """The problem with the positions and normals of all its measurements displaced by T (4, 4)."""
    words, problem_told = problem.domain.conventions, with_places(problem)
    moved = dict[tuple[str, str], Function]()
    for point in points_of_problem(problem_told):
        name = Function(point.name)
        at, along = apply(T, np.array([point.position]))[0], T[:3, :3] @ np.array(point.normal)
        moved[words.position, point.name] = Function(
            words.position, (name, *_whole_numbers(at, 1e6))
        )
        moved[words.normal, point.name] = Function(
            words.normal, (name, *_whole_numbers(along, 1e3))
        )
    statics = tuple(
        moved.get((fact.name, str(fact.arguments[0])), fact) if fact.arguments else fact
        for fact in problem_told.statics
    )
    return replace(problem, statics=statics)


def _whole_numbers(v: Floats, scale: float) -> tuple[Number, ...]:
    return tuple(Number(round(float(coordinate) * scale)) for coordinate in v)
