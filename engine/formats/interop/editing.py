"""Edits of the measurements in a problem file, so that comments and all other lines do not change.

Measurements stand in a list under their type under `objects:`, one a line or in brackets, alone or in ranges. Facts and
goals stand in lists; one item may contain several of them.
"""

import re
from collections.abc import Iterator, Sequence

from cellwright.engine.formats.interop.lists import ListedItem, YamlList, listed, refused, split
from cellwright.engine.formats.interop.measurements import facts, goal
from cellwright.engine.model.measurement import MeasurementPoint
from cellwright.kb.model.conventions import Conventions

RANGE = re.compile(r"([a-z]\w*?)(\d+)\.\.((?:[a-z]\w*?)?)(\d+)")


def added(lines: Sequence[str], point: MeasurementPoint, path: str, words: Conventions) -> list[str]:
    """The lines with one more measurement, its facts and a goal."""
    found = _with_name(list(lines), point.name, path, words)
    found = _with_items(found, "statics", facts(point, words), path)
    return _with_items(found, "goals", [goal(point.name, words)], path)


def removed(lines: Sequence[str], name: str, path: str, words: Conventions) -> list[str]:
    """The lines without a measurement and without the facts and goals about it. Raises `InvalidInput` if more depends on it."""
    names = listed(lines, ("objects", words.measurement), path)
    if names is None or all(name not in _expanded(each.text) for each in names.entries()):
        raise refused(path, f"'{name}' does not stand in a list under `{words.measurement}:`")
    found = _replaced(lines, names, [each for item in names.items for each in _without_name(item, name)])
    for section in ("statics", "initial", "goals"):
        block = listed(found, (section,), path)
        if block is not None:
            _require_free(block, section, name, path, words)
            found = _replaced(
                found, block, [each for item in block.items for each in _without(item, name, path)]
            )
    _require_unused(found, name, path)
    return found


def replaced(lines: Sequence[str], point: MeasurementPoint, path: str, words: Conventions) -> list[str]:
    """The lines with new facts about an existing measurement; its goal and all its other facts are kept."""
    told = {
        words.needs,
        words.position,
        words.normal,
        words.nominal,
        words.tolerance,
        words.bore,
        words.prefers,
    }
    own = re.compile(rf"\s*(?:{'|'.join(sorted(told))})\(\s*{re.escape(point.name)}\s*,")
    found = list(lines)
    if (block := listed(lines, ("statics",), path)) is not None:
        kept = [each for item in block.items for each in _without(item, "", path, own)]
        found = _replaced(lines, block, kept)
    return _with_items(found, "statics", facts(point, words), path)


def _replaced(lines: Sequence[str], block: YamlList, items: Sequence[ListedItem | str]) -> list[str]:
    """The lines with other items in a list; they do not change if the items are the same."""
    if list(items) == list(block.items):
        return list(lines)
    return [*lines[: block.first], *block.written(items), *lines[block.stop :]]


def _with_items(lines: Sequence[str], section: str, texts: Sequence[str], path: str) -> list[str]:
    """The lines with items at the end of a list, which is made if there is none."""
    block = listed(lines, (section,), path)
    items = [ListedItem(text) for text in texts]
    if block is None:
        return [*lines, f"{section}:", *(f"  - {each}" for each in texts)]
    if block.margin is None and not block.entries():  # `goals: []`
        block = YamlList(block.first, block.stop, f"{block.head.rstrip()}{block.tail}", (), margin="  ")
    return _replaced(lines, block, [*block.items, *items])


def _with_name(lines: list[str], name: str, path: str, words: Conventions) -> list[str]:
    block = listed(lines, ("objects", words.measurement), path)
    if block is not None:
        return _replaced(lines, block, _appended(block.items, name))
    at = next((n for n, line in enumerate(lines) if re.match(r"objects\s*:\s*(#.*)?$", line)), None)
    if at is not None:
        return [*lines[: at + 1], f"  {words.measurement}: [{name}]", *lines[at + 1 :]]
    if any(re.match(r"objects\s*:", line) for line in lines):
        raise refused(
            path, f"`objects:` has no list of {words.measurement}", f"add `{words.measurement}: []` to it"
        )
    head = next((n for n, line in enumerate(lines) if re.match(r"domain\s*:", line)), -1) + 1
    return [*lines[:head], "objects:", f"  {words.measurement}: [{name}]", *lines[head:]]


