"""The outline of a file: its sections and what stands in them."""

from collections.abc import Iterator
from typing import NamedTuple

from cellwright.kb.editing.index import ASP, FileIndex
from cellwright.kb.loader.node import Node
from cellwright.kb.loader.tolerant import Piece, pieces, tree_of


class Entry(NamedTuple):
    """A part of a file: its name, what it is, where it begins and ends, where its name does, and its parts."""

    name: str
    kind: str
    start: int
    end: int
    name_start: int
    name_end: int
    parts: tuple["Entry", ...] = ()


def outline(file: FileIndex) -> list[Entry]:
    """The entries of a file, in its order."""
    if file.kind == ASP:
        return list(_rules(file))
    entries: list[Entry] = []
    for piece in pieces(file.text):
        root = tree_of(piece.text)
        if root is None or isinstance(root.value, str):
            continue
        if piece.section and entries:
            parts = tuple(_entries(piece, root, piece.section))
            last = entries[-1]
            end = max(last.end, parts[-1].end) if parts else last.end
            entries[-1] = last._replace(end=end, parts=(*last.parts, *parts))
        elif not piece.section:
            entries += _entries(piece, root, "section", True)
    return entries


def _entries(piece: Piece, root: Node, kind: str, deep: bool = False) -> Iterator[Entry]:
    """The entries of a mapping, or of a list, by their first lines."""
    if isinstance(root.value, dict):
        for name, (key, value) in root.value.items():
            end = max(_end(piece.text, value), key.end)
            inner = piece._replace(text=piece.text)
            parts = tuple(_entries(inner, value, name)) if deep and isinstance(value.value, dict) else ()
            shown = (
                f"{name}: {value.value}" if deep and isinstance(value.value, str) and value.value else name
            )
            yield Entry(shown, kind, piece.start + key.start, piece.start + end,
                        piece.start + key.start, piece.start + key.end, parts)  # fmt: skip
    elif isinstance(root.value, list):
        for item in root.value:
            start = piece.start + item.start
            end = piece.start + max(_end(piece.text, item), item.start + 1)
            name = _title(item)
            yield Entry(name, kind, start, end, start, min(end, start + 1))


def _title(item: Node) -> str:
    """The name of an item of a list: its text, or its first entry."""
    if isinstance(item.value, str):
        return item.value or "..."
    if isinstance(item.value, dict) and item.value:
        key, (_, value) = next(iter(item.value.items()))
        return f"{key} {value.value}" if isinstance(value.value, str) else key
    return "..."


def _end(text: str, node: Node) -> int:
    """Where a node ends, without the blank lines and comments after it."""
    end = node.end
    while end > node.start:
        start = max(text.rfind("\n", node.start, end) + 1, node.start)
        line = text[start:end].strip()
        if line and not (line.startswith("#") and (not start or text[start - 1] == "\n")):
            return end - len(text[start:end]) + len(text[start:end].rstrip())
        end = start - 1
    return node.start


def _rules(file: FileIndex) -> Iterator[Entry]:
    """For each predicate that the rules of a file define, its rules."""
    found: dict[str, list[Entry]] = {}
    for _, each in file.occurrences():
        if each.doing in ("defined", "declared") and not each.head:
            line = file.text[each.start :].partition("\n")[0].strip()
            end = each.start + len(line)
            part = Entry(line[:60], "rule", each.start, max(end, each.end), each.start, each.end)
            found.setdefault(each.name, []).append(part)
    for name, rules in found.items():
        first = rules[0]
        yield Entry(name, "predicate", first.start, max(each.end for each in rules), first.start, first.name_end,
                    tuple(rules) if len(rules) > 1 else ())  # fmt: skip
