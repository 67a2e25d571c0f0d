"""Tables of measurements: one row for each point, columns by name."""

import csv
import io
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from cellwright.engine.model.measurement import Inspection, MeasurementPoint
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, nearest
from cellwright.kb.files import File, read_file
from cellwright.kb.numbers import DIGITS, NumberError, decimal

NEEDED = ("x", "y", "z", "nx", "ny", "nz")
OPTIONAL = ("name", "kind", "nominal", "tolerance", "bore", "feature")
NUMBERS = (*NEEDED, "nominal", "tolerance", "bore")
LENGTHS = ("x", "y", "z", "nominal", "tolerance", "bore")
UNITS_M = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254}
WITH_UNIT = re.compile(rf"({'|'.join(LENGTHS)})_({'|'.join(UNITS_M)})")  # x_mm, tolerance_in
NAME = re.compile(r"[a-z][A-Za-z0-9_]*")
FARTHEST_M = 2_147.0  # the language has whole numbers of 32 bits, and positions are in micrometres
MARKS = ",;\t"
HINT = f"the first line has {', '.join(NEEDED)}, and any of {', '.join(OPTIONAL)}"


@dataclass(frozen=True)
class _Head:
    """The first line: the columns as they are `written`, and without their units, and what lengths are given in."""

    written: Sequence[str]
    columns: Sequence[str]
    units: Mapping[str, float]

    def called(self, column: str) -> str:
        """A column as it is written."""
        return self.written[self.columns.index(column)] if column in self.columns else column


def unit_m(unit: str) -> float:
    """What a unit of length is in metres. Raises `InvalidInput`."""
    if unit not in UNITS_M:
        hint = f"one of {', '.join(UNITS_M)}"
        raise InvalidInput([Diagnostic(Source("--unit"), "K406", f"no unit '{unit}'", hint)])
    return UNITS_M[unit]


def read_table(path: Path, unit: str = "mm") -> Inspection:
    """The points of a CSV table with the columns NEEDED and any of OPTIONAL, lengths in `unit`. Raises `InvalidInput`.

    A column such as `x_m` has the unit in its name. Without names, points are called p1, p2, ... Columns are divided by the first of comma, semicolon and tab that its first line contains.
    """
    units = dict.fromkeys(LENGTHS, unit_m(unit))
    file = read_file(path)
    head = file.text.partition("\n")[0]
    rows = csv.reader(
        io.StringIO(file.text, newline=None), delimiter=next((mark for mark in MARKS if mark in head), ",")
    )
    try:
        written = [each.strip() for each in next(rows, [])]
        columns = [_plain(each.lower(), units) for each in written]
        wrong, first = _columns(columns, file), _Head(written, columns, units)
        found = (
            []
            if wrong
            else [
                _row(row, first, file.line(rows.line_num, 1), f"p{number}")
                for number, row in enumerate(filter(any, rows), 1)
            ]
        )
    except csv.Error as error:
        raise InvalidInput([_wrong(file.line(rows.line_num, 1), f"not a table: {error}")]) from None
    points = [each for each in found if isinstance(each, tuple)]
    wrong += [each for each in found if isinstance(each, Diagnostic)]
    wrong += _repeated(points)
    if wrong:
        raise InvalidInput(wrong)
    if not points:
        raise InvalidInput([_wrong(Source(file.path), "the table has no rows", "one row for each point")])
    made = tuple(point for point, _ in points)
    return Inspection(path.stem, made, features=len({point.feature for point in made}))


def _plain(column: str, units: dict[str, float]) -> str:
    """The name of a column without its unit, which is noted."""
    found = WITH_UNIT.fullmatch(column)
    if found is None:
        return column
    units[found[1]] = UNITS_M[found[2]]
    return found[1]


def _wrong(where: Source, message: str, hint: str = "") -> Diagnostic:
    return Diagnostic(where, "K805", message, hint)


