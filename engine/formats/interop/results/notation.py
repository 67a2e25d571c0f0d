"""Results as JSON: what was measured, and what was done to each object."""

import json
import sys
from typing import Any

from cellwright.kb.json_text import parsed
from cellwright.kb.model.results import Measured, Results, Treated
from cellwright.kb.numbers import is_number

VERSION = 1
KEYS = (
    "of", "quantity", "value", "unit", "nominal", "lower", "upper", "uncertainty", "risk", "passed", "conformity", "tool",
    "action", "at_ms",
)  # fmt: skip
FOLLOWS = ("passed", "conformity")


def entry(results: Results) -> dict[str, Any]:
    """The results as plain values. `passed` and `conformity` follow from the value, its limits and its uncertainty."""
    return {
        "version": VERSION,
        "run": results.run,
        "started": results.started,
        "measured": [{name: getattr(each, name) for name in KEYS} for each in results.measured],
        "history": [
            {
                "object": each.object,
                "action": each.action,
                "started_ms": each.started_ms,
                "ended_ms": each.ended_ms,
                "changes": list(each.changes),
            }
            for each in results.history
        ],
    }


def written_json(results: Results) -> str:
    """The results as a JSON text."""
    return json.dumps(entry(results), ensure_ascii=False, indent=1) + "\n"


def read_json(text: str) -> Results:
    """The results of a JSON text. Raises `ValueError`."""
    found = parsed(text)
    if not isinstance(found, dict) or found.get("version") != VERSION:
        raise ValueError(f"not results in version {VERSION}")
    history = [{**each, "changes": tuple(each["changes"])} for each in found["history"]]
    return Results(
        found["run"],
        found["started"],
        tuple(map(_measured, found["measured"])),
        tuple(Treated(**each) for each in history),
    )


def _measured(entry: dict[str, Any]) -> Measured:
    said = {key: value for key, value in entry.items() if key not in FOLLOWS}
    for key, value in said.items():
        if not _fits(key, value):
            raise ValueError(f"`{key}` cannot be {str(value)[:40]}")
    return Measured(**said)


def _fits(key: str, value: object) -> bool:
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
