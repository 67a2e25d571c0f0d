"""Pieces of a sentence: words, numbers, times, and what is said in a slot of a phrase."""

import functools
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction

from cellwright.kb.commands.phrase_patterns import ARTICLES, COUNTS, split_word
from cellwright.kb.syntax import unit_seconds

NUMBER, WORD, MARK, OTHER = "number", "word", "mark", "other"
DASHES = ("-", "–", "..", "...")

_UNIT = r"(?:ms|milliseconds?|h|hrs?|hours?|mins?|minutes?|secs?|seconds?|s|days?)(?!\w)"
_COUNT = "|".join(sorted(COUNTS, key=len, reverse=True))
_AMOUNT = rf"(?:\d{{1,9}}(?:\.\d{{1,9}})?\s*|(?:{_COUNT}|an?)\s+)"
_STOP = r"(?:\.(?=\s*(?:[,;]|(?:and|then)\b)))?"
_PIECE = rf"{_AMOUNT}(?P<unit>{_UNIT}){_STOP}"
_PART_OF_UNIT = r"(?:half\s+an?|an?\s+half|(?:an?\s+|three\s+)?quarters?(?:\s+of)?\s+an?)\s+(?:hour|minute)(?!\w)"
_HALF = rf"(?:{_AMOUNT}(?:and\s+a\s+half\s+){_UNIT}|an?\s+(?:hour|minute)\s+and\s+a\s+half)(?!\w)"
_PHRASED, _MORE = rf"{_HALF}|{_PART_OF_UNIT}", rf"\s*,?\s*(?:and\s+)?{_PIECE}"
_SENTENCE_TOKEN = re.compile(
    r"(?P<number>\d+(?![\w.]*\w))"
    r"|(?P<range>(?P<range_low>[^\W\d_]\w*)(?P<range_dash>-|\.\.\.?)(?P<range_high>[^\W\d_]\w*\d|\d{1,9}))"
    r"|(?P<span>(?P<span_low>\d{1,9})\s*(?P<span_dash>-|\.\.\.?|–)\s*(?P<span_high>\d{1,9})(?!\w))"
    r"|(?P<word>[^\W\d_]+(?:-[^\W\d_]+)+(?!\w)|[^\W\d]\w*(?:['’]\w+)*)"
    r"|(?P<mark>\.\.\.?|[,;.&!?#–-])"
    r"|(?P<other>\S[\w.,]*\w|\S)"
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class SentencePiece:
    """A piece of a sentence: its kind, its text, its place, and the value of a number (also of
    one in words).
    """

    kind: str
    text: str
    offset: int
    value: Fraction | None = None

    @property
    def lower(self) -> str:
        """The text in small letters, with straight apostrophes."""
        return self.text.lower().replace("’", "'")


def split_joined(said: Sequence[SentencePiece]) -> Iterator[SentencePiece]:
    """The pieces with joined words taken apart: "heater-shaker" as "heater", "shaker", and
    "oven-2" as "oven", "2".
    """
    for number, piece in enumerate(said):
        if piece.text == "-" and _is_joining(said[max(number - 1, 0) : number + 2]):
            continue
        offset = piece.offset
        for word in split_word(piece.text, numbered=True) if piece.kind == WORD else ():
            yield _make_piece(word, offset)
            offset += len(word) + 1
        if piece.kind != WORD:
            yield piece


def _is_joining(around: Sequence[SentencePiece]) -> bool:
    """Whether a hyphen stands between a word and a number without blanks."""
    kinds = [piece.kind for piece in around]
    ends = [piece.offset + len(piece.text) for piece in around]
    return kinds == [WORD, MARK, NUMBER] and [piece.offset for piece in around[1:]] == ends[:2]


def read_pieces(sentence: str) -> Iterator[SentencePiece]:
    """The pieces of a sentence in order. Ranges such as `1..3` and `m1-m12` give three."""
    for match in _SENTENCE_TOKEN.finditer(sentence):
        if match.lastgroup in ("range", "span"):
            for part in ("low", "dash", "high"):
                name = f"{match.lastgroup}_{part}"
                yield _make_piece(match[name], match.start(name), MARK if part == "dash" else "")
        else:
            yield _make_piece(match[0], match.start(), match.lastgroup or OTHER)


def _make_piece(text: str, offset: int, kind: str = "") -> SentencePiece:
    if text.isdecimal():
        return SentencePiece(NUMBER, text, offset, Fraction(text[:12]))
    value = COUNTS.get(text.lower())
    return SentencePiece(kind or WORD, text, offset, None if value is None else Fraction(value))


def time_at(sentence: str, offset: int) -> tuple[int, Fraction] | None:
    """The end and the seconds of the time that begins at a character; None if none does.

    The units of one time become smaller: "1 h and 30 min" is one time, "5 min and 5 min" are two.
    """
    if match := _time_pattern(_PHRASED).match(sentence, offset):
        return match.end(), read_seconds(match[0])
    end, last = offset, None
    while (piece := _time_pattern(_MORE if last else _PIECE).match(sentence, end)) and (
        last is None or _unit_of(piece) < last
    ):
        end, last = piece.end(), _unit_of(piece)
    return None if last is None else (end, read_seconds(sentence[offset:end]))


@functools.cache
def _time_pattern(form: str) -> re.Pattern[str]:
    """The form of a time. It is long, and compiled only when there is a sentence."""
    return re.compile(form, re.IGNORECASE)


def _unit_of(piece: re.Match[str]) -> Fraction:
    return _seconds_of_unit(piece["unit"].lower())


def read_seconds(text: str) -> Fraction:
    """A time in words or figures: `90 s`, `1.5 hours`, `1 h 30 min`, `a quarter of an hour`,
    `two and a half minutes`.
    """
    lower = text.lower()
    if part := re.fullmatch(r"(?:(three)\s+|an?\s+)?(half|quarters?)\b.*\b(hour|minute)", lower):
        share = Fraction(1, 2) if part[2] == "half" else Fraction(3 if part[1] else 1, 4)
        return share * _seconds_of_unit(part[3])
    if part := re.fullmatch(r"(.*?)\s+(?:(\w+)\s+)?and\s+a\s+half(?:\s+(\w+))?", lower):
        return (_read_count(part[1]) + Fraction(1, 2)) * _seconds_of_unit(part[2] or part[3])
    pairs = re.finditer(rf"({_AMOUNT})({_UNIT})", lower)
    return sum(
        (_read_count(pair[1].strip()) * _seconds_of_unit(pair[2]) for pair in pairs), Fraction(0)
    )


def _read_count(amount: str) -> Fraction:
    return Fraction(1) if amount in ("a", "an") else Fraction(COUNTS.get(amount, amount))


_UNIT_SPELLINGS = {"hr": "h", "hrs": "h", "millisecond": "ms", "milliseconds": "ms"}


def _seconds_of_unit(name: str) -> Fraction:
    """Seconds in one unit of time."""
    if name.startswith("day"):
        return Fraction(86_400)
    return unit_seconds(_UNIT_SPELLINGS.get(name, name)) or Fraction(1)


def is_spoken(word: str) -> bool:
    """Whether a sentence can contain this as one word."""
    word_pieces = list(read_pieces(word))
    return word.lower() in ARTICLES or [piece.kind for piece in word_pieces] == [WORD]


A_NUMBER, A_TIME, A_NAME = "NUMBER", "TIME", "NAME"  # what a place may expect beside words


class SentenceReader:
    """The pieces of a sentence. Methods return the place after what they look for, or None, and
    note what they looked for.

    Articles may stand before anything. With `apart`, joined words such as "heater-shaker" count as
    several.
    """

    def __init__(self, text: str, apart: bool = False) -> None:
        self.text = text
        all_pieces = tuple(read_pieces(text))
        self.pieces = tuple(split_joined(all_pieces)) if apart else all_pieces
        self.expected: dict[int, set[str]] = {}

    def note(self, place: int, what: str) -> None:
        """Note that `what` would be understood at a place."""
        self.expected.setdefault(self.start(place), set()).add(what)

    def start(self, place: int) -> int:
        """The first piece from a place on that is no article."""
        while place < len(self.pieces) and self.pieces[place].lower in ARTICLES:
            place += 1
        return place

    def starts(self, place: int) -> tuple[int, ...]:
        """Where what is said at a place can begin: at the place itself, or after articles."""
        begins = dict.fromkeys((place, self.start(place)))
        return tuple(begin for begin in begins if begin < len(self.pieces))

    def at(self, place: int) -> SentencePiece | None:
        """The piece at a place, after articles; None at the end."""
        place = self.start(place)
        return self.pieces[place] if place < len(self.pieces) else None

    def word(self, place: int, word: str) -> int | None:
        """The place after a word or mark."""
        if place < len(self.pieces) and self.pieces[place].lower == word:
            return place + 1  # also an article, such as the A of "box A"
        piece = self.at(place)
        if piece is not None and (piece.lower == word or _is_same_number(piece, word)):
            return self.start(place) + 1
        self.note(place, word)
        return None

    def words(self, place: int, words: Iterable[str]) -> int | None:
        """The place after several words, of which only the first is noted."""
        end = place
        for number, word in enumerate(words):
            piece = self.at(end)
            exact = self.pieces[end].lower == word if end < len(self.pieces) else False
            if (
                number
                and not exact
                and (piece is None or (piece.lower != word and not _is_same_number(piece, word)))
            ):
                return None
            after = self.word(end, word)
            if after is None:
                return None
            end = after
        return end

    def one_of(self, place: int, words: Iterable[str]) -> int | None:
        """The place after one of several words."""
        ends = [end for word in words if (end := self.word(place, word)) is not None]
        return ends[0] if ends else None

    def number(self, place: int) -> int | None:
        """The place after a number in figures or words."""
        piece = self.at(place)
        if piece is not None and (piece.kind == NUMBER or piece.value is not None):
            return self.start(place) + 1
        self.note(place, A_NUMBER)
        return None

    def time(self, place: int, hint: bool = True) -> tuple[int, Fraction, str] | None:
        """The place after a time, its seconds, and its text. With `hint`, a time is told to be
        possible here.
        """
        for begin in self.starts(place):
            offset = self.pieces[begin].offset
            if time := time_at(self.text, offset):
                end = begin
                while end < len(self.pieces) and self.pieces[end].offset < time[0]:
                    end += 1
                return end, time[1], self.text[offset : time[0]].rstrip(".")
        if hint:
            self.note(place, A_TIME)
        return None

    def offset(self, place: int) -> int:
        """The character at which a place begins; the end of the text behind the last piece."""
        return self.pieces[place].offset if place < len(self.pieces) else len(self.text)

    def furthest(self) -> int:
        """The last place at which something else would have been understood."""
        return max(self.expected, default=0)


def _is_same_number(piece: SentencePiece, word: str) -> bool:
    """Whether a number is what a word says: the 2 of "oven 2", where a phrase has "oven two"."""
    return piece.kind == NUMBER and COUNTS.get(word) == piece.value


class UnclearReference(Exception):
    """A part of a sentence names nothing, or is ambiguous. `offset` is its place."""

    def __init__(self, offset: int, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.offset, self.message, self.hint = offset, message, hint


@dataclass(frozen=True, slots=True)
class SlotMention:
    """One part of a list: how it names objects, the owner of its noun (a type, or an object with
    its own words), and its ends.

    `how` is `numbered`, `numbers` (a range), `named`, `names` (a range), `sole` (a noun alone),
    `called`, `counted` (a number before a noun, or a number in words alone) or `ranked` ("the first
    two": an ordinal, and how many).
    """

    how: str
    owner: str
    ends: tuple[SentencePiece, ...]
    pieces: tuple[SentencePiece, ...]


@dataclass(frozen=True, slots=True)
class SlotWords:
    """The content of a slot. `how` is `list`, `all`, `bare` ("all" without a noun), `both`,
    `others`, `pronoun`, `omitted` or `value`.

    An `omitted` one was not said at all. `owner` is the type whose noun was said with it; `but`
    holds what "except" leaves out.
    """

    how: str
    pieces: tuple[SentencePiece, ...]
    mentions: tuple[SlotMention, ...] = ()
    owner: str = ""
    but: tuple[SlotMention, ...] = ()

    @property
    def leans_back(self) -> bool:
        """Whether this means things that were named before: "cool it", "and store"."""
        return self.how in ("pronoun", "omitted")
