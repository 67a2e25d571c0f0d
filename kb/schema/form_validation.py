"""Checks the content of a file against its schema, and lists the keys allowed at a path."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from typing import Any

from pydantic import BaseModel, ValidationError

from cellwright.kb.diagnostics import nearest_hint

Path = tuple[str | int, ...]
CUT_OFF = "a comma between { and } ends a value: put the whole value in quotes"


@dataclass(frozen=True, slots=True)
class Deviation:
    """An error at `path`, and what to try.

    If `at_key`, it concerns the last key of the path, not its value.
    """

    path: Path
    message: str
    hint: str = ""
    at_key: bool = False


def find_deviations(kind: str, content: Any) -> list[Deviation]:
    """The differences of plain content (strings, lists, dicts, None for an empty scalar) from
    the form of its kind.
    """
    model = form_model(kind)
    try:
        model.model_validate(content)
    except ValidationError as error:
        return list(_merge_errors(error.errors(include_url=False), model, content))
    return []


FORM_MODELS = {
    "domain": ("domain", "DomainFile"),
    "problem": ("problem", "ProblemFile"),
    "plan": ("plan", "PlanFile"),
    "cell": ("cell", "CellFile"),
    "arm": ("arm", "ArmFile"),
    "faults": ("faults", "FaultsFile"),
    "contacts": ("contacts", "ContactsFile"),
    "scene": ("scene", "SceneFile"),
    "device": ("device", "DeviceFile"),
    "events": ("events", "EventLine"),
}
"""For each kind of file, the module of its form and the name of it there."""


def form_model(kind: str) -> type[BaseModel]:
    """The model of a kind of file, imported when it is needed. Raises `KeyError`."""
    module, name = FORM_MODELS[kind]
    model_class: type[BaseModel] = getattr(import_module(f"cellwright.kb.schema.{module}"), name)
    return model_class


def _merge_errors(
    errors: Sequence[Any], model: type[BaseModel], content: Any
) -> Iterator[Deviation]:
    """One deviation per place.

    Pydantic reports one error for each alternative of a union; they are merged.
    """
    places: dict[Path, list[Any]] = {}
    for error in errors:
        places.setdefault(_error_path(error, content), []).append(error)
    for path, place_errors in places.items():
        match place_errors[0]["type"]:
            case "extra_forbidden":
                yield _unknown_key(path, model)
            case "missing":
                yield Deviation(path[:-1], f"the key '{path[-1]}' is missing", f"add `{path[-1]}:`")
            case _:
                yield _wrong_value(path, place_errors)


def _error_path(error: Any, content: Any) -> Path:
    """The location without the names of a union's alternatives, which are not part of the file."""
    path: list[str | int] = []
    for number, part in enumerate(error["loc"], 1):
        inside = isinstance(content, Mapping) and part in content
        inside = inside or (
            isinstance(content, list) and isinstance(part, int) and part < len(content)
        )
        if inside:
            content = content[part]
            path.append(part)
        elif error["type"] == "missing" and number == len(error["loc"]):
            path.append(part)
    return tuple(path)


def _unknown_key(path: Path, model: type[BaseModel]) -> Deviation:
    known, key = known_keys(model, path[:-1]), str(path[-1])
    # the rest of a term that YAML has split
    cut_off = CUT_OFF if key.count(")") > key.count("(") else ""
    hint = (
        cut_off
        or nearest_hint(key, known)
        or (f"known here: {', '.join(known)}" if known else "leave it out")
    )
    return Deviation(path, f"unknown key '{key}'", hint, at_key=True)


def _wrong_value(path: Path, errors: Sequence[Any]) -> Deviation:
    name = ".".join(map(str, path)) or "the file"
    value = errors[0]["input"]
    said = [_EXPECTED[error["type"]] for error in errors if error["type"] in _EXPECTED]
    if said:
        expected = " or ".join(dict.fromkeys(said))
        return Deviation(
            path,
            f"{name}: expected {expected}, found {_kind_of_value(value)}",
            _give_advice(said, value),
        )
    return Deviation(
        path, f"{name}: {_describe_error(errors[0])}", _HINTS.get(errors[0]["type"], "")
    )


