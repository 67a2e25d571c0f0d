"""What joins the clauses of a sentence, and how acts are said behind "after" and "before"."""

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, replace

from cellwright.kb.commands.phrase_matching import LEFT_OUT, Match, Matcher
from cellwright.kb.commands.phrase_patterns import (
    PARTICLES,
    PREPOSITIONS,
    PatternSlot,
    PhraseForm,
    PhraseNode,
    verb_gerunds,
    verb_participles,
)
from cellwright.kb.commands.sentence_pieces import SentenceReader, SlotWords
from cellwright.kb.commands.time_words import SaidTime, times_before_acts, times_behind_acts


def _split_sayings(text: str) -> tuple[tuple[str, ...], ...]:
    return tuple(tuple(saying.split()) for saying in text.split(" | "))


CLAUSE_MARKS = (",", ";", ".", "!")
AND_SAYINGS = _split_sayings("and | & | but | plus | as well as")
THEN_SAYINGS = _split_sayings(
    "then | afterwards | afterward | after that | after this | after which | thereafter | next "
    "| finally | lastly"
    " | subsequently | later on | later | at last | at the end | in the end | second | secondly "
    "| third | thirdly"
)
THANKS_SAYINGS = _split_sayings("please | thanks | thank you | each")
THEN_BEHIND = _split_sayings(
    "afterwards | afterward | after that | after this | thereafter | next | last | later | at "
    "the end"
)
POLITE_SAYINGS = _split_sayings(
    "could you | can you | would you | will you | i want you to | i would like you to | i'd "
    "like you to | you should"
    " | you must | you have to | let us | let's | we want to | i want to | i would like to | we "
    "need to | kindly"
)
WHEN, WHAT = (
    ("once", "when", "as soon as", "after"),
    ("this is", "that is", "it is", "they are", ""),
)
THEN_SAYINGS += tuple(
    tuple(f"{when} {what} {end}".split())
    for when in WHEN
    for what in WHAT
    for end in ("done", "finished", "ready", "over")
)
REMINDER_SAYINGS = _split_sayings(
    "make sure to | make sure you | be sure to | remember to | don't forget to | do not forget "
    "to | see to it that you"
)
FILLERS_BEFORE = _split_sayings("now | also | just | ok | okay")
FILLERS_BEHIND = _split_sayings(
    "too | as well | also | now | each | again | please | thanks | thank you"
)
FIRST_SAYINGS = _split_sayings(
    "first | first of all | at first | to begin with | beforehand | before anything else"
)
FIRST_BEHIND = _split_sayings("first | beforehand | before anything else")
THAT_SAYINGS = _split_sayings("before that | before this | before doing so | before then")
STOP_MARKS = (";", ".", "!")


@dataclass(frozen=True, slots=True)
class ClauseJoint:
    """What stands between two clauses: the place after it, whether it says "then", and whether
    anything stands there.

    `stop` means that a sentence or half of one ends there.
    """

    end: int
    then: bool
    marked: bool
    stop: bool = False


def find_joints(said: SentenceReader, place: int) -> Iterator[ClauseJoint]:
    """The joints that begin at a place: a mark, "and", "then", or several of them."""
    mark = said.one_of(place, CLAUSE_MARKS)
    for after_mark in _optional_ends(place, [mark]):
        stop = after_mark > place and said.pieces[after_mark - 1].text in STOP_MARKS
        for after_and in _optional_ends(after_mark, _saying_ends(said, after_mark, AND_SAYINGS)):
            stops = stop and after_and == after_mark
            if after_and > place:
                yield ClauseJoint(after_and, False, True, stops)
            for end in _saying_ends(said, after_and, THEN_SAYINGS):
                for last in _optional_ends(end, [said.word(end, ",")]):
                    yield ClauseJoint(last, True, True, stops)


def _optional_ends(place: int, ends: Iterable[int | None]) -> Iterator[int]:
    yield place
    yield from (end for end in ends if end is not None)


