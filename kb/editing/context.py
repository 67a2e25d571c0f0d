"""What is written at a place of a text, told from the lines above it alone: so it is known while a line is unfinished."""

import re
from typing import NamedTuple

from cellwright.kb.editing.shapes import KINDS, Shape

_LINE = re.compile(r"([ ]*)((?:-(?:[ ]+|$))*)(.*)", re.DOTALL)
_KEY = re.compile(r"""("[^"\n]*"|'[^'\n]*'|[^\s"'#{\[&*!|>%@`-][^#\n]*?):(?:[ \t]+|$)(.*)""", re.DOTALL)
MAX_LINES = 5000  # above the place


class Context(NamedTuple):
    """The path to a place of a YAML text (0 for each list), and what of its scalar stands before the place.

    `key` says that it may be the beginning of a key. `begin` is where the scalar begins.
    """

    path: tuple[str | int, ...]
    written: str
    begin: int
    key: bool

    def shape(self, kind: str) -> Shape:
        """What the value there may be."""
        shape = KINDS[kind]
        for part in self.path:
            shape = shape.under(part)
        return shape


class _Line(NamedTuple):
    """A line: the columns of its dashes, the column, name and value of its key."""

    dashes: tuple[int, ...]
    column: int
    key: str | None
    value: str


def _line(text: str) -> _Line:
    found = _LINE.match(text)
    assert found is not None
    spaces, dashes, rest = found.groups()
    columns = tuple(len(spaces) + each.start() for each in re.finditer("-", dashes))
    column = len(spaces) + len(dashes)
    keyed = _KEY.match(rest)
    if keyed is None or keyed[1].endswith(" "):
        return _Line(columns, column, None, rest)
    return _Line(columns, column, keyed[1].strip("\"'"), keyed[2])


def context(text: str, offset: int) -> Context:
    """What is written at a place of a YAML text."""
    start = text.rfind("\n", 0, offset) + 1
    line = _line(text[start:offset])
    above = text[:start].split("\n")[:-1][-MAX_LINES:]
    path = _parents(above, line.column if not line.dashes else line.dashes[0], bool(line.dashes))
    path += (0,) * len(line.dashes)
    if line.key is not None:
        return _inside((*path, line.key), line.value, offset)
    if not line.dashes and (held := _continued(above, line.column)) is not None:
        return Context((*path, *held), line.value, offset - len(line.value), False)
    found = _inside(path, line.value, offset)
    return found._replace(key=found.path == path)


def _parents(above: list[str], column: int, dash: bool) -> tuple[str | int, ...]:
    """The keys and lists around a place, from the lines above it; a dash may stand below its key."""
    path: list[str | int] = []
    for text in reversed(above):
        if not text.strip() or text.lstrip().startswith("#"):
            continue
        line = _line(text)
        if line.key is not None and (
            line.column < column or (dash and line.column == column and not line.dashes)
        ):
            path.insert(0, line.key)
            column, dash = line.column, False
        for each in reversed(line.dashes):
            if each < column:
                path.insert(0, 0)
                column, dash = each, True
        if column == 0 and not dash:
            break
    return tuple(path)


def _continued(above: list[str], column: int) -> tuple[str | int, ...] | None:
    """What a line goes on with, if the line above it that is indented less has begun a scalar; empty path: that of its key."""
    for text in reversed(above):
        if not text.strip() or text.lstrip().startswith("#"):
            continue
        line = _line(text)
        if line.column >= column and not (line.dashes and line.key is None and line.dashes[-1] < column):
            continue
        value = line.value.split(" #")[0].strip()
        return () if value and value[0] not in "{[#" else None
    return None


def _inside(path: tuple[str | int, ...], value: str, offset: int) -> Context:
    """The place inside a value of one line, which may be a mapping or a list in brackets."""
    begin = offset - len(value)
    if not value or value[0] not in "{[":
        quoted = 1 if value[:1] in ("'", '"') else 0
        return Context(path, value[quoted:], begin + quoted, False)
    scan = _Brackets(value)
    written = value[scan.scalar :]
    begin += scan.scalar + len(written) - len(written.lstrip())
    inner = scan.open[:-1] if scan.keyed else scan.open
    return Context((*path, *inner), written.lstrip(), begin, scan.keyed)


class _Brackets:
    """Reads a mapping or list in brackets up to where it breaks off: the keys and lists that are open, where the scalar begins."""

    def __init__(self, value: str) -> None:
        self.value = value
        self.open: list[str | int] = []
        self.scalar, self.keyed, self.quote = 0, False, ""
        for at, each in enumerate(value):
            if self.quote:
                self.quote = "" if each == self.quote else self.quote
            elif each in "'\"" and not value[self.scalar : at].strip():
                self.quote, self.scalar = each, at + 1
            else:
                self._step(at, each)

    def _step(self, at: int, each: str) -> None:
        in_mapping = bool(self.open) and isinstance(self.open[-1], str)
        if each in "{[":
            self.open.append("" if each == "{" else 0)
            self.scalar, self.keyed = at + 1, each == "{"
        elif each in "}]" and self.open:
            self.open.pop()
            self.scalar, self.keyed = at + 1, False
        elif each == ",":
            self.scalar, self.keyed = at + 1, in_mapping
        elif each == ":" and in_mapping and self.value[at + 1 : at + 2] in ("", " "):
            self.open[-1] = self.value[self.scalar : at].strip().strip("\"'")
            self.scalar, self.keyed = at + 1, False
