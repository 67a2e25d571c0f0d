"""The clauses of a sentence: which phrases it says, what fills their slots, and how they are joined.

All readings are followed from left to right, and the best one is kept for each place. The best reading needs the fewest words
that are left out, then the fewest objects that do not fit, then the fewest phrases in another order; then the earlier phrase wins.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

from kb.commands.joints import Joint, before, behind, closes, joints
from kb.commands.mentions import Mentions, Words
from kb.commands.patterns import Slot, Word
from kb.commands.phrasebook import Form, Node, gerunds
from kb.commands.reading import Said
from kb.commands.tokens import Piece
from kb.commands.vocabulary import Vocabulary

LINKS = ("after", "before")


@dataclass(frozen=True, slots=True)
class Clause:
    """One phrase in a sentence: its form, the content of its slots, where it begins, and whether "then" precedes it.

    `link` is "after" or "before" for a clause such as "after heating probe 1", which stands before or behind another.
    `marked` says that a comma or "and" precedes it.
    """

    form: Form
    values: tuple[Words, ...]
    offset: int
    then: bool
    link: str = ""
    marked: bool = False

    @property
    def slots(self) -> dict[str, Words]:
        """What fills each slot, by its variable."""
        found = [part.variable for part in self.form.parts if isinstance(part, Slot)]
        return dict(zip(found, self.values, strict=True))


class NotUnderstood(Exception):
    """The sentence is not understood from piece `index` on. `expected` holds what is possible there."""

    def __init__(self, said: Sequence[Piece], index: int, expected: frozenset[str]) -> None:
        super().__init__("not understood")
        self.said, self.index, self.expected = tuple(said), index, expected


@dataclass(frozen=True, slots=True)
class _Reading:
    """The clauses up to a place, the last one first, with their cost."""

    place: int
    cost: tuple[int, int, int]
    clause: Clause
    earlier: "_Reading | None"
    polite: bool = False

    def clauses(self) -> Iterator[Clause]:
        """The clauses, the last one first."""
        reading: _Reading | None = self
        while reading is not None:
            yield reading.clause
            reading = reading.earlier


@dataclass(frozen=True, slots=True)
class _Match:
    """A form that was found: the place after it, what fills its slots, and its cost."""

    end: int
    form: Form
    values: tuple[Words, ...]
    cost: int = 0


MOVED, UNFIT, LEFT_OUT = 1, 100, 10_000  # costs of a reading


@dataclass(frozen=True, slots=True)
class Clauses:
    """Reads sentences with the phrases of `natural` and, in another order of their parts, of `moved`."""

    natural: Node
    moved: Node
    vocabulary: Vocabulary

    def read(self, text: str) -> list[Clause]:
        """The clauses of a sentence, in the order said. Raises `NotUnderstood`."""
        first = _Search(self, text, False)
        if (found := first.run()) is not None:
            return found
        second = _Search(self, text, True)
        if (found := second.run()) is not None:
            return found
        last = max((first.said, second.said), key=Said.furthest)
        expected = last.expected.get(last.furthest(), set())
        raise NotUnderstood(last.pieces, last.furthest(), frozenset(expected))


@dataclass(slots=True)
class _Search:
    """One search for the best reading. With `short`, a clause may leave out words that the clause before it has."""

    book: Clauses
    text: str
    short: bool
    said: Said = field(init=False)
    mentions: Mentions = field(init=False)

    def __post_init__(self) -> None:
        self.said = Said(self.text)
        self.mentions = Mentions(self.said, self.book.vocabulary)

    def run(self) -> list[Clause] | None:
        """The best reading of the whole sentence, if there is one."""
        best: dict[int, dict[tuple[object, ...], _Reading]] = {}
        self._add(best, self._next(None, Joint(0, False, False)))
        ends: list[_Reading] = []
        for place in range(len(self.said.pieces) + 1):
            for reading in best.pop(place, {}).values():
                if closes(self.said, place, reading.polite):
                    ends.append(reading)
                else:
                    self._add(best, self._following(reading))
        found = min(ends, key=lambda each: each.cost, default=None)
        return [*found.clauses()][::-1] if found is not None else None

    def _add(self, best: dict[int, dict[tuple[object, ...], _Reading]], readings: Iterator[_Reading]) -> None:
        for reading in readings:
            form = (reading.clause.form.phrase, reading.clause.form.parts) if self.short else ()
            key = (reading.clause.link, reading.polite, *form)
            known = best.setdefault(reading.place, {}).get(key)
            if known is None or reading.cost < known.cost:
                best[reading.place][key] = reading

    def _following(self, reading: _Reading) -> Iterator[_Reading]:
        nothing = Joint(reading.place, False, False)
        for joint in (nothing, *joints(self.said, reading.place)):
            yield from self._next(reading, joint)

    def _next(self, earlier: _Reading | None, joint: Joint) -> Iterator[_Reading]:
        """The readings with one clause more, after a joint."""
        link = earlier.clause.link if earlier is not None else ""
        if earlier is None or joint.marked or link:
            for begin, polite in before(self.said, joint.end):
                for match in (*self._forms(begin), *self._short(earlier, begin)):
                    yield from self._ended(earlier, joint, begin, match, "", polite)
        if link and joint.marked and not joint.then:
            for match in self._forms(joint.end, gerund=True):
                yield from self._ended(earlier, joint, joint.end, match, link)
        for word in LINKS:
            if (begin := self.said.word(joint.end, word)) is not None:
                for match in self._forms(begin, gerund=True):
                    yield from self._ended(earlier, joint, joint.end, match, word)

    def _ended(
        self, earlier: _Reading | None, joint: Joint, begin: int, match: _Match, link: str, polite: bool = False
    ) -> Iterator[_Reading]:
        offset = self.said.pieces[self.said.start(begin)].offset
        cost, count, order = earlier.cost if earlier is not None else (0, 0, 0)
        cost += match.cost + self._unfit(match) + (MOVED if match.form.moved else 0)
        for end, last in behind(self.said, match.end, earlier is None):
            clause = Clause(match.form, match.values, offset, joint.then or last, link, joint.marked)
            total = (cost, count + 1, order + match.form.phrase)
            yield _Reading(end, total, clause, earlier, polite or (earlier is not None and earlier.polite))

    def _unfit(self, match: _Match) -> int:
        """The cost of objects that are not of the type of their slot."""
        types = [part.type for part in match.form.parts if isinstance(part, Slot)]
        return sum(
            UNFIT * self._misfits(words, type_) for words, type_ in zip(match.values, types, strict=True)
        )

    def _misfits(self, words: Words, type_: str) -> int:
        book = self.book.vocabulary
        named = (book.name(end.text) for each in words.mentions if each.how in ("named", "names") for end in each.ends)
        numbers = (end for each in words.mentions if each.how == "numbered" and not each.owner for end in each.ends)
        wrong = sum(name is not None and not book.is_a(name, type_) for name in named)
        return wrong + sum(not book.numbered(type_, end.value) for end in numbers)

    # phrases

    def _forms(self, begin: int, gerund: bool = False) -> Iterator[_Match]:
        """The phrases that are said whole from a place on."""
        if gerund:
            yield from self._gerunds(begin)
            return
        yield from self._walk(self.book.natural, begin, ())
        here = {self.said.pieces[each].lower for each in self.said.starts(begin)}
        for word in sorted(here & set(self.book.moved.words)):
            if (end := self.said.word(begin, word)) is not None:
                yield from self._walk(self.book.moved.words[word], end, ())

    def _gerunds(self, begin: int) -> Iterator[_Match]:
        for root in (self.book.natural, self.book.moved):
            for verb, node in root.words.items():
                if (end := self.said.one_of(begin, gerunds(verb))) is not None:
                    yield from self._walk(node, end, ())

    def _walk(
        self, node: Node, place: int, values: tuple[Words, ...], things: Sequence[tuple[str, ...]] = ()
    ) -> Iterator[_Match]:
        """The forms behind a node that are said from a place on. `things` are what "it" can stand for."""
        for form in node.ends:
            yield _Match(place, form, values)
        for word, following in node.words.items():
            if (end := self.said.word(place, word)) is not None:
                yield from self._walk(following, end, values, things)
        for type_, following in node.slots.items():
            for end, words in self._slot(type_, place):
                yield from self._walk(following, end, (*values, words), things)
        for thing in things:
            found = self._along(node, [Word(word) for word in thing])
            if found is not None and (end := self.said.word(place, "it")) is not None:
                yield from self._walk(found, end, values)

    def _slot(self, type_: str, place: int) -> Iterator[tuple[int, Words]]:
        if type_ == "time":
            if (time := self.said.time(place)) is not None:
                offset = self.said.pieces[self.said.start(place)].offset
                yield time[0], Words("value", (Piece("time", time[2], offset, time[1]),))
        elif type_ == "int":
            if (end := self.said.number(place)) is not None:
                yield end, Words("value", (self.said.pieces[end - 1],))
        else:
            yield from self.mentions.at(type_, place).items()

    # clauses that leave words out

    def _short(self, earlier: _Reading | None, begin: int) -> Iterator[_Match]:
        """The clauses that share words with the one before: "... and probe 2 for 10 min", "... and close it"."""
        if not self.short or earlier is None:
            return
        for match in self._shared(earlier.clause, begin):
            if not self._unfit(match):
                yield replace(match, cost=match.cost + LEFT_OUT)
        things = [each for clause in earlier.clauses() for each in self._things(clause)]
        for word, node in self.book.natural.words.items():
            if (end := self.said.word(begin, word)) is not None:
                for match in self._walk(node, end, (), tuple(dict.fromkeys(things))[:10]):
                    yield replace(match, cost=match.cost + LEFT_OUT)

    def _shared(self, clause: Clause, begin: int) -> Iterator[_Match]:
        form = clause.form
        root = self.book.moved if form.moved else self.book.natural
        starts = {len(form.verb), *(n + 1 for n, part in enumerate(form.parts) if isinstance(part, Slot))}
        for start in sorted(starts - {len(form.parts)}):
            node = self._along(root, form.parts[:start])
            slots = sum(isinstance(part, Slot) for part in form.parts[:start])
            if node is not None:
                yield from (each for each in self._walk(node, begin, clause.values[:slots]) if each.end > begin)
            if isinstance(form.parts[start], Slot) and form.parts[start + 1 :]:
                yield from self._with_the_same_end(clause, start, slots, begin)

    def _with_the_same_end(self, clause: Clause, start: int, slots: int, begin: int) -> Iterator[_Match]:
        """Only the slot at `start` is said; what follows is as in the clause before."""
        part = clause.form.parts[start]
        assert isinstance(part, Slot)
        for end, words in self._slot(part.type, begin):
            values = (*clause.values[:slots], words, *clause.values[slots + 1 :])
            yield _Match(end, clause.form, values, LEFT_OUT)

    def _along(self, node: Node, parts: Sequence[Word | Slot]) -> Node | None:
        """The node that some parts lead to."""
        found: Node | None = node
        for part in parts:
            if found is not None:
                found = found.words.get(part.text) if isinstance(part, Word) else found.slots.get(part.type)
        return found

    def _things(self, clause: Clause) -> Iterator[tuple[str, ...]]:
        """What a clause names in the words of its phrase: objects, or all words behind the verb."""
        words = tuple(part.text if isinstance(part, Word) else "" for part in clause.form.parts)
        for found in reversed(self.book.vocabulary.named(clause.form.parts)):
            yield words[found.first : found.last + 1]
        if "" not in words:
            yield words[len(clause.form.verb) :]

