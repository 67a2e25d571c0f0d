"""All values of an inspection together: bad ones are told by their neighbours and by repetition, and each feature is judged.

A single value that its neighbours do not explain (`cellwright.engine.stages.fitting.consistency`) is in doubt until it is repeated. Values of
one feature that agree confirm each other: a dent is no bad measurement. Repeated values are averaged; what is unsure about where
the part lies does not become surer by that.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.kernels.rigid import apply
from cellwright.engine.model.measurement import MeasurementPoint
from cellwright.engine.model.verdicts import Feature, Spoilt
from cellwright.engine.pipelines.points import METRES, PROFILE, points, with_places
from cellwright.engine.pipelines.verdicts.averaging import agreeing, mean, sigma_of
from cellwright.engine.pipelines.verdicts.lying import Lying
from cellwright.engine.pipelines.verdicts.spoiling import set_aside, standing
from cellwright.engine.stages.fitting.consistency import expected
from cellwright.kb.model.conformity import COVERAGE
from cellwright.kb.model.problem import Problem
from cellwright.kb.model.results import Measured

SUSPECT = 3.0  # standard deviations from what the neighbours let expect; so an error of six is caught
Key = tuple[str, str]  # of what, and which quantity


@dataclass(frozen=True, slots=True)
class _Known:
    """The values of one feature, with where it is if that is known. `sigma_lying` is how unsure the place of the part makes it."""

    values: tuple[Measured, ...]
    point: MeasurementPoint | None
    sigma_lying: float

    @property
    def last(self) -> Measured:
        return self.values[-1]


def assessed(
    problem: Problem,
    measured: Sequence[Measured],
    lying: Lying | None = None,
    spoilt: Collection[Spoilt] = (),
) -> tuple[Feature, ...]:
    """What was measured of each feature, in the order in which they were first measured. Spoilt values count for nothing."""
    known = _by_feature(problem, standing(measured, spoilt), lying)
    off, aside = _off(known), set_aside(measured, spoilt)
    found = {key: _feature(each, off[key], lying) for key, each in known.items()}
    order = dict.fromkeys((each.of, each.quantity) for each in measured)
    return tuple(_with_spoilt(found.get(key), aside.get(key, [])) for key in order)


def _with_spoilt(found: Feature | None, aside: Sequence[tuple[Measured, str]]) -> Feature:
    """A feature with the values that do not count any more; in doubt as long as it has no others."""
    bad = tuple((each, f"{why} has put it in doubt") for each, why in aside)
    if found is not None:
        return replace(found, bad=(*bad, *found.bad)) if bad else found
    last, why = aside[-1]
    demand = (last.unit, last.nominal, last.lower, last.upper, last.risk)
    return Feature(last.of, last.quantity, *demand, bad=bad, doubt=f"{why} has put its values in doubt")


def _by_feature(problem: Problem, measured: Sequence[Measured], lying: Lying | None) -> dict[Key, _Known]:
    where = {point.name: point for point in points(with_places(problem))}
    found = dict[Key, list[Measured]]()
    for each in measured:
        point = where.get(each.of)
        found.setdefault((each.of, each.quantity), []).append(_in_part(each, point, lying))
    return {
        key: _Known(tuple(values), where.get(key[0]), _unsure(values[-1], where.get(key[0]), lying))
        for key, values in found.items()
    }


def _wrong(number: int, each: _Known, lying: Lying | None) -> bool:
    """Whether a value is one of a datum that disagrees with the others."""
    return lying is not None and each.last.of in lying.wrong and each.values[number].at_ms <= lying.since_ms


def _is_profile(measured: Measured, point: MeasurementPoint | None) -> bool:
    return point is not None and point.kind == PROFILE and measured.unit in METRES


def _in_part(measured: Measured, point: MeasurementPoint | None, lying: Lying | None) -> Measured:
    """A value as it is in the frame of the part: a surface that was measured before it was known where the part lies is moved."""
    if lying is None or point is None or not _is_profile(measured, point) or measured.at_ms > lying.since_ms:
        return measured
    unit, nominal = METRES[measured.unit], measured.nominal or 0.0
    p, n = np.array(point.position), np.array(point.normal)
    met = p + n * (measured.value - nominal) * unit
    off = float((lying.T[:3, :3] @ n) @ (met - apply(lying.T, p[None])[0]))
    return replace(measured, value=nominal + off / unit)


def _unsure(measured: Measured, point: MeasurementPoint | None, lying: Lying | None) -> float:
    if lying is None or point is None or not _is_profile(measured, point):
        return 0.0
    return lying.sigma_along(np.array(point.position), np.array(point.normal)) / METRES[measured.unit]


def _off(known: Mapping[Key, _Known]) -> dict[Key, tuple[float, ...] | None]:
    """How far each value of each feature is from what its neighbours let expect, in standard deviations; None if they tell nothing."""
    found: dict[Key, tuple[float, ...] | None] = dict.fromkeys(known)
    surfaces = dict[tuple[str, str, float | None], list[Key]]()
    for key, each in known.items():
        if each.point is not None and all(map(sigma_of, each.values)):
            surfaces.setdefault((each.last.quantity, each.last.unit, each.last.nominal), []).append(key)
    for keys in surfaces.values():
        found |= _beside(known, keys)
    return found


def _beside(known: Mapping[Key, _Known], keys: Sequence[Key]) -> dict[Key, tuple[float, ...] | None]:
    places = [known[key].point for key in keys]
    at = np.array([each.position for each in places if each is not None])
    along = np.array([each.normal for each in places if each is not None], float)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    groups = [agreeing(known[key].values) for key in keys]
    means = [mean(known[key].values, each[0]) for key, each in zip(keys, groups, strict=True)]
    first, sigma = np.array(means).T
    hopes = expected(at, along, first, sigma, np.array([len(each) == 1 for each in groups]))
    told: dict[Key, tuple[float, ...] | None] = {}
    for number, key in enumerate(keys):
        hope, unsure = float(hopes.value[number]), float(hopes.sigma[number])
        off = ((each.value - hope) / math.hypot(sigma_of(each), unsure) for each in known[key].values)
        told[key] = tuple(off) if hopes.known[number] else None
    return told


def _chosen(each: _Known, off: tuple[float, ...] | None, disagrees: bool) -> tuple[tuple[int, ...], str]:
    """Which values of a feature count, and why they are in doubt, if they are.

    Those that the neighbours explain count; if these explain none, or tell nothing, those that agree with each other.
    """
    groups = agreeing(each.values)
    usual = tuple(n for n, far in enumerate(off or ()) if abs(far) <= SUSPECT)
    if usual and not (disagrees and len(each.values) == 1):
        return usual, ""
    first = groups[0]
    if len(first) > 1 and len(groups) == 1:
        return first, ""
    if len(each.values) > 1 and sigma_of(each.last):
        return first, f"{len(each.values)} values disagree"
    if disagrees and sigma_of(each.last):
        return first, "it disagrees with the other datums"
    if off is None:
        return first, ""
    return first, f"it is {abs(off[first[0]]):.1f} standard deviations from what its neighbours let expect"


def _feature(each: _Known, off: tuple[float, ...] | None, lying: Lying | None) -> Feature:
    last = each.last
    right = [n for n in range(len(each.values)) if not _wrong(n, each, lying)]
    used = right or list(range(len(each.values)))
    some = replace(each, values=tuple(each.values[n] for n in used))
    places, doubt = _chosen(some, None if off is None else tuple(off[n] for n in used), not right)
    chosen = tuple(used[n] for n in places)
    value, sigma = mean(each.values, chosen)
    bad = [(one, _why_bad(n, off)) for n, one in enumerate(each.values) if n not in chosen and sigma_of(one)]
    unsure = COVERAGE * math.hypot(sigma, each.sigma_lying) if sigma else None
    counted = tuple(each.values[number] for number in chosen)
    demand = (last.unit, last.nominal, last.lower, last.upper, last.risk)
    return Feature(last.of, last.quantity, *demand, value, unsure, counted, tuple(bad), doubt)


def _why_bad(number: int, off: tuple[float, ...] | None) -> str:
    if off is None or abs(off[number]) <= SUSPECT:
        return "it disagrees with the other values"
    return f"it is {abs(off[number]):.1f} standard deviations from what its neighbours let expect"