def _saying_ends(said: SentenceReader, place: int, sayings: Iterable[tuple[str, ...]]) -> list[int]:
    places = (said.words(place, saying) for saying in sayings)
    return sorted({end for end in places if end is not None}, reverse=True)


def clause_beginnings(
    said: SentenceReader, place: int, goes_on: bool
) -> Iterator[tuple[int, bool, str]]:
    """Where a clause can begin after words that change nothing or its place in time; whether they
    make a polite question of it.

    The third is "first" for a clause that comes before all that was said, "that" for one that comes
    before the clause before it, and else empty. `goes_on` says that the sentence goes on here, so
    that "first" is not the beginning of a list.
    """
    yield place, False, ""
    for polite in _saying_ends(said, place, POLITE_SAYINGS):
        yield polite, True, ""
    beginnings = [
        (end, "") for end in _saying_ends(said, place, (*FILLERS_BEFORE, *REMINDER_SAYINGS))
    ]
    beginnings += [
        (end, "first" if goes_on else "") for end in _saying_ends(said, place, FIRST_SAYINGS)
    ]
    beginnings += [(end, "that") for end in _saying_ends(said, place, THAT_SAYINGS)]
    for end, link in beginnings:
        comma = said.word(end, ",")
        yield from ((begin, False, link) for begin in (end, comma) if begin is not None)


def timed_endings(
    said: SentenceReader, place: int, is_first: bool
) -> Iterator[tuple[int, bool, str, SaidTime | None]]:
    """`clause_endings`, also behind "within 10 min", with this time."""
    yield from ((*ending, None) for ending in clause_endings(said, place, is_first))
    yield from ((end, False, "", time) for end, time in times_behind_acts(said, place))


def clause_endings(
    said: SentenceReader, place: int, is_first: bool
) -> Iterator[tuple[int, bool, str]]:
    """Where a clause can end after words behind it, whether they put it after the clauses
    before it, or before them.
    """
    yield place, False, ""
    comma = said.word(place, ",")
    for begin in (place,) if comma is None else (place, comma):
        yield from (
            (end, False, "")
            for end in _saying_ends(
                said, begin, FILLERS_BEHIND if begin == place else THANKS_SAYINGS
            )
        )
    yield from (
        (end, False, "" if is_first else "first") for end in _saying_ends(said, place, FIRST_BEHIND)
    )
    if not is_first:
        yield from ((end, True, "") for end in _saying_ends(said, place, THEN_BEHIND))
        yield from ((end, False, "that") for end in _saying_ends(said, place, THAT_SAYINGS))


AFTER_SAYINGS = _split_sayings(
    "after | once | when | as soon as | only after | only once | right after | directly after | "
    "immediately after"
)
BEFORE_SAYINGS = _split_sayings("before | prior to | right before | shortly before")


def link_beginnings(said: SentenceReader, place: int) -> Iterator[tuple[int, str, SaidTime | None]]:
    """Where an act can begin that another one comes after or before: behind "after", "once",
    "before", "within 10 min of"; with the time between them.
    """
    yield from ((end, "after", None) for end in _saying_ends(said, place, AFTER_SAYINGS))
    yield from ((end, "before", None) for end in _saying_ends(said, place, BEFORE_SAYINGS))
    yield from ((end, "after", time) for end, time in times_before_acts(said, place))


def ends_sentence(said: SentenceReader, place: int, polite: bool) -> bool:
    """Whether the sentence ends at a place, after its last mark."""
    marks = (".", "!", "?") if polite else (".", "!")
    while (end := said.one_of(place, marks)) is not None:
        place = end
    return said.start(place) == len(said.pieces)


SUBJECT_WORDS = ("you", "we", "i", "they", "robot", "cell")
HAVE_FORMS = ("have", "has", "had")
BE_FORMS = tuple(
    tuple(form.split())
    for form in ["is", "are", "was", "were", "has been", "have been", "had been", "gets", "get"]
)
_SHOULD = (
    "should be,must be,shall be,is to be,are to be,has to be,have to be,ought to be,needs to "
    "be,need to be,will be"
    ",should get,must get"
)
SHOULD_FORMS = tuple(tuple(form.split()) for form in _SHOULD.split(","))

