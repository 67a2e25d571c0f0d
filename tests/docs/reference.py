"""The reference of all files as a page, made of their schemas.

`pytest tests/docs/test_reference_page.py --update-golden` writes it.
"""

from collections.abc import Iterator, Mapping
from textwrap import fill
from typing import Any

from cellwright.kb.schema import json_schema

Part = Mapping[str, Any]

# What each kind of file is, in the order of the page, with the page that explains it.
FILES = {
    "domain": ("domain.yaml", "What a cell can do.", "language.md"),
    "problem": ("problems/*.yaml", "What is there, and what is wanted.", "language.md#problems"),
    "device": (
        "devices/NAME/device.yaml",
        "A part of a domain that cells share. Beside these keys it has those of a domain.",
        "devices.md",
    ),
    "faults": (
        "faults.yaml",
        "What can go wrong, how it is told apart, and what puts it right.",
        "diagnosis.md",
    ),
    "cell": ("cell.yaml", "What stands where: arms, bodies, places.", "geometry.md"),
    "arm": ("an arm of your own", "The joints and shapes of an arm.", "geometry.md"),
    "contacts": ("contacts.yaml", "Which objects can touch where.", "task-space.md"),
    "scene": ("scene.yaml", "A camera, parts, and where they belong.", "placing.md"),
    "plan": (
        "a plan in JSON",
        "What `--format json` writes, and `validate` reads.",
        "plan-format.md",
    ),
    "events": (
        "the events of a run",
        "What `run --events` writes, one object a line.",
        "execution.md",
    ),
}
HEAD = """# Reference of all files

Every key of every kind of file. This page is made of the schemas in [schema/](schema), with which
editors complete and explain keys; `cellwright schema KIND` prints them. What the keys mean together
is told on the pages that each section names. Keys with a * must be there. What several kinds of
files have in common is told at the first of them.
"""


def page() -> str:
    """The whole page."""
    told: dict[str, Part] = {}
    return HEAD + "".join(text for kind in FILES for text in _section(kind, told))


def _section(kind: str, told: dict[str, Part]) -> Iterator[str]:
    """The tables of one kind of file, without those that another kind has in the same words."""
    name, about, link = FILES[kind]
    schema = json_schema(kind)
    definitions = schema.get("$defs", {})
    more = f"{about} More: [{link.partition('#')[0]}]({link})."
    yield f"\n## {name}\n\n{_filled(more)}\n"
    if schema.get("properties"):
        yield _table(schema, definitions)
    for each in definitions:
        if definitions[each].get("properties") and told.get(each) != definitions[each]:
            told[each] = definitions[each]
            sentence = _sentence(definitions[each].get("description", ""))
            yield f"\n### {name}: {_title(each)}\n\n{_filled(sentence)}\n"
            yield _table(definitions[each], definitions)


def _filled(prose: str) -> str:
    """Prose in lines of at most 100 columns."""
    return fill(prose, 100, break_long_words=False, break_on_hyphens=False)


def _table(part: Part, definitions: Part) -> str:
    needed = set(part.get("required", ()))
    rows = [
        f"| `{key}`{'*' if key in needed else ''} | {_kind(value, definitions)} | "
        f"{_meaning(value)} |"
        for key, value in part["properties"].items()
    ]
    return "\n".join(["\n| key | value | meaning |", "| --- | --- | --- |", *rows, ""])


def _meaning(value: Part) -> str:
    default = value.get("default")
    said = _cell(value.get("description", ""))
    plain = isinstance(default, str | int | float | bool) and default != ""
    return (
        f"{said}; `{str(default).lower() if isinstance(default, bool) else default}` if left out"
        if plain
        else said
    )


def _kind(value: Part, definitions: Part) -> str:
    """What may stand behind a key, in a few words."""
    if "$ref" in value:
        name = value["$ref"].rpartition("/")[2]
        target = definitions[name]
        return _title(name) if target.get("properties") else _kind(target, definitions)
    for several in ("anyOf", "oneOf"):
        if several in value:
            kinds = [
                _kind(each, definitions) for each in value[several] if each.get("type") != "null"
            ]
            return " or ".join(dict.fromkeys(kinds))
    if "const" in value:
        return f"`{value['const']}`"
    if "enum" in value:
        return ", ".join(f"`{each}`" for each in value["enum"])
    return _plain(value, definitions)


def _plain(value: Part, definitions: Part) -> str:
    match value.get("type"):
        case "array":
            return f"list of {_kind(value['items'], definitions)}" if value.get("items") else "list"
        case "object":
            inner = value.get("additionalProperties")
            return (
                f"by name: {_kind(inner, definitions)}"
                if isinstance(inner, dict)
                else "keys and values"
            )
        case "string":
            return "text"
        case "integer":
            return "whole number"
        case "boolean":
            return "`true` or `false`"
        case kind:
            return kind if isinstance(kind, str) else "anything"


def _title(name: str) -> str:
    """`CommandEntry` as people say it: command."""
    plain = name.removesuffix("Entry").removesuffix("File") or name
    words = "".join(f" {each.lower()}" if each.isupper() else each for each in plain).split()
    return " ".join(words)


def _sentence(text: str) -> str:
    return _cell(text) or "No more is said of it."


def _cell(text: str) -> str:
    """A text as a cell of a table: one line, nothing in it that Markdown reads as a column or
    as HTML.
    """
    return " ".join(text.split()).replace("|", "\\|").replace("<", "\\<")
