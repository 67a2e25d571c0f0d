"""The form of the files as pydantic models, also exported as JSON Schema for editors.

ASP in strings is not read here.
"""

from typing import Any

from cellwright.kb.schema.form_validation import (
    Deviation,
    find_deviations,
    form_model,
    keys_at,
    values_at,
)

__all__ = ["FORM_KINDS", "Deviation", "find_deviations", "json_schema", "keys_at", "values_at"]

FORM_KINDS = (
    "domain",
    "problem",
    "plan",
    "cell",
    "arm",
    "faults",
    "contacts",
    "scene",
    "device",
    "events",
)


def json_schema(kind: str) -> dict[str, Any]:
    """The JSON Schema of a kind of file, with a description of every key."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **_unbroken(form_model(kind).model_json_schema(by_alias=True)),
    }


def _unbroken(schema: Any) -> Any:
    """A schema whose descriptions have one line for each paragraph, however docstrings break."""
    if isinstance(schema, dict):
        return {
            key: " ".join(value.split())
            if key == "description" and isinstance(value, str)
            else _unbroken(value)
            for key, value in schema.items()
        }
    return [_unbroken(item) for item in schema] if isinstance(schema, list) else schema