Named = tuple[int, tuple[SlotWords, ...]]
"""The place after an act that was said before, and what fills its slots now."""


def linked_acts(matcher: Matcher, begin: int) -> Iterator[Match]:
    """The acts that are said whole behind "after", "once" or "before"."""
    for root in (matcher.book.natural, matcher.book.moved):
        for verb, node in root.words.items():
            for end in _verb_ends(matcher.said, begin, verb):
                yield from matcher.walk(node, end, ())
    for words, node in _verb_nodes(matcher):
        yield from _passive_acts(matcher, words, node, begin, BE_FORMS)
        yield from _participles_alone(matcher, words, node, begin)


def wished_acts(matcher: Matcher, begin: int, goes_on: bool) -> Iterator[Match]:
    """The acts that are said as what should be done: "probe 1 must be heated for 5 min", and
    behind such: "and then cooled".
    """
    if not goes_on and not _says_should(matcher.said):
        return
    for verb, node in _verb_nodes(matcher):
        acts = _passive_acts(matcher, verb, node, begin, SHOULD_FORMS)
        yield from (replace(act, passive=True) for act in acts)
        if goes_on:
            yield from (
                replace(act, passive=True) for act in _participles_alone(matcher, verb, node, begin)
            )


def _says_should(said: SentenceReader) -> bool:
    words = [piece.lower for piece in said.pieces]
    return any(
        tuple(words[n : n + len(form)]) == form for n in range(len(words)) for form in SHOULD_FORMS
    )


def _verb_nodes(matcher: Matcher) -> Iterator[tuple[tuple[str, ...], PhraseNode]]:
    """The verbs of the phrases with the nodes behind them."""
    for verb, node in matcher.book.natural.words.items():
        yield from (((verb, *particles), start) for particles, start in _particle_nodes(node))


def _passive_acts(
    matcher: Matcher,
    verb: tuple[str, ...],
    node: PhraseNode,
    begin: int,
    be: Iterable[tuple[str, ...]],
) -> Iterator[Match]:
    """Acts in the passive. `node` is behind the words of the verb."""
    for place, values, following in _object_nodes(matcher, node, begin):
        for end in _passive_ends(matcher.said, place, verb, be):
            yield from matcher.walk(following, end, values)


def _participles_alone(
    matcher: Matcher, verb: tuple[str, ...], node: PhraseNode, begin: int
) -> Iterator[Match]:
    """Acts of which only the participle is said, for objects that were named before: "... and
    cooled for 3 min".
    """
    for words, following in _left_out(matcher, node, begin):
        for end in _participle_ends(matcher.said, begin, verb):
            yield from matcher.walk(following, end, (words,))


def repeated_acts(
    matcher: Matcher, begin: int, earlier: Iterable[tuple[PhraseForm, tuple[SlotWords, ...]]]
) -> Iterator[Match]:
    """The acts of earlier clauses that are said again in short: "once heated", "after heating
    it", "once probe 1 is heated".
    """
    for form, values in earlier:
        for end, now in (
            *_active_repetitions(matcher, begin, form, values),
            *_passive_repetitions(matcher, begin, form, values),
        ):
            yield Match(end, form, now, LEFT_OUT, again=True)


def _active_repetitions(
    matcher: Matcher, begin: int, form: PhraseForm, values: tuple[SlotWords, ...]
) -> Iterator[Named]:
    """Active: the verb, with or without its first object."""
    verb, *rest = form.verb
    for place in _verb_ends(matcher.said, begin, verb):
        end = _heard_all(matcher.said, place, rest)
        if end is not None:
            yield end, values
            yield from (
                (after, (words, *values[1:])) for after, words in _first_slot(matcher, end, form)
            )


