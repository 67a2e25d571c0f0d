"""Matches phrases from a place of a sentence on, and the objects that it names in their slots."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

from cellwright.kb.commands.domain_nouns import Nouns, NounVocabulary
from cellwright.kb.commands.phrase_patterns import PatternSlot, PatternWord, PhraseForm, PhraseNode
from cellwright.kb.commands.sentence_pieces import (
    A_NAME,
    DASHES,
    WORD,
    SentencePiece,
    SentenceReader,
    SlotMention,
    SlotWords,
)
from cellwright.kb.model.domain_model import NUMERIC_TYPES

PRONOUNS = ("it", "them", "they", "these", "those", "both", "each")
POINTING = ("this", "that", "these", "those", "same")
ALL_WORDS = ("all", "each", "every", "everything")
UNTIL = ("to", "through", *DASHES)
OTHER_WORDS = ("other", "remaining")
EXCEPT_SAYINGS = (
    ("except",),
    ("but",),
    ("besides",),
    ("apart", "from"),
    ("other", "than"),
    ("except", "for"),
    ("excluding",),
    ("but", "not"),
)
BUT_BEHIND_A_COMMA = (
    ("except",),
    ("except", "for"),
    ("but", "not"),
    ("not",),
    ("apart", "from"),
    ("excluding",),
)
ORDINAL_WORDS = (
    "first",
    "second",
    "third",
    "fourth",
    "fifth",
    "sixth",
    "seventh",
    "eighth",
    "ninth",
    "tenth",
    "last",
)
MOST_NOTED = 50  # nouns that a message could show
NUMBER_SIGNS = (("number",), ("no",), ("no", "."), ("nr",), ("nr", "."), ("#",))


class Mentions:
    """The readings of slots in one sentence: `at(type, place)` gives each place where a reading may
    end.

    With `strict`, a name of an object of another type is no reading; otherwise it is one, and is
    reported later.
    """

    def __init__(self, said: SentenceReader, vocabulary: NounVocabulary, strict: bool) -> None:
        self.said, self.vocabulary, self.strict = said, vocabulary, strict
        self._known: dict[tuple[str, int], dict[int, SlotWords]] = {}

    def at(self, type_: str, place: int) -> dict[int, SlotWords]:
        """The contents that a slot of a type can have from a place on, by the place after them."""
        if (type_, place) not in self._known:
            contents: dict[int, SlotWords] = {}
            for end, words in self._slot(type_, place):
                contents.setdefault(end, words)
            self._known[type_, place] = contents
        return self._known[type_, place]

    def _slot(self, type_: str, place: int) -> Iterator[tuple[int, SlotWords]]:
        for end, words in self._whole(type_, place):
            yield end, words
            yield from self._without(type_, place, end, words)

    def _whole(self, type_: str, place: int) -> Iterator[tuple[int, SlotWords]]:
        """The contents of a slot, before anything is left out of them."""
        for end, mentions in self._list(type_, place):
            yield end, SlotWords("list", self._pieces(place, end), mentions)
            comma = self.said.word(end, ",")
            for after in (end, comma) if len(mentions) > 1 and comma is not None else (end,):
                if (
                    len(mentions) > 1
                    and (after_each := self.said.one_of(after, ("each", "both"))) is not None
                ):
                    yield after_each, SlotWords("list", self._pieces(place, after_each), mentions)
        yield from self._both(type_, place)
        yield from self._all(type_, place)
        yield from self._others(type_, place)
        yield from self._pronoun(type_, place)

    def _without(
        self, type_: str, place: int, end: int, words: SlotWords
    ) -> Iterator[tuple[int, SlotWords]]:
        """The same objects without some that are named behind "except"."""
        if (
            words.how == "list"
            and len(words.mentions) == 1
            and words.mentions[0].how not in ("numbers", "names")
        ):
            return
        behind = [self.said.words(end, saying) for saying in EXCEPT_SAYINGS]
        if (comma := self.said.word(end, ",")) is not None:
            behind += [self.said.words(comma, saying) for saying in BUT_BEHIND_A_COMMA]
        for but in (end_behind for end_behind in behind if end_behind is not None):
            for after, excepted in self._list(words.owner or type_, but):
                yield after, replace(words, pieces=self._pieces(place, after), but=excepted)

    def _list(self, type_: str, place: int) -> Iterator[tuple[int, tuple[SlotMention, ...]]]:
        """Lists of mentions, the shortest first.

        After "and", each further mention makes a longer list.
        """
        ends: list[tuple[int, tuple[SlotMention, ...]]] = [
            (end, (_as_count(mention),)) for end, mention in self._items(type_, place)
        ]
        seen: set[int] = set()
        while ends:
            end, mentions = ends.pop(0)
            if end in seen:
                continue
            seen.add(end)
            yield end, mentions
            for begin in self._more(end):
                ends += [
                    (after, (*mentions, mention)) for after, mention in self._items(type_, begin)
                ]

    def _more(self, place: int) -> Iterator[int]:
        comma = self.said.word(place, ",")
        if comma is not None:
            yield comma
        start = place if comma is None else comma
        for joint in (("and",), ("&",), ("as", "well", "as"), ("and", "also")):
            if (end := self.said.words(start, joint)) is not None:
                yield end

    def _items(self, type_: str, place: int) -> Iterator[tuple[int, SlotMention]]:
        """The mentions that begin at a place; the longest of a kind first."""
        called = list(self._said(self.vocabulary.called(type_), place))
        for end, name in called:
            yield end, SlotMention("called", name, (), self._pieces(place, end))
        nouns = list(self._said(self.vocabulary.nouns(type_), place))
        for end, owner in (*nouns, (place, "")):
            for begin in (
                end,
                *(e for sign in NUMBER_SIGNS if (e := self.said.words(end, sign)) is not None),
            ):
                yield from self._numbers(owner, place, begin, nouns)
            yield from self._names(type_, owner, place, end)
        yield from self._ranked(type_, place)
        longest = max((end for end, _ in called), default=place)
        for end, owner in (
            noun for noun in nouns if noun[0] >= longest
        ):  # "part A" is no part with an article behind it
            yield end, SlotMention("sole", owner, (), self._pieces(place, end))
        if (count := self.said.number(place)) is not None:
            for end, owner in self._said(self.vocabulary.nouns(type_), count):
                yield (
                    end,
                    SlotMention("counted", owner, (self._last(count),), self._pieces(place, end)),
                )

    def _ranked(self, type_: str, place: int) -> Iterator[tuple[int, SlotMention]]:
        """Objects by their places in a row: the first two probes, the last one, the first."""
        if (end := self.said.one_of(place, ORDINAL_WORDS)) is None:
            return
        ordinal, count = self.said.pieces[end - 1], self.said.number(end)
        many = () if count is None else (self.pieces_at(count),)
        behind = end if count is None else count
        for after, owner in self._said(self.vocabulary.nouns(type_), behind):
            yield after, SlotMention("ranked", owner, (ordinal, *many), self._pieces(place, after))
        # "the first", "first one"
        if self.said.start(place) > place or (many and many[0].lower == "one"):
            yield behind, SlotMention("ranked", "", (ordinal, *many), self._pieces(place, behind))

    def _numbers(
        self, owner: str, place: int, begin: int, nouns: Sequence[tuple[int, str]]
    ) -> Iterator[tuple[int, SlotMention]]:
        end = self.said.number(begin)
        if end is None:
            return
        first = self._last(end)
        if (until := self.said.one_of(end, UNTIL)) is not None:
            after = next((e for e, noun_owner in self._nouns_at(until, nouns)), until)
            if (last := self.said.number(after)) is not None:
                yield (
                    last,
                    SlotMention(
                        "numbers", owner, (first, self._last(last)), self._pieces(place, last)
                    ),
                )
        yield end, SlotMention("numbered", owner, (first,), self._pieces(place, end))

    def _nouns_at(self, place: int, nouns: Sequence[tuple[int, str]]) -> Iterator[tuple[int, str]]:
        """The same nouns again, as in "probe 1 to probe 3"."""
        for _, owner in nouns:
            yield from self._said(self.vocabulary.nouns(owner), place)

    def _names(
        self, type_: str, owner: str, place: int, begin: int
    ) -> Iterator[tuple[int, SlotMention]]:
        end = self._name(begin, type_)
        if end is None:
            return
        first = self._last(end)
        if (until := self.said.one_of(end, UNTIL)) is not None:
            last = self._name(until, type_)
            last = self.said.number(until) if last is None else last
            if last is not None:
                yield (
                    last,
                    SlotMention(
                        "names", owner, (first, self._last(last)), self._pieces(place, last)
                    ),
                )
        yield end, SlotMention("named", owner, (first,), self._pieces(place, end))

    def _name(self, place: int, type_: str) -> int | None:
        """The place after the name of an object."""
        for begin in self.said.starts(place):
            piece = self.said.pieces[begin]
            name = self.vocabulary.name(piece.text) if piece.kind == WORD else None
            if name is not None and (not self.strict or self.vocabulary.is_a(name, type_)):
                return begin + 1
        self.said.note(place, A_NAME)
        return None

    def _both(self, type_: str, place: int) -> Iterator[tuple[int, SlotWords]]:
        begin = self.said.word(place, "both")
        if begin is None:
            return
        for end, mentions in self._list(type_, begin):
            if len(mentions) == 2:
                yield end, SlotWords("list", self._pieces(place, end), mentions)
        of = self.said.word(begin, "of")
        for end, owner in self._said(self.vocabulary.nouns(type_), begin if of is None else of):
            yield end, SlotWords("both", self._pieces(place, end), owner=owner)

    def _all(self, type_: str, place: int) -> Iterator[tuple[int, SlotWords]]:
        """All, every or each, with or without a noun and a number; and what is left out."""
        first = self.said.one_of(place, ALL_WORDS)
        if first is None:
            return
        begin = self.said.words(first, ("one", "of"))
        begin = begin if begin is not None else self.said.word(first, "of") or first
        counted = self.said.number(begin)
        ends = list(self._said(self.vocabulary.nouns(type_), begin if counted is None else counted))
        if self.pieces_at(first).lower in ("all", "everything"):
            ends.append((first, ""))
        if counted is not None and self.pieces_at(first).lower == "all":
            yield (
                counted,
                SlotWords(
                    "list", self._pieces(place, counted), (self._counted("", counted, counted),)
                ),
            )
        for end, owner in ends:
            number = (self._counted(owner, counted, end),) if counted is not None and owner else ()
            how = "all" if owner or self.pieces_at(first).lower != "all" else "bare"
            yield end, SlotWords(how, self._pieces(place, end), number, owner or type_)

    def _counted(self, owner: str, number: int, end: int) -> SlotMention:
        return SlotMention("counted", owner, (self._last(number),), self._pieces(number - 1, end))

    def pieces_at(self, end: int) -> SentencePiece:
        """The piece before a place."""
        return self.said.pieces[end - 1]

    def _others(self, type_: str, place: int) -> Iterator[tuple[int, SlotWords]]:
        """The other probes, the remaining ones, the rest."""
        whole = self.said.word(place, "all")
        begin = place if whole is None else whole
        if (end := self.said.one_of(begin, OTHER_WORDS)) is not None:
            count = self.said.number(end)
            behind, many = (
                (end, ()) if count is None else (count, (self._counted("", count, count),))
            )
            for after, owner in self._said(self.vocabulary.nouns(type_), behind):
                yield after, SlotWords("others", self._pieces(place, after), many, owner)
            if count is not None:
                yield count, SlotWords("others", self._pieces(place, count), many, type_)
        for words in (
            ("others",),
            ("rest",),
            ("other", "ones"),
            ("other", "one"),
            ("remaining", "ones"),
        ):
            if (end := self.said.words(begin, words)) is not None:
                yield end, SlotWords("others", self._pieces(place, end), owner=type_)
                if words == ("rest",) and (of := self.said.word(end, "of")) is not None:
                    for after, owner in self._said(self.vocabulary.nouns(type_), of):
                        yield after, SlotWords("others", self._pieces(place, after), owner=owner)

    def _pronoun(self, type_: str, place: int) -> Iterator[tuple[int, SlotWords]]:
        for end in self._pronouns(place):
            yield end, SlotWords("pronoun", self._pieces(place, end), owner=type_)
        if (behind := self.said.one_of(place, POINTING)) is not None:
            for after, owner in self._said(self.vocabulary.nouns(type_), behind):
                yield after, SlotWords("pronoun", self._pieces(place, after), owner=owner)

    def _pronouns(self, place: int) -> Iterator[int]:
        wholes = (self.said.words(place, (whole, "of")) for whole in ("both", "all", "each"))
        for of in (whole for whole in wholes if whole is not None):
            if (end := self.said.one_of(of, PRONOUNS)) is not None:
                yield end
        if (end := self.said.one_of(place, PRONOUNS)) is not None:
            yield end
            if (both := self.said.one_of(end, ("both", "all"))) is not None and self.pieces_at(
                end
            ).lower != "it":
                yield both

    def _said(self, nouns: Nouns, place: int) -> Iterator[tuple[int, str]]:
        """The nouns that are said at a place, the longest first, with their owners."""
        for first in nouns if len(nouns) <= MOST_NOTED else ():
            self.said.word(place, first)
        words_here = dict.fromkeys(
            self.said.pieces[start].lower for start in self.said.starts(place)
        )
        nouns_here = (noun for word in words_here for noun in nouns.get(word, ()))
        noun_ends = [
            (end, owner)
            for noun, owner in nouns_here
            if (end := self.said.words(place, noun)) is not None
        ]
        yield from sorted(dict.fromkeys(noun_ends), key=lambda noun_end: -noun_end[0])

    def _last(self, end: int) -> SentencePiece:
        return self.pieces_at(end)

    def _pieces(self, begin: int, end: int) -> tuple[SentencePiece, ...]:
        return self.said.pieces[
            self.said.start(begin) if self.said.start(begin) < end else begin : end
        ]


def _as_count(mention: SlotMention) -> SlotMention:
    """A number in words alone says how many, unless other objects with a noun stand before it:
    "heat two", "all but one".
    """
    alone = mention.how == "numbered" and not mention.owner and len(mention.pieces) == 1
    return replace(mention, how="counted") if alone and mention.ends[0].kind == WORD else mention


MOVED, UNFIT, LEFT_OUT = 1, 100, 10_000  # costs of a reading


@dataclass(frozen=True, slots=True)
class Book:
    """What sentences are read with: the phrases as they are written, those in another order,
    and the nouns.
    """

    natural: PhraseNode
    moved: PhraseNode
    vocabulary: NounVocabulary


@dataclass(frozen=True, slots=True)
class Match:
    """A form that was found: the place after it, what fills its slots, and its cost.

    `again` means that it is said in short, for an act that was said before: "once heated".
    `passive` means that it says what should be done: "probe 1 must be heated". `shared` means that
    its verb is that of the clause before: "..., b2 first".
    """

    end: int
    form: PhraseForm
    values: tuple[SlotWords, ...]
    cost: int = 0
    again: bool = False
    passive: bool = False
    shared: bool = False


@dataclass(slots=True)
class Matcher:
    """Matches phrases in one sentence. With `short`, objects may be left out."""

    book: Book
    said: SentenceReader
    short: bool
    mentions: Mentions = field(init=False)

    def __post_init__(self) -> None:
        self.mentions = Mentions(self.said, self.book.vocabulary, self.short)

    def whole(self) -> Iterator[Match]:
        """The phrases, as they are written, that the whole sentence says with objects that fit."""
        matches = self.walk(self.book.natural, 0, ())
        return (
            match
            for match in matches
            if match.end == len(self.said.pieces) and not self.unfit(match)
        )

    def forms(self, begin: int) -> Iterator[Match]:
        """The phrases that are said whole from a place on."""
        yield from self.walk(self.book.natural, begin, ())
        words_here = {self.said.pieces[start].lower for start in self.said.starts(begin)}
        for word in sorted(words_here & set(self.book.moved.words)):
            if (end := self.said.word(begin, word)) is not None:
                yield from self.walk(self.book.moved.words[word], end, ())

    def walk(
        self,
        node: PhraseNode,
        place: int,
        values: tuple[SlotWords, ...],
        things: Sequence[tuple[str, ...]] = (),
    ) -> Iterator[Match]:
        """The forms behind a node that are said from a place on.

        `things` are what "it" can stand for.
        """
        for form in node.ends:
            yield Match(place, form, values)
        for word, following in node.words.items():
            if (end := self.said.word(place, word)) is not None:
                yield from self.walk(following, end, values, things)
        for type_, following in node.slots.items():
            for end, words in self.slot(type_, place):
                yield from self.walk(following, end, (*values, words), things)
        for antecedent in things:
            thing_node = follow_parts(node, [PatternWord(word) for word in antecedent])
            if thing_node is not None and (end := self.said.word(place, "it")) is not None:
                yield from self.walk(thing_node, end, values)

    def slot(self, type_: str, place: int) -> Iterator[tuple[int, SlotWords]]:
        """What can fill a slot from a place on, by the place after it.

        In a clause that leaves words out, nothing may fill it.
        """
        if self.short and type_ not in NUMERIC_TYPES:
            yield (
                place,
                SlotWords(
                    "omitted", self.said.pieces[max(place - 1, 0) : max(place, 1)], owner=type_
                ),
            )
        if type_ == "time":
            if (time := self.said.time(place)) is not None:
                offset = self.said.pieces[self.said.start(place)].offset
                yield (
                    time[0],
                    SlotWords("value", (SentencePiece("time", time[2], offset, time[1]),)),
                )
        elif type_ == "int":
            if (end := self.said.number(place)) is not None:
                yield end, SlotWords("value", (self.said.pieces[end - 1],))
        else:
            yield from self.mentions.at(type_, place).items()

    def unfit(self, match: Match) -> int:
        """The cost of objects that are not of the type of their slot."""
        types = [part.type for part in match.form.parts if isinstance(part, PatternSlot)]
        wrong = sum(
            self._misfits(words, type_) for words, type_ in zip(match.values, types, strict=True)
        )
        return UNFIT * wrong + LEFT_OUT * sum(words.how == "omitted" for words in match.values)

    def _misfits(self, words: SlotWords, type_: str) -> int:
        book = self.book.vocabulary
        named = (
            book.name(end.text)
            for mention in words.mentions
            if mention.how in ("named", "names")
            for end in mention.ends
        )
        numbers = (
            end
            for mention in words.mentions
            if mention.how == "numbered" and not mention.owner
            for end in mention.ends
        )
        wrong = sum(name is not None and not book.is_a(name, type_) for name in named)
        return wrong + sum(not book.numbered(type_, end.value) for end in numbers)


def follow_parts(node: PhraseNode, parts: Sequence[PatternWord | PatternSlot]) -> PhraseNode | None:
    """The node that some parts lead to."""
    reached: PhraseNode | None = node
    for part in parts:
        if reached is not None:
            reached = (
                reached.words.get(part.text)
                if isinstance(part, PatternWord)
                else reached.slots.get(part.type)
            )
    return reached
