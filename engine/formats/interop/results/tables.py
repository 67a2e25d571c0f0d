"""Measured values as a table: one row for each. Numbers are written so that they are read back equal."""

import csv
import io
from collections.abc import Mapping

from cellwright.kb.model.results import Measured, Results
from cellwright.kb.numbers import finite, whole

TEXTS = ("of", "quantity", "unit", "tool", "action")
LIMITS, SURENESS = ("nominal", "lower", "upper"), ("uncertainty", "risk")
NUMBERS = (*LIMITS, *SURENESS)
NEW = (*SURENESS, "conformity")  # tables of older runs lack these
COLUMNS = (
    "run", "started", "at_ms", "of", "quantity", "value", "unit", *LIMITS, "passed", "tool", "action", *NEW,
)  # fmt: skip
VERDICTS = {True: "yes", False: "no", None: ""}


def written_csv(results: Results) -> str:
    """The measured values of a run."""
    out = io.StringIO(newline="")
    table = csv.DictWriter(out, COLUMNS, lineterminator="\r\n")
    table.writeheader()
    for each in results.measured:
        row = {name: getattr(each, name) for name in TEXTS}
        row |= {name: _number(getattr(each, name)) for name in NUMBERS}
        row |= {"value": _number(each.value), "passed": VERDICTS[each.passed], "at_ms": str(each.at_ms)}
        row["conformity"] = each.conformity or ""
        table.writerow({**row, "run": results.run, "started": results.started})
    return out.getvalue()


def read_csv(text: str) -> Results:
    """The measured values of a table. Raises `ValueError`."""
    rows = list(csv.DictReader(io.StringIO(text, newline="")))
    if rows and set(COLUMNS) - set(NEW) - set(rows[0]):
        raise ValueError("not a table of results")
    first = rows[0] if rows else {"run": "", "started": ""}
    return Results(first["run"], first["started"], tuple(map(_measured, rows)))


def _measured(row: Mapping[str, str]) -> Measured:
    said = (finite(row[name]) if row.get(name) else None for name in NUMBERS)
    nominal, lower, upper, uncertainty, risk = said
    of, quantity, unit, tool, action = (row[name] for name in TEXTS)
    value, at_ms = finite(row["value"]), whole(row["at_ms"])
    return Measured(of, quantity, value, unit, nominal, lower, upper, tool, action, at_ms, uncertainty, risk)


def _number(value: float | None) -> str:
    """A number as text: whole ones without a fraction."""
    if value is None:
        return ""
    return str(int(value)) if float(value).is_integer() and abs(value) < 1e15 else repr(value)
