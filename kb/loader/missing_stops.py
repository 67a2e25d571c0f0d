"""Finds where a full stop was left out of an ASP text that cannot be parsed.

Parsers stop at a later place. The cause is where one more full stop helps.
"""

import re

from cellwright.kb.asp import AspError
from cellwright.kb.asp.statements import statement_texts
from cellwright.kb.files import File
from cellwright.kb.loader.missing_colons import MAX_TEXT


def lacking_stop(file: File, line: int, column: int) -> int | None:
    """The offset at which one more full stop mends the error of an ASP text at a line and a
    column; None if there is none.
    """
    if len(file.text) > MAX_TEXT or not 1 <= line <= len(file.line_starts):
        return None
    before = _blank(file.text)[: file.line_starts[line - 1] + column - 1].rstrip()
    if not before or before.endswith((".", ",", ";", ":-", "(", "{", ":")):
        return None
    offset = len(before)
    found = _asp_error(f"{file.text[:offset]}.{file.text[offset:]}")
    return offset if found > (line, column + 1) else None


def _blank(text: str) -> str:
    """An ASP text whose comments are spaces."""

    def spaces(comment: re.Match[str]) -> str:
        return comment[0] if comment[0][0] == '"' else re.sub(r"[^\n]", " ", comment[0])

    return re.sub(r'"(?:\\.|[^"\\\n])*"|%\*.*?\*%|%[^\n]*', spaces, text, flags=re.DOTALL)


def _asp_error(text: str) -> tuple[float, float]:
    """The line and column of the first error in an ASP text; endless if there is none."""
    try:
        statement_texts(text)
    except AspError as error:
        return min(((line, column) for line, column, _ in error.messages), default=(0, 0))
    return float("inf"), 0.0
