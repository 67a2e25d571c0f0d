"""Judges all measured values of an inspection: bad values, features, and the survey of a run.

A single value that its neighbours do not explain
(`cellwright.engine.stages.fitting.deviation_outliers`) is in doubt until it is repeated. Values of
one feature that agree confirm each other: a dent is no bad measurement. Repeated values are
averaged; what is unsure about where the part lies does not become surer by that.
"""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from cellwright.engine.kernels.rigid import apply
from cellwright.engine.model.part_measurements import (
    MeasurementPoint,
    chooses_tools,
    goal_measurements,
    measurements_of,
)
from cellwright.engine.model.verdicts import MeasuredFeature, Spoilt, Survey, Unmeasured
from cellwright.engine.pipelines.inspection.measurement_points import (
    METRES_PER_UNIT,
    PROFILE_KIND,
    points_of_problem,
    with_places,
)
from cellwright.engine.pipelines.inspection.part_alignment import (
    PartAlignment,
    agreeing_sets,
    lying_in,
    value_sigma,
    weighted_mean,
)
from cellwright.engine.pipelines.inspection.spoilt_values import counting_values, set_aside
from cellwright.engine.stages.fitting.deviation_outliers import expect_deviations
from cellwright.kb.model.measured_results import COVERAGE_FACTOR, Measured, Results
from cellwright.kb.model.planning_problem import Problem

# standard deviations from what the neighbours let expect; so an error of six is caught
SUSPECT_SIGMAS = 3.0
Key = tuple[str, str]  # of what, and which quantity


@dataclass(frozen=True, slots=True)
class _FeatureValues:
    """The values of one feature, with where it is if that is known.

    `sigma_lying` is how unsure the place of the part makes it.
    """

    values: tuple[Measured, ...]
    point: MeasurementPoint | None
    sigma_lying: float

    @property
    def last(self) -> Measured:
        return self.values[-1]


def assess_features(
    problem: Problem,
    measured: Sequence[Measured],
    lying: PartAlignment | None = None,
    spoilt: Collection[Spoilt] = (),
) -> tuple[MeasuredFeature, ...]:
    """What was measured of each feature, in the order in which they were first measured.

    Spoilt values count for nothing.
    """
    values_by_feature = _by_feature(problem, counting_values(measured, spoilt), lying)
    off, aside = _deviations(values_by_feature), set_aside(measured, spoilt)
    features = {
        key: _feature_of(values, off[key], lying) for key, values in values_by_feature.items()
    }
    order = dict.fromkeys((value.of, value.quantity) for value in measured)
    return tuple(_with_spoilt(features.get(key), aside.get(key, [])) for key in order)


def _with_spoilt(
    feature: MeasuredFeature | None, aside: Sequence[tuple[Measured, str]]
) -> MeasuredFeature:
    """A feature with the values that do not count any more; in doubt as long as it has no
    others.
    """
    bad = tuple((spoilt_value, f"{why} has put it in doubt") for spoilt_value, why in aside)
    if feature is not None:
        return replace(feature, bad=(*bad, *feature.bad)) if bad else feature
    last, why = aside[-1]
    demand = (last.unit, last.nominal, last.lower, last.upper, last.risk)
    return MeasuredFeature(
        last.of, last.quantity, *demand, bad=bad, doubt=f"{why} has put its values in doubt"
    )


def _by_feature(
    problem: Problem, measured: Sequence[Measured], lying: PartAlignment | None
) -> dict[Key, _FeatureValues]:
    where = {point.name: point for point in points_of_problem(with_places(problem))}
    values_by_key = dict[Key, list[Measured]]()
    for value in measured:
        point = where.get(value.of)
        values_by_key.setdefault((value.of, value.quantity), []).append(
            _in_part(value, point, lying)
        )
    return {
        key: _FeatureValues(
            tuple(values), where.get(key[0]), _lying_sigma(values[-1], where.get(key[0]), lying)
        )
        for key, values in values_by_key.items()
    }


