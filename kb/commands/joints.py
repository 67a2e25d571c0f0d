"""What joins the clauses of a sentence, and the words around a clause that change nothing or only its order."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from cellwright.kb.commands.reading import Said


def _sayings(text: str) -> tuple[tuple[str, ...], ...]:
    return tuple(tuple(each.split()) for each in text.split(" | "))


MARKS = (",", ";", ".", "!")
AND = _sayings("and | & | but | plus | as well as")
THEN = _sayings(
    "then | afterwards | afterward | after that | after this | after which | thereafter | next | finally | lastly"
    " | subsequently | later on | later | at last | at the end | in the end | second | secondly | third | thirdly"
)
THANKS = _sayings("please | thanks | thank you | each")
THEN_BEHIND = _sayings(
    "afterwards | afterward | after that | after this | thereafter | next | last | later | at the end"
)
POLITE = _sayings(
    "could you | can you | would you | will you | i want you to | i would like you to | i'd like you to | you should"
    " | you must | you have to | let us | let's | we want to | i want to | i would like to | we need to | kindly"
)
WHEN, WHAT = ("once", "when", "as soon as", "after"), ("this is", "that is", "it is", "they are", "")
THEN += tuple(
    tuple(f"{when} {what} {end}".split())
    for when in WHEN
    for what in WHAT
    for end in ("done", "finished", "ready", "over")
)
REMIND = _sayings(
    "make sure to | make sure you | be sure to | remember to | don't forget to | do not forget to | see to it that you"
)
BEFORE = _sayings("now | also | just | ok | okay")
BEHIND = _sayings("too | as well | also | now | each | again | please | thanks | thank you")
FIRST = _sayings("first | first of all | at first | to begin with | beforehand | before anything else")
FIRST_BEHIND = _sayings("first | beforehand | before anything else")
THAT = _sayings("before that | before this | before doing so | before then")
STOPS = (";", ".", "!")


@dataclass(frozen=True, slots=True)
class Joint:
    """What stands between two clauses: the place after it, whether it says "then", and whether anything stands there.

    `stop` means that a sentence or half of one ends there.
    """

    end: int
    then: bool
    marked: bool
    stop: bool = False


def joints(said: Said, place: int) -> Iterator[Joint]:
    """The joints that begin at a place: a mark, "and", "then", or several of them."""
    mark = said.one_of(place, MARKS)
    for after_mark in _maybe(place, [mark]):
        stop = after_mark > place and said.pieces[after_mark - 1].text in STOPS
        for after_and in _maybe(after_mark, _ends(said, after_mark, AND)):
            stops = stop and after_and == after_mark
            if after_and > place:
                yield Joint(after_and, False, True, stops)
            for end in _ends(said, after_and, THEN):
                for last in _maybe(end, [said.word(end, ",")]):
                    yield Joint(last, True, True, stops)


def _maybe(place: int, ends: Iterable[int | None]) -> Iterator[int]:
    yield place
    yield from (end for end in ends if end is not None)


def _ends(said: Said, place: int, sayings: Iterable[tuple[str, ...]]) -> list[int]:
    found = (said.words(place, each) for each in sayings)
    return sorted({end for end in found if end is not None}, reverse=True)


def before(said: Said, place: int, goes_on: bool) -> Iterator[tuple[int, bool, str]]:
    """Where a clause can begin after words that change nothing or its place in time; whether they make a polite question of it.

    The third is "first" for a clause that comes before all that was said, "that" for one that comes before the clause before
    it, and else empty. `goes_on` says that the sentence goes on here, so that "first" is not the beginning of a list.
    """
    yield place, False, ""
    for polite in _ends(said, place, POLITE):
        yield polite, True, ""
    found = [(end, "") for end in _ends(said, place, (*BEFORE, *REMIND))]
    found += [(end, "first" if goes_on else "") for end in _ends(said, place, FIRST)]
    found += [(end, "that") for end in _ends(said, place, THAT)]
    for end, link in found:
        comma = said.word(end, ",")
        yield from ((each, False, link) for each in (end, comma) if each is not None)


def behind(said: Said, place: int, is_first: bool) -> Iterator[tuple[int, bool, str]]:
    """Where a clause can end after words behind it, whether they put it after the clauses before it, or before them."""
    yield place, False, ""
    comma = said.word(place, ",")
    for begin in (place,) if comma is None else (place, comma):
        yield from ((end, False, "") for end in _ends(said, begin, BEHIND if begin == place else THANKS))
    yield from ((end, False, "" if is_first else "first") for end in _ends(said, place, FIRST_BEHIND))
    if not is_first:
        yield from ((end, True, "") for end in _ends(said, place, THEN_BEHIND))
        yield from ((end, False, "that") for end in _ends(said, place, THAT))


AFTER = _sayings(
    "after | once | when | as soon as | only after | only once | right after | directly after | immediately after"
)
EARLIER = _sayings("before | prior to | right before | shortly before")


def linking(said: Said, place: int) -> Iterator[tuple[int, str]]:
    """Where an act can begin that another one comes after or before: behind "after", "once", "before"."""
    yield from ((end, "after") for end in _ends(said, place, AFTER))
    yield from ((end, "before") for end in _ends(said, place, EARLIER))


def closes(said: Said, place: int, polite: bool) -> bool:
    """Whether the sentence ends at a place, after its last mark."""
    marks = (".", "!", "?") if polite else (".", "!")
    while (end := said.one_of(place, marks)) is not None:
        place = end
    return said.start(place) == len(said.pieces)
