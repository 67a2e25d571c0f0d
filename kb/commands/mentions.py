"""How a sentence names the objects of a slot: by numbers, names, ranges, "all", "both", "the others", pronouns."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from cellwright.kb.commands.reading import A_NAME, Said
from cellwright.kb.commands.tokens import DASHES, WORD, Piece
from cellwright.kb.commands.vocabulary import Nouns, Vocabulary
from cellwright.kb.commands.words import Mention, Words

PRONOUNS = ("it", "them", "they", "these", "those", "both", "each")
POINTING = ("this", "that", "these", "those", "same")
ALL = ("all", "each", "every", "everything")
UNTIL = ("to", "through", *DASHES)
OTHERS = ("other", "remaining")
BUT = (
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
ORDINALS = (
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
NUMBERED = (("number",), ("no",), ("no", "."), ("nr",), ("nr", "."), ("#",))


class Mentions:
    """The readings of slots in one sentence: `at(type, place)` gives each place where a reading may end.

    With `strict`, a name of an object of another type is no reading; otherwise it is one, and is reported later.
    """

    def __init__(self, said: Said, vocabulary: Vocabulary, strict: bool) -> None:
        self.said, self.vocabulary, self.strict = said, vocabulary, strict
        self._known: dict[tuple[str, int], dict[int, Words]] = {}

    def at(self, type_: str, place: int) -> dict[int, Words]:
        """The contents that a slot of a type can have from a place on, by the place after them."""
        if (type_, place) not in self._known:
            found: dict[int, Words] = {}
            for end, words in self._slot(type_, place):
                found.setdefault(end, words)
            self._known[type_, place] = found
        return self._known[type_, place]

    def _slot(self, type_: str, place: int) -> Iterator[tuple[int, Words]]:
        for end, words in self._whole(type_, place):
            yield end, words
            yield from self._without(type_, place, end, words)

    def _whole(self, type_: str, place: int) -> Iterator[tuple[int, Words]]:
        """The contents of a slot, before anything is left out of them."""
        for end, mentions in self._list(type_, place):
            yield end, Words("list", self._pieces(place, end), mentions)
            comma = self.said.word(end, ",")
            for after in (end, comma) if len(mentions) > 1 and comma is not None else (end,):
                if len(mentions) > 1 and (each := self.said.one_of(after, ("each", "both"))) is not None:
                    yield each, Words("list", self._pieces(place, each), mentions)
        yield from self._both(type_, place)
        yield from self._all(type_, place)
        yield from self._others(type_, place)
        yield from self._pronoun(type_, place)

    def _without(self, type_: str, place: int, end: int, words: Words) -> Iterator[tuple[int, Words]]:
        """The same objects without some that are named behind "except"."""
        if (
            words.how == "list"
            and len(words.mentions) == 1
            and words.mentions[0].how not in ("numbers", "names")
        ):
            return
        behind = [self.said.words(end, each) for each in BUT]
        if (comma := self.said.word(end, ",")) is not None:
            behind += [self.said.words(comma, each) for each in BUT_BEHIND_A_COMMA]
        for but in (each for each in behind if each is not None):
            for after, left in self._list(words.owner or type_, but):
                yield after, replace(words, pieces=self._pieces(place, after), but=left)

    def _list(self, type_: str, place: int) -> Iterator[tuple[int, tuple[Mention, ...]]]:
        """Lists of mentions, the shortest first. After "and", each further mention makes a longer list."""
        ends: list[tuple[int, tuple[Mention, ...]]] = [
            (end, (_as_count(each),)) for end, each in self._items(type_, place)
        ]
        seen: set[int] = set()
        while ends:
            end, mentions = ends.pop(0)
            if end in seen:
                continue
            seen.add(end)
            yield end, mentions
            for begin in self._more(end):
                ends += [(after, (*mentions, each)) for after, each in self._items(type_, begin)]

    def _more(self, place: int) -> Iterator[int]:
        comma = self.said.word(place, ",")
        if comma is not None:
            yield comma
        start = place if comma is None else comma
        for joint in (("and",), ("&",), ("as", "well", "as"), ("and", "also")):
            if (end := self.said.words(start, joint)) is not None:
                yield end

    def _items(self, type_: str, place: int) -> Iterator[tuple[int, Mention]]:
        """The mentions that begin at a place; the longest of a kind first."""
        called = list(self._said(self.vocabulary.called(type_), place))
        for end, name in called:
            yield end, Mention("called", name, (), self._pieces(place, end))
        nouns = list(self._said(self.vocabulary.nouns(type_), place))
        for end, owner in (*nouns, (place, "")):
            for begin in (end, *(e for each in NUMBERED if (e := self.said.words(end, each)) is not None)):
                yield from self._numbers(owner, place, begin, nouns)
            yield from self._names(type_, owner, place, end)
        yield from self._ranked(type_, place)
        longest = max((end for end, _ in called), default=place)
        for end, owner in (
            each for each in nouns if each[0] >= longest
        ):  # "part A" is no part with an article behind it
            yield end, Mention("sole", owner, (), self._pieces(place, end))
        if (count := self.said.number(place)) is not None:
            for end, owner in self._said(self.vocabulary.nouns(type_), count):
                yield end, Mention("counted", owner, (self._last(count),), self._pieces(place, end))

    def _ranked(self, type_: str, place: int) -> Iterator[tuple[int, Mention]]:
        """Objects by their places in a row: the first two probes, the last one, the first."""
        if (end := self.said.one_of(place, ORDINALS)) is None:
            return
        ordinal, count = self.said.pieces[end - 1], self.said.number(end)
        many = () if count is None else (self.pieces_at(count),)
        behind = end if count is None else count
        for after, owner in self._said(self.vocabulary.nouns(type_), behind):
            yield after, Mention("ranked", owner, (ordinal, *many), self._pieces(place, after))
        if self.said.start(place) > place or (many and many[0].lower == "one"):  # "the first", "first one"
            yield behind, Mention("ranked", "", (ordinal, *many), self._pieces(place, behind))

    def _numbers(
        self, owner: str, place: int, begin: int, nouns: Sequence[tuple[int, str]]
    ) -> Iterator[tuple[int, Mention]]:
        end = self.said.number(begin)
        if end is None:
            return
        first = self._last(end)
        if (until := self.said.one_of(end, UNTIL)) is not None:
            after = next((e for e, each in self._nouns_at(until, nouns)), until)
            if (last := self.said.number(after)) is not None:
                yield last, Mention("numbers", owner, (first, self._last(last)), self._pieces(place, last))
        yield end, Mention("numbered", owner, (first,), self._pieces(place, end))

    def _nouns_at(self, place: int, nouns: Sequence[tuple[int, str]]) -> Iterator[tuple[int, str]]:
        """The same nouns again, as in "probe 1 to probe 3"."""
        for _, owner in nouns:
            yield from self._said(self.vocabulary.nouns(owner), place)

    def _names(self, type_: str, owner: str, place: int, begin: int) -> Iterator[tuple[int, Mention]]:
        end = self._name(begin, type_)
        if end is None:
            return
        first = self._last(end)
        if (until := self.said.one_of(end, UNTIL)) is not None:
            last = self._name(until, type_)
            last = self.said.number(until) if last is None else last
            if last is not None:
                yield last, Mention("names", owner, (first, self._last(last)), self._pieces(place, last))
        yield end, Mention("named", owner, (first,), self._pieces(place, end))

    def _name(self, place: int, type_: str) -> int | None:
        """The place after the name of an object."""
        for begin in self.said.starts(place):
            piece = self.said.pieces[begin]
            name = self.vocabulary.name(piece.text) if piece.kind == WORD else None
            if name is not None and (not self.strict or self.vocabulary.is_a(name, type_)):
                return begin + 1
        self.said.note(place, A_NAME)
        return None

    def _both(self, type_: str, place: int) -> Iterator[tuple[int, Words]]:
        begin = self.said.word(place, "both")
        if begin is None:
            return
        for end, mentions in self._list(type_, begin):
            if len(mentions) == 2:
                yield end, Words("list", self._pieces(place, end), mentions)
        of = self.said.word(begin, "of")
        for end, owner in self._said(self.vocabulary.nouns(type_), begin if of is None else of):
            yield end, Words("both", self._pieces(place, end), owner=owner)

    def _all(self, type_: str, place: int) -> Iterator[tuple[int, Words]]:
        """All, every or each, with or without a noun and a number; and what is left out."""
        first = self.said.one_of(place, ALL)
        if first is None:
            return
        begin = self.said.words(first, ("one", "of"))
        begin = begin if begin is not None else self.said.word(first, "of") or first
        counted = self.said.number(begin)
        ends = list(self._said(self.vocabulary.nouns(type_), begin if counted is None else counted))
        if self.pieces_at(first).lower in ("all", "everything"):
            ends.append((first, ""))
        if counted is not None and self.pieces_at(first).lower == "all":
            yield counted, Words("list", self._pieces(place, counted), (self._counted("", counted, counted),))
        for end, owner in ends:
            number = (self._counted(owner, counted, end),) if counted is not None and owner else ()
            how = "all" if owner or self.pieces_at(first).lower != "all" else "bare"
            yield end, Words(how, self._pieces(place, end), number, owner or type_)

    def _counted(self, owner: str, number: int, end: int) -> Mention:
        return Mention("counted", owner, (self._last(number),), self._pieces(number - 1, end))

    def pieces_at(self, end: int) -> Piece:
        """The piece before a place."""
        return self.said.pieces[end - 1]

    def _others(self, type_: str, place: int) -> Iterator[tuple[int, Words]]:
        """The other probes, the remaining ones, the rest."""
        whole = self.said.word(place, "all")
        begin = place if whole is None else whole
        if (end := self.said.one_of(begin, OTHERS)) is not None:
            count = self.said.number(end)
            behind, many = (end, ()) if count is None else (count, (self._counted("", count, count),))
            for after, owner in self._said(self.vocabulary.nouns(type_), behind):
                yield after, Words("others", self._pieces(place, after), many, owner)
            if count is not None:
                yield count, Words("others", self._pieces(place, count), many, type_)
        for words in (("others",), ("rest",), ("other", "ones"), ("other", "one"), ("remaining", "ones")):
            if (end := self.said.words(begin, words)) is not None:
                yield end, Words("others", self._pieces(place, end), owner=type_)
                if words == ("rest",) and (of := self.said.word(end, "of")) is not None:
                    for after, owner in self._said(self.vocabulary.nouns(type_), of):
                        yield after, Words("others", self._pieces(place, after), owner=owner)

    def _pronoun(self, type_: str, place: int) -> Iterator[tuple[int, Words]]:
        for end in self._pronouns(place):
            yield end, Words("pronoun", self._pieces(place, end), owner=type_)
        if (behind := self.said.one_of(place, POINTING)) is not None:
            for after, owner in self._said(self.vocabulary.nouns(type_), behind):
                yield after, Words("pronoun", self._pieces(place, after), owner=owner)

    def _pronouns(self, place: int) -> Iterator[int]:
        wholes = (self.said.words(place, (whole, "of")) for whole in ("both", "all", "each"))
        for of in (each for each in wholes if each is not None):
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
        here = dict.fromkeys(self.said.pieces[each].lower for each in self.said.starts(place))
        said = (each for word in here for each in nouns.get(word, ()))
        found = [(end, owner) for noun, owner in said if (end := self.said.words(place, noun)) is not None]
        yield from sorted(dict.fromkeys(found), key=lambda each: -each[0])

    def _last(self, end: int) -> Piece:
        return self.pieces_at(end)

    def _pieces(self, begin: int, end: int) -> tuple[Piece, ...]:
        return self.said.pieces[self.said.start(begin) if self.said.start(begin) < end else begin : end]


def _as_count(mention: Mention) -> Mention:
    """A number in words alone says how many, unless other objects with a noun stand before it: "heat two", "all but one"."""
    alone = mention.how == "numbered" and not mention.owner and len(mention.pieces) == 1
    return replace(mention, how="counted") if alone and mention.ends[0].kind == WORD else mention
