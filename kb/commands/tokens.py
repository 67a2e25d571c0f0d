"""The tokens of a sentence: words, numbers, times, names of objects, punctuation marks. Articles are dropped."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

from kb.commands.patterns import ARTICLES
from kb.syntax import unit_seconds

NUMBER, TIME, NAME, UNKNOWN = "NUMBER", "TIME", "NAME", "UNKNOWN"
MARKS = {
    ",": "COMMA",
    ";": "SEMICOLON",
    ".": "STOP",
    "..": "DOTS",
    "-": "DASH",
    "–": "DASH",
    "&": "AMPERSAND",
}

COUNTS = {
    "one": 1, "two": 2, "three": 3, "four": 4, "five": 5, "six": 6, "seven": 7, "eight": 8, "nine": 9, "ten": 10,
    "eleven": 11, "twelve": 12,
}  # fmt: skip
_UNIT = r"(?:ms|h|hrs?|hours?|mins?|minutes?|secs?|seconds?|s)(?!\w)"
_AMOUNT = rf"(?:\d{{1,9}}(?:\.\d{{1,9}})?\s*|(?:{'|'.join(COUNTS)}|an?)\s+)"
_PIECE = rf"{_AMOUNT}{_UNIT}(?:\.(?=\s*(?:[,;]|(?:and|then)\b)))?"
_PART = r"(?:half\s+an?|an?\s+half|(?:an?\s+|three\s+)?quarters?(?:\s+of)?\s+an)\s+(?:hour|minute)(?!\w)"
_TOKEN = re.compile(
    rf"(?P<time>{_PART}|{_PIECE}(?:\s*(?:and\s+)?{_PIECE})*)"
    r"|(?P<number>\d{1,9}(?![\w.]*\w))"
    r"|(?P<range>(?P<range_low>[A-Za-z]\w*)(?P<range_dash>-|\.\.)(?P<range_high>[A-Za-z]\w*\d|\d{1,9}))"
    r"|(?P<span>(?P<span_low>\d{1,9})\s*(?P<span_dash>-|\.\.\.?|–)\s*(?P<span_high>\d{1,9})(?!\w))"
    r"|(?P<word>[A-Za-z]+(?:-[A-Za-z]+)+|[A-Za-z_][\w']*)"
    r"|(?P<mark>\.\.\.?|[,;.&–-])"
    r"|(?P<other>\S[\w.]*\w|\S)",
    re.IGNORECASE,
)


@dataclass(frozen=True, slots=True)
class Piece:
    """A token: its kind (for a word, the word itself), its text, its place, and the value of a number or a time."""

    kind: str
    text: str
    offset: int
    value: Fraction | None = None


def pieces(sentence: str, words: frozenset[str], names: frozenset[str]) -> Iterator[Piece]:
    """The tokens of a sentence. A word that is neither in `words` nor in `names` is UNKNOWN."""
    for found in _TOKEN.finditer(sentence):
        text, offset = found[0], found.start()
        match found.lastgroup:
            case "time":
                yield Piece(TIME, text, offset, seconds(text))
            case "number":
                yield _number(text, offset)
            case "span" | "range" as kind:
                yield from _range(found, f"{kind}_", words, names)
            case "mark":
                yield Piece(MARKS.get(text, "DASH"), text, offset)
            case "word" if text.lower() not in ARTICLES:
                yield _word(text, offset, words, names)
            case "other":
                yield Piece(UNKNOWN, text, offset)


def _range(found: re.Match[str], kind: str, words: frozenset[str], names: frozenset[str]) -> Iterator[Piece]:
    """The three tokens of a range written without blanks, such as `1..3` or `m1-m12`."""
    for part in ("low", "dash", "high"):
        text, offset = found[kind + part], found.start(kind + part)
        if part == "dash":
            yield Piece("DASH", text, offset)
        else:
            yield _number(text, offset) if text.isdigit() else _word(text, offset, words, names)


def _number(text: str, offset: int) -> Piece:
    return Piece(NUMBER, text, offset, Fraction(text))


def _word(text: str, offset: int, words: frozenset[str], names: frozenset[str]) -> Piece:
    lower = text.lower()
    if lower in words:
        return Piece(lower, text, offset)
    for name in (text, lower):
        if name in names:
            return Piece(NAME, name, offset)
    if lower in COUNTS:
        return Piece(NUMBER, text, offset, Fraction(COUNTS[lower]))
    return Piece(UNKNOWN, text, offset)


def is_spoken(word: str) -> bool:
    """Whether a sentence can contain this as one word."""
    found = list(pieces(word, frozenset({word.lower()}), frozenset()))
    return word.lower() in ARTICLES or [piece.kind for piece in found] == [word.lower()]


def seconds(text: str) -> Fraction:
    """A time in words or figures: `90 s`, `1.5 hours`, `1 h 30 min`, `a quarter of an hour`."""
    lower = text.lower()
    if part := re.fullmatch(r"(.*?)\b(half|quarters?)\b.*\b(hour|minute)", lower):
        share = {"half": Fraction(1, 2)}.get(part[2], Fraction(1, 4)) * (3 if "three" in part[1] else 1)
        return share * (3600 if part[3] == "hour" else 60)
    total = Fraction(0)
    for piece in re.finditer(rf"({_AMOUNT})({_UNIT})", lower):
        amount = piece[1].strip()
        count = Fraction(1) if amount in ("a", "an") else Fraction(COUNTS.get(amount, 0)) or Fraction(amount)
        total += count * (unit_seconds("h" if piece[2].startswith("hr") else piece[2]) or 1)
    return total