_EXPECTED = {
    "string_type": "text",
    "list_type": "a list",
    "dict_type": "a mapping",
    "model_type": "a mapping",
    "model_attributes_type": "a mapping",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "whole_number": "a whole number",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "truth": "true or false",
}
_HINTS = {
    "literal_error": "choose one of them",
    "string_pattern_mismatch": "a small letter, then small letters, digits and _",
}


def _describe_error(error: Any) -> str:
    shown = error["input"] if len(str(error["input"])) <= 60 else f"{str(error['input'])[:60]}..."
    limits = error.get("ctx", {})
    match error["type"]:
        case "string_pattern_mismatch":
            return f"'{shown}' is not a name"
        case "literal_error":
            return f"'{shown}' is not one of {limits['expected']}".replace(" or ", ", ")
        case "greater_than_equal" | "greater_than":
            return (
                f"{shown} is too small: the least is {limits.get('ge', limits.get('gt', -1) + 1)}"
            )
        case "less_than_equal":
            return f"{shown} is too large: the most is {limits['le']}"
        case _:
            said = str(error["msg"])
            return f"{said[0].lower()}{said[1:]}"


def _kind_of_value(value: Any) -> str:
    match value:
        case None:
            return "nothing"
        case list():
            return "a list"
        case Mapping():
            return "a mapping"
        case _:
            return f"'{value}'" if len(str(value)) <= 40 else "a long text"


def _give_advice(expected: Sequence[str], found: Any) -> str:
    match found:
        case list() | Mapping() if "text" in expected:
            return "write it as one string; quotes keep YAML from splitting it"
        case str() if "a list" in expected:
            return "put it in [ ], or give each item a line that starts with '- '"
        case str() | list() if "a mapping" in expected:
            return "give each entry a line `key: value`"
        case None:
            return "fill it in, or leave the key out"
        case str() if "a whole number" in expected:
            return "write it in digits"
        case str() if "true or false" in expected:
            return "write `true` or `false`"
        case _:
            return ""


def known_keys(model: type[BaseModel], path: Path) -> list[str]:
    """The keys that a mapping at `path` may have; empty if it may have any keys."""
    schema = model.model_json_schema(by_alias=True)
    return list(_schema_at(schema, path).get("properties", {}))


def _schema_at(schema: Any, path: Path) -> Any:
    """The part of a JSON Schema that describes what is at `path`."""
    at: Any = schema
    for part in path:
        at = _resolve_reference(schema, at)
        if isinstance(part, int):
            at = at.get("items", {})
        else:
            more = at.get("additionalProperties")
            at = at.get("properties", {}).get(part) or (more if isinstance(more, dict) else {})
    return _resolve_reference(schema, at)


@lru_cache(maxsize=16)
def _kind_schema(kind: str) -> Any:
    return form_model(kind).model_json_schema(by_alias=True)


def keys_at(kind: str, path: Path) -> dict[str, str]:
    """The keys that a mapping at `path` of a kind of file may have, each with its description."""
    schema = _kind_schema(kind)
    properties = _schema_at(schema, path).get("properties", {})
    return {key: _key_description(schema, key_schema) for key, key_schema in properties.items()}


def values_at(kind: str, path: Path) -> list[str]:
    """The values among which a scalar at `path` of a kind of file chooses; empty if it is free."""
    at = _schema_at(_kind_schema(kind), path)
    if at.get("type") == "boolean":
        return ["true", "false"]
    return [str(value) for option in [at, *at.get("anyOf", [])] for value in option.get("enum", [])]


def _key_description(schema: Any, at: Any) -> str:
    said = at.get("description") or _resolve_reference(schema, at).get("description") or ""
    return str(said)


def _resolve_reference(schema: Any, at: Any) -> Any:
    for option in [at, *at.get("anyOf", []), *at.get("allOf", [])]:
        if "$ref" in option:
            return schema["$defs"][option["$ref"].rsplit("/", 1)[1]]
    return at
