"""A sentence as it is being read: its pieces, and what would have been understood where it was not."""

from collections.abc import Iterable
from fractions import Fraction

from cellwright.kb.commands.patterns import ARTICLES
from cellwright.kb.commands.spelling import COUNTS
from cellwright.kb.commands.tokens import NUMBER, Piece, pieces, separated, time_at

A_NUMBER, A_TIME, A_NAME = "NUMBER", "TIME", "NAME"  # what a place may expect beside words


class Said:
    """The pieces of a sentence. Methods return the place after what they look for, or None, and note what they looked for.

    Articles may stand before anything. With `apart`, joined words such as "heater-shaker" count as several.
    """

    def __init__(self, text: str, apart: bool = False) -> None:
        self.text = text
        found = tuple(pieces(text))
        self.pieces = tuple(separated(found)) if apart else found
        self.expected: dict[int, set[str]] = {}

    def note(self, place: int, what: str) -> None:
        """Note that `what` would be understood at a place."""
        self.expected.setdefault(self.start(place), set()).add(what)

    def start(self, place: int) -> int:
        """The first piece from a place on that is no article."""
        while place < len(self.pieces) and self.pieces[place].lower in ARTICLES:
            place += 1
        return place

    def starts(self, place: int) -> tuple[int, ...]:
        """Where what is said at a place can begin: at the place itself, or after articles."""
        begins = dict.fromkeys((place, self.start(place)))
        return tuple(each for each in begins if each < len(self.pieces))

    def at(self, place: int) -> Piece | None:
        """The piece at a place, after articles; None at the end."""
        place = self.start(place)
        return self.pieces[place] if place < len(self.pieces) else None

    def word(self, place: int, word: str) -> int | None:
        """The place after a word or mark."""
        if place < len(self.pieces) and self.pieces[place].lower == word:
            return place + 1  # also an article, such as the A of "box A"
        found = self.at(place)
        if found is not None and (found.lower == word or _counts(found, word)):
            return self.start(place) + 1
        self.note(place, word)
        return None

    def words(self, place: int, words: Iterable[str]) -> int | None:
        """The place after several words, of which only the first is noted."""
        end = place
        for number, word in enumerate(words):
            found = self.at(end)
            exact = self.pieces[end].lower == word if end < len(self.pieces) else False
            if number and not exact and (found is None or (found.lower != word and not _counts(found, word))):
                return None
            after = self.word(end, word)
            if after is None:
                return None
            end = after
        return end

    def one_of(self, place: int, words: Iterable[str]) -> int | None:
        """The place after one of several words."""
        found = [end for word in words if (end := self.word(place, word)) is not None]
        return found[0] if found else None

    def number(self, place: int) -> int | None:
        """The place after a number in figures or words."""
        found = self.at(place)
        if found is not None and (found.kind == NUMBER or found.value is not None):
            return self.start(place) + 1
        self.note(place, A_NUMBER)
        return None

    def time(self, place: int) -> tuple[int, Fraction, str] | None:
        """The place after a time, its seconds, and its text."""
        for begin in self.starts(place):
            offset = self.pieces[begin].offset
            if found := time_at(self.text, offset):
                end = begin
                while end < len(self.pieces) and self.pieces[end].offset < found[0]:
                    end += 1
                return end, found[1], self.text[offset : found[0]].rstrip(".")
        self.note(place, A_TIME)
        return None

    def offset(self, place: int) -> int:
        """The character at which a place begins; the end of the text behind the last piece."""
        return self.pieces[place].offset if place < len(self.pieces) else len(self.text)

    def furthest(self) -> int:
        """The last place at which something else would have been understood."""
        return max(self.expected, default=0)


def _counts(piece: Piece, word: str) -> bool:
    """Whether a number is what a word says: the 2 of "oven 2", where a phrase has "oven two"."""
    return piece.kind == NUMBER and COUNTS.get(word) == piece.value
