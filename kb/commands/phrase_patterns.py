"""Patterns of phrases: the language of `say`, the spelling of words, and the tree of all forms."""

import functools
import itertools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

_ONES = (
    "zero one two three four five six seven eight nine ten eleven twelve thirteen fourteen "
    "fifteen sixteen "
    "seventeen eighteen nineteen"
)
_DECADES = "twenty thirty forty fifty sixty seventy eighty ninety"
_SMALL, _TENS = _ONES.split(), _DECADES.split()
COUNTS = {word: value for value, word in enumerate(_SMALL)}
COUNTS |= {word: 10 * value for value, word in enumerate(_TENS, 2)}
COUNTS |= {f"{ten}-{one}": COUNTS[ten] + COUNTS[one] for ten in _TENS for one in _SMALL[1:10]}

_JOINED = re.compile(r"[^\W\d_]+(?:[-_][^\W\d_]+)+")
_NUMBERED = re.compile(r"[^\W\d_]+(?:[-_](?:[^\W\d_]+|\d{1,9}))+")


def split_word(word: str, numbered: bool = False) -> tuple[str, ...]:
    """The words that a joined one consists of: "heater-shaker" and "heater_shaker" are "heater
    shaker"; numbers stay whole.

    With `numbered`, numbers may be among them: "oven_2" is "oven 2".
    """
    joined = (_NUMBERED if numbered else _JOINED).fullmatch(
        word
    ) is not None and word.lower() not in COUNTS
    return tuple(re.split("[-_]", word)) if joined else (word,)


def with_article(noun: str) -> str:
    """The noun behind "a" or "an", as one hears it."""
    vowel = noun[0] in "aeiou" and not re.match(r"u[sn]i|u[st][ei]|eu|one", noun)
    return f"{'an' if vowel else 'a'} {noun}"


# these words are ignored in phrases and in sentences
ARTICLES = frozenset({"the", "a", "an", "please"})


@dataclass(frozen=True, slots=True)
class PatternWord:
    """One word, in lower case; a joined one, "heater-shaker", stands as several."""

    text: str


@dataclass(frozen=True, slots=True)
class PatternSlot:
    """A place for objects, a number or a time. `offset` is its place in the pattern."""

    variable: str
    type: str
    offset: int = 0


@dataclass(frozen=True, slots=True)
class PatternSequence:
    """Parts one after another."""

    parts: tuple["Pattern", ...] = ()


@dataclass(frozen=True, slots=True)
class PatternChoice:
    """One of the options. An optional part is a choice with an empty option."""

    options: tuple["Pattern", ...]


Pattern = PatternWord | PatternSlot | PatternSequence | PatternChoice


