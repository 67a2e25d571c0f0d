"""Where a colon or a full stop was left out. Parsers stop a line later, or many; the cause is where
one more character helps.

A place counts only if the text with the character is read without the error, or if the first error
then comes later.
"""

import re
from collections.abc import Iterator

import yaml

from cellwright.kb.files import File

MAX_LINES = 40  # above the place of an error
MAX_TEXT = 2**18  # characters; longer texts are not read again and again
KEY = re.compile(r"\s*(?:- +)*(?:[\w$]+(?:\([^()\n]*\))?|'[^'\n]*'|\"[^\"\n]*\")")
COMMENT = re.compile(r"(?:^|\s)#.*$")


def lacking_colon(file: File, stopped: int) -> int | None:
    """The offset at which one more colon mends the YAML error at the offset `stopped`; None if
    no line above lacks one.
    """
    if len(file.text) > MAX_TEXT:
        return None
    for offset in _colon_places(file.text, stopped):
        rest = "" if file.text[offset : offset + 1] in ("", "\n", " ") else " "
        if _yaml_error(f"{file.text[:offset]}:{rest}{file.text[offset:]}") > stopped + 1 + len(
            rest
        ):
            return offset
    return None


def _colon_places(text: str, stopped: int) -> Iterator[int]:
    """Where keys without a colon end: at and above the place, the nearest line first."""
    end = text.find("\n", stopped)
    lines = text[: len(text) if end < 0 else end].split("\n")
    start = sum(len(line) + 1 for line in lines)
    for line in reversed(lines[-MAX_LINES:]):
        start -= len(line) + 1
        bare = COMMENT.sub("", line).rstrip()
        key = KEY.match(bare)
        if key is None or re.match(r"\s*:(?:\s|$)", bare[key.end() :]):
            continue
        yield start + key.end()


def _yaml_error(text: str) -> float:
    """The offset of the first error in a YAML text; endless if there is none."""
    try:
        for _ in yaml.parse(text, Loader=yaml.CSafeLoader):
            pass
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        return float(mark.index) if mark else 0.0
    return float("inf")


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
    # both load clingo, which most files never need
    from cellwright.kb.asp import AspError
    from cellwright.kb.asp.statements import statement_texts

    try:
        statement_texts(text)
    except AspError as error:
        return min(((line, column) for line, column, _ in error.messages), default=(0, 0))
    return float("inf"), 0.0
