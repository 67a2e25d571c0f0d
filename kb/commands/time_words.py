"""What a sentence says of the time between two acts: "within 10 min of stopping it", "an hour after
the start of washing it", "then read it within 10 min".
"""

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

from cellwright.kb.commands.sentence_pieces import SentenceReader
from cellwright.kb.model.time_windows import Side

MOST = ("within", "at most", "no later than", "not later than", "no more than", "not more than")
LEAST = ("at least", "no sooner than", "not sooner than", "no earlier than", "not before")
EXACT = ("exactly", "")
BEHIND_TIME = ("after", "of", "from")
SIDES = {"start": Side.START, "beginning": Side.START, "end": Side.END}


@dataclass(frozen=True, slots=True)
class SaidTime:
    """The least and the greatest time in seconds, from one end of the earlier act; `offset` is
    where the sentence says so, and `text` how.
    """

    offset: int
    text: str
    least: Fraction | None = None
    most: Fraction | None = None
    side: Side = Side.END


def times_before_acts(said: SentenceReader, place: int) -> Iterator[tuple[int, SaidTime]]:
    """Where an act can begin that another one comes so long after: behind "within 10 min of", "an
    hour after the start of".
    """
    for end, time in _times(said, place, (*MOST, *LEAST, *EXACT)):
        for word in BEHIND_TIME:
            after = _heard(said, end, word)
            if after is not None:
                yield after, time
                yield from _sides(said, after, time)


def times_behind_acts(said: SentenceReader, place: int) -> Iterator[tuple[int, SaidTime]]:
    """Where a clause can end behind the time within which it follows the act before it, or the
    start of the plan: "then read it within 10 min".
    """
    yield from _times(said, place, ("within",))


def _times(
    said: SentenceReader, place: int, sayings: tuple[str, ...]
) -> Iterator[tuple[int, SaidTime]]:
    for saying in sayings:
        begin = _heard(said, place, saying)
        time = None if begin is None else said.time(begin, hint=bool(saying))
        if time is None:
            continue
        end, seconds, text = time
        least = None if saying in MOST else seconds
        most = None if saying in LEAST else seconds
        offset = said.pieces[said.start(place)].offset
        yield end, SaidTime(offset, text, least, most)


def _sides(said: SentenceReader, place: int, time: SaidTime) -> Iterator[tuple[int, SaidTime]]:
    for word, side in SIDES.items():
        behind = _heard(said, place, f"{word} of")
        if behind is not None:
            yield behind, SaidTime(time.offset, time.text, time.least, time.most, side)


def _heard(said: SentenceReader, place: int, saying: str) -> int | None:
    """The place after some words, which are not noted as what would be understood here."""
    end = place
    for word in saying.split():
        piece = said.at(end)
        if piece is None or piece.lower != word:
            return None
        end = said.start(end) + 1
    return end
