"""Where the part lies, by the datums that were measured on it, and a problem with its points where they are then.

Datums are the profiles of the alignment's steps (`alignment(point, step)`), or all profiles where there are none.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cellwright.engine.kernels.rigid import apply
from cellwright.engine.model.fits import Datums
from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.measurement import MeasurementPoint
from cellwright.engine.pipelines.points import METRES, PROFILE, points, with_places
from cellwright.engine.pipelines.verdicts.averaging import agreeing, mean, sigma_of
from cellwright.kb.model.problem import Problem
from cellwright.kb.model.results import Measured
from cellwright.kb.terms import Function, Number


@dataclass(frozen=True, slots=True, eq=False)
class Lying:
    """Where a part was found to lie, as a displacement (4, 4) of its model, and since when its points were measured there.

    `centre` (3,) and `covariance` (6, 6) say how sure that is, as in `Alignment`. `wrong` are datums that disagree, `datums` is how many agree.
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


def lying_of(content: Mapping[str, Any], since_ms: int) -> Lying:
    """Where the part lies, as the record of an alignment says."""
    T = np.vstack([np.array(content["part"], float).reshape(3, 4), [0.0, 0.0, 0.0, 1.0]])
    sure = (np.array(content["centre"], float), np.array(content["covariance"], float))
    return Lying(T, since_ms, *sure, tuple(content["wrong"]), int(content.get("datums", 0)))


def lying_in(alignments: Iterable[tuple[Mapping[str, Any], int]]) -> tuple[Lying | None, str]:
    """Where the part lies by the last of some records with their times, if one says so; and why its datums fit nowhere, if the last says that."""
    found, refused = None, ""
    for content, at_ms in alignments:
        found = lying_of(content, at_ms) if content["part"] else found
        refused = str(content.get("why", ""))
    return found, refused


def profiles(problem: Problem) -> dict[str, MeasurementPoint]:
    """The profiles of a problem whose places are known, by name."""
    return {point.name: point for point in points(with_places(problem)) if point.kind == PROFILE}


def datum_points(problem: Problem) -> dict[str, MeasurementPoint]:
    """The profiles of a problem that are datums, by name."""
    known = profiles(problem)
    steps = {name: point for name, point in known.items() if point.step}
    return steps or known


def alignment_asked(problem: Problem) -> tuple[str, ...]:
    """The measurements in the alignment's steps, in their order; none if the problem asks for no alignment."""
    words = problem.domain.conventions
    told = ((str(f.arguments[0]), f.arguments[1]) for f in problem.statics if f.name == words.alignment)
    steps = sorted((step.value, name) for name, step in told if isinstance(step, Number))
    return tuple(name for _, name in steps)


def datums(found: Sequence[tuple[MeasurementPoint, float]], sigma_m: Sequence[float]) -> Datums:
    """Points with how far (m) along its normal the surface lies from each, and the standard deviation of that."""
    nominal, normals = (np.array([getattr(p, what) for p, _ in found]) for what in ("position", "normal"))
    measured = nominal + normals * np.array([off for _, off in found])[:, None]
    names = tuple(point.name for point, _ in found)
    return Datums(names, nominal, normals, measured, np.array(sigma_m, float), np.zeros(len(found), bool))


def measured_datums(problem: Problem, measured: Sequence[Measured]) -> Datums | None:
    """The datums of the alignment's steps, each with the mean of its values that agree; None if one is missing, or nobody said how sure it is."""
    asked, known = alignment_asked(problem), datum_points(problem)
    values = dict[str, list[Measured]]()
    for each in measured:
        values.setdefault(each.of, []).append(each)
    found, sigma = list[tuple[MeasurementPoint, float]](), list[float]()
    for name in asked:
        if name not in known:
            continue
        own = values.get(name, [])
        if not own or not own[-1].uncertainty or own[-1].unit not in METRES:
            return None
        value, sure = mean(own, max(agreeing(own), key=max))
        found.append((known[name], (value - (own[-1].nominal or 0.0)) * METRES[own[-1].unit]))
        sigma.append(sure * METRES[own[-1].unit])
    return datums(found, sigma) if found else None


def once_m(measured: Sequence[Measured], names: Sequence[str]) -> Floats:
    """The standard deviations (n,) in metres of one more value of each of some measurements, as of its last one."""
    last = {each.of: each for each in measured}
    return np.array([sigma_of(last[name]) * METRES[last[name].unit] for name in names])


def aligned_within_m(problem: Problem) -> float | None:
    """How well every measured point has to be known once the part is aligned: two standard deviations, in metres; None if nobody says."""
    words = problem.domain.conventions
    told = [each.arguments[0] for each in problem.statics if each.name == words.aligned_within]
    numbers = [each.value for each in told if isinstance(each, Number)]
    return 1e-6 * min(numbers) if numbers else None


def deviation_m(measured: Measured) -> float:
    """How far (m) beyond its nominal value a value is."""
    return (measured.value - (measured.nominal or 0.0)) * METRES[measured.unit]


def displaced(problem: Problem, T: Floats) -> Problem:
    """The problem with the positions and normals of all its measurements displaced by T (4, 4)."""
    words, told = problem.domain.conventions, with_places(problem)
    moved = dict[tuple[str, str], Function]()
    for point in points(told):
        name = Function(point.name)
        at, along = apply(T, np.array([point.position]))[0], T[:3, :3] @ np.array(point.normal)
        moved[words.position, point.name] = Function(words.position, (name, *_whole(at, 1e6)))
        moved[words.normal, point.name] = Function(words.normal, (name, *_whole(along, 1e3)))
    statics = tuple(
        moved.get((each.name, str(each.arguments[0])), each) if each.arguments else each
        for each in told.statics
    )
    return replace(problem, statics=statics)


def _whole(v: Floats, scale: float) -> tuple[Number, ...]:
    return tuple(Number(round(float(each) * scale)) for each in v)
