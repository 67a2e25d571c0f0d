"""Reads the clauses of a sentence: the phrases it says and what fills their slots.

All readings are followed from left to right, and the best one is kept for each place. The best
reading needs the fewest words that are left out, then the fewest objects that do not fit, then the
fewest phrases in another order; then the earlier phrase wins.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

from cellwright.kb.commands.clause_links import (
    ClauseJoint,
    clause_beginnings,
    ends_sentence,
    find_joints,
    link_beginnings,
    linked_acts,
    repeated_acts,
    timed_endings,
    wished_acts,
)
from cellwright.kb.commands.phrase_matching import (
    LEFT_OUT,
    MOVED,
    Book,
    Match,
    Matcher,
    follow_parts,
)
from cellwright.kb.commands.phrase_patterns import (
    PREPOSITIONS,
    PatternSlot,
    PatternWord,
    PhraseForm,
)
from cellwright.kb.commands.sentence_pieces import SentencePiece, SentenceReader, SlotWords
from cellwright.kb.commands.time_words import SaidTime
from cellwright.kb.model.domain_model import NUMERIC_TYPES

LINK_KINDS = ("after", "before")
FRONT_LINKS = ("first", "that")


@dataclass(frozen=True, slots=True)
class Clause:
    """One phrase in a sentence: its form, the content of its slots, where it begins, and whether
    "then" precedes it.

    `link` is "after" or "before" for a clause such as "after heating probe 1", which stands before
    or behind another. It is "first" or "that" for one that comes before all that was said, or
    before the clause before it: "but first open the drawer". `again` means that it stands in short
    for an act that was said before, `passive` that it says what should be done. `marked` says that
    a comma or "and" precedes it, `stop` that a sentence or half of one begins with it. `waits` has
    the offsets of the clauses that it waits for. `time` is the time that passes between a clause
    that follows "within 10 min of" and its act, or between the act before and a clause that has
    "within 10 min" behind it.
    """

    form: PhraseForm
    values: tuple[SlotWords, ...]
    offset: int
    then: bool
    link: str = ""
    marked: bool = False
    stop: bool = False
    waits: frozenset[int] = frozenset()
    again: bool = False
    passive: bool = False
    time: SaidTime | None = None

    @property
    def slots(self) -> dict[str, SlotWords]:
        """What fills each slot, by its variable."""
        variables = [part.variable for part in self.form.parts if isinstance(part, PatternSlot)]
        return dict(zip(variables, self.values, strict=True))


class NotUnderstood(Exception):
    """The sentence is not understood from piece `index` on.

    `expected` holds what is possible there.
    """

    def __init__(self, said: Sequence[SentencePiece], index: int, expected: frozenset[str]) -> None:
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
    searches: list[ClauseSearch] = []
    for apart in (False, True) if _has_joined(text) else (False,):
        for short in (False, True):
            searches.append(ClauseSearch(book, text, short, apart))
            if (clauses := searches[-1].run()) is not None:
                return clauses
    last = max((search.said for search in searches), key=lambda said: said.offset(said.furthest()))
    expected = last.expected.get(last.furthest(), set())
    raise NotUnderstood(last.pieces, last.furthest(), frozenset(expected))


def _has_joined(text: str) -> bool:
    """Whether a sentence has words that can be taken apart, so that it may be understood where
    it is not as it stands.
    """
    said = SentenceReader(text)
    return said.pieces != SentenceReader(text, apart=True).pieces


@dataclass(slots=True)
class ClauseSearch:
    """One search for the best reading. With `short`, a clause may leave out words that the clause
    before it has.

    With `apart`, joined words such as "heater-shaker" are read as several.
    """

    book: Book
    text: str
    short: bool
    apart: bool = False
    said: SentenceReader = field(init=False)
    matcher: Matcher = field(init=False)

    def __post_init__(self) -> None:
        self.said = SentenceReader(self.text, self.apart)
        self.matcher = Matcher(self.book, self.said, self.short)

    def run(self) -> list[Clause] | None:
        """The best reading of the whole sentence, if there is one."""
        best: dict[int, dict[tuple[object, ...], _Reading]] = {}
        self._add(best, self._next(None, ClauseJoint(0, False, False)))
        ends: list[_Reading] = []
        for place in range(len(self.said.pieces) + 1):
            for reading in best.pop(place, {}).values():
                if ends_sentence(self.said, place, reading.polite):
                    ends.append(reading)
                else:
                    self._add(best, self._following(reading))
        chosen = min(ends, key=lambda end: end.cost, default=None)
        return [*chosen.clauses()][::-1] if chosen is not None else None

    def _add(
        self, best: dict[int, dict[tuple[object, ...], _Reading]], readings: Iterator[_Reading]
    ) -> None:
        for reading in readings:
            form = (reading.clause.form.phrase, reading.clause.form.parts) if self.short else ()
            key = (reading.clause.link, reading.polite, *form)
            known_reading = best.setdefault(reading.place, {}).get(key)
            if known_reading is None or reading.cost < known_reading.cost:
                best[reading.place][key] = reading

    def _following(self, reading: _Reading) -> Iterator[_Reading]:
        nothing = ClauseJoint(reading.place, False, False)
        for joint in (nothing, *find_joints(self.said, reading.place)):
            yield from self._next(reading, joint)

    def _next(self, earlier: _Reading | None, joint: ClauseJoint) -> Iterator[_Reading]:
        """The readings with one clause more, after a joint."""
        link = (
            earlier.clause.link if earlier is not None and earlier.clause.link in LINK_KINDS else ""
        )
        if earlier is None or joint.marked or link:
            goes_on = earlier is not None and not joint.stop
            for begin, polite, place in clause_beginnings(self.said, joint.end, goes_on):
                matches = (
                    *self.matcher.forms(begin),
                    *wished_acts(
                        self.matcher, begin, earlier is not None and earlier.clause.passive
                    ),
                )
                for match in (*matches, *self._short(earlier, begin)):
                    if earlier is not None or not place:
                        yield from self._ended(earlier, joint, begin, match, place, polite)
        for begin, act_link, time in self._links(joint, link):
            for match in (*linked_acts(self.matcher, begin), *self._again(earlier, begin)):
                yield from self._ended(earlier, joint, joint.end, match, act_link, time=time)

    def _links(self, joint: ClauseJoint, link: str) -> Iterator[tuple[int, str, SaidTime | None]]:
        """Where an act that another one comes after or before can begin; or one more of the
        same kind.
        """
        if link and joint.marked and not joint.then:
            yield joint.end, link, None
        yield from link_beginnings(self.said, joint.end)

    def _ended(
        self,
        earlier: _Reading | None,
        joint: ClauseJoint,
        begin: int,
        match: Match,
        link: str,
        polite: bool = False,
        time: SaidTime | None = None,
    ) -> Iterator[_Reading]:
        offset = self.said.pieces[self.said.start(begin)].offset
        cost, count, order = earlier.cost if earlier is not None else (0, 0, 0)
        cost += match.cost + self.matcher.unfit(match) + (MOVED if match.form.moved else 0)
        for end, last, place, behind in timed_endings(self.said, match.end, earlier is None):
            if behind is not None and link:
                continue
            if (
                match.values
                and match.values[-1].but
                and _says_first(self.said.pieces[match.end : end])
            ):
                continue  # "store all probes but probe 2 first" leaves nothing out
            then = joint.then or last
            if then and place == "first":
                place = ""  # "then open the drawer first": before what follows
            if match.shared and "first" in (place, link):
                place = link = (
                    # "fill all bottles, then pack them, b2 first": b2 is packed first, not before
                    # all
                    "that"
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
                time=time or behind,
            )
            again = earlier is not None and match.form.phrase == earlier.clause.form.phrase
            phrase = -1 if match.shared and again else match.form.phrase
            total = (cost, count + 1, order + phrase)
            yield _Reading(
                end, total, clause, earlier, polite or (earlier is not None and earlier.polite)
            )

    def _again(self, earlier: _Reading | None, begin: int) -> Iterator[Match]:
        """Acts behind "after" or "before" that share words with an earlier clause: "once
        heated", "measure m1 before m2".
        """
        if self.short and earlier is not None:
            yield from (
                replace(match, cost=LEFT_OUT) for match in self._shared(earlier.clause, begin)
            )
            yield from repeated_acts(
                self.matcher, begin, [(clause.form, clause.values) for clause in earlier.clauses()]
            )

    def _short(self, earlier: _Reading | None, begin: int) -> Iterator[Match]:
        """The clauses that share words with the one before: "... and probe 2 for 10 min", "...
        and close it".
        """
        if not self.short or earlier is None:
            return
        for match in self._shared(earlier.clause, begin):
            yield replace(match, cost=match.cost + LEFT_OUT, shared=True)
        named_things = [
            named_thing for clause in earlier.clauses() for named_thing in self._things(clause)
        ]
        for word, node in self.book.natural.words.items():
            if (end := self.said.word(begin, word)) is not None:
                for match in self.matcher.walk(
                    node, end, (), tuple(dict.fromkeys(named_things))[:10]
                ):
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
            *(n + 1 for n, part in enumerate(form.parts) if isinstance(part, PatternSlot)),
        }
        for start in sorted(starts - {len(form.parts)}):
            node = follow_parts(root, form.parts[:start])
            slots = sum(isinstance(part, PatternSlot) for part in form.parts[:start])
            if node is not None:
                yield from (
                    match
                    for match in self.matcher.walk(node, begin, clause.values[:slots])
                    if match.end > begin
                )
            yield from self._with_the_same_end(clause, start, begin, clause.values[:slots])

    def _with_the_same_end(
        self,
        clause: Clause,
        start: int,
        place: int,
        values: tuple[SlotWords, ...],
        first: bool = True,
    ) -> Iterator[Match]:
        """Only some parts from `start` on are said; what follows is as in the clause before.

        `first`: nothing is said yet.
        """
        part = clause.form.parts[start] if start < len(clause.form.parts) else None
        if isinstance(part, PatternWord):
            if (end := self.said.word(place, part.text)) is not None:
                yield from self._with_the_same_end(clause, start + 1, end, values, False)
        elif part is not None:
            numbers = any(
                isinstance(form_part, PatternSlot) and form_part.type in NUMERIC_TYPES
                for form_part in clause.form.parts
            )
            for end, words in self.matcher.slot(part.type, place):
                if first and numbers and _is_bare_number(words):
                    continue  # "put probe 1 into depot 2 and 3": nobody can say which one is meant
                now = (*values, words)
                if end > place and clause.form.parts[start + 1 :]:
                    yield Match(end, clause.form, (*now, *clause.values[len(now) :]), LEFT_OUT)
                yield from self._with_the_same_end(clause, start + 1, end, now, False)

    def _things(self, clause: Clause) -> Iterator[tuple[str, ...]]:
        """What a clause names in the words of its phrase: objects, or all words behind the verb."""
        words = tuple(
            part.text if isinstance(part, PatternWord) else "" for part in clause.form.parts
        )
        for named in reversed(self.book.vocabulary.named(clause.form.parts)):
            yield words[named.first : named.last + 1]
        if "" not in words:
            yield words[len(clause.form.verb) :]


def _is_bare_number(words: SlotWords) -> bool:
    """Whether a slot is filled by numbers alone."""
    return all(
        mention.how == "numbered" and not mention.owner for mention in words.mentions
    ) and bool(words.mentions)


def _says_first(pieces: Sequence[SentencePiece]) -> bool:
    return any(piece.lower in ("first", "beforehand", "before") for piece in pieces)