def _appended(items: Sequence[ListedItem | str], name: str) -> list[ListedItem | str]:
    """The items with one more name; a range that ends just before it is made longer."""
    last = items[-1] if items else None
    found = RANGE.fullmatch(last.text) if isinstance(last, ListedItem) else None
    if found and isinstance(last, ListedItem) and name == f"{found[1]}{_next(found[4], found[2])}":
        longer = f"{found[1]}{found[2]}..{found[3]}{_next(found[4], found[2])}"
        return [*items[:-1], ListedItem(longer, last.comment)]
    return [*items, ListedItem(name)]


def _next(number: str, first: str) -> str:
    width = len(first) if first.startswith("0") else 0
    return f"{int(number) + 1:0{width}d}"


def _expanded(text: str) -> list[str]:
    """The names of an item: one, or those of a range."""
    found = RANGE.fullmatch(text)
    if found is None or found[3] not in ("", found[1]):
        return [text.strip("\"'")]
    width = len(found[2]) if found[2].startswith("0") else 0
    return [f"{found[1]}{number:0{width}d}" for number in range(int(found[2]), int(found[4]) + 1)]


def _without_name(item: ListedItem | str, name: str) -> Iterator[ListedItem | str]:
    """An item without a name: nothing, the item itself, or the ranges before and behind the name."""
    names = _expanded(item.text) if isinstance(item, ListedItem) else []
    if name not in names or isinstance(item, str):
        yield item
        return
    place = names.index(name)
    for number, part in enumerate((names[:place], names[place + 1 :])):
        if part:
            last = re.search(r"\d+$", part[-1])
            shown = part[0] if len(part) == 1 or last is None else f"{part[0]}..{last[0]}"
            yield ListedItem(shown, item.comment if number else "")


def _without(
    item: ListedItem | str, name: str, path: str, about: re.Pattern[str] | None = None
) -> Iterator[ListedItem | str]:
    """An item without the atoms that mention a name (or that match `about`); nothing if none is left."""
    if isinstance(item, str):
        yield item
        return
    quote = item.text[:1] if item.text[:1] in ("'", '"') and item.text[-1:] == item.text[:1] else ""
    parts = split(item.text[len(quote) : len(item.text) - len(quote)])
    gone = [part for part in parts if (about.match(part) if about else _mentions(part, name))]
    if any("|" in part or " : " in part for part in gone):
        message = f"'{name}' stands in a condition with others: {gone[0].strip()}"
        raise refused(path, message, "change this condition first")
    kept = [part for part in parts if part not in gone]
    if not gone:
        yield item
    elif kept:
        yield ListedItem(f"{quote}{','.join(kept).strip()}{quote}", item.comment)


def _mentions(text: str, name: str) -> bool:
    return re.search(rf"(?<!\w){re.escape(name)}(?!\w)", re.sub(r'"[^"]*"', '""', text)) is not None


def _require_free(block: YamlList, section: str, name: str, path: str, words: Conventions) -> None:
    """Refuse to take away initial facts other than that the measurement is done."""
    if section != "initial":
        return
    parts = [part.strip(" \"'") for item in block.entries() for part in split(item.text.strip("\"'"))]
    for part in parts:
        if _mentions(part, name) and not part.startswith(f"{words.measured}("):
            hint = "let it begin somewhere else first, or keep the measurement"
            raise refused(path, f"the initial fact {part} needs '{name}'", hint)


def _require_unused(lines: Sequence[str], name: str, path: str) -> None:
    """Refuse to remove a measurement that other parts of the file name."""
    for number, line in enumerate(lines, 1):
        if _mentions(line.partition("#")[0], name):
            raise refused(
                path, f"line {number} also names '{name}': {line.strip()}", "change this line first"
            )
