"""Tokens of expressions and of ASP, also of broken ones, and what each name there is."""

import re
from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple


class Token(NamedTuple):
    """A token; `kind` is the name of its group in the pattern."""

    kind: str
    text: str
    start: int

    @property
    def end(self) -> int:
        """The place after its last character."""
        return self.start + len(self.text)


class NameMention(NamedTuple):
    """A name or variable in an expression.

    `atom` says that it stands for an atom; `called` that an open bracket follows; `head` and
    `number` which argument of what it is part of.
    """

    name: str
    start: int
    atom: bool
    called: bool
    variable: bool = False
    head: str = ""
    number: int = 0

    @property
    def end(self) -> int:
        """The place after its last character."""
        return self.start + len(self.name)


_CODE_PATTERN = r"""
    (?P<text>"(?:\\.|[^"\\\n])*"?)
  | (?P<directive>\#[a-z]+\+?)
  | (?P<name>_*[a-z][A-Za-z0-9_']*)
  | (?P<variable>_*[A-Z][A-Za-z0-9_']*|_)
  | (?P<number>[0-9]+(?:\.[0-9]+)?)
  | (?P<space>\s+)
  | (?P<mark>:-|:~|\.\.|\*\*|!=|<=|>=|==|<>|.)
"""
_EXPRESSION_TOKEN = re.compile(_CODE_PATTERN, re.VERBOSE | re.DOTALL)
_ASP_TOKEN = re.compile(
    rf"(?P<comment>%\*.*?(?:\*%|\Z)|%[^\n]*)|{_CODE_PATTERN}", re.VERBOSE | re.DOTALL
)
_TIME_UNITS = re.compile(r"(ms|s|secs?|seconds?|min|mins|minutes?|h|hours?)")
_OPERAND_MARKS = {
    "=",
    "==",
    "!=",
    "<>",
    "<",
    "<=",
    ">",
    ">=",
    "+",
    "-",
    "*",
    "/",
    "\\",
    "**",
    "..",
    "?",
    "^",
    "&",
}
_CLOSING_BRACKETS = {")": "(", "}": "{", "]": "["}


@lru_cache(8192)
def tokens_of(text: str, asp: bool = False) -> tuple[Token, ...]:
    """The tokens of a text, spaces left out.

    Every text has tokens: what fits nothing is a mark of one character.
    """
    pattern = _ASP_TOKEN if asp else _EXPRESSION_TOKEN
    return tuple(
        Token(str(match.lastgroup), match[0], match.start())
        for match in pattern.finditer(text)
        if match.lastgroup != "space"
    )


class _BracketLevel:
    """Brackets that are open: what stands before them, and how many commas were seen inside."""

    def __init__(self, opened: str, head: str, number: int, terms: bool) -> None:
        self.opened, self.head, self.number, self.terms = opened, head, number, terms


@lru_cache(8192)
def mentions_in(text: str, asp: bool = False, terms: bool = False) -> tuple[NameMention, ...]:
    """The names and variables of an expression.

    With `terms`, its outermost names are terms and not atoms.
    """
    return tuple(
        _find_mentions([token for token in tokens_of(text, asp) if token.kind != "comment"], terms)
    )


def _find_mentions(tokens_found: list[Token], terms: bool) -> Iterator[NameMention]:
    after = _closing_tokens(tokens_found)
    levels = [_BracketLevel("", "", 0, terms)]
    for place, token in enumerate(tokens_found):
        level = levels[-1]
        if token.text == ".":
            # the end of a statement closes what was left open
            levels = [_BracketLevel("", "", 0, terms)]
        elif token.kind == "mark":
            _step_level(levels, tokens_found, place)
        elif token.kind == "variable":
            yield NameMention(token.text, token.start, False, False, True, level.head, level.number)
        elif token.kind == "name" and not _is_word(tokens_found, place):
            called = place + 1 < len(tokens_found) and tokens_found[place + 1].text == "("
            past = after.get(place + 1, place + 1) if called else place + 1
            atom = not level.terms and not _is_operand(tokens_found, place, past)
            yield NameMention(
                token.text, token.start, atom, called, False, level.head, level.number
            )


def _closing_tokens(tokens_found: list[Token]) -> dict[int, int]:
    """For each open bracket, the number of the token after the one that closes it."""
    waiting: list[int] = []
    after: dict[int, int] = {}
    for place, token in enumerate(tokens_found):
        if token.kind == "mark" and token.text in "({[":
            waiting.append(place)
        elif token.kind == "mark" and token.text in ")}]" and waiting:
            after[waiting.pop()] = place + 1
    return after


def _step_level(levels: list[_BracketLevel], tokens_found: list[Token], place: int) -> None:
    """Open or close brackets, and count arguments."""
    mark, level = tokens_found[place].text, levels[-1]
    if mark == "(":
        called = place > 0 and tokens_found[place - 1].kind == "name"
        head, number = (tokens_found[place - 1].text, 0) if called else (level.head, level.number)
        levels.append(_BracketLevel(mark, head, number, True))
    elif mark == "{":
        levels.append(_BracketLevel(mark, "", 0, True))
    elif mark in _CLOSING_BRACKETS and len(levels) > 1:
        levels.pop()
    elif mark == "," and level.opened == "(":
        level.number += 1
    elif level.opened == "{" and mark in (":", ";"):
        level.terms = mark == ";"  # terms of a tuple, then the atoms of its condition


def _is_word(tokens_found: list[Token], place: int) -> bool:
    """Whether a name is `not`, or the unit of a number."""
    token = tokens_found[place]
    if token.text == "not":
        return True
    return (
        place > 0
        and tokens_found[place - 1].kind == "number"
        and _TIME_UNITS.fullmatch(token.text) is not None
    )


def _is_operand(tokens_found: list[Token], place: int, past: int) -> bool:
    """Whether a term is compared or counted with: what stands before or after it says so.

    `p & q` joins atoms.
    """
    before = tokens_found[place - 1].text if place else ""
    behind = tokens_found[past].text if past < len(tokens_found) else ""
    return bool({before, behind} & (_OPERAND_MARKS - {"&"}))
