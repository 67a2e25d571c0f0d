"""The names in one piece of an ASP file."""

from collections.abc import Iterator
from functools import lru_cache

from cellwright.kb.editing.occurrences import Declared, Names, Occurrence, space_of
from cellwright.kb.editing.tokens import Mention, mentions, tokens


@lru_cache(4096)
def names_in_rules(text: str) -> Names:
    """The names in a piece of an ASP file. A head defines what its atom names; the other atoms are read."""
    ends = [each.start for each in tokens(text, True) if each.text == "."]
    necks = [each.start for each in tokens(text, True) if each.text == ":-"]
    constants = {each.start for each in _constants(text)}
    found: list[Occurrence] = []
    statement = neck = 0
    for each in mentions(text, True):
        while statement < len(ends) and each.start > ends[statement]:
            statement += 1
        begin = ends[statement - 1] if statement else -1
        while neck < len(necks) and necks[neck] < begin:
            neck += 1
        past = neck < len(necks) and begin < necks[neck] < each.start
        doing = "declared" if each.start in constants else "read" if past else "defined"
        doing = doing if each.atom or doing == "declared" else "named"
        found.append(
            Occurrence(
                space_of(each) if doing != "declared" else "object",
                each.name, each.start, each.end, doing, each.head, each.number, scope=statement,
            )
        )  # fmt: skip
    declared = [
        Declared("object", each.name, "constant", each.start, each.end)
        for each in found
        if each.doing == "declared"
    ]
    return Names(tuple(found), tuple(declared))


def _constants(text: str) -> Iterator[Mention]:
    """The names that `#const` declares."""
    starts = [each.end for each in tokens(text, True) if each.text == "#const"]
    for start in starts:
        yield from [each for each in mentions(text, True) if each.start >= start][:1]