def _is_wrong_datum(number: int, values: _FeatureValues, lying: PartAlignment | None) -> bool:
    """Whether a value is one of a datum that disagrees with the others."""
    return (
        lying is not None
        and values.last.of in lying.wrong
        and values.values[number].at_ms <= lying.since_ms
    )


def _is_profile(measured: Measured, point: MeasurementPoint | None) -> bool:
    return point is not None and point.kind == PROFILE_KIND and measured.unit in METRES_PER_UNIT


def _in_part(
    measured: Measured, point: MeasurementPoint | None, lying: PartAlignment | None
) -> Measured:
    """A value as it is in the frame of the part: a surface that was measured before it was
    known where the part lies is moved.
    """
    if (
        lying is None
        or point is None
        or not _is_profile(measured, point)
        or measured.at_ms > lying.since_ms
    ):
        return measured
    unit, nominal = METRES_PER_UNIT[measured.unit], measured.nominal or 0.0
    p, n = np.array(point.position), np.array(point.normal)
    met = p + n * (measured.value - nominal) * unit
    off = float((lying.T[:3, :3] @ n) @ (met - apply(lying.T, p[None])[0]))
    return replace(measured, value=nominal + off / unit)


def _lying_sigma(
    measured: Measured, point: MeasurementPoint | None, lying: PartAlignment | None
) -> float:
    if lying is None or point is None or not _is_profile(measured, point):
        return 0.0
    return (
        lying.sigma_along(np.array(point.position), np.array(point.normal))
        / METRES_PER_UNIT[measured.unit]
    )


def _deviations(known: Mapping[Key, _FeatureValues]) -> dict[Key, tuple[float, ...] | None]:
    """How far each value of each feature is from what its neighbours let expect, in standard
    deviations; None if they tell nothing.
    """
    deviations: dict[Key, tuple[float, ...] | None] = dict.fromkeys(known)
    surfaces = dict[tuple[str, str, float | None], list[Key]]()
    for key, values_known in known.items():
        if values_known.point is not None and all(map(value_sigma, values_known.values)):
            surfaces.setdefault(
                (values_known.last.quantity, values_known.last.unit, values_known.last.nominal), []
            ).append(key)
    for keys in surfaces.values():
        deviations |= _neighbour_deviations(known, keys)
    return deviations


def _neighbour_deviations(
    known: Mapping[Key, _FeatureValues], keys: Sequence[Key]
) -> dict[Key, tuple[float, ...] | None]:
    places = [known[key].point for key in keys]
    at = np.array([place.position for place in places if place is not None])
    along = np.array([place.normal for place in places if place is not None], float)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    groups = [agreeing_sets(known[key].values) for key in keys]
    means = [
        weighted_mean(known[key].values, indices[0])
        for key, indices in zip(keys, groups, strict=True)
    ]
    first, sigma = np.array(means).T
    hopes = expect_deviations(
        at, along, first, sigma, np.array([len(group) == 1 for group in groups])
    )
    deviations: dict[Key, tuple[float, ...] | None] = {}
    for number, key in enumerate(keys):
        hope, unsure = float(hopes.value[number]), float(hopes.sigma[number])
        off = (
            (value.value - hope) / math.hypot(value_sigma(value), unsure)
            for value in known[key].values
        )
        deviations[key] = tuple(off) if hopes.known[number] else None
    return deviations


def _counting_values(
    values: _FeatureValues, off: tuple[float, ...] | None, disagrees: bool
) -> tuple[tuple[int, ...], str]:
    """Which values of a feature count, and why they are in doubt, if they are.

    Those that the neighbours explain count; if these explain none, or tell nothing, those that
    agree with each other.
    """
    groups = agreeing_sets(values.values)
    usual = tuple(n for n, far in enumerate(off or ()) if abs(far) <= SUSPECT_SIGMAS)
    if usual and not (disagrees and len(values.values) == 1):
        return usual, ""
    first = groups[0]
    if len(first) > 1 and len(groups) == 1:
        return first, ""
    if len(values.values) > 1 and value_sigma(values.last):
        return first, f"{len(values.values)} values disagree"
    if disagrees and value_sigma(values.last):
        return first, "it disagrees with the other datums"
    if off is None:
        return first, ""
    return (
        first,
        f"it is {abs(off[first[0]]):.1f} standard deviations from what its neighbours let expect",
    )


