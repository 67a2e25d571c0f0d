"""What joins the clauses of a sentence, and the words around a clause that change nothing or only its order."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from kb.commands.reading import Said


def _sayings(text: str) -> tuple[tuple[str, ...], ...]:
    return tuple(tuple(each.split()) for each in text.split(" | "))


MARKS = (",", ";", ".", "!")
AND = _sayings("and | & | but | plus | as well as")
THEN = _sayings(
    "then | afterwards | afterward | after that | after this | after which | thereafter | next | finally | lastly"
    " | subsequently | later on | later | at last | at the end | in the end | second | secondly | third | thirdly"
)
THEN_BEHIND = _sayings(
    "afterwards | afterward | after that | after this | thereafter | next | last | later | at the end"
)
POLITE = _sayings(
    "could you | can you | would you | will you | i want you to | i would like you to | i'd like you to | you should"
    " | you must | you have to | let us | let's | we want to | i want to | i would like to | we need to | kindly"
)
BEFORE = _sayings("first | first of all | at first | to begin with | now | also | just")
BEHIND = _sayings("too | as well | also | now | each | first")


@dataclass(frozen=True, slots=True)
class Joint:
    """What stands between two clauses: the place after it, whether it says "then", and whether anything stands there."""

    end: int
    then: bool
    marked: bool


def joints(said: Said, place: int) -> Iterator[Joint]:
    """The joints that begin at a place: a mark, "and", "then", or several of them."""
    mark = said.one_of(place, MARKS)
    for after_mark in _maybe(place, [mark]):
        for after_and in _maybe(after_mark, _ends(said, after_mark, AND)):
            if after_and > place:
                yield Joint(after_and, False, True)
            for end in _ends(said, after_and, THEN):
                for last in _maybe(end, [said.word(end, ",")]):
                    yield Joint(last, True, True)


def _maybe(place: int, ends: Iterable[int | None]) -> Iterator[int]:
    yield place
    yield from (end for end in ends if end is not None)


def _ends(said: Said, place: int, sayings: Iterable[tuple[str, ...]]) -> list[int]:
    found = (said.words(place, each) for each in sayings)
    return sorted({end for end in found if end is not None}, reverse=True)


def before(said: Said, place: int) -> Iterator[tuple[int, bool]]:
    """Where a clause can begin after words that change nothing, and whether they make a polite question of it."""
    yield place, False
    for polite in _ends(said, place, POLITE):
        yield polite, True
    for end in _ends(said, place, BEFORE):
        comma = said.word(end, ",")
        yield from ((each, False) for each in (end, comma) if each is not None)


def behind(said: Said, place: int, is_first: bool) -> Iterator[tuple[int, bool]]:
    """Where a clause can end after words behind it, and whether they put it after the clauses before it."""
    yield place, False
    yield from (
        (end, False)
        for end in _ends(said, place, BEHIND)
        if is_first or said.pieces[end - 1].lower != "first"
    )
    if not is_first:
        yield from ((end, True) for end in _ends(said, place, THEN_BEHIND))


def closes(said: Said, place: int, polite: bool) -> bool:
    """Whether the sentence ends at a place, after its last mark."""
    marks = (".", "!", "?") if polite else (".", "!")
    while (end := said.one_of(place, marks)) is not None:
        place = end
    return said.start(place) == len(said.pieces)
