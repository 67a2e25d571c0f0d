"""What stands at a place of a YAML text, told from the lines above it alone."""

import re
from typing import NamedTuple

from cellwright.kb.editing.scalar_roles import SHAPE_OF_KIND, ScalarShape

_YAML_LINE = re.compile(r"([ ]*)((?:-(?:[ ]+|$))*)(.*)", re.DOTALL)
_YAML_KEY = re.compile(
    r"""("[^"\n]*"|'[^'\n]*'|[^\s"'#{\[&*!|>%@`-][^#\n]*?):(?:[ \t]+|$)(.*)""", re.DOTALL
)
MAX_LINES_ABOVE = 5000  # above the place


class Context(NamedTuple):
    """The path to a place of a YAML text (0 for each list), and what of its scalar stands before
    the place.

    `key` says that it may be the beginning of a key. `begin` is where the scalar begins.
    """

    path: tuple[str | int, ...]
    written: str
    begin: int
    key: bool

    def shape(self, kind: str) -> ScalarShape:
        """What the value there may be."""
        shape = SHAPE_OF_KIND[kind]
        for part in self.path:
            shape = shape.under(part)
        return shape


class _Line(NamedTuple):
    """A line: the columns of its dashes, the column, name and value of its key."""

    dashes: tuple[int, ...]
    column: int
    key: str | None
    value: str


def _split_line(text: str) -> _Line:
    parts = _YAML_LINE.match(text)
    assert parts is not None
    spaces, dashes, rest = parts.groups()
    columns = tuple(len(spaces) + dash_match.start() for dash_match in re.finditer("-", dashes))
    column = len(spaces) + len(dashes)
    keyed = _YAML_KEY.match(rest)
    if keyed is None or keyed[1].endswith(" "):
        return _Line(columns, column, None, rest)
    return _Line(columns, column, keyed[1].strip("\"'"), keyed[2])


def context_at(text: str, offset: int) -> Context:
    """What is written at a place of a YAML text."""
    start = text.rfind("\n", 0, offset) + 1
    line = _split_line(text[start:offset])
    above = text[:start].split("\n")[:-1][-MAX_LINES_ABOVE:]
    path = _parent_path(
        above, line.column if not line.dashes else line.dashes[0], bool(line.dashes)
    )
    path += (0,) * len(line.dashes)
    if line.key is not None:
        return _context_inside((*path, line.key), line.value, offset)
    if not line.dashes and (held := _scalar_begun_above(above, line.column)) is not None:
        return Context((*path, *held), line.value, offset - len(line.value), False)
    place_context = _context_inside(path, line.value, offset)
    return place_context._replace(key=place_context.path == path)


def _parent_path(above: list[str], column: int, dash: bool) -> tuple[str | int, ...]:
    """The keys and lists around a place, from the lines above it; a dash may stand below its
    key.
    """
    path: list[str | int] = []
    for text in reversed(above):
        if not text.strip() or text.lstrip().startswith("#"):
            continue
        line = _split_line(text)
        if line.key is not None and (
            line.column < column or (dash and line.column == column and not line.dashes)
        ):
            path.insert(0, line.key)
            column, dash = line.column, False
        for dash_column in reversed(line.dashes):
            if dash_column < column:
                path.insert(0, 0)
                column, dash = dash_column, True
        if column == 0 and not dash:
            break
    return tuple(path)


def _scalar_begun_above(above: list[str], column: int) -> tuple[str | int, ...] | None:
    """What a line goes on with, if the line above it that is indented less has begun a scalar;
    empty path: that of its key.
    """
    for text in reversed(above):
        if not text.strip() or text.lstrip().startswith("#"):
            continue
        line = _split_line(text)
        if line.column >= column and not (
            line.dashes and line.key is None and line.dashes[-1] < column
        ):
            continue
        value = line.value.split(" #")[0].strip()
        return () if value and value[0] not in "{[#" else None
    return None


def _context_inside(path: tuple[str | int, ...], value: str, offset: int) -> Context:
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
    """Reads a mapping or list in brackets up to where it breaks off: the keys and lists that
    are open, where the scalar begins.
    """

    def __init__(self, value: str) -> None:
        self.value = value
        self.open: list[str | int] = []
        self.scalar, self.keyed, self.quote = 0, False, ""
        for at, character in enumerate(value):
            if self.quote:
                self.quote = "" if character == self.quote else self.quote
            elif character in "'\"" and not value[self.scalar : at].strip():
                self.quote, self.scalar = character, at + 1
            else:
                self._step(at, character)

    def _step(self, at: int, character: str) -> None:
        in_mapping = bool(self.open) and isinstance(self.open[-1], str)
        if character in "{[":
            self.open.append("" if character == "{" else 0)
            self.scalar, self.keyed = at + 1, character == "{"
        elif character in "}]" and self.open:
            self.open.pop()
            self.scalar, self.keyed = at + 1, False
        elif character == ",":
            self.scalar, self.keyed = at + 1, in_mapping
        elif character == ":" and in_mapping and self.value[at + 1 : at + 2] in ("", " "):
            self.open[-1] = self.value[self.scalar : at].strip().strip("\"'")
            self.scalar, self.keyed = at + 1, False
