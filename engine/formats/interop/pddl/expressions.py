"""PDDL text as nested lists of words, each with its place in the file."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from cellwright.engine.formats.interop.pddl.task_files import require_file
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import File, read_file

_PDDL_TOKEN = re.compile(r";[^\n]*|[()]|[^\s();]+")
MAX_PDDL_DEPTH = 200


@dataclass(frozen=True, slots=True)
class PddlWord:
    """A name, variable or number in small letters; PDDL does not distinguish case."""

    text: str
    offset: int


@dataclass(frozen=True, slots=True)
class Group:
    """The expressions between a pair of parentheses."""

    parts: tuple["PddlWord | Group", ...]
    offset: int

    @property
    def head(self) -> str:
        """The first word, or an empty text."""
        first = self.parts[0] if self.parts else None
        return first.text if isinstance(first, PddlWord) else ""

    @property
    def rest(self) -> tuple["PddlWord | Group", ...]:
        """All parts except the first."""
        return self.parts[1:]

    def field(self, key: str) -> "PddlWord | Group | None":
        """The expression after a keyword such as `:effect`."""
        for part, following in pairwise(self.parts):
            if isinstance(part, PddlWord) and part.text == key:
                return following
        return None


Expression = PddlWord | Group


@dataclass
class Document:
    """One file: its only expression, and the findings about it."""

    file: File
    root: Group
    found: list[Diagnostic]

    def add(self, at: Expression, code: str, message: str, hint: str = "") -> None:
        """Note a finding at an expression."""
        self.found.append(Diagnostic(self.where(at), code, message, hint))

    def where(self, at: Expression) -> Source:
        """The place of an expression."""
        return self.file.at(at.offset)


def read_document(path: Path, kind: str) -> Document:
    """The expression in a PDDL file, which is a domain or a problem.

    Raises `InvalidInput` when parentheses do not match, or for a file of another kind.
    """
    file = read_file(path)
    require_file(file, kind)
    return Document(file, _only_group(file), [])


def _only_group(file: File) -> Group:
    roots = list(_outer_groups(file))
    if len(roots) != 1:
        what = "no expression" if not roots else "more than one expression"
        hint = "a PDDL file is one (define ...)"
        raise InvalidInput([Diagnostic(Source(file.path), "K801", f"{what} in this file", hint)])
    return roots[0]


def _outer_groups(file: File) -> Iterator[Group]:
    """The outermost groups.

    An explicit stack limits the depth, instead of Python's recursion limit.
    """
    stack: list[tuple[int, list[Expression]]] = []
    for token, offset in _tokens_of(file.text):
        if token == "(" and len(stack) >= MAX_PDDL_DEPTH:
            raise InvalidInput(
                [Diagnostic(file.at(offset), "K007", f"nested deeper than {MAX_PDDL_DEPTH} levels")]
            )
        if token == "(":
            stack.append((offset, []))
        elif not stack:
            raise InvalidInput(
                [Diagnostic(file.at(offset), "K106", f"'{token}' is outside all parentheses")]
            )
        elif token != ")":
            stack[-1][1].append(PddlWord(token.lower(), offset))
        else:
            start, parts = stack.pop()
            group = Group(tuple(parts), start)
            if stack:
                stack[-1][1].append(group)
            else:
                yield group
    if stack:
        raise InvalidInput(
            [Diagnostic(file.at(stack[-1][0]), "K106", "this parenthesis is never closed")]
        )


def _tokens_of(text: str) -> Iterator[tuple[str, int]]:
    for token in _PDDL_TOKEN.finditer(text):
        if not token[0].startswith(";"):
            yield token[0], token.start()


_TEXT_LINE = re.compile(r"[^\n]+")
_AROUND_ACTION = re.compile(r"^\s*(?:\d+(?:\.\d+)?\s*:)?\s*|\s*(?:\[[\d.\s]*\])?\s*(?:;.*)?$")


def plan_actions(text: str) -> Iterator[tuple[list[str], int]]:
    """The actions of a plan file, one per line: their words in small letters, and their place.

    Parentheses, a time before the action (`3: (...)`), a duration after it (`[1]`) and comments are
    skipped.
    """
    for line in _TEXT_LINE.finditer(text):
        small = line[0].lower()
        said = _AROUND_ACTION.sub("", small)
        if words := said.removeprefix("(").removesuffix(")").split():
            yield words, line.start() + small.index(words[0], small.index(said))
