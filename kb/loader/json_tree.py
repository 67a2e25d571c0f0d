"""The tree of a file that is JSON, with the same values and places as YAML gives it, in a quarter of the time.

Answers of the engine are such files, and hold hundreds of thousands of values. What is not plainly JSON is left to YAML,
which says what is wrong with it.
"""

import json
import re

from cellwright.kb.files import File
from cellwright.kb.loader.node import MAX_DEPTH, Node, too_many

LONGEST_KEY = 500  # characters; YAML takes about a thousand

_PART = re.compile(
    r'[ \n]*(?:("[^"\\]*(?:\\["\\/][^"\\]*)*")|(-?[0-9][-+.0-9eE]*|true|false|null)|([{[])|([]}]))(?:,(?=[ \n])|: )?'
)
QUOTED, OPENING, CLOSING = 1, 3, 4  # groups of the pattern; 1 and 2 are single values
_ESCAPED = re.compile(r"\\(.)")


def json_tree(file: File, most: int) -> Node | None:
    """The tree of a file; None if it is not plainly JSON. Raises `InvalidInput` for more than `most` values."""
    if not file.text.startswith("{") or not _is_json(file.text):
        return None
    return _tree(file, most)


def _is_json(text: str) -> bool:
    try:
        json.loads(text, object_pairs_hook=_forgotten)
    except (ValueError, RecursionError):
        return False
    return True


def _forgotten(_pairs: object) -> None:
    """Nothing: only the form of the text is asked for."""


def _tree(file: File, most: int) -> Node | None:
    """The tree of a text that is JSON; None if YAML could read a part of it in another way.

    `items` are those of the innermost collection that is open, `opened` the others around it and where each begins.
    """
    items: list[Node] = []
    opened: list[tuple[int, list[Node]]] = []
    left, end, whole = most, 0, len(file.text.rstrip(" \n"))
    make = (
        tuple.__new__
    )  # a node is made for each value: the constructor of a named tuple takes twice as long
    # Each part begins where the last one ends: a search from any other place would go through long blanks again and again.
    for found in iter(_PART.scanner(file.text, 0, whole).match, None):  # type: ignore[attr-defined]
        kind, end = found.lastindex or 0, found.end()
        first, last = found.span(kind)
        if kind == OPENING:
            opened.append((first, items))
            items = []
            continue
        if kind == CLOSING:
            if len(opened) > MAX_DEPTH or (closed := _closed(items, found[kind])) is None:
                return None
            first, items = opened.pop()
            items.append(make(Node, (closed, file, first, last)))
        else:
            written = found[kind]
            if kind == QUOTED:
                written = _ESCAPED.sub(r"\1", written[1:-1]) if "\\" in written else written[1:-1]
            items.append(make(Node, (written, file, first, last)))
        left -= 1
        if left < 0:
            raise too_many(file, first, most)
    return items[0] if end == whole else None


def _closed(items: list[Node], sign: str) -> list[Node] | dict[str, tuple[Node, Node]] | None:
    """The values of a list; of a mapping the keys with their nodes and values, or None if a key is long or comes twice."""
    if sign == "]":
        return items
    pairs = {key.value: (key, value) for key, value in zip(items[::2], items[1::2], strict=True)}
    if 2 * len(pairs) < len(items) or max(map(len, pairs), default=0) > LONGEST_KEY:
        return None
    return pairs
