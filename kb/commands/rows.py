"""Objects by their places in a row: the first two, the third, the last."""

from collections.abc import Sequence
from dataclasses import dataclass

from cellwright.kb.commands.mentions import ORDINALS
from cellwright.kb.commands.tokens import Piece
from cellwright.kb.commands.words import Mention, Unclear


@dataclass(frozen=True, slots=True)
class Rows:
    """The rows of which "the last two" may speak: the objects `named` before, and the `whole` row of all.

    The named ones may have been `ranked` themselves: "heat the first two". `there` says which objects there are.
    """

    named: Sequence[str]
    whole: Sequence[str]
    ranked: bool
    there: str

    def chosen(self, mention: Mention, said: str) -> Sequence[str]:
        """The objects at the places that a mention names in the row that is meant. Raises `Unclear`.

        With a noun, as in "the first probe", both rows must agree. Without one, those that were named are meant, unless they
        were all named as the first or the last ones: then the others of the whole row are.
        """
        ends = mention.ends
        rows = [each for each in (self.named if len(self.named) > 1 else (), self.whole) if each]
        if not rows:
            hint = f"{self.there}; say its number or its name"
            raise Unclear(ends[0].offset, f"'{said}' of what? nothing here stands in a row", hint)
        found = list(dict.fromkeys(each for row in rows if (each := tuple(_at_places(row, ends)))))
        if not found:
            raise Unclear(ends[0].offset, f"there is no '{said}'", self.there)
        if self.ranked and len(found) > 1 and set(found[0]) == set(self.named):
            return found[1]
        if len(found) > 1 and (mention.owner or self.ranked):
            message = f"'{said}' can mean those that were named, or all that there are"
            raise Unclear(ends[0].offset, message, "say the numbers or names")
        if not mention.owner and self.named and not self.ranked:
            self._require_enough(ends, said)
        return found[0]

    def _require_enough(self, ends: Sequence[Piece], said: str) -> None:
        """Raises `Unclear` if fewer were named than are asked for: nobody knows whether the others are meant, too."""
        if len(self.named) > 1 and _at_places(self.named, ends):
            return
        only = f"only {' and '.join(self.named)} {'was' if len(self.named) == 1 else 'were'} named before"
        raise Unclear(ends[0].offset, f"'{said}' of which? {only}", "say the numbers or names")


def _at_places(row: Sequence[str], ends: Sequence[Piece]) -> Sequence[str]:
    """The objects at the places that an ordinal and a count name: the first two, the third, the last; nothing if there are too few."""
    ordinal, count = ends[0].lower, int(ends[1].value or 1) if len(ends) > 1 else 1
    first = len(row) - count if ordinal == "last" else ORDINALS.index(ordinal)
    return row[first : first + count] if 0 <= first <= len(row) - count else ()
