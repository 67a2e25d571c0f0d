"""The usual form of a file: indentation, spaces, blank lines. Comments and meaning stay.

Lines are never broken or joined, and nothing is quoted or sorted. What comes out is compared with what went in: the tree of
YAML, or the statements of ASP, must be the same. The form follows `docs/language.md`: two columns for each level, also
before the dash of a list; spaces in expressions as in ASP by hand.
"""

import re
from bisect import bisect_right
from collections.abc import Iterator
from itertools import zip_longest
from typing import NamedTuple

from cellwright.kb.asp import AspError
from cellwright.kb.asp.statements import printed
from cellwright.kb.diagnostics import Diagnostic, InvalidInput
from cellwright.kb.editing.index import ASP, kind_of
from cellwright.kb.editing.shapes import KINDS, TEXT, Role, Shape
from cellwright.kb.editing.spacing import same_but_for_spaces, spaced, spaced_rules
from cellwright.kb.files import File
from cellwright.kb.loader.node import Node
from cellwright.kb.loader.tree import outlined, read_tree

STEP = 2  # columns of a level
BRACED = re.compile(r"\$\{(\w+)\}")
FILLED_IN = re.compile(r"\$\{\w+\}|\$\w+")
STAND_IN = "filled_in_"
_EXPRESSIONS = (Role.ATOMS, Role.TERMS, Role.STEP, Role.SIGNATURE, Role.HEADER)


def formatted(path: str, text: str) -> str:
    """The text in its usual form. Raises `InvalidInput` if it is not YAML or ASP."""
    text = text.removeprefix("\ufeff").replace("\r\n", "\n")
    if kind_of(path, text) == ASP:
        return _rules(path, text)
    file = File.of(path, text)
    root, found = read_tree(File.of(path, _as_names(text)))
    if found:
        raise InvalidInput(found)
    shape = KINDS.get(kind_of(path, text), TEXT)
    made = _Layout(file, root, shape).written()
    return made if made == text or _same(root, made, shape) else text


def _as_names(text: str) -> str:
    """YAML in which `${name}` stands as a name of the same length: as it is, its brackets could be those of YAML."""
    return BRACED.sub(r"$_\1_", text)


def _rules(path: str, text: str) -> str:
    """The rules of a domain, or of a device: what is filled in there (`$name`) stands as a name meanwhile."""
    file, filled = File.of(path, text), dict[str, str]()

    def stand_in(found: re.Match[str]) -> str:
        return filled.setdefault(found[0], f"{STAND_IN}{len(filled)}_")

    plain = text if STAND_IN in text else FILLED_IN.sub(stand_in, text)
    made = _spaced_rules(file, plain)
    for said, name in filled.items():
        made = made.replace(name, said)
    return made


def _spaced_rules(file: File, text: str) -> str:
    try:
        before = printed(text)
    except AspError as error:
        hint = "mend it first: a broken text is not formatted"
        raise InvalidInput(
            [Diagnostic(file.line(line, column), "K201", said, hint) for line, column, said in error.messages]
        ) from None
    made = spaced_rules(text)
    return made if printed(made) == before else text


def _same(root: Node, made: str, shape: Shape) -> bool:
    """Whether a text holds the tree, except that expressions have other spaces."""
    try:
        return all(
            _alike(*each)
            for each in zip_longest(_scalars(root, shape), outlined(_as_names(made)), fillvalue=("", None))
        )
    except InvalidInput:
        return False


def _alike(one: tuple[str | None, Role | None], other: object) -> bool:
    value, role = one
    if value == other:
        return True
    both = isinstance(value, str) and isinstance(other, str)
    return both and role in _EXPRESSIONS and same_but_for_spaces(str(value), str(other))


