"""The small language of `say`: words, `{P:probe}` slots, `(a|b)` alternatives and `[optional]` parts."""

import functools
import itertools
import re
from collections.abc import Iterator
from dataclasses import dataclass

from cellwright.kb.commands.spelling import parts

ARTICLES = frozenset({"the", "a", "an", "please"})  # these words are ignored in phrases and in sentences


@dataclass(frozen=True, slots=True)
class Word:
    """One word, in lower case; a joined one, "heater-shaker", stands as several."""

    text: str


@dataclass(frozen=True, slots=True)
class Slot:
    """A place for objects, a number or a time. `offset` is its place in the pattern."""

    variable: str
    type: str
    offset: int = 0


@dataclass(frozen=True, slots=True)
class Sequence:
    """Parts one after another."""

    parts: tuple["Pattern", ...] = ()


@dataclass(frozen=True, slots=True)
class Choice:
    """One of the options. An optional part is a choice with an empty option."""

    options: tuple["Pattern", ...]


Pattern = Word | Slot | Sequence | Choice


class PatternError(Exception):
    """The text is not a pattern; `offset` is the first character that does not fit."""

    def __init__(self, offset: int, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.offset, self.message, self.hint = offset, message, hint


_TOKEN = re.compile(
    r"\s*(?:(?P<slot>\{\s*(?P<variable>[A-Z]\w*)\s*:\s*(?P<type>[a-z]\w*)\s*\})"
    r"|(?P<mark>[()\[\]|])|(?P<word>[^\W\d_][\w'-]*))"
)
_CLOSES = {"(": ")", "[": "]"}
MAX_PARTS = 200  # words, slots and brackets of one phrase
MAX_NESTING = 20


@functools.lru_cache(1024)
def read_pattern(text: str) -> Pattern:
    """The pattern that `text` describes. Raises `PatternError`."""
    return _PatternReader(text).whole()


class _PatternReader:
    """A reader by recursive descent, with one method per construct."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.tokens = list(self._tokens())
        self.next = 0
        self._check_size()

    def _tokens(self) -> Iterator[re.Match[str]]:
        position, end = 0, len(self.text.rstrip())
        while position < end:
            found = _TOKEN.match(self.text, position)
            if found is None:
                position += len(self.text[position:]) - len(self.text[position:].lstrip())
                message = f"unexpected '{self.text[position]}'"
                raise PatternError(
                    position, message, "use words, {P:type} slots, (a|b) alternatives and [optional] parts"
                )
            yield found
            position = found.end()

    def _check_size(self) -> None:
        if len(self.tokens) > MAX_PARTS:
            offset = self.tokens[MAX_PARTS].end() - 1
            raise PatternError(offset, f"more than {MAX_PARTS} parts", "split it into several phrases")
        depth = 0
        for found in self.tokens:
            depth += (found["mark"] in _CLOSES) - (found["mark"] in _CLOSES.values())
            if depth > MAX_NESTING:
                message = f"nested deeper than {MAX_NESTING} brackets"
                raise PatternError(found.start("mark"), message, "split it into several phrases")

    def whole(self) -> Pattern:
        pattern = self._options()
        if self.next < len(self.tokens):
            raise PatternError(self._offset(), f"'{self._mark()}' closes nothing")
        if () in expansions(pattern):
            raise PatternError(0, "every part of this phrase is optional", "give it at least one word")
        return pattern

    def _mark(self) -> str:
        return self.tokens[self.next]["mark"] or "" if self.next < len(self.tokens) else ""

    def _offset(self) -> int:
        found = self.tokens[self.next]
        return found.start(found.lastgroup if found.lastgroup in ("mark", "word") else "slot")

    def _options(self) -> Pattern:
        options = [self._sequence()]
        while self._mark() == "|":
            self.next += 1
            options.append(self._sequence())
        return options[0] if len(options) == 1 else Choice(tuple(options))

    def _sequence(self) -> Pattern:
        found: list[Pattern] = []
        while self.next < len(self.tokens) and self._mark() not in (")", "]", "|"):
            found.extend(self._part())
        return Sequence(tuple(found))

    def _part(self) -> Iterator[Pattern]:
        found, offset, opening = self.tokens[self.next], self._offset(), self._mark()
        self.next += 1
        if found["slot"]:
            yield Slot(found["variable"], found["type"], offset)
        elif found["word"]:
            words = parts(found["word"].lower())
            yield from (Word(each) for each in words if each not in ARTICLES)
        else:
            inner = self._options()
            if self._mark() != _CLOSES[opening]:
                raise PatternError(offset, f"this '{opening}' is never closed")
            self.next += 1
            yield Choice((inner, Sequence())) if opening == "[" else inner


MAX_EXPANSIONS = 1000


def expansions(pattern: Pattern) -> list[tuple[Word | Slot, ...]]:
    """Every sequence of words and slots that the pattern allows, each once. Raises `PatternError` beyond a thousand."""
    match pattern:
        case Word() | Slot():
            return [(pattern,)]
        case Choice(options):
            found = [each for option in options for each in expansions(option)]
        case Sequence(inner):
            found = [()]
            for part in inner:
                following = expansions(part)
                if len(found) * len(following) > MAX_EXPANSIONS:
                    raise PatternError(
                        0, "too many alternatives in one phrase", "split it into several phrases"
                    )
                found = [(*before, *after) for before in found for after in following]
    return list(dict.fromkeys(found))


_PREPOSITIONS = "in into inside on onto to from for with using at by under over through between against"
PREPOSITIONS = frozenset(_PREPOSITIONS.split())
MAX_MOVED = 3  # groups that may change places
COMMA = Word(",")

Variant = tuple[Word | Slot, ...]


def variants(expansion: Variant) -> Iterator[tuple[Variant, bool]]:
    """The orders in which the parts of an expansion can be said; for each, whether it is another than the written one.

    A group that begins with a preposition can be said before or after other such groups, or before all the rest:
    "heat it for 5 min in the furnace", "in the furnace, heat it for 5 min".
    """
    yield expansion, False
    head, *groups = _groups(expansion)
    if not head or len(groups) > MAX_MOVED:
        return
    for number in range(len(groups) + 1):
        for front in itertools.combinations(range(len(groups)), number):
            rest = [group for index, group in enumerate(groups) if index not in front]
            before = [part for index in front for part in groups[index]]
            for order in itertools.permutations(rest):
                after = [part for group in order for part in group]
                if front:
                    yield (*before, *head, *after), True
                    yield (*before, COMMA, *head, *after), True
                elif after != [part for group in groups for part in group]:
                    yield (*head, *after), True


def _groups(expansion: Variant) -> list[Variant]:
    """The words before the first preposition, then one group for each preposition with what follows it."""
    cuts = [0]
    for number, part in enumerate(expansion):
        if number > cuts[-1] + 1 and isinstance(part, Word) and part.text in PREPOSITIONS:
            cuts.append(number)
    return [expansion[begin:end] for begin, end in itertools.pairwise([*cuts, len(expansion)])]


def readable(say: str) -> str:
    """A pattern as text for people: slots are shown by their types."""
    return re.sub(r"\{\s*\w+\s*:\s*(\w+)\s*\}", lambda found: f"<{SHOWN_TYPES.get(found[1], found[1])}>", say)


SHOWN_TYPES = {"int": "number"}
