"""Results of runs as JSON (with the history of each object) and as CSV (measured values only)."""

import csv
import io
import json
import sys
from collections.abc import Mapping
from typing import Any

from cellwright.kb.json_text import parse_json
from cellwright.kb.model.measured_results import Measured, Results, Treated
from cellwright.kb.numbers import is_number, read_finite, read_whole

TEXT_COLUMNS = ("of", "quantity", "unit", "tool", "action")
LIMITS, SURENESS = ("nominal", "lower", "upper"), ("uncertainty", "risk")
VALUE_COLUMNS = (*LIMITS, *SURENESS)
NEW_COLUMNS = (*SURENESS, "conformity")  # tables of older runs lack these
RESULT_COLUMNS = (
    "run", "started", "at_ms", "of", "quantity", "value", "unit", *LIMITS, "passed", "tool",
    "action", *NEW_COLUMNS,
)  # fmt: skip
PASSED_WORDS = {True: "yes", False: "no", None: ""}


def written_csv(results: Results) -> str:
    """The measured values of a run."""
    out = io.StringIO(newline="")
    table = csv.DictWriter(out, RESULT_COLUMNS, lineterminator="\r\n")
    table.writeheader()
    for value in results.measured:
        row = {name: getattr(value, name) for name in TEXT_COLUMNS}
        row |= {name: _number_text(getattr(value, name)) for name in VALUE_COLUMNS}
        row |= {
            "value": _number_text(value.value),
            "passed": PASSED_WORDS[value.passed],
            "at_ms": str(value.at_ms),
        }
        row["conformity"] = value.conformity or ""
        table.writerow({**row, "run": results.run, "started": results.started})
    return out.getvalue()


def read_csv(text: str) -> Results:
    """The measured values of a table. Raises `ValueError`."""
    rows = list(csv.DictReader(io.StringIO(text, newline="")))
    if rows and set(RESULT_COLUMNS) - set(NEW_COLUMNS) - set(rows[0]):
        raise ValueError("not a table of results")
    first = rows[0] if rows else {"run": "", "started": ""}
    return Results(first["run"], first["started"], tuple(map(_measured_of_row, rows)))


def _measured_of_row(row: Mapping[str, str]) -> Measured:
    said = (read_finite(row[name]) if row.get(name) else None for name in VALUE_COLUMNS)
    nominal, lower, upper, uncertainty, risk = said
    of, quantity, unit, tool, action = (row[name] for name in TEXT_COLUMNS)
    value, at_ms = read_finite(row["value"]), read_whole(row["at_ms"])
    return Measured(
        of, quantity, value, unit, nominal, lower, upper, tool, action, at_ms, uncertainty, risk
    )


def _number_text(value: float | None) -> str:
    """A number as text: whole ones without a fraction."""
    if value is None:
        return ""
    return str(int(value)) if float(value).is_integer() and abs(value) < 1e15 else repr(value)


RESULTS_VERSION = 1
MEASURED_KEYS = (
    "of", "quantity", "value", "unit", "nominal", "lower", "upper", "uncertainty", "risk",
    "passed", "conformity", "tool",
    "action", "at_ms",
)  # fmt: skip
DERIVED_KEYS = ("passed", "conformity")


def results_entry(results: Results) -> dict[str, Any]:
    """The results as plain values.

    `passed` and `conformity` follow from the value, its limits and its uncertainty.
    """
    return {
        "version": RESULTS_VERSION,
        "run": results.run,
        "started": results.started,
        "measured": [
            {name: getattr(value, name) for name in MEASURED_KEYS} for value in results.measured
        ],
        "history": [
            {
                "object": treated.object,
                "action": treated.action,
                "started_ms": treated.started_ms,
                "ended_ms": treated.ended_ms,
                "changes": list(treated.changes),
            }
            for treated in results.history
        ],
    }


def written_json(results: Results) -> str:
    """The results as a JSON text."""
    return json.dumps(results_entry(results), ensure_ascii=False, indent=1) + "\n"


def read_json(text: str) -> Results:
    """The results of a JSON text. Raises `ValueError`."""
    document = parse_json(text)
    if not isinstance(document, dict) or document.get("version") != RESULTS_VERSION:
        raise ValueError(f"not results in version {RESULTS_VERSION}")
    history = [{**treated, "changes": tuple(treated["changes"])} for treated in document["history"]]
    return Results(
        document["run"],
        document["started"],
        tuple(map(_measured_of_entry, document["measured"])),
        tuple(Treated(**treated) for treated in history),
    )


def _measured_of_entry(entry: dict[str, Any]) -> Measured:
    said = {key: value for key, value in entry.items() if key not in DERIVED_KEYS}
    for key, value in said.items():
        if not _fits_key(key, value):
            raise ValueError(f"`{key}` cannot be {str(value)[:40]}")
    return Measured(**said)


def _fits_key(key: str, value: object) -> bool:
    """Whether a value is of the type that a measured value has there."""
    match key:
        case "value":
            return is_number(value, sys.float_info.max)
        case "nominal" | "lower" | "upper" | "uncertainty" | "risk":
            return value is None or is_number(value, sys.float_info.max)
        case "at_ms":
            return type(value) is int
        case _:
            return isinstance(value, str)
