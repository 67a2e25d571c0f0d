"""Results as JSON: what was measured, and what was done to each object."""

import json
from typing import Any

from kb.model.results import Measured, Results, Treated

VERSION = 1
KEYS = ("of", "quantity", "value", "unit", "nominal", "lower", "upper", "passed", "tool", "action", "at_ms")


def entry(results: Results) -> dict[str, Any]:
    """The results as plain values. `passed` follows from the value and its limits."""
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
    found = json.loads(text)
    if not isinstance(found, dict) or found.get("version") != VERSION:
        raise ValueError(f"not results in version {VERSION}")
    measured = [{key: value for key, value in each.items() if key != "passed"} for each in found["measured"]]
    history = [{**each, "changes": tuple(each["changes"])} for each in found["history"]]
    return Results(
        found["run"],
        found["started"],
        tuple(Measured(**each) for each in measured),
        tuple(Treated(**each) for each in history),
    )