def _columns(columns: Sequence[str], file: File) -> list[Diagnostic]:
    """What is wrong with the first line: columns that are missing, are there twice, or have no meaning."""
    where = file.line(1, 1)
    missing = [f"'{each}'" for each in NEEDED if each not in columns]
    found = [_wrong(where, f"no column {', '.join(missing)}", HINT)] if missing else []
    known = (*NEEDED, *OPTIONAL)
    twice = sorted({each for each in columns if each and columns.count(each) > 1})
    found += [_wrong(where, f"the column '{each}' is there twice", "remove one of them") for each in twice]
    strange = [each for each in columns if each and each not in known and nearest(each, known)]
    return found + [_wrong(where, f"unknown column '{each}'", nearest(each, known)) for each in strange]


def _repeated(points: Sequence[tuple[MeasurementPoint, Source]]) -> list[Diagnostic]:
    first: dict[str, Source] = {}
    found = []
    for point, where in points:
        if point.name in first:
            message = f"the name '{point.name}' is used twice: first in line {first[point.name].line}"
            found.append(_wrong(where, message, "give each point a name of its own"))
        first.setdefault(point.name, where)
    return found


def _row(
    row: Sequence[str], head: _Head, where: Source, name: str
) -> tuple[MeasurementPoint, Source] | Diagnostic:
    columns = head.columns
    if len(row) > len(columns) and any(each.strip() for each in row[len(columns) :]):
        return _wrong(
            where, f"{len(row)} cells in {len(columns)} columns", "write 1.5 with a point, not a comma"
        )
    cells = {"name": name} if "name" not in columns else {}
    cells |= {key: text.strip() for key, text in zip(columns, row, strict=False)}
    bad = next(_bad_numbers(cells, head), None)
    if bad is not None:
        return _wrong(where, *bad)
    values = {key: decimal(cells[key]) for key in NUMBERS if cells.get(key)}
    values |= {key: values[key] * head.units[key] for key in LENGTHS if key in values}
    if (message := _senseless(cells.get("name", ""), cells.get("kind", ""), values)) is not None:
        return _wrong(where, *message)
    length = math.hypot(values["nx"], values["ny"], values["nz"])
    name = cells["name"]
    point = MeasurementPoint(
        name,
        cells.get("feature") or name,
        cells.get("kind") or "profile",
        (values["x"], values["y"], values["z"]),
        (values["nx"] / length, values["ny"] / length, values["nz"] / length),
        values.get("tolerance"),
        values.get("bore"),
        nominal_m=values.get("nominal"),
    )
    return point, where


def _bad_numbers(cells: Mapping[str, str], head: _Head) -> Iterator[tuple[str, str]]:
    """What is wrong with the numbers of a row, and what to try."""
    for key in NUMBERS:
        text = cells.get(key, "")
        if not text and key in NEEDED:
            yield f"no number in the column '{head.called(key)}'", "every point needs a position and a normal"
        elif text:
            try:
                decimal(text)
            except NumberError as error:
                yield (
                    f"'{text[:DIGITS]}' {error}",
                    f"the column '{head.called(key)}' needs a number such as 1.5",
                )


def _senseless(name: str, kind: str, values: Mapping[str, float]) -> tuple[str, str] | None:
    """Why a row describes no point, and what to try; None if it does."""
    if not NAME.fullmatch(name) or name == "not":
        return f"'{name}' is not a name", "a small letter, then letters, digits and _"
    if kind and not NAME.fullmatch(kind):
        return f"'{kind}' is not a kind of measurement", "profile, thickness, or a kind of the domain"
    if not any(values[key] for key in ("nx", "ny", "nz")):
        return "the normal has no length", "give the direction away from the material"
    if max(abs(values[key]) for key in LENGTHS if key in values) > FARTHEST_M:
        return f"a length of more than {FARTHEST_M:.0f} m", "look at --unit"
    if min((values[key] for key in ("tolerance", "bore") if key in values), default=0) < 0:
        return "a tolerance or a bore is less than 0", "give how wide it is"
    return None