def _passive_repetitions(
    matcher: Matcher, begin: int, form: PhraseForm, values: tuple[SlotWords, ...]
) -> Iterator[Named]:
    """Passive: the participle, with or without the first object."""
    verb = tuple(word for word in form.verb if word not in PREPOSITIONS)
    for end in _participle_ends(matcher.said, begin, verb):
        yield end, values
    for place, words in _first_slot(matcher, begin, form):
        yield from ((end, (words, *values[1:])) for end in _passive_ends(matcher.said, place, verb))


def _first_slot(matcher: Matcher, place: int, form: PhraseForm) -> Iterator[tuple[int, SlotWords]]:
    """What can fill the first slot of a form from a place on."""
    slot = next((part for part in form.parts if isinstance(part, PatternSlot)), None)
    if slot is not None:
        for end, words in matcher.slot(slot.type, place):
            if words.how == "bare" and not words.but:
                # "once all are heated": all that were said
                yield end, replace(words, how="pronoun")
            elif words.how != "omitted":
                yield end, words


def _verb_ends(said: SentenceReader, begin: int, verb: str) -> Iterator[int]:
    """The places after a verb: heating, having heated, you heat, you have heated."""
    yield from _heard_word(said, begin, verb_gerunds(verb))
    for having in _heard_word(said, begin, ("having",)):
        yield from _heard_word(said, having, verb_participles(verb))
    for subject in _heard_word(said, begin, SUBJECT_WORDS):
        yield from _heard_word(said, subject, (verb, f"{verb}s"))
        for have in _heard_word(said, subject, HAVE_FORMS):
            yield from _heard_word(said, have, verb_participles(verb))


def _passive_ends(
    said: SentenceReader,
    place: int,
    verb: tuple[str, ...],
    be: Iterable[tuple[str, ...]] = BE_FORMS,
) -> Iterator[int]:
    """The places after "is heated", "has been picked up"; or, with other words of `be`, after
    "must be heated".
    """
    for words in be:
        if (end := _heard_all(said, place, words)) is not None:
            yield from _participle_ends(said, end, verb)


def _participle_ends(said: SentenceReader, place: int, verb: tuple[str, ...]) -> Iterator[int]:
    for end in _heard_word(said, place, verb_participles(verb[0])):
        if (last := _heard_all(said, end, verb[1:])) is not None:
            yield last


def _particle_nodes(node: PhraseNode) -> Iterator[tuple[tuple[str, ...], PhraseNode]]:
    """The node behind a verb, and those behind one word such as "up" more."""
    yield (), node
    yield from (((word,), following) for word, following in node.words.items() if word in PARTICLES)


def _object_nodes(
    matcher: Matcher, node: PhraseNode, place: int
) -> Iterator[tuple[int, tuple[SlotWords, ...], PhraseNode]]:
    """What a phrase names first, a slot or words, from a place on: the place after it, what
    fills the slot, the node behind it.
    """
    for type_, following in node.slots.items():
        for end, words in matcher.slot(type_, place):
            if words.how != "omitted":
                yield end, (words,), following
    for word, following in node.words.items():
        if word not in PREPOSITIONS | PARTICLES:
            for end in _heard_word(matcher.said, place, (word,)):
                yield end, (), following
                yield from (
                    (e, v, n) for e, v, n in _object_nodes(matcher, following, end) if not v
                )


def _left_out(
    matcher: Matcher, node: PhraseNode, place: int
) -> Iterator[tuple[SlotWords, PhraseNode]]:
    """The slots behind a node that may be left out here, with what is in them then: "... and
    cooled for 3 min".
    """
    for type_, following in node.slots.items():
        yield from (
            (words, following) for _, words in matcher.slot(type_, place) if words.how == "omitted"
        )


def _heard_word(said: SentenceReader, place: int, words: Collection[str]) -> Iterator[int]:
    """The place after one of some words, which are not noted as what would be understood here."""
    piece = said.at(place)
    if piece is not None and piece.lower in words:
        yield said.start(place) + 1


def _heard_all(said: SentenceReader, place: int, words: Iterable[str]) -> int | None:
    end: int | None = place
    for word in words:
        end = next(_heard_word(said, end, (word,)), None) if end is not None else None
    return end
