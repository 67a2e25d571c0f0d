"""Measurements in problem files: written as facts and goals, and edited line by line.

A list stands with one item a line, or between brackets. Only its own lines change. Lists in another
form are refused.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from cellwright.engine.model.part_measurements import Inspection, MeasurementPoint, Triple
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.name_conventions import Conventions
from cellwright.kb.terms import Function, Number, Text

OPENING, CLOSING = "([{", ")]}"


@dataclass(frozen=True, slots=True)
class ListedItem:
    """An item as it is written, with its quotes, and the comment behind it."""

    text: str
    comment: str = ""


@dataclass(frozen=True, slots=True)
class YamlList:
    """A list in lines `first` to `stop`.

    `head` stands before the items, `tail` behind them; `margin` is None in brackets.
    """

    first: int
    stop: int
    head: str
    items: tuple[ListedItem | str, ...]  # in a list of lines, comments and empty lines are texts
    tail: str = ""
    margin: str | None = None

    def entries(self) -> list[ListedItem]:
        """The items without the comments between them."""
        return [item for item in self.items if isinstance(item, ListedItem)]

    def written(self, items: Sequence[ListedItem | str]) -> list[str]:
        """The lines of the list with these items."""
        if self.margin is None:
            shown = [
                _quote_in_brackets(item.text) for item in items if isinstance(item, ListedItem)
            ]
            return [f"{self.head}[{', '.join(shown)}]{self.tail}"]
        lines = [e if isinstance(e, str) else f"{self.margin}- {e.text}{e.comment}" for e in items]
        entries = any(isinstance(item, ListedItem) for item in items)
        return [self.head if entries else _empty_head(self.head), *lines]


def _empty_head(head: str) -> str:
    key, colon, rest = head.partition(":")
    return f"{key}{colon} []{rest}"


def edit_refusal(
    path: str, message: str, hint: str = "write one measurement, one fact or one goal per line"
) -> InvalidInput:
    """The refusal of a file whose lists cannot be changed line by line."""
    return InvalidInput([Diagnostic(Source(path), "K418", message, hint)])


def find_list(lines: Sequence[str], keys: Sequence[str], path: str) -> YamlList | None:
    """The list under nested keys; None if one of them does not occur. Raises `InvalidInput` if
    it has another form.
    """
    at, begin, end, depth, head, rest = 0, 0, len(lines), -1, "", ""
    for number, key in enumerate(keys):
        key_line = _find_key(lines, key, range(begin, end), depth)
        if key_line is None:
            return None
        at = key_line
        depth = _indentation(lines[at])
        head, rest = _split_comment(lines[at])
        inside = re.match(rf"\s*\{{(.*\b{keys[-1]}\s*:\s*)(?=\[)", rest)
        if number + 1 < len(keys) and inside:
            return _bracketed_list(lines, at, f"{head}{inside[0]}", path)
        begin, end = at + 1, _end_of_block(lines, at, depth)
    if rest.strip().startswith("["):
        return _bracketed_list(lines, at, head + rest[: rest.index("[")], path)
    if rest.strip() and not rest.strip().startswith("#"):
        raise edit_refusal(path, f"'{keys[-1]}:' in line {at + 1} is no list")
    return _lined_list(lines, at, end, depth, path)


def _find_key(lines: Sequence[str], key: str, among: range, depth: int) -> int | None:
    """The first line of a key that is deeper than `depth`, among the least deep lines there."""
    inner = [
        number
        for number in among
        if _indentation(lines[number]) > depth and _has_content(lines[number])
    ]
    least = min((_indentation(lines[number]) for number in inner), default=0)
    key_line = (
        n
        for n in inner
        if _indentation(lines[n]) == least and re.match(rf"\s*{re.escape(key)}\s*:(\s|$)", lines[n])
    )
    return next(key_line, None)


def _has_content(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith("#")


def _split_comment(line: str) -> tuple[str, str]:
    colon = line.index(":") + 1
    return line[:colon], line[colon:]


def _indentation(line: str) -> int:
    return len(line) - len(line.lstrip())


def _end_of_block(lines: Sequence[str], at: int, depth: int) -> int:
    """The line behind everything that belongs to a key; items of a list may be as deep as their
    key.
    """
    for number in range(at + 1, len(lines)):
        line = lines[number]
        if _has_content(line) and (
            _indentation(line) < depth
            or (_indentation(line) == depth and not line.lstrip().startswith("- "))
        ):
            return number
    return len(lines)


def _lined_list(lines: Sequence[str], at: int, end: int, depth: int, path: str) -> YamlList:
    while end > at + 1 and not _has_content(lines[end - 1]):
        end -= 1
    items: list[ListedItem | str] = []
    margin = " " * (depth + 2)
    for line in lines[at + 1 : end]:
        entry = re.match(r"(\s*)- (.*)$", line)
        if entry:
            margin = entry[1]
            items.append(ListedItem(*_without_comment(entry[2])))
        elif _has_content(line):
            raise edit_refusal(path, f"an item of '{lines[at].strip()}' goes over several lines")
        else:
            items.append(line)
    return YamlList(at, end, lines[at], tuple(items), margin=margin)


def _bracketed_list(lines: Sequence[str], at: int, head: str, path: str) -> YamlList:
    text, stop = lines[at], at + 1
    close = _closing_bracket(text, len(head))
    while close is None and stop < len(lines):
        text, stop = f"{text} {lines[stop].strip()}", stop + 1
        close = _closing_bracket(text, len(head))
    if close is None or (stop > at + 1 and _without_comment(text[:close])[1]):
        raise edit_refusal(path, f"the list in line {at + 1} cannot be read as lines")
    parts = [part.strip() for part in split_items(text[len(head) + 1 : close])]
    return YamlList(
        at, stop, head, tuple(ListedItem(part) for part in parts if part), text[close + 1 :]
    )


def _closing_bracket(text: str, begin: int) -> int | None:
    """The place of the bracket that closes the one at `begin`."""
    return next(
        (place for place, depth, _ in _unquoted_characters(text, begin) if depth == 0), None
    )


def _unquoted_characters(text: str, begin: int = 0) -> Iterator[tuple[int, int, str]]:
    """Each character outside of quotes: its place, how deep in brackets it stands, and itself."""
    depth, quote = 0, ""
    for place in range(begin, len(text)):
        character = text[place]
        if quote:
            quote = "" if character == quote and text[place - 1] != "\\" else quote
        elif character in "\"'" and (place == begin or not text[place - 1].isalnum()):
            quote = character
        else:
            depth += (character in OPENING) - (character in CLOSING)
            yield place, depth, character


def split_items(text: str) -> list[str]:
    """The parts of a text between commas that stand outside of brackets and quotes."""
    cuts = [
        place
        for place, depth, character in _unquoted_characters(text)
        if character == "," and depth == 0
    ]
    return [text[a + 1 : b] for a, b in zip([-1, *cuts], [*cuts, len(text)], strict=True)]


def _without_comment(text: str) -> tuple[str, str]:
    """The text of an item, and the comment behind it with the blanks before that."""
    cut = next(
        (
            p
            for p, _, character in _unquoted_characters(text)
            if character == "#" and (p == 0 or text[p - 1].isspace())
        ),
        len(text),
    )
    body = text[:cut].rstrip()
    return body, text[len(body) :]


def _quote_in_brackets(text: str) -> str:
    """An item as it can stand in brackets: with quotes if it contains a comma."""
    if text[:1] in ("'", '"') or "," not in text:
        return text
    return f"'{text}'" if '"' in text else f'"{text}"'


def point_atoms(point: MeasurementPoint, words: Conventions) -> list[Function]:
    """The facts of a problem about a point."""
    name = Function(point.name)
    declarations = [
        Function(words.needs, (name, Function(words.kind(point.kind)))),
        Function(words.position, (name, *_scaled_numbers(point.position, 1e6))),
        Function(words.normal, (name, *_scaled_numbers(point.normal, 1e3))),
    ]
    if point.nominal_m is not None:
        declarations.append(Function(words.nominal, (name, Number(round(point.nominal_m * 1e6)))))
    if point.tolerance_m is not None:
        declarations.append(
            Function(words.tolerance, (name, Number(round(point.tolerance_m * 1e6))))
        )
    if point.step:
        declarations.append(Function(words.alignment, (name, Number(point.step))))
    if point.bore_m is not None:
        declarations.append(Function(words.bore, (name, Number(round(point.bore_m * 1e6)))))
    if point.tool:
        declarations.append(Function(words.prefers, (name, Function(point.tool))))
    return declarations


def point_facts(point: MeasurementPoint, words: Conventions) -> list[str]:
    """The facts of a problem about a point, as texts."""
    return list(map(str, point_atoms(point, words)))


def measurement_goal(name: str, words: Conventions) -> str:
    """That a measurement is done, by whatever tool."""
    return f"{words.measured}(_, _, {words.place(name)})"


def _scaled_numbers(v: Triple, scale: float) -> tuple[Number, Number, Number]:
    x, y, z = (Number(round(component * scale)) for component in v)
    return x, y, z


def measurement_names(inspection: Inspection) -> list[str]:
    """The measurements: first the points, then the features without points."""
    return [
        *(point.name for point in inspection.points),
        *(exclusion.feature for exclusion in inspection.excluded),
    ]


def all_facts(inspection: Inspection, words: Conventions) -> Iterator[Function]:
    """The facts of a problem about all points and all excluded features."""
    for point in inspection.points:
        yield from point_atoms(point, words)
    for exclusion in inspection.excluded:
        name = Function(exclusion.feature)
        yield Function(words.needs, (name, Function(words.profile)))
        yield Function(words.impossible, (name, Text(exclusion.reason)))


def problem_text(
    inspection: Inspection,
    domain: str,
    words: Conventions,
    facts: Iterable[Function],
    wanted: Iterable[str],
) -> str:
    """A problem file: every point with its facts, excluded features with their reason, and a goal
    for each wanted name.

    `domain` is how the file refers to its domain, `words` is what that calls things.
    """
    return "\n".join(_problem_lines(inspection, domain, words, facts, wanted)) + "\n"


def _problem_lines(
    inspection: Inspection,
    domain: str,
    words: Conventions,
    facts: Iterable[Function],
    wanted: Iterable[str],
) -> Iterator[str]:
    name = re.sub(r"[^A-Za-z0-9_]", "_", inspection.name)
    counts = f"{len(inspection.points)} points; {len(inspection.excluded)} features without any"
    yield f"# {inspection.features} features, {counts}; micrometres"
    yield "# What is not said here is at the start as the defaults of the domain say."
    yield from (f"problem: {name}", f"domain: {domain}", "objects:", f"  {words.measurement}:")
    yield from (f"    - {measurement}" for measurement in measurement_names(inspection))
    yield "statics:"
    yield from (f"  - {fact}" for fact in facts)
    goals = [f"  - {measurement_goal(wanted_name, words)}" for wanted_name in wanted]
    yield from ("goals:", *goals) if goals else ("goals: []",)


RANGE_OF_NAMES = re.compile(r"([a-z]\w*?)(\d+)\.\.((?:[a-z]\w*?)?)(\d+)")


def add_measurement_lines(
    lines: Sequence[str], point: MeasurementPoint, path: str, words: Conventions
) -> list[str]:
    """The lines with one more measurement, its facts and a goal."""
    edited = _with_name(list(lines), point.name, path, words)
    edited = _with_items(edited, "statics", point_facts(point, words), path)
    return _with_items(edited, "goals", [measurement_goal(point.name, words)], path)


def remove_measurement_lines(
    lines: Sequence[str], name: str, path: str, words: Conventions
) -> list[str]:
    """The lines without a measurement and without the facts and goals about it.

    Raises `InvalidInput` if more depends on it.
    """
    names = find_list(lines, ("objects", words.measurement), path)
    if names is None or all(name not in _expand_range(entry.text) for entry in names.entries()):
        raise edit_refusal(path, f"'{name}' does not stand in a list under `{words.measurement}:`")
    edited = _replace_items(
        lines, names, [kept_item for item in names.items for kept_item in _without_name(item, name)]
    )
    for section in ("statics", "initial", "goals"):
        block = find_list(edited, (section,), path)
        if block is not None:
            _require_free(block, section, name, path, words)
            edited = _replace_items(
                edited,
                block,
                [kept_item for item in block.items for kept_item in _drop_atoms(item, name, path)],
            )
    _require_unused(edited, name, path)
    return edited


def replace_measurement_lines(
    lines: Sequence[str], point: MeasurementPoint, path: str, words: Conventions
) -> list[str]:
    """The lines with new facts about an existing measurement; its goal and all its other facts
    are kept.
    """
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
    edited = list(lines)
    if (block := find_list(lines, ("statics",), path)) is not None:
        kept = [kept_item for item in block.items for kept_item in _drop_atoms(item, "", path, own)]
        edited = _replace_items(lines, block, kept)
    return _with_items(edited, "statics", point_facts(point, words), path)


def _replace_items(
    lines: Sequence[str], block: YamlList, items: Sequence[ListedItem | str]
) -> list[str]:
    """The lines with other items in a list; they do not change if the items are the same."""
    if list(items) == list(block.items):
        return list(lines)
    return [*lines[: block.first], *block.written(items), *lines[block.stop :]]


def _with_items(lines: Sequence[str], section: str, texts: Sequence[str], path: str) -> list[str]:
    """The lines with items at the end of a list, which is made if there is none."""
    block = find_list(lines, (section,), path)
    items = [ListedItem(text) for text in texts]
    if block is None:
        return [*lines, f"{section}:", *(f"  - {added_text}" for added_text in texts)]
    if block.margin is None and not block.entries():  # `goals: []`
        block = YamlList(
            block.first, block.stop, f"{block.head.rstrip()}{block.tail}", (), margin="  "
        )
    return _replace_items(lines, block, [*block.items, *items])


def _with_name(lines: list[str], name: str, path: str, words: Conventions) -> list[str]:
    block = find_list(lines, ("objects", words.measurement), path)
    if block is not None:
        return _replace_items(lines, block, _append_name(block.items, name))
    at = next((n for n, line in enumerate(lines) if re.match(r"objects\s*:\s*(#.*)?$", line)), None)
    if at is not None:
        return [*lines[: at + 1], f"  {words.measurement}: [{name}]", *lines[at + 1 :]]
    if any(re.match(r"objects\s*:", line) for line in lines):
        raise edit_refusal(
            path,
            f"`objects:` has no list of {words.measurement}",
            f"add `{words.measurement}: []` to it",
        )
    head = next((n for n, line in enumerate(lines) if re.match(r"domain\s*:", line)), -1) + 1
    return [*lines[:head], "objects:", f"  {words.measurement}: [{name}]", *lines[head:]]


def _append_name(items: Sequence[ListedItem | str], name: str) -> list[ListedItem | str]:
    """The items with one more name; a range that ends just before it is made longer."""
    last = items[-1] if items else None
    name_range = RANGE_OF_NAMES.fullmatch(last.text) if isinstance(last, ListedItem) else None
    if (
        name_range
        and isinstance(last, ListedItem)
        and name == f"{name_range[1]}{_next_number(name_range[4], name_range[2])}"
    ):
        longer = f"{name_range[1]}{name_range[2]}..{name_range[3]}{_next_number(name_range[4], name_range[2])}"
        return [*items[:-1], ListedItem(longer, last.comment)]
    return [*items, ListedItem(name)]


def _next_number(number: str, first: str) -> str:
    width = len(first) if first.startswith("0") else 0
    return f"{int(number) + 1:0{width}d}"


def _expand_range(text: str) -> list[str]:
    """The names of an item: one, or those of a range."""
    name_range = RANGE_OF_NAMES.fullmatch(text)
    if name_range is None or name_range[3] not in ("", name_range[1]):
        return [text.strip("\"'")]
    width = len(name_range[2]) if name_range[2].startswith("0") else 0
    return [
        f"{name_range[1]}{number:0{width}d}"
        for number in range(int(name_range[2]), int(name_range[4]) + 1)
    ]


def _without_name(item: ListedItem | str, name: str) -> Iterator[ListedItem | str]:
    """An item without a name: nothing, the item itself, or the ranges before and behind the
    name.
    """
    names = _expand_range(item.text) if isinstance(item, ListedItem) else []
    if name not in names or isinstance(item, str):
        yield item
        return
    place = names.index(name)
    for number, part in enumerate((names[:place], names[place + 1 :])):
        if part:
            last = re.search(r"\d+$", part[-1])
            shown = part[0] if len(part) == 1 or last is None else f"{part[0]}..{last[0]}"
            yield ListedItem(shown, item.comment if number else "")


def _drop_atoms(
    item: ListedItem | str, name: str, path: str, about: re.Pattern[str] | None = None
) -> Iterator[ListedItem | str]:
    """An item without the atoms that mention a name (or that match `about`); nothing if none is
    left.
    """
    if isinstance(item, str):
        yield item
        return
    quote = item.text[:1] if item.text[:1] in ("'", '"') and item.text[-1:] == item.text[:1] else ""
    parts = split_items(item.text[len(quote) : len(item.text) - len(quote)])
    gone = [part for part in parts if (about.match(part) if about else _names_it(part, name))]
    if any("|" in part or " : " in part for part in gone):
        message = f"'{name}' stands in a condition with others: {gone[0].strip()}"
        raise edit_refusal(path, message, "change this condition first")
    kept = [part for part in parts if part not in gone]
    if not gone:
        yield item
    elif kept:
        yield ListedItem(f"{quote}{','.join(kept).strip()}{quote}", item.comment)


def _names_it(text: str, name: str) -> bool:
    return re.search(rf"(?<!\w){re.escape(name)}(?!\w)", re.sub(r'"[^"]*"', '""', text)) is not None


def _require_free(block: YamlList, section: str, name: str, path: str, words: Conventions) -> None:
    """Refuse to take away initial facts other than that the measurement is done."""
    if section != "initial":
        return
    parts = [
        part.strip(" \"'")
        for item in block.entries()
        for part in split_items(item.text.strip("\"'"))
    ]
    for part in parts:
        if _names_it(part, name) and not part.startswith(f"{words.measured}("):
            hint = "let it begin somewhere else first, or keep the measurement"
            raise edit_refusal(path, f"the initial fact {part} needs '{name}'", hint)


def _require_unused(lines: Sequence[str], name: str, path: str) -> None:
    """Refuse to remove a measurement that other parts of the file name."""
    for number, line in enumerate(lines, 1):
        if _names_it(line.partition("#")[0], name):
            raise edit_refusal(
                path, f"line {number} also names '{name}': {line.strip()}", "change this line first"
            )
