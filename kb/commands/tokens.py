"""The pieces of a sentence: words, numbers, punctuation marks; and the times that begin at a piece."""

import functools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction

from cellwright.kb.commands.patterns import ARTICLES
from cellwright.kb.commands.spelling import COUNTS, parts
from cellwright.kb.syntax import unit_seconds

NUMBER, WORD, MARK, OTHER = "number", "word", "mark", "other"
DASHES = ("-", "–", "..", "...")

_UNIT = r"(?:ms|milliseconds?|h|hrs?|hours?|mins?|minutes?|secs?|seconds?|s|days?)(?!\w)"
_COUNT = "|".join(sorted(COUNTS, key=len, reverse=True))
_AMOUNT = rf"(?:\d{{1,9}}(?:\.\d{{1,9}})?\s*|(?:{_COUNT}|an?)\s+)"
_STOP = r"(?:\.(?=\s*(?:[,;]|(?:and|then)\b)))?"
_PIECE = rf"{_AMOUNT}(?P<unit>{_UNIT}){_STOP}"
_PART = r"(?:half\s+an?|an?\s+half|(?:an?\s+|three\s+)?quarters?(?:\s+of)?\s+an?)\s+(?:hour|minute)(?!\w)"
_HALF = rf"(?:{_AMOUNT}(?:and\s+a\s+half\s+){_UNIT}|an?\s+(?:hour|minute)\s+and\s+a\s+half)(?!\w)"
_PHRASED, _MORE = rf"{_HALF}|{_PART}", rf"\s*,?\s*(?:and\s+)?{_PIECE}"
_TOKEN = re.compile(
    r"(?P<number>\d+(?![\w.]*\w))"
    r"|(?P<range>(?P<range_low>[^\W\d_]\w*)(?P<range_dash>-|\.\.\.?)(?P<range_high>[^\W\d_]\w*\d|\d{1,9}))"
    r"|(?P<span>(?P<span_low>\d{1,9})\s*(?P<span_dash>-|\.\.\.?|–)\s*(?P<span_high>\d{1,9})(?!\w))"
    r"|(?P<word>[^\W\d_]+(?:-[^\W\d_]+)+(?!\w)|[^\W\d]\w*(?:['’]\w+)*)"
    r"|(?P<mark>\.\.\.?|[,;.&!?#–-])"
    r"|(?P<other>\S[\w.,]*\w|\S)"
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Piece:
    """A piece of a sentence: its kind, its text, its place, and the value of a number (also of one in words)."""

    kind: str
    text: str
    offset: int
    value: Fraction | None = None

    @property
    def lower(self) -> str:
        """The text in small letters, with straight apostrophes."""
        return self.text.lower().replace("’", "'")


def separated(said: Sequence[Piece]) -> Iterator[Piece]:
    """The pieces with joined words taken apart: "heater-shaker" as "heater", "shaker", and "oven-2" as "oven", "2"."""
    for number, piece in enumerate(said):
        if piece.text == "-" and _joins(said[max(number - 1, 0) : number + 2]):
            continue
        offset = piece.offset
        for word in parts(piece.text, numbered=True) if piece.kind == WORD else ():
            yield _piece(word, offset)
            offset += len(word) + 1
        if piece.kind != WORD:
            yield piece


def _joins(around: Sequence[Piece]) -> bool:
    """Whether a hyphen stands between a word and a number without blanks."""
    kinds = [piece.kind for piece in around]
    ends = [piece.offset + len(piece.text) for piece in around]
    return kinds == [WORD, MARK, NUMBER] and [piece.offset for piece in around[1:]] == ends[:2]


def pieces(sentence: str) -> Iterator[Piece]:
    """The pieces of a sentence in order. Ranges such as `1..3` and `m1-m12` give three."""
    for found in _TOKEN.finditer(sentence):
        if found.lastgroup in ("range", "span"):
            for part in ("low", "dash", "high"):
                name = f"{found.lastgroup}_{part}"
                yield _piece(found[name], found.start(name), MARK if part == "dash" else "")
        else:
            yield _piece(found[0], found.start(), found.lastgroup or OTHER)


def _piece(text: str, offset: int, kind: str = "") -> Piece:
    if text.isdecimal():
        return Piece(NUMBER, text, offset, Fraction(text[:12]))
    value = COUNTS.get(text.lower())
    return Piece(kind or WORD, text, offset, None if value is None else Fraction(value))


def time_at(sentence: str, offset: int) -> tuple[int, Fraction] | None:
    """The end and the seconds of the time that begins at a character; None if none does.

    The units of one time become smaller: "1 h and 30 min" is one time, "5 min and 5 min" are two.
    """
    if found := _compiled(_PHRASED).match(sentence, offset):
        return found.end(), seconds(found[0])
    end, last = offset, None
    while (piece := _compiled(_MORE if last else _PIECE).match(sentence, end)) and (
        last is None or _unit_of(piece) < last
    ):
        end, last = piece.end(), _unit_of(piece)
    return None if last is None else (end, seconds(sentence[offset:end]))


@functools.cache
def _compiled(form: str) -> re.Pattern[str]:
    """The form of a time. It is long, and compiled only when there is a sentence."""
    return re.compile(form, re.IGNORECASE)


def _unit_of(piece: re.Match[str]) -> Fraction:
    return _unit(piece["unit"].lower())


def seconds(text: str) -> Fraction:
    """A time in words or figures: `90 s`, `1.5 hours`, `1 h 30 min`, `a quarter of an hour`, `two and a half minutes`."""
    lower = text.lower()
    if part := re.fullmatch(r"(?:(three)\s+|an?\s+)?(half|quarters?)\b.*\b(hour|minute)", lower):
        share = Fraction(1, 2) if part[2] == "half" else Fraction(3 if part[1] else 1, 4)
        return share * _unit(part[3])
    if part := re.fullmatch(r"(.*?)\s+(?:(\w+)\s+)?and\s+a\s+half(?:\s+(\w+))?", lower):
        return (_count(part[1]) + Fraction(1, 2)) * _unit(part[2] or part[3])
    pairs = re.finditer(rf"({_AMOUNT})({_UNIT})", lower)
    return sum((_count(pair[1].strip()) * _unit(pair[2]) for pair in pairs), Fraction(0))


def _count(amount: str) -> Fraction:
    return Fraction(1) if amount in ("a", "an") else Fraction(COUNTS.get(amount, amount))


_UNITS = {"hr": "h", "hrs": "h", "millisecond": "ms", "milliseconds": "ms"}


def _unit(name: str) -> Fraction:
    """Seconds in one unit of time."""
    if name.startswith("day"):
        return Fraction(86_400)
    return unit_seconds(_UNITS.get(name, name)) or Fraction(1)


def is_spoken(word: str) -> bool:
    """Whether a sentence can contain this as one word."""
    found = list(pieces(word))
    return word.lower() in ARTICLES or [piece.kind for piece in found] == [WORD]
