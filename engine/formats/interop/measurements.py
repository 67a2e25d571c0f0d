"""Measurements as text: tables in, problem files out, in the words of a domain that chooses tools.

Positions are written in micrometres, normals in thousandths, as whole numbers.
"""

import csv
import io
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from engine.model.measurement import Inspection, MeasurementPoint, Triple
from kb.diagnostics import Diagnostic, InvalidInput, Source
from kb.files import read_file
from kb.model.conventions import Conventions

NEEDED = ("name", "x", "y", "z", "nx", "ny", "nz")
OPTIONAL = ("kind", "tolerance", "bore", "feature")
UNITS_M = {"mm": 1e-3, "m": 1.0, "in": 0.0254}
NAME = re.compile(r"[a-z][A-Za-z0-9_]*")


def read_table(path: Path, unit: str = "mm") -> Inspection:
    """The points of a CSV table with the columns NEEDED and any of OPTIONAL, lengths in `unit`. Raises `InvalidInput`."""
    if unit not in UNITS_M:
        hint = f"one of {', '.join(UNITS_M)}"
        raise InvalidInput([Diagnostic(Source("--unit"), "K406", f"no unit '{unit}'", hint)])
    file = read_file(path)
    rows = csv.DictReader(io.StringIO(file.text))
    missing = [column for column in NEEDED if column not in (rows.fieldnames or ())]
    if missing:
        hint = f"the first line has {', '.join(NEEDED)}, and any of {', '.join(OPTIONAL)}"
        raise InvalidInput([_wrong(file.line(1, 1), f"no column '{missing[0]}'", hint)])
    found = [_row(row, file.line(number, 1), UNITS_M[unit]) for number, row in enumerate(rows, 2)]
    points = tuple(each for each in found if isinstance(each, MeasurementPoint))
    wrong = [each for each in found if isinstance(each, Diagnostic)]
    wrong += [
        _wrong(Source(file.path), f"the name '{name}' is used twice")
        for name in _repeated(each.name for each in points)
    ]
    if wrong:
        raise InvalidInput(wrong)
    return Inspection(path.stem, points, features=len({point.feature for point in points}))


def _wrong(where: Source, message: str, hint: str = "") -> Diagnostic:
    return Diagnostic(where, "K805", message, hint)


def _repeated(names: Iterable[str]) -> list[str]:
    seen: set[str] = set()
    return sorted({name for name in names if name in seen or seen.add(name)})  # type: ignore[func-returns-value]


def _row(row: Mapping[str, str | None], where: Source, unit_m: float) -> MeasurementPoint | Diagnostic:
    cells = {key: (value or "").strip() for key, value in row.items() if isinstance(key, str)}
    numbers = {key: cells.get(key, "") for key in (*NEEDED[1:], "tolerance", "bore")}
    try:
        values = {key: float(text) for key, text in numbers.items() if text or key in NEEDED}
    except ValueError:
        bad = next(text for text in numbers.values() if not _is_number(text))
        return _wrong(where, f"'{bad}' is not a number")
    if not all(math.isfinite(value) for value in values.values()):
        return _wrong(where, "a number is not finite")
    if not NAME.fullmatch(cells["name"]):
        return _wrong(where, f"'{cells['name']}' is not a name", "a small letter, then letters, digits and _")
    length = math.hypot(values["nx"], values["ny"], values["nz"])
    if length == 0:
        return _wrong(where, "the normal has no length")
    position = (values["x"] * unit_m, values["y"] * unit_m, values["z"] * unit_m)
    normal = (values["nx"] / length, values["ny"] / length, values["nz"] / length)
    sizes = [values[key] * unit_m if key in values else None for key in ("tolerance", "bore")]
    return MeasurementPoint(
        cells["name"],
        cells.get("feature") or cells["name"],
        cells.get("kind") or "profile",
        position,
        normal,
        *sizes,
    )


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def facts(point: MeasurementPoint, words: Conventions) -> list[str]:
    """The facts of a problem about a point."""
    name = point.name
    found = [
        f"{words.needs}({name}, {words.kind(point.kind)})",
        f"{words.position}({name}, {_whole(point.position, 1e6)})",
        f"{words.normal}({name}, {_whole(point.normal, 1e3)})",
    ]
    if point.tolerance_m is not None:
        found.append(f"{words.tolerance}({name}, {round(point.tolerance_m * 1e6)})")
    if point.bore_m is not None:
        found.append(f"{words.bore}({name}, {round(point.bore_m * 1e6)})")
    return found


def goal(name: str, words: Conventions) -> str:
    """That a measurement is done, by whatever tool."""
    return f"{words.measured}(_, _, {words.place(name)})"


def _whole(v: Triple, scale: float) -> str:
    return ", ".join(str(round(each * scale)) for each in v)


def names(inspection: Inspection) -> list[str]:
    """The measurements: first the points, then the features without points."""
    return [*(point.name for point in inspection.points), *(each.feature for each in inspection.excluded)]


def all_facts(inspection: Inspection, words: Conventions) -> Iterator[str]:
    """The facts of a problem about all points and all excluded features."""
    for point in inspection.points:
        yield from facts(point, words)
    for each in inspection.excluded:
        yield f"{words.needs}({each.feature}, {words.profile})"
        yield f'{words.impossible}({each.feature}, "{each.reason}")'


def problem_text(inspection: Inspection, domain: str, words: Conventions, wanted: Iterable[str]) -> str:
    """A problem file: every point with its facts, excluded features with their reason, and a goal for each wanted name.

    `domain` is how the file refers to its domain, `words` is what that calls things.
    """
    return "\n".join(_lines(inspection, domain, words, wanted)) + "\n"


def _lines(inspection: Inspection, domain: str, words: Conventions, wanted: Iterable[str]) -> Iterator[str]:
    name = re.sub(r"[^A-Za-z0-9_]", "_", inspection.name)
    counts = f"{len(inspection.points)} points; {len(inspection.excluded)} features without any"
    yield f"# {inspection.features} features, {counts}; micrometres"
    yield from (f"problem: {name}", f"domain: {domain}", "objects:", f"  {words.measurement}:")
    yield from (f"    - {each}" for each in names(inspection))
    yield "statics:"
    yield from (f"  - {fact}" for fact in all_facts(inspection, words))
    goals = [f"  - {goal(each, words)}" for each in wanted]
    yield from ("goals:", *goals) if goals else ("goals: []",)
