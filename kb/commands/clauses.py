"""The clauses of a sentence: which phrases it says, what fills their slots, and how they are joined.

All readings are followed from left to right, and the best one is kept for each place. The best reading needs the fewest words
that are left out, then the fewest objects that do not fit, then the fewest phrases in another order; then the earlier phrase wins.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

from cellwright.kb.commands.joints import Joint, before, behind, closes, joints, linking
from cellwright.kb.commands.linked import again, linked, wished
from cellwright.kb.commands.matching import LEFT_OUT, MOVED, Book, Match, Matcher, along
from cellwright.kb.commands.patterns import PREPOSITIONS, Slot, Word
from cellwright.kb.commands.phrasebook import Form
from cellwright.kb.commands.reading import Said
from cellwright.kb.commands.tokens import Piece
from cellwright.kb.commands.words import Words
from cellwright.kb.model.domain import NUMERIC_TYPES

LINKED = ("after", "before")
FIRST = ("first", "that")


@dataclass(frozen=True, slots=True)
class Clause:
    """One phrase in a sentence: its form, the content of its slots, where it begins, and whether "then" precedes it.

    `link` is "after" or "before" for a clause such as "after heating probe 1", which stands before or behind another. It is
    "first" or "that" for one that comes before all that was said, or before the clause before it: "but first open the drawer".
    `again` means that it stands in short for an act that was said before, `passive` that it says what should be done.
    `marked` says that a comma or "and" precedes it, `stop` that a sentence or half of one begins with it. `waits` has the
    offsets of the clauses that it waits for.
    """

    form: Form
    values: tuple[Words, ...]
    offset: int
    then: bool
    link: str = ""
    marked: bool = False
    stop: bool = False
    waits: frozenset[int] = frozenset()
    again: bool = False
    passive: bool = False

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


def read_clauses(book: Book, text: str) -> list[Clause]:
    """The clauses of a sentence, in the order said. Raises `NotUnderstood`."""
    searches: list[Search] = []
    for apart in (False, True) if _has_joined(text) else (False,):
        for short in (False, True):
            searches.append(Search(book, text, short, apart))
            if (found := searches[-1].run()) is not None:
                return found
    last = max((each.said for each in searches), key=lambda said: said.offset(said.furthest()))
    expected = last.expected.get(last.furthest(), set())
    raise NotUnderstood(last.pieces, last.furthest(), frozenset(expected))


def _has_joined(text: str) -> bool:
    """Whether a sentence has words that can be taken apart, so that it may be understood where it is not as it stands."""
    said = Said(text)
    return said.pieces != Said(text, apart=True).pieces


@dataclass(slots=True)
class Search:
    """One search for the best reading. With `short`, a clause may leave out words that the clause before it has.

    With `apart`, joined words such as "heater-shaker" are read as several.
    """

    book: Book
    text: str
    short: bool
    apart: bool = False
    said: Said = field(init=False)
    matcher: Matcher = field(init=False)

    def __post_init__(self) -> None:
        self.said = Said(self.text, self.apart)
        self.matcher = Matcher(self.book, self.said, self.short)

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
        link = earlier.clause.link if earlier is not None and earlier.clause.link in LINKED else ""
        if earlier is None or joint.marked or link:
            goes_on = earlier is not None and not joint.stop
            for begin, polite, place in before(self.said, joint.end, goes_on):
                said = (
                    *self.matcher.forms(begin),
                    *wished(self.matcher, begin, earlier is not None and earlier.clause.passive),
                )
                for match in (*said, *self._short(earlier, begin)):
                    if earlier is not None or not place:
                        yield from self._ended(earlier, joint, begin, match, place, polite)
        for begin, each in self._links(joint, link):
            for match in (*linked(self.matcher, begin), *self._again(earlier, begin)):
                yield from self._ended(earlier, joint, joint.end, match, each)

    def _links(self, joint: Joint, link: str) -> Iterator[tuple[int, str]]:
        """Where an act that another one comes after or before can begin; or one more of the same kind."""
        if link and joint.marked and not joint.then:
            yield joint.end, link
        yield from linking(self.said, joint.end)

    def _ended(
        self,
        earlier: _Reading | None,
        joint: Joint,
        begin: int,
        match: Match,
        link: str,
        polite: bool = False,
    ) -> Iterator[_Reading]:
        offset = self.said.pieces[self.said.start(begin)].offset
        cost, count, order = earlier.cost if earlier is not None else (0, 0, 0)
        cost += match.cost + self.matcher.unfit(match) + (MOVED if match.form.moved else 0)
        for end, last, place in behind(self.said, match.end, earlier is None):
            if match.values and match.values[-1].but and _says_first(self.said.pieces[match.end : end]):
                continue  # "store all probes but probe 2 first" leaves nothing out
            then = joint.then or last
            if then and place == "first":
                place = ""  # "then open the drawer first": before what follows
            if match.shared and "first" in (place, link):
                place = link = (
                    "that"  # "fill all bottles, then pack them, b2 first": b2 is packed first, not before all
                )
            clause = Clause(
                match.form,
                match.values,
                offset,
                then,
                link or place,
                joint.marked,
                joint.stop,
                again=match.again,
                passive=match.passive,
            )
            total = (cost, count + 1, order + match.form.phrase)
            yield _Reading(end, total, clause, earlier, polite or (earlier is not None and earlier.polite))

    def _again(self, earlier: _Reading | None, begin: int) -> Iterator[Match]:
        """Acts behind "after" or "before" that share words with an earlier clause: "once heated", "measure m1 before m2"."""
        if self.short and earlier is not None:
            yield from (replace(each, cost=LEFT_OUT) for each in self._shared(earlier.clause, begin))
            yield from again(self.matcher, begin, [(each.form, each.values) for each in earlier.clauses()])

    def _short(self, earlier: _Reading | None, begin: int) -> Iterator[Match]:
        """The clauses that share words with the one before: "... and probe 2 for 10 min", "... and close it"."""
        if not self.short or earlier is None:
            return
        for match in self._shared(earlier.clause, begin):
            yield replace(match, cost=match.cost + LEFT_OUT, shared=True)
        things = [each for clause in earlier.clauses() for each in self._things(clause)]
        for word, node in self.book.natural.words.items():
            if (end := self.said.word(begin, word)) is not None:
                for match in self.matcher.walk(node, end, (), tuple(dict.fromkeys(things))[:10]):
                    yield replace(match, cost=match.cost + LEFT_OUT)

    def _shared(self, clause: Clause, begin: int) -> Iterator[Match]:
        form = clause.form
        root = self.book.moved if form.moved else self.book.natural
        verb = form.verb
        while verb and verb[-1] in PREPOSITIONS:
            verb = verb[:-1]  # "go to m3, then to m4"
        starts = {
            len(verb),
            len(form.verb),
            *(n + 1 for n, part in enumerate(form.parts) if isinstance(part, Slot)),
        }
        for start in sorted(starts - {len(form.parts)}):
            node = along(root, form.parts[:start])
            slots = sum(isinstance(part, Slot) for part in form.parts[:start])
            if node is not None:
                yield from (
                    each for each in self.matcher.walk(node, begin, clause.values[:slots]) if each.end > begin
                )
            yield from self._with_the_same_end(clause, start, begin, clause.values[:slots])

    def _with_the_same_end(
        self, clause: Clause, start: int, place: int, values: tuple[Words, ...], first: bool = True
    ) -> Iterator[Match]:
        """Only some parts from `start` on are said; what follows is as in the clause before. `first`: nothing is said yet."""
        part = clause.form.parts[start] if start < len(clause.form.parts) else None
        if isinstance(part, Word):
            if (end := self.said.word(place, part.text)) is not None:
                yield from self._with_the_same_end(clause, start + 1, end, values, False)
        elif part is not None:
            numbers = any(isinstance(each, Slot) and each.type in NUMERIC_TYPES for each in clause.form.parts)
            for end, words in self.matcher.slot(part.type, place):
                if first and numbers and _is_bare_number(words):
                    continue  # "put probe 1 into depot 2 and 3": nobody can say which one is meant
                now = (*values, words)
                if end > place and clause.form.parts[start + 1 :]:
                    yield Match(end, clause.form, (*now, *clause.values[len(now) :]), LEFT_OUT)
                yield from self._with_the_same_end(clause, start + 1, end, now, False)

    def _things(self, clause: Clause) -> Iterator[tuple[str, ...]]:
        """What a clause names in the words of its phrase: objects, or all words behind the verb."""
        words = tuple(part.text if isinstance(part, Word) else "" for part in clause.form.parts)
        for found in reversed(self.book.vocabulary.named(clause.form.parts)):
            yield words[found.first : found.last + 1]
        if "" not in words:
            yield words[len(clause.form.verb) :]


def _is_bare_number(words: Words) -> bool:
    """Whether a slot is filled by numbers alone."""
    return all(each.how == "numbered" and not each.owner for each in words.mentions) and bool(words.mentions)


def _says_first(pieces: Sequence[Piece]) -> bool:
    return any(each.lower in ("first", "beforehand", "before") for each in pieces)
