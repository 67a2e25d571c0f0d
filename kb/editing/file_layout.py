"""The usual form of a file: indentation, spaces, blank lines. Meaning and comments stay.

Lines are never broken or joined, and nothing is quoted or sorted. What comes out is compared with
what went in: the tree of YAML, or the statements of ASP, must be the same. The form follows
`docs/language.md`: two columns for each level, also before the dash of a list; spaces in
expressions as in ASP by hand.
"""

import re
from bisect import bisect_right
from collections.abc import Iterator
from functools import lru_cache
from itertools import zip_longest
from typing import NamedTuple

from cellwright.kb.asp import AspError
from cellwright.kb.asp.statements import statement_texts
from cellwright.kb.diagnostics import Diagnostic, InvalidInput
from cellwright.kb.editing.expression_tokens import Token, tokens_of
from cellwright.kb.editing.name_index import ASP_KIND, editor_file_kind
from cellwright.kb.editing.scalar_roles import SHAPE_OF_KIND, TEXT_SHAPE, Role, ScalarShape
from cellwright.kb.files import File
from cellwright.kb.loader.yaml_tree import YamlNode, outline_yaml, read_tree

_SPACED_RELATIONS = {"=", "==", "!=", "<>", "<", "<=", ">", ">=", ":-", ":~", "|", "&"}
_TIGHT_BEFORE = {",", ";", ")", "]", "."}
_TIGHT_AFTER = {"(", "["}


@lru_cache(8192)
def space_expression(text: str) -> str:
    """An expression of one line with its usual spaces: `at(Item,Place)` becomes `at(Item,
    Place)`.
    """
    line_tokens = tokens_of(text.strip())
    parts: list[str] = []
    for number, token in enumerate(line_tokens):
        if number:
            before = line_tokens[number - 1]
            gap = text.strip()[before.end : token.start]
            parts.append(_gap_between(before, token, gap))
        parts.append(token.text)
    return "".join(parts)


def spaced_rules(text: str) -> str:
    """ASP with its usual spaces. Lines, indentation, comments and columns aligned with several
    spaces stay; the first line has no indentation."""
    text_tokens = tokens_of(text, True)
    parts: list[str] = []
    end = 0
    for number, token in enumerate(text_tokens):
        gap = text[end : token.start]
        if "\n" in gap or not number:
            parts.append(_line_ends(gap) if number else "")
        elif (
            token.kind == "comment"
            or text_tokens[number - 1].text in (".", "]")
            or (len(gap) > 1 and _may_align(token))
        ):
            parts.append(gap.expandtabs(4) if gap or token.kind != "comment" else " ")
        else:
            parts.append(_gap_between(text_tokens[number - 1], token, gap))
        parts.append(token.text.rstrip() if token.kind == "comment" else token.text)
        end = token.end
    return "".join(parts).rstrip() + "\n" if text_tokens else ""


def _may_align(token: Token) -> bool:
    return token.text not in _TIGHT_BEFORE


def _line_ends(gap: str) -> str:
    """The ends of lines between two tokens: at most one blank line, and the indentation of the
    next line.
    """
    indent = gap.rpartition("\n")[2].expandtabs(4)
    return "\n" * min(gap.count("\n"), 2) + indent


def _gap_between(before: Token, token: Token, gap: str) -> str:
    """What stands between two tokens of a line."""
    if token.text in _TIGHT_BEFORE or before.text in _TIGHT_AFTER:
        return ""
    if (
        before.text in (",", ";")
        or before.text in _SPACED_RELATIONS
        or token.text in _SPACED_RELATIONS
    ):
        return " "
    if token.text == ":" or before.text == ":":
        return " "
    if token.text == "(" and before.kind == "name" and before.text != "not":
        return ""
    return " " if gap else ""


def same_but_for_spaces(one: str, other: str) -> bool:
    """Whether two expressions have the same tokens."""
    return one == other or _token_texts(one) == _token_texts(other)


def _token_texts(text: str) -> list[str]:
    return [token.text for token in tokens_of(text)]


INDENT_COLUMNS = 2  # columns of a level
BRACED_NAME = re.compile(r"\$\{(\w+)\}")
FILLED_IN = re.compile(r"\$\{\w+\}|\$\w+")
FILLED_NAME_PREFIX = "filled_in_"
_EXPRESSION_ROLES = (Role.ATOMS, Role.TERMS, Role.STEP, Role.SIGNATURE, Role.HEADER)


