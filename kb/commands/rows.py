"""Objects by their places in a row: the first two, the third, the last."""

from collections.abc import Sequence

from kb.commands.mentions import ORDINALS
from kb.commands.tokens import Piece
from kb.commands.words import Mention, Unclear


def chosen(rows: Sequence[Sequence[str]], mention: Mention, said: str, there: str) -> Sequence[str]:
    """The objects at the places that a mention names in the first row that has them. Raises `Unclear`.

    With a noun, as in "the first probe", all rows must agree. `there` says which objects there are.
    """
    ends = mention.ends
    if not rows:
        hint = f"{there}; say its number or its name"
        raise Unclear(ends[0].offset, f"'{said}' of what? nothing here stands in a row", hint)
    found = list(dict.fromkeys(each for row in rows if (each := tuple(_at_places(row, ends)))))
    if not found:
        raise Unclear(ends[0].offset, f"there is no '{said}'", there)
    if len(found) > 1 and mention.owner:
        message = f"'{said}' can mean those that were named, or all that there are"
        raise Unclear(ends[0].offset, message, "say the numbers or names")
    return found[0]


def _at_places(row: Sequence[str], ends: Sequence[Piece]) -> Sequence[str]:
    """The objects at the places that an ordinal and a count name: the first two, the third, the last; nothing if there are too few."""
    ordinal, count = ends[0].lower, int(ends[1].value or 1) if len(ends) > 1 else 1
    first = len(row) - count if ordinal == "last" else ORDINALS.index(ordinal)
    return row[first : first + count] if 0 <= first <= len(row) - count else ()