class PatternError(Exception):
    """The text is not a pattern; `offset` is the first character that does not fit."""

    def __init__(self, offset: int, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.offset, self.message, self.hint = offset, message, hint


_PATTERN_TOKEN = re.compile(
    r"\s*(?:(?P<slot>\{\s*(?P<variable>[A-Z]\w*)\s*:\s*(?P<type>[a-z]\w*)\s*\})"
    r"|(?P<mark>[()\[\]|])|(?P<word>[^\W\d_][\w'-]*))"
)
_CLOSING_SIGN = {"(": ")", "[": "]"}
MAX_PATTERN_PARTS = 200  # words, slots and brackets of one phrase
MAX_PATTERN_NESTING = 20


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
            match = _PATTERN_TOKEN.match(self.text, position)
            if match is None:
                position += len(self.text[position:]) - len(self.text[position:].lstrip())
                message = f"unexpected '{self.text[position]}'"
                raise PatternError(
                    position,
                    message,
                    "use words, {P:type} slots, (a|b) alternatives and [optional] parts",
                )
            yield match
            position = match.end()

    def _check_size(self) -> None:
        if len(self.tokens) > MAX_PATTERN_PARTS:
            offset = self.tokens[MAX_PATTERN_PARTS].end() - 1
            raise PatternError(
                offset, f"more than {MAX_PATTERN_PARTS} parts", "split it into several phrases"
            )
        depth = 0
        for token in self.tokens:
            depth += (token["mark"] in _CLOSING_SIGN) - (token["mark"] in _CLOSING_SIGN.values())
            if depth > MAX_PATTERN_NESTING:
                message = f"nested deeper than {MAX_PATTERN_NESTING} brackets"
                raise PatternError(token.start("mark"), message, "split it into several phrases")

    def whole(self) -> Pattern:
        pattern = self._options()
        if self.next < len(self.tokens):
            raise PatternError(self._offset(), f"'{self._mark()}' closes nothing")
        if () in expand_pattern(pattern):
            raise PatternError(
                0, "every part of this phrase is optional", "give it at least one word"
            )
        return pattern

    def _mark(self) -> str:
        return self.tokens[self.next]["mark"] or "" if self.next < len(self.tokens) else ""

    def _offset(self) -> int:
        token = self.tokens[self.next]
        return token.start(token.lastgroup if token.lastgroup in ("mark", "word") else "slot")

    def _options(self) -> Pattern:
        options = [self._sequence()]
        while self._mark() == "|":
            self.next += 1
            options.append(self._sequence())
        return options[0] if len(options) == 1 else PatternChoice(tuple(options))

    def _sequence(self) -> Pattern:
        parts: list[Pattern] = []
        while self.next < len(self.tokens) and self._mark() not in (")", "]", "|"):
            parts.extend(self._part())
        return PatternSequence(tuple(parts))

    def _part(self) -> Iterator[Pattern]:
        token, offset, opening = self.tokens[self.next], self._offset(), self._mark()
        self.next += 1
        if token["slot"]:
            yield PatternSlot(token["variable"], token["type"], offset)
        elif token["word"]:
            words = split_word(token["word"].lower())
            yield from (PatternWord(word) for word in words if word not in ARTICLES)
        else:
            inner = self._options()
            if self._mark() != _CLOSING_SIGN[opening]:
                raise PatternError(offset, f"this '{opening}' is never closed")
            self.next += 1
            yield PatternChoice((inner, PatternSequence())) if opening == "[" else inner


MAX_EXPANSIONS = 1000


def expand_pattern(pattern: Pattern) -> list[tuple[PatternWord | PatternSlot, ...]]:
    """Every sequence of words and slots that the pattern allows, each once.

    Raises `PatternError` beyond a thousand.
    """
    match pattern:
        case PatternWord() | PatternSlot():
            return [(pattern,)]
        case PatternChoice(options):
            expanded = [expansion for option in options for expansion in expand_pattern(option)]
        case PatternSequence(inner):
            expanded = [()]
            for part in inner:
                following = expand_pattern(part)
                if len(expanded) * len(following) > MAX_EXPANSIONS:
                    raise PatternError(
                        0, "too many alternatives in one phrase", "split it into several phrases"
                    )
                expanded = [(*before, *after) for before in expanded for after in following]
    return list(dict.fromkeys(expanded))


_PREPOSITIONS = (
    "in into inside on onto to from for with using at by under over through between against"
)
PREPOSITIONS = frozenset(_PREPOSITIONS.split())
MAX_MOVED = 3  # groups that may change places
COMMA = PatternWord(",")

Variant = tuple[PatternWord | PatternSlot, ...]


def order_variants(expansion: Variant) -> Iterator[tuple[Variant, bool]]:
    """The orders in which the parts of an expansion can be said; for each, whether it is another
    than the written one.

    A group that begins with a preposition can be said before or after other such groups, or before
    all the rest: "heat it for 5 min in the furnace", "in the furnace, heat it for 5 min".
    """
    yield expansion, False
    head, *groups = _preposition_groups(expansion)
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


def _preposition_groups(expansion: Variant) -> list[Variant]:
    """The words before the first preposition, then one group for each preposition with what
    follows it.
    """
    cuts = [0]
    for number, part in enumerate(expansion):
        if number > cuts[-1] + 1 and isinstance(part, PatternWord) and part.text in PREPOSITIONS:
            cuts.append(number)
    return [expansion[begin:end] for begin, end in itertools.pairwise([*cuts, len(expansion)])]


def readable_pattern(say: str) -> str:
    """A pattern as text for people: slots are shown by their types."""
    return re.sub(
        r"\{\s*\w+\s*:\s*(\w+)\s*\}", lambda match: f"<{SHOWN_TYPES.get(match[1], match[1])}>", say
    )


SHOWN_TYPES = {"int": "number"}


@dataclass(frozen=True, slots=True)
class PhraseForm:
    """One way of saying a phrase: its number, its parts, and whether they are in another order
    than the written one.
    """

    phrase: int
    parts: Variant
    moved: bool

    @property
    def verb(self) -> tuple[str, ...]:
        """The words before the first slot; for a phrase without slots, the first word and a
        particle after it.
        """
        words = tuple(part.text if isinstance(part, PatternWord) else "" for part in self.parts)
        if "" in words:
            return words[: words.index("")]
        return words[: 2 if words[1:2] and words[1] in PARTICLES else 1]


PARTICLES = frozenset({"up", "down", "on", "off", "out", "back", "away"})


@dataclass(slots=True)
class PhraseNode:
    """A place in the tree: where each word and each type of slot leads, and the forms that end
    here.
    """

    words: dict[str, "PhraseNode"] = field(default_factory=dict)
    slots: dict[str, "PhraseNode"] = field(default_factory=dict)
    ends: list[PhraseForm] = field(default_factory=list)

    def after(self, part: PatternWord | PatternSlot) -> "PhraseNode":
        """The node behind a part, which is made if there is none."""
        if isinstance(part, PatternWord):
            return self.words.setdefault(part.text, PhraseNode())
        return self.slots.setdefault(part.type, PhraseNode())


@functools.lru_cache(16)
def build_phrase_tree(patterns: tuple[Pattern, ...], moved: bool) -> PhraseNode:
    """The root of the tree of all forms of the patterns: those as written, or those in another
    order.
    """
    root = PhraseNode()
    for form in phrase_forms(patterns):
        if form.moved != moved:
            continue
        node = root
        for part in form.parts:
            node = node.after(part)
        if not any(end.phrase == form.phrase and end.parts == form.parts for end in node.ends):
            node.ends.append(form)
    return root


def phrase_forms(patterns: Sequence[Pattern]) -> Iterator[PhraseForm]:
    """Every way of saying every pattern, in the order of the patterns."""
    for number, pattern in enumerate(patterns):
        for expansion in expand_pattern(pattern):
            for variant, moved in order_variants(expansion):
                yield PhraseForm(number, variant, moved)


def verb_gerunds(verb: str) -> tuple[str, ...]:
    """What a verb may look like after "after" and "before": heating, storing, putting."""
    if verb.endswith("ie"):
        return (f"{verb[:-2]}ying",)
    short = (f"{verb[:-1]}ing",) if verb.endswith("e") else ()
    return (*short, f"{verb}ing", f"{verb}{verb[-1]}ing")


_IRREGULAR = (
    "put put,take taken,bring brought,hold held,give given,cut cut,spin spun,shut shut,set "
    "set,send sent,read read,get got,"
    "make made,lay laid,find found,feed fed,wind wound,draw drawn,drive driven,write "
    "written,shake shaken,freeze frozen,"
    "grind ground,bend bent,hang hung,leave left,open opened open,sweep swept,stick stuck,burn "
    "burnt burned,go gone,do done"
)
IRREGULAR_PARTICIPLES = {
    words.split()[0]: tuple(words.split()[1:]) for words in _IRREGULAR.split(",")
}


def verb_participles(verb: str) -> tuple[str, ...]:
    """What a verb may look like after "is" and "have": heated, stored, put."""
    if verb in IRREGULAR_PARTICIPLES:
        return IRREGULAR_PARTICIPLES[verb]
    if verb.endswith("e"):
        return (f"{verb}d",)
    return f"{verb}ed", f"{verb}{verb[-1]}ed", *((f"{verb[:-1]}ied",) if verb.endswith("y") else ())


def spoken_words(say: str) -> tuple[str, ...]:
    """The words of a noun, in small letters, joined ones taken apart."""
    words = say.lower().replace("’", "'").split()
    return tuple(part for word in words for part in split_word(word))


def noun_plurals(noun: str) -> tuple[str, ...]:
    """A noun and its plurals, as people may spell them."""
    if noun.endswith("y") and noun[-2:-1] not in tuple("aeiou"):
        return noun, f"{noun[:-1]}ies", f"{noun}s"
    return (
        (noun, f"{noun}es", f"{noun}s")
        if noun.endswith(("s", "x", "z", "ch", "sh"))
        else (noun, f"{noun}s")
    )