def format_file(path: str, text: str) -> str:
    """The text in its usual form. Raises `InvalidInput` if it is not YAML or ASP."""
    text = text.removeprefix("\ufeff").replace("\r\n", "\n")
    if editor_file_kind(path, text) == ASP_KIND:
        return _format_rules(path, text)
    file = File.of(path, text)
    root, tree_file = read_tree(File.of(path, _as_names(text)))
    if tree_file:
        raise InvalidInput(tree_file)
    shape = SHAPE_OF_KIND.get(editor_file_kind(path, text), TEXT_SHAPE)
    new_text = _FileLayout(file, root, shape).written()
    return new_text if new_text == text or _same_meaning(root, new_text, shape) else text


def _as_names(text: str) -> str:
    """YAML in which `${name}` stands as a name of the same length: as it is, its brackets could
    be those of YAML.
    """
    return BRACED_NAME.sub(r"$_\1_", text)


def _format_rules(path: str, text: str) -> str:
    """The rules of a domain, or of a device: what is filled in there (`$name`) stands as a name
    meanwhile.
    """
    file, filled = File.of(path, text), dict[str, str]()

    def stand_in(match: re.Match[str]) -> str:
        return filled.setdefault(match[0], f"{FILLED_NAME_PREFIX}{len(filled)}_")

    plain = text if FILLED_NAME_PREFIX in text else FILLED_IN.sub(stand_in, text)
    made = _spaced_rules(file, plain)
    for said, name in filled.items():
        made = made.replace(name, said)
    return made


def _spaced_rules(file: File, text: str) -> str:
    try:
        before = statement_texts(text)
    except AspError as error:
        hint = "mend it first: a broken text is not formatted"
        raise InvalidInput(
            [
                Diagnostic(file.line(line, column), "K201", said, hint)
                for line, column, said in error.messages
            ]
        ) from None
    made = spaced_rules(text)
    return made if statement_texts(made) == before else text


def _same_meaning(root: YamlNode, made: str, shape: ScalarShape) -> bool:
    """Whether a text holds the tree, except that expressions have other spaces."""
    try:
        return all(
            _alike_scalars(*scalars)
            for scalars in zip_longest(
                _role_scalars(root, shape), outline_yaml(_as_names(made)), fillvalue=("", None)
            )
        )
    except InvalidInput:
        return False


def _alike_scalars(one: tuple[str | None, Role | None], other: object) -> bool:
    value, role = one
    if value == other:
        return True
    both = isinstance(value, str) and isinstance(other, str)
    return both and role in _EXPRESSION_ROLES and same_but_for_spaces(str(value), str(other))


def _role_scalars(
    node: YamlNode, shape: ScalarShape, key: Role | None = None
) -> Iterator[tuple[str | None, Role | None]]:
    """The scalars of a tree with their roles, in order, and None where a mapping or list begins
    or ends.
    """
    if isinstance(node.value, str):
        yield node.value, key or shape.role
        return
    yield None, None
    if isinstance(node.value, list):
        for item in node.value:
            yield from _role_scalars(item, shape.items or TEXT_SHAPE)
    else:
        for name, (key_node, value) in node.value.items():
            yield key_node.value, shape.key
            yield from _role_scalars(value, shape.under(name))
    yield None, None


class _ScalarEdit(NamedTuple):
    start: int
    end: int
    text: str