def _feature_of(
    values: _FeatureValues, off: tuple[float, ...] | None, lying: PartAlignment | None
) -> MeasuredFeature:
    last = values.last
    right = [n for n in range(len(values.values)) if not _is_wrong_datum(n, values, lying)]
    used = right or list(range(len(values.values)))
    some = replace(values, values=tuple(values.values[n] for n in used))
    places, doubt = _counting_values(
        some, None if off is None else tuple(off[n] for n in used), not right
    )
    chosen = tuple(used[n] for n in places)
    value, sigma = weighted_mean(values.values, chosen)
    bad = [
        (bad_value, _why_bad(n, off))
        for n, bad_value in enumerate(values.values)
        if n not in chosen and value_sigma(bad_value)
    ]
    unsure = COVERAGE_FACTOR * math.hypot(sigma, values.sigma_lying) if sigma else None
    counted = tuple(values.values[number] for number in chosen)
    demand = (last.unit, last.nominal, last.lower, last.upper, last.risk)
    return MeasuredFeature(
        last.of, last.quantity, *demand, value, unsure, counted, tuple(bad), doubt
    )


def _why_bad(number: int, off: tuple[float, ...] | None) -> str:
    if off is None or abs(off[number]) <= SUSPECT_SIGMAS:
        return "it disagrees with the other values"
    return f"it is {abs(off[number]):.1f} standard deviations from what its neighbours let expect"


Content = Mapping[str, Any]


def survey_run(
    problem: Problem,
    results: Results,
    alignments: Iterable[tuple[Content, int]] = (),
    given_up: Iterable[tuple[str, str]] = (),
    impossible: Mapping[str, str] | None = None,
    spoilt: Collection[Spoilt] = (),
    again: Mapping[str, Sequence[str]] = MappingProxyType({}),
) -> Survey | None:
    """The survey of a run; None for a problem without measurements.

    `alignments` are its records about where the part lies, each with its time, the last one last.
    `given_up` are goals with reasons, `impossible` measurements that no tool can take, `spoilt`
    values that were found not to count, `again` why measurements were made again.
    """
    if not chooses_tools(problem.domain):
        return None
    alignment, refused = lying_in(alignments)
    judged = assess_features(problem, results.measured, alignment, spoilt)
    features = tuple(replace(feature, again=tuple(again.get(feature.of, ()))) for feature in judged)
    done = {feature.of for feature in features}
    why = _missing_reasons(problem, given_up, impossible or {})
    missing = tuple(Unmeasured(name, reason) for name, reason in why.items() if name not in done)
    places = {point.name: point.position for point in points_of_problem(with_places(problem))}
    if alignment is None:
        return Survey(features, missing, places, refused=refused)
    part = tuple(float(number) for number in alignment.T[:3].ravel())
    return Survey(features, missing, places, part, alignment.datums, alignment.wrong)


def _missing_reasons(
    problem: Problem, given_up: Iterable[tuple[str, str]], impossible: Mapping[str, str]
) -> dict[str, str]:
    """Why each measurement is not made if it is not made; those that goals ask for come first."""
    asked, names = goal_measurements(problem), measurements_of(problem)
    reasons = {name: "the run has not come to it" for name in names if name in asked}
    reasons |= {name: "no goal asks for it" for name in names if name not in asked}
    words = problem.domain.conventions
    for goal, why in given_up:
        reasons |= {name: why for name in reasons if f"{words.place(name)}" in goal}
    return reasons | {name: why for name, why in impossible.items() if name in reasons}
