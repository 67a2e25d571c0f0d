"""Reads tables of measurements: one row for each point, columns by name."""

import csv
import io
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from cellwright.engine.formats.interop.tolerance_columns import (
    ENDS,
    contradiction,
    looks_like_tolerance,
    tolerance_column,
    zone,
)
from cellwright.engine.model.part_measurements import Inspection, MeasurementPoint
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, nearest_hint
from cellwright.kb.files import File, read_file
from cellwright.kb.numbers import MAX_NUMBER_CHARACTERS, NumberError, read_decimal

NEEDED_COLUMNS = ("x", "y", "z", "nx", "ny", "nz")
OPTIONAL_COLUMNS = ("name", "kind", "nominal", "tolerance", "bore", "feature")
NUMERIC_COLUMNS = (*NEEDED_COLUMNS, "nominal", "tolerance", "bore", *ENDS)
LENGTH_COLUMNS = ("x", "y", "z", "nominal", "tolerance", "bore", *ENDS)
TABLE_UNITS_M = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254}
MEASUREMENT_NAME = re.compile(r"[a-z][A-Za-z0-9_]*")
# the language has whole numbers of 32 bits, and positions are in micrometres
MAX_COORDINATE_M = 2_147.0
COLUMN_SEPARATORS = ",;\t"
UNIT_AT_END = re.compile(
    rf"(.+?)[_ ]?[(\[]?(?<![a-z])({'|'.join(TABLE_UNITS_M)})[)\]]?"
)  # x_mm, tolerance_in, upper_tol (mm)
TOLERANCES = "tolerance is the width of the zone; else upper_tol and lower_tol, or +tol and -tol"
TABLE_HINT = (
    f"the first line has {', '.join(NEEDED_COLUMNS)}, and any of {', '.join(OPTIONAL_COLUMNS)}"
)


@dataclass(frozen=True)
class _Head:
    """The first line: the columns as they are `written`, and without their units, and what
    lengths are given in.
    """

    written: Sequence[str]
    columns: Sequence[str]
    units: Mapping[str, float]

    def called(self, column: str) -> str:
        """A column as it is written."""
        return self.written[self.columns.index(column)] if column in self.columns else column


def unit_m(unit: str) -> float:
    """What a unit of length is in metres. Raises `InvalidInput`."""
    if unit not in TABLE_UNITS_M:
        hint = f"one of {', '.join(TABLE_UNITS_M)}"
        raise InvalidInput([Diagnostic(Source("--unit"), "K406", f"no unit '{unit}'", hint)])
    return TABLE_UNITS_M[unit]


def read_table(path: Path, unit: str = "mm") -> Inspection:
    """The points of a CSV table with the columns NEEDED and any of OPTIONAL, lengths in `unit`.
    Raises `InvalidInput`.

    A column such as `x_m` has the unit in its name. Without names, points are called p1, p2, ...
    Columns are divided by the first of comma, semicolon and tab that its first line contains.
    """
    units = dict.fromkeys(LENGTH_COLUMNS, unit_m(unit))
    file = read_file(path)
    head = file.text.partition("\n")[0]
    rows = csv.reader(
        io.StringIO(file.text, newline=None),
        delimiter=next((mark for mark in COLUMN_SEPARATORS if mark in head), ","),
    )
    try:
        written = [cell.strip() for cell in next(rows, [])]
        columns = [_column_name(column.lower(), units) for column in written]
        wrong, first = _column_errors(columns, file), _Head(written, columns, units)
        read_rows = (
            []
            if wrong
            else [
                _read_row(row, first, file.line(rows.line_num, 1), f"p{number}")
                for number, row in enumerate(filter(any, rows), 1)
            ]
        )
    except csv.Error as error:
        raise InvalidInput(
            [_table_error(file.line(rows.line_num, 1), f"not a table: {error}")]
        ) from None
    points = [read_row for read_row in read_rows if isinstance(read_row, tuple)]
    wrong += [read_row for read_row in read_rows if isinstance(read_row, Diagnostic)]
    wrong += _repeated_names(points)
    if wrong:
        raise InvalidInput(wrong)
    if not points:
        raise InvalidInput(
            [_table_error(Source(file.path), "the table has no rows", "one row for each point")]
        )
    all_points = tuple(point for point, _ in points)
    return Inspection(path.stem, all_points, features=len({point.feature for point in all_points}))


def _column_name(column: str, units: dict[str, float]) -> str:
    """The meaning of a column without its unit, which is noted."""
    with_unit = UNIT_AT_END.fullmatch(column)
    name = column if with_unit is None else with_unit[1]
    name = name if name in (*NEEDED_COLUMNS, *OPTIONAL_COLUMNS) else tolerance_column(name) or name
    if with_unit is None or name not in LENGTH_COLUMNS:
        return name if with_unit is None else column
    units[name] = TABLE_UNITS_M[with_unit[2]]
    return name


def _table_error(where: Source, message: str, hint: str = "") -> Diagnostic:
    return Diagnostic(where, "K805", message, hint)