def _scalars(node: Node, shape: Shape, key: Role | None = None) -> Iterator[tuple[str | None, Role | None]]:
    """The scalars of a tree with their roles, in order, and None where a mapping or list begins or ends."""
    if isinstance(node.value, str):
        yield node.value, key or shape.role
        return
    yield None, None
    if isinstance(node.value, list):
        for item in node.value:
            yield from _scalars(item, shape.items or TEXT)
    else:
        for name, (key_node, value) in node.value.items():
            yield key_node.value, shape.key
            yield from _scalars(value, shape.under(name))
    yield None, None


class _Edit(NamedTuple):
    start: int
    end: int
    text: str


class _Layout:
    """Collects changes of scalars and the indentation of lines, then writes the text anew."""

    def __init__(self, file: File, root: Node, shape: Shape) -> None:
        self.file, self.text = file, file.text
        self.indents: dict[int, int] = {}  # of lines that begin with a key or a dash
        self.edits: dict[int, list[_Edit]] = {}  # by line
        self.scalars: dict[int, list[tuple[int, int]]] = {}  # by each line on which they stand
        self.inside: dict[int, int] = {}  # lines inside a scalar or a bracket: the line in which it begins
        self.kept: set[int] = set()  # lines inside a scalar, whose ends of lines and blanks count
        self._block(root, shape, 0)

    def _block(self, node: Node, shape: Shape, indent: int) -> None:
        """Note the form of a node whose keys or dashes stand at `indent`, if they stand on lines of their own."""
        if isinstance(node.value, str):
            self._scalar(node, shape.role)
        elif self.text[node.start : node.start + 1] in ("{", "["):
            self._brackets(node, shape)
        elif isinstance(node.value, dict):
            for name, (key, value) in node.value.items():
                self._first(key.start, indent)
                self._scalar(key, shape.key or Role.TEXT)
                self._block(value, shape.under(name), indent + STEP)
        else:
            for item in node.value:
                dash = self._dash(item)
                self._first(dash, indent)
                if item.start > dash and self._line(dash) == self._line(item.start) and item.end > item.start:
                    self._edit(_Edit(dash + 1, item.start, " "))
                self._block(item, shape.items or TEXT, indent + STEP)

    def _dash(self, item: Node) -> int:
        """The place of the dash before an item."""
        if self.text[item.start : item.start + 1] == "-" and not item.value:
            return item.start
        return self.text.rfind("-", 0, item.start)

    def _first(self, place: int, indent: int) -> None:
        """Give a line its indentation, if it begins at this place."""
        line = self._line(place)
        if not self.text[self.file.line_starts[line] : place].strip():
            self.indents[line] = indent

    def _brackets(self, node: Node, shape: Shape) -> None:
        """Note the scalars in a mapping or list in brackets. Its lines keep their form."""
        self._goes_on(node.start, node.end)
        parts: Iterator[tuple[Node, Shape, Role | None]]
        if isinstance(node.value, dict):
            values = ((value, shape.under(name), None) for name, (_, value) in node.value.items())
            keys = ((key, TEXT, shape.key) for key, _ in node.value.values())
            parts = iter([*values, *keys])
        else:
            parts = ((item, shape.items or TEXT, None) for item in node.value)
        for each, inner, key in parts:
            if isinstance(each.value, str):
                self._scalar(each, key or inner.role)
            else:
                self._brackets(each, inner)

    def _scalar(self, node: Node, role: Role) -> None:
        raw, first = self.text[node.start : node.end], self._line(node.start)
        for line in range(first, (self._line(node.end - 1) if "\n" in raw else first) + 1):
            self.scalars.setdefault(line, []).append((node.start, node.end))
        if "\n" in raw.rstrip():
            last = self._line(max(node.start, node.start + len(raw.rstrip()) - 1))
            self.kept |= set(range(first + 1, last + 1))
            if raw[0] in "|>":
                self.kept.add(first)
            self._goes_on(node.start, node.end)
        elif role in _EXPRESSIONS and raw.strip():
            self._respace(node, raw)

    def _respace(self, node: Node, raw: str) -> None:
        """Give an expression its usual spaces, unless YAML would read it otherwise then."""
        quote = raw[0] if raw[0] in "'\"" else ""
        inner = raw[1:-1] if quote else raw
        if quote and (quote in inner or "\\" in inner):
            return
        made = spaced(inner)
        if made == inner:
            return
        if quote or (": " not in made and " #" not in made and not made.endswith(":")):
            self._edit(_Edit(node.start, node.end, f"{quote}{made}{quote}"))

    def _edit(self, edit: _Edit) -> None:
        self.edits.setdefault(self._line(edit.start), []).append(edit)

    def _goes_on(self, start: int, end: int) -> None:
        """The lines of a node after its first one."""
        first = self._line(start)
        for line in range(first + 1, self._line(max(start, end - 1)) + 1):
            self.inside.setdefault(line, first)

    def _line(self, place: int) -> int:
        """The number of the line of a place, from 0."""
        return bisect_right(self.file.line_starts, place) - 1

    def written(self) -> str:
        """The text anew."""
        lines = self.text.split("\n")
        indents = self._all_indents(lines)
        made: list[str] = []
        for number, line in enumerate(lines):
            if number in self.kept and number in self.inside and not line.strip():
                made.append(line)
            elif not line.strip():
                if made and made[-1].strip():
                    made.append("")
            else:
                made.append(self._with_comment(number, line, indents[number]))
        return "\n".join(made).rstrip("\n") + "\n" if any(map(str.strip, made)) else self.text

    def _all_indents(self, lines: list[str]) -> dict[int, int]:
        """The indentation of every line that is not blank."""
        old = {n: len(line) - len(line.lstrip(" ")) for n, line in enumerate(lines) if line.strip()}
        found = {n: self.indents[n] for n in old if n in self.indents}
        for n in old:
            if n in self.inside:
                first = self.inside[n]
                found[n] = max(old[n] + found.get(first, old.get(first, 0)) - old.get(first, 0), 0)
        known = sorted(found)
        for n in old:
            if n not in found:
                found[n] = self._of_comment(n, old, found, known)
        return found

    def _of_comment(self, line: int, old: dict[int, int], found: dict[int, int], known: list[int]) -> int:
        """A comment moves with the line below it, or with the one above if it stands as far in as that one."""
        below = next((n for n in known if n > line), None)
        above = next((n for n in reversed(known) if n < line), None)
        near = [n for n in (below, above) if n is not None]
        same = [n for n in near if old[n] == old[line]] or near
        return max(old[line] + found[same[0]] - old[same[0]], 0) if same else old[line]

    def _with_comment(self, number: int, line: str, indent: int) -> str:
        """A line with its changes. A comment behind it keeps its column if it can."""
        mark = self._comment(number, line)
        code = line if mark is None else line[:mark]
        if number in self.kept and number in self.inside and mark is None:
            changed = code.lstrip(" ") if code.strip() else code
        else:
            changed = self._edited(number, code).strip()
        made = " " * indent + changed
        if mark is None:
            return made
        said = line[mark:].rstrip()
        return f"{made}{' ' * max(mark - len(made), 2)}{said}" if changed else " " * indent + said

    def _comment(self, number: int, line: str) -> int | None:
        """The column of the comment of a line."""
        if "#" not in line:
            return None
        start, scalars = self.file.line_starts[number], self.scalars.get(number, [])
        for found in re.finditer(r"(?:^|(?<=[ \t]))#", line):
            place = start + found.start()
            if not any(first <= place < end for first, end in scalars):
                return found.start()
        return None

    def _edited(self, number: int, code: str) -> str:
        """The code of a line with the changes in it."""
        if number not in self.edits:
            return code
        start = self.file.line_starts[number]
        for each in sorted(self.edits[number], reverse=True):
            if each.end <= start + len(code):
                code = code[: each.start - start] + each.text + code[each.end - start :]
        return code
