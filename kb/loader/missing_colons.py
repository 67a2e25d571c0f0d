"""Finds where a colon was left out of a YAML text that cannot be parsed.

Parsers stop a line later, or many. The cause is where one more colon helps.
A place counts only if the text with the colon is read without the error, or if the first error
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