def _column_errors(columns: Sequence[str], file: File) -> list[Diagnostic]:
    """What is wrong with the first line: columns that are missing, are there twice, or have no
    meaning.
    """
    where = file.line(1, 1)
    missing = [f"'{column}'" for column in NEEDED_COLUMNS if column not in columns]
    errors = [_table_error(where, f"no column {', '.join(missing)}", TABLE_HINT)] if missing else []
    known = (*NEEDED_COLUMNS, *OPTIONAL_COLUMNS)
    twice = sorted({column for column in columns if column and columns.count(column) > 1})
    errors += [
        _table_error(where, f"the column '{column}' is there twice", "remove one of them")
        for column in twice
    ]
    strange = [column for column in columns if column and column not in (*known, *ENDS)]
    for column in strange:
        if hint := nearest_hint(column, known):
            errors.append(_table_error(where, f"unknown column '{column}'", hint))
        elif looks_like_tolerance(column):
            errors.append(
                _table_error(
                    where,
                    f"the column '{column}' looks like a tolerance, and is not read",
                    TOLERANCES,
                )
            )
    both = contradiction(columns)
    return (
        [*errors, _table_error(where, f"the columns give {both}", TOLERANCES)] if both else errors
    )


def _repeated_names(points: Sequence[tuple[MeasurementPoint, Source]]) -> list[Diagnostic]:
    first: dict[str, Source] = {}
    errors = []
    for point, where in points:
        if point.name in first:
            message = (
                f"the name '{point.name}' is used twice: first in line {first[point.name].line}"
            )
            errors.append(_table_error(where, message, "give each point a name of its own"))
        first.setdefault(point.name, where)
    return errors


def _read_row(
    row: Sequence[str], head: _Head, where: Source, name: str
) -> tuple[MeasurementPoint, Source] | Diagnostic:
    columns = head.columns
    if len(row) > len(columns) and any(cell.strip() for cell in row[len(columns) :]):
        return _table_error(
            where,
            f"{len(row)} cells in {len(columns)} columns",
            "write 1.5 with a point, not a comma",
        )
    cells = {"name": name} if "name" not in columns else {}
    cells |= {key: text.strip() for key, text in zip(columns, row, strict=False)}
    bad = next(_bad_numbers(cells, head), None)
    if bad is not None:
        return _table_error(where, *bad)
    values = {key: read_decimal(cells[key]) for key in NUMERIC_COLUMNS if cells.get(key)}
    values |= {key: values[key] * head.units[key] for key in LENGTH_COLUMNS if key in values}
    told = _with_zone(values, cells.get("kind") or "profile")
    if isinstance(told, str):
        return _table_error(where, told, TOLERANCES)
    values = told
    if (
        message := _row_objection(cells.get("name", ""), cells.get("kind", ""), values)
    ) is not None:
        return _table_error(where, *message)
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


def _with_zone(values: dict[str, float], kind: str) -> dict[str, float] | str:
    """The numbers of a row with the width of the zone between two deviations and the value in
    its middle; or what is wrong.
    """
    if (ends := zone(values)) is None:
        return "one end of the tolerance without the other" if set(ENDS) & set(values) else values
    lower, upper = ends
    if lower > upper:
        return (
            f"the lower end of the tolerance is above the upper one: {lower * 1e3:g} and "
            f"{upper * 1e3:g} mm"
        )
    middle, nominal = (lower + upper) / 2, values.get("nominal", 0.0 if kind == "profile" else None)
    if not middle:
        return {**values, "tolerance": upper - lower}
    if nominal is None:
        return "a tolerance that is not even needs a nominal value"
    return {**values, "tolerance": upper - lower, "nominal": nominal + middle}


def _bad_numbers(cells: Mapping[str, str], head: _Head) -> Iterator[tuple[str, str]]:
    """What is wrong with the numbers of a row, and what to try."""
    for key in NUMERIC_COLUMNS:
        text = cells.get(key, "")
        if not text and key in NEEDED_COLUMNS:
            yield (
                f"no number in the column '{head.called(key)}'",
                "every point needs a position and a normal",
            )
        elif text:
            try:
                read_decimal(text)
            except NumberError as error:
                yield (
                    f"'{text[:MAX_NUMBER_CHARACTERS]}' {error}",
                    f"the column '{head.called(key)}' needs a number such as 1.5",
                )


def _row_objection(name: str, kind: str, values: Mapping[str, float]) -> tuple[str, str] | None:
    """Why a row describes no point, and what to try; None if it does."""
    if not MEASUREMENT_NAME.fullmatch(name) or name == "not":
        return f"'{name}' is not a name", "a small letter, then letters, digits and _"
    if kind and not MEASUREMENT_NAME.fullmatch(kind):
        return (
            f"'{kind}' is not a kind of measurement",
            "profile, thickness, or a kind of the domain",
        )
    if not any(values[key] for key in ("nx", "ny", "nz")):
        return "the normal has no length", "give the direction away from the material"
    if max(abs(values[key]) for key in LENGTH_COLUMNS if key in values) > MAX_COORDINATE_M:
        return f"a length of more than {MAX_COORDINATE_M:.0f} m", "look at --unit"
    if min((values[key] for key in ("tolerance", "bore") if key in values), default=0) < 0:
        return "a tolerance or a bore is less than 0", "give how wide it is"
    return None
