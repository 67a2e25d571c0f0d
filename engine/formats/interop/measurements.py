"""Measurements as text: problem files in the words of a domain that chooses tools.

Positions are written in micrometres, normals in thousandths, as whole numbers.
"""

import re
from collections.abc import Iterable, Iterator

from cellwright.engine.model.measurement import Inspection, MeasurementPoint, Triple
from cellwright.kb.model.conventions import Conventions
from cellwright.kb.terms import Function, Number, Text


def atoms(point: MeasurementPoint, words: Conventions) -> list[Function]:
    """The facts of a problem about a point."""
    name = Function(point.name)
    found = [
        Function(words.needs, (name, Function(words.kind(point.kind)))),
        Function(words.position, (name, *_whole(point.position, 1e6))),
        Function(words.normal, (name, *_whole(point.normal, 1e3))),
    ]
    if point.nominal_m is not None:
        found.append(Function(words.nominal, (name, Number(round(point.nominal_m * 1e6)))))
    if point.tolerance_m is not None:
        found.append(Function(words.tolerance, (name, Number(round(point.tolerance_m * 1e6)))))
    if point.step:
        found.append(Function(words.alignment, (name, Number(point.step))))
    if point.bore_m is not None:
        found.append(Function(words.bore, (name, Number(round(point.bore_m * 1e6)))))
    if point.tool:
        found.append(Function(words.prefers, (name, Function(point.tool))))
    return found


def facts(point: MeasurementPoint, words: Conventions) -> list[str]:
    """The facts of a problem about a point, as texts."""
    return list(map(str, atoms(point, words)))


def goal(name: str, words: Conventions) -> str:
    """That a measurement is done, by whatever tool."""
    return f"{words.measured}(_, _, {words.place(name)})"


def _whole(v: Triple, scale: float) -> tuple[Number, Number, Number]:
    x, y, z = (Number(round(each * scale)) for each in v)
    return x, y, z


def names(inspection: Inspection) -> list[str]:
    """The measurements: first the points, then the features without points."""
    return [*(point.name for point in inspection.points), *(each.feature for each in inspection.excluded)]


def all_facts(inspection: Inspection, words: Conventions) -> Iterator[Function]:
    """The facts of a problem about all points and all excluded features."""
    for point in inspection.points:
        yield from atoms(point, words)
    for each in inspection.excluded:
        name = Function(each.feature)
        yield Function(words.needs, (name, Function(words.profile)))
        yield Function(words.impossible, (name, Text(each.reason)))


def problem_text(
    inspection: Inspection, domain: str, words: Conventions, facts: Iterable[Function], wanted: Iterable[str]
) -> str:
    """A problem file: every point with its facts, excluded features with their reason, and a goal for each wanted name.

    `domain` is how the file refers to its domain, `words` is what that calls things.
    """
    return "\n".join(_lines(inspection, domain, words, facts, wanted)) + "\n"


def _lines(
    inspection: Inspection, domain: str, words: Conventions, facts: Iterable[Function], wanted: Iterable[str]
) -> Iterator[str]:
    name = re.sub(r"[^A-Za-z0-9_]", "_", inspection.name)
    counts = f"{len(inspection.points)} points; {len(inspection.excluded)} features without any"
    yield f"# {inspection.features} features, {counts}; micrometres"
    yield "# What is not said here is at the start as the defaults of the domain say."
    yield from (f"problem: {name}", f"domain: {domain}", "objects:", f"  {words.measurement}:")
    yield from (f"    - {each}" for each in names(inspection))
    yield "statics:"
    yield from (f"  - {fact}" for fact in facts)
    goals = [f"  - {goal(each, words)}" for each in wanted]
    yield from ("goals:", *goals) if goals else ("goals: []",)
