"""The phrases that are said from a place on, and what fills their slots."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from cellwright.kb.commands.mentions import Mentions
from cellwright.kb.commands.patterns import Slot, Word
from cellwright.kb.commands.phrasebook import Form, Node
from cellwright.kb.commands.reading import Said
from cellwright.kb.commands.tokens import Piece
from cellwright.kb.commands.vocabulary import Vocabulary
from cellwright.kb.commands.words import Words
from cellwright.kb.model.domain import NUMERIC_TYPES

MOVED, UNFIT, LEFT_OUT = 1, 100, 10_000  # costs of a reading


@dataclass(frozen=True, slots=True)
class Book:
    """What sentences are read with: the phrases as they are written, those in another order, and the nouns."""

    natural: Node
    moved: Node
    vocabulary: Vocabulary


@dataclass(frozen=True, slots=True)
class Match:
    """A form that was found: the place after it, what fills its slots, and its cost.

    `again` means that it is said in short, for an act that was said before: "once heated". `passive` means that it says what
    should be done: "probe 1 must be heated". `shared` means that its verb is that of the clause before: "..., b2 first".
    """

    end: int
    form: Form
    values: tuple[Words, ...]
    cost: int = 0
    again: bool = False
    passive: bool = False
    shared: bool = False


@dataclass(slots=True)
class Matcher:
    """Matches phrases in one sentence. With `short`, objects may be left out."""

    book: Book
    said: Said
    short: bool
    mentions: Mentions = field(init=False)

    def __post_init__(self) -> None:
        self.mentions = Mentions(self.said, self.book.vocabulary, self.short)

    def whole(self) -> Iterator[Match]:
        """The phrases, as they are written, that the whole sentence says with objects that fit."""
        found = self.walk(self.book.natural, 0, ())
        return (each for each in found if each.end == len(self.said.pieces) and not self.unfit(each))

    def forms(self, begin: int) -> Iterator[Match]:
        """The phrases that are said whole from a place on."""
        yield from self.walk(self.book.natural, begin, ())
        here = {self.said.pieces[each].lower for each in self.said.starts(begin)}
        for word in sorted(here & set(self.book.moved.words)):
            if (end := self.said.word(begin, word)) is not None:
                yield from self.walk(self.book.moved.words[word], end, ())

    def walk(
        self, node: Node, place: int, values: tuple[Words, ...], things: Sequence[tuple[str, ...]] = ()
    ) -> Iterator[Match]:
        """The forms behind a node that are said from a place on. `things` are what "it" can stand for."""
        for form in node.ends:
            yield Match(place, form, values)
        for word, following in node.words.items():
            if (end := self.said.word(place, word)) is not None:
                yield from self.walk(following, end, values, things)
        for type_, following in node.slots.items():
            for end, words in self.slot(type_, place):
                yield from self.walk(following, end, (*values, words), things)
        for thing in things:
            found = along(node, [Word(word) for word in thing])
            if found is not None and (end := self.said.word(place, "it")) is not None:
                yield from self.walk(found, end, values)

    def slot(self, type_: str, place: int) -> Iterator[tuple[int, Words]]:
        """What can fill a slot from a place on, by the place after it. In a clause that leaves words out, nothing may fill it."""
        if self.short and type_ not in NUMERIC_TYPES:
            yield place, Words("omitted", self.said.pieces[max(place - 1, 0) : max(place, 1)], owner=type_)
        if type_ == "time":
            if (time := self.said.time(place)) is not None:
                offset = self.said.pieces[self.said.start(place)].offset
                yield time[0], Words("value", (Piece("time", time[2], offset, time[1]),))
        elif type_ == "int":
            if (end := self.said.number(place)) is not None:
                yield end, Words("value", (self.said.pieces[end - 1],))
        else:
            yield from self.mentions.at(type_, place).items()

    def unfit(self, match: Match) -> int:
        """The cost of objects that are not of the type of their slot."""
        types = [part.type for part in match.form.parts if isinstance(part, Slot)]
        wrong = sum(self._misfits(words, type_) for words, type_ in zip(match.values, types, strict=True))
        return UNFIT * wrong + LEFT_OUT * sum(words.how == "omitted" for words in match.values)

    def _misfits(self, words: Words, type_: str) -> int:
        book = self.book.vocabulary
        named = (
            book.name(end.text)
            for each in words.mentions
            if each.how in ("named", "names")
            for end in each.ends
        )
        numbers = (
            end for each in words.mentions if each.how == "numbered" and not each.owner for end in each.ends
        )
        wrong = sum(name is not None and not book.is_a(name, type_) for name in named)
        return wrong + sum(not book.numbered(type_, end.value) for end in numbers)


def along(node: Node, parts: Sequence[Word | Slot]) -> Node | None:
    """The node that some parts lead to."""
    found: Node | None = node
    for part in parts:
        if found is not None:
            found = found.words.get(part.text) if isinstance(part, Word) else found.slots.get(part.type)
    return found