class _FileLayout:
    """Collects changes of scalars and the indentation of lines, then writes the text anew."""

    def __init__(self, file: File, root: YamlNode, shape: ScalarShape) -> None:
        self.file, self.text = file, file.text
        self.indents: dict[int, int] = {}  # of lines that begin with a key or a dash
        self.edits: dict[int, list[_ScalarEdit]] = {}  # by line
        self.scalars: dict[int, list[tuple[int, int]]] = {}  # by each line on which they stand
        # lines inside a scalar or a bracket: the line in which it begins
        self.inside: dict[int, int] = {}
        self.kept: set[int] = set()  # lines inside a scalar, whose ends of lines and blanks count
        self._block(root, shape, 0)

    def _block(self, node: YamlNode, shape: ScalarShape, indent: int) -> None:
        """Note the form of a node whose keys or dashes stand at `indent`, if they stand on
        lines of their own.
        """
        if isinstance(node.value, str):
            self._scalar(node, shape.role)
        elif self.text[node.start : node.start + 1] in ("{", "["):
            self._brackets(node, shape)
        elif isinstance(node.value, dict):
            for name, (key, value) in node.value.items():
                self._first(key.start, indent)
                self._scalar(key, shape.key or Role.TEXT)
                self._block(value, shape.under(name), indent + INDENT_COLUMNS)
        else:
            for item in node.value:
                dash = self._dash(item)
                self._first(dash, indent)
                if (
                    item.start > dash
                    and self._line(dash) == self._line(item.start)
                    and item.end > item.start
                ):
                    self._edit(_ScalarEdit(dash + 1, item.start, " "))
                self._block(item, shape.items or TEXT_SHAPE, indent + INDENT_COLUMNS)

    def _dash(self, item: YamlNode) -> int:
        """The place of the dash before an item."""
        if self.text[item.start : item.start + 1] == "-" and not item.value:
            return item.start
        return self.text.rfind("-", 0, item.start)

    def _first(self, place: int, indent: int) -> None:
        """Give a line its indentation, if it begins at this place."""
        line = self._line(place)
        if not self.text[self.file.line_starts[line] : place].strip():
            self.indents[line] = indent

    def _brackets(self, node: YamlNode, shape: ScalarShape) -> None:
        """Note the scalars in a mapping or list in brackets. Its lines keep their form."""
        self._goes_on(node.start, node.end)
        parts: Iterator[tuple[YamlNode, ScalarShape, Role | None]]
        if isinstance(node.value, dict):
            values = ((value, shape.under(name), None) for name, (_, value) in node.value.items())
            keys = ((key, TEXT_SHAPE, shape.key) for key, _ in node.value.values())
            parts = iter([*values, *keys])
        else:
            parts = ((item, shape.items or TEXT_SHAPE, None) for item in node.value)
        for child, inner, key in parts:
            if isinstance(child.value, str):
                self._scalar(child, key or inner.role)
            else:
                self._brackets(child, inner)

    def _scalar(self, node: YamlNode, role: Role) -> None:
        raw, first = self.text[node.start : node.end], self._line(node.start)
        for line in range(first, (self._line(node.end - 1) if "\n" in raw else first) + 1):
            self.scalars.setdefault(line, []).append((node.start, node.end))
        if "\n" in raw.rstrip():
            last = self._line(max(node.start, node.start + len(raw.rstrip()) - 1))
            self.kept |= set(range(first + 1, last + 1))
            if raw[0] in "|>":
                self.kept.add(first)
            self._goes_on(node.start, node.end)
        elif role in _EXPRESSION_ROLES and raw.strip():
            self._respace(node, raw)

    def _respace(self, node: YamlNode, raw: str) -> None:
        """Give an expression its usual spaces, unless YAML would read it otherwise then."""
        quote = raw[0] if raw[0] in "'\"" else ""
        inner = raw[1:-1] if quote else raw
        if quote and (quote in inner or "\\" in inner):
            return
        made = space_expression(inner)
        if made == inner:
            return
        if quote or (": " not in made and " #" not in made and not made.endswith(":")):
            self._edit(_ScalarEdit(node.start, node.end, f"{quote}{made}{quote}"))

    def _edit(self, edit: _ScalarEdit) -> None:
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
        indents = {n: self.indents[n] for n in old if n in self.indents}
        for n in old:
            if n in self.inside:
                first = self.inside[n]
                indents[n] = max(
                    old[n] + indents.get(first, old.get(first, 0)) - old.get(first, 0), 0
                )
        known_lines = sorted(indents)
        for n in old:
            if n not in indents:
                indents[n] = self._of_comment(n, old, indents, known_lines)
        return indents

    def _of_comment(
        self, line: int, old: dict[int, int], indents: dict[int, int], known: list[int]
    ) -> int:
        """A comment moves with the line below it, or with the one above if it stands as far in
        as that one.
        """
        below = next((n for n in known if n > line), None)
        above = next((n for n in reversed(known) if n < line), None)
        near = [n for n in (below, above) if n is not None]
        same = [n for n in near if old[n] == old[line]] or near
        return max(old[line] + indents[same[0]] - old[same[0]], 0) if same else old[line]

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
        for mark_match in re.finditer(r"(?:^|(?<=[ \t]))#", line):
            place = start + mark_match.start()
            if not any(first <= place < end for first, end in scalars):
                return mark_match.start()
        return None

    def _edited(self, number: int, code: str) -> str:
        """The code of a line with the changes in it."""
        if number not in self.edits:
            return code
        start = self.file.line_starts[number]
        for scalar_edit in sorted(self.edits[number], reverse=True):
            if scalar_edit.end <= start + len(code):
                code = (
                    code[: scalar_edit.start - start]
                    + scalar_edit.text
                    + code[scalar_edit.end - start :]
                )
        return code
