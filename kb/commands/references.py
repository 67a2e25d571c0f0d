"""The objects that a sentence means: by numbers, names, ranges, "all", and pronouns for objects named before."""

import re
from collections.abc import Iterator, Sequence
from fractions import Fraction

from cellwright.kb.commands.rows import Rows
from cellwright.kb.commands.spelling import with_article
from cellwright.kb.commands.tokens import Piece
from cellwright.kb.commands.vocabulary import Vocabulary
from cellwright.kb.commands.words import Mention, Unclear, Words
from cellwright.kb.diagnostics import nearest
from cellwright.kb.terms import Function, natural_key

ENDING = re.compile(r"(.*?)(\d+)")


class References:
    """The objects named so far, and the objects that a slot of a type may mean. `objects` maps names to types."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        self.vocabulary, self.domain, self.objects = vocabulary, vocabulary.domain, vocabulary.objects
        self.named: list[tuple[str, ...]] = []
        self.nouns: dict[str, str] = {}  # what the sentence calls an object of a type
        self.each: set[tuple[str, ...]] = set()  # named by "each" or "every", so that "it" means each of them
        self.ranked: set[tuple[str, ...]] = set()  # named as the first ones, the last ones, ...

    def resolve(self, words: Words, type_: str) -> tuple[Function, ...]:
        """The objects meant, each once, in the order in which they are said. Raises `Unclear`."""
        self.nouns |= self.vocabulary.said_nouns(words)
        found = self._left(words, type_, self._meant(words, type_))
        unique = tuple(dict.fromkeys(found))
        for name in unique:
            if not self._is(name, type_):
                said = f"{name} is {self._article(self.objects[name])}, not {self._article(type_)}"
                raise Unclear(words.pieces[0].offset, said)
        if words.how not in ("pronoun", "omitted"):
            self.named.append(tuple(dict.fromkeys(found)))
            if words.pieces[0].lower in ("each", "every"):
                self.each.add(self.named[-1])
            if [mention.how for mention in words.mentions] == ["ranked"]:
                self.ranked.add(self.named[-1])
        return tuple(map(Function, unique))

    def _left(self, words: Words, type_: str, found: Sequence[str]) -> Sequence[str]:
        """The objects without those that "except" names, each of which must be among them."""
        if not words.but:
            return found
        gone = self._listed(words.but, words.owner or type_)
        if strange := [name for name in gone if name not in found]:
            message = f"{strange[0]} is not among those from which it is left out"
            raise Unclear(words.but[0].pieces[0].offset, message, f"these are: {', '.join(found)}")
        if not (left := [name for name in found if name not in gone]):
            raise Unclear(words.pieces[0].offset, f"there is no other {self._noun(words.owner or type_)}")
        return left

    def _meant(self, words: Words, type_: str) -> Sequence[str]:
        offset = words.pieces[0].offset
        match words.how:
            case "pronoun":
                return self._earlier(words, offset, words.owner or type_)
            case "omitted":
                return self._omitted(words, offset, type_)
            case "others":
                return self._others(words, offset)
            case "all" | "bare":
                return self._all(words, offset)
            case "both":
                return self._both(words, offset)
            case _:
                return self._listed(words.mentions, type_)

    def _listed(self, mentions: Sequence[Mention], type_: str) -> list[str]:
        owner = type_
        found: list[str] = []
        for mention in mentions:
            owner = mention.owner or owner  # "probes 1 and 2": the noun also belongs to the 2
            found.extend(self._mention(mention, owner if owner in self.domain.types else type_))
        return found

    def _all(self, words: Words, offset: int) -> list[str]:
        found = self._of(words.owner)
        for counted in words.mentions:
            self._check_count(counted, found, words.owner)
        if not found:
            raise Unclear(offset, f"there is no {self._noun(words.owner)}")
        named = {name for names in self.named for name in names if self._is(name, words.owner)}
        if words.how == "bare" and named and named != set(found):
            message = (
                f"'all' can mean those that were named ({', '.join(sorted(named))}), or all that there are"
            )
            raise Unclear(offset, message, "say 'them', 'all of them', or 'all' with a noun")
        return found

    def _check_count(self, counted: Mention, found: Sequence[str], owner: str) -> None:
        if counted.ends[0].value != len(found):
            message = f"there are {len(found)}, not {counted.ends[0].text}"
            raise Unclear(counted.ends[0].offset, message, self._range(owner))

    def _both(self, words: Words, offset: int) -> list[str]:
        found = self._of(words.owner)
        if len(found) == 2:
            return found
        last = self.named[-1] if self.named else ()
        if len(last) != 2 or not all(self._is(name, words.owner) for name in last):
            raise Unclear(offset, f"'both' means two, but there are {len(found)}", self._range(words.owner))
        return list(last)

    def _others(self, words: Words, offset: int) -> list[str]:
        """All objects of the type that were not named so far."""
        named = {name for names in self.named for name in names if self._is(name, words.owner)}
        found = [name for name in self._of(words.owner) if name not in named]
        said = " ".join(piece.text for piece in words.pieces)
        if named and found and self._is_one(words) and len(found) > 1:
            raise Unclear(offset, f"which '{said}'? there are {len(found)}", f"these: {', '.join(found)}")
        for counted in words.mentions:
            if counted.ends[0].value != 1:
                self._check_count(counted, found, words.owner)
        if not named:
            message = (
                f"'{said}' means those that were not named, but no {self._noun(words.owner)} was named before"
            )
            raise Unclear(offset, message, self._range(words.owner))
        if not found:
            raise Unclear(
                offset, f"'{said}': there is no other {self._noun(words.owner)}", self._range(words.owner)
            )
        return found

    def _is_one(self, words: Words) -> bool:
        """Whether the words name one object: "the other one", "the other probe"."""
        last = words.pieces[-1].lower
        plurals = {noun[-1] for nouns in self.vocabulary.nouns(words.owner).values() for noun, _ in nouns}
        return last == "one" or any(each in plurals and each != last for each in (f"{last}s", f"{last}es"))

    def _earlier(self, words: Words, offset: int, type_: str) -> Sequence[str]:
        """The objects that a pronoun means: the last list of this type. "them" after single objects means all of them."""
        said = [piece.lower for piece in words.pieces]
        fitting = [names for names in self.named if all(self._is(name, type_) for name in names)]
        if not fitting:
            hint = f"name it: {self._range(type_)}" if self._of(type_) else self._range(type_)
            raise Unclear(offset, f"nothing before '{' '.join(said)}' is {self._article(type_)}", hint)
        last = fitting[-1]
        if said[0] in ("it", "this", "that"):
            if len(last) > 1 and last not in self.each:
                message = (
                    f"'{' '.join(said)}' means one object, but the last ones named were {', '.join(last)}"
                )
                raise Unclear(offset, message, "did you mean 'them'?")
            return last
        if said[0] == "same":
            return last
        meant = self._named_so_far(type_)
        if "both" in said and len(meant) != 2:
            raise Unclear(
                offset,
                f"'both' means two objects, but these were named: {', '.join(meant)}",
                "did you mean 'them'?",
            )
        return meant

    def _omitted(self, words: Words, offset: int, type_: str) -> Sequence[str]:
        """The objects of the last act: "heat probe 1 for 15 min, cool for 5 min"."""
        fitting = [names for names in self.named if all(self._is(name, type_) for name in names)]
        if not fitting:
            message = f"'{words.pieces[-1].text}' what? {self._article(type_)} is missing behind it"
            raise Unclear(offset, message, self._range(type_))
        return fitting[-1]

    def _mention(self, mention: Mention, type_: str) -> Sequence[str]:
        match mention.how, mention.ends:
            case "called", _:
                return [mention.owner]
            case "sole" | "counted" | "ranked", ends:
                return self._by_noun(mention, ends, type_)
            case "numbered", (end,):
                return [self._numbered(end, type_)]
            case "named", (end,):
                return [self._named(end)]
            case "numbers", (first, last):
                return list(self._range_of(first, last, type_))
            case _, (first, last):
                return list(self._names(first, last))
            case how, ends:
                raise AssertionError(f"a mention that no rule makes: {how} {ends}")

    def _by_noun(self, mention: Mention, ends: Sequence[Piece], type_: str) -> Sequence[str]:
        if mention.how == "ranked":
            return self._ranked(mention, type_)
        return self._sole(mention, type_) if not ends else self._counted(mention, ends[0], type_)

    def _sole(self, mention: Mention, type_: str) -> Sequence[str]:
        """The only object of a type, or the one that was named last: "heat probe 1, then cool the probe"."""
        found = self._of(type_)
        if len(found) == 1:
            return found
        fitting = [names for names in self.named if all(self._is(name, type_) for name in names)]
        if fitting and len(fitting[-1]) == 1:
            return fitting[-1]
        said = mention.pieces[-1]
        if not found:
            raise Unclear(said.offset, f"there is no {said.text}")
        hint = f"{self._range(type_)}; say which, or 'all'"
        raise Unclear(said.offset, f"which {said.text}? there are {len(found)}", hint)

    def _counted(self, mention: Mention, count: Piece, type_: str) -> Sequence[str]:
        """Exactly as many objects as there are, or as were named last: "the two probes"."""
        found = self._of(type_)
        fitting = [names for names in self.named if all(self._is(name, type_) for name in names)]
        if count.value != 1 and fitting and len(fitting[-1]) == count.value:
            return fitting[-1]
        if count.value == len(found):
            return found
        said = " ".join(piece.text for piece in mention.pieces)
        raise Unclear(count.offset, f"which {said}? there are {len(found)}", self._range(type_))

    def _ranked(self, mention: Mention, type_: str) -> Sequence[str]:
        """The objects at places of a row: of those that were named, or else of all, if these are numbered from 1 on."""
        said = " ".join(piece.text for piece in mention.pieces)
        named, whole = self._named_so_far(type_), self._of(type_)
        numbered = [_number(each) for each in whole] == [*range(1, len(whole) + 1)]
        ranked = named in self.ranked or all((each,) in self.ranked for each in named)
        rows = Rows(named, whole if numbered else (), ranked, self._range(type_))
        return rows.chosen(mention, said)

    def _named_so_far(self, type_: str) -> tuple[str, ...]:
        """The last list of objects of a type, as they were said; single ones together, in the order in which they were."""
        fitting = [names for names in self.named if all(self._is(name, type_) for name in names)]
        if fitting and len(fitting[-1]) > 1:
            return fitting[-1]
        return tuple(dict.fromkeys(name for names in fitting for name in names))

    def _numbered(self, end: Piece, type_: str) -> str:
        found = [name for name in self._of(type_) if _number(name) == end.value]
        if len(found) != 1:
            several = f"{' and '.join(found)} both have the number {end.text}"
            message = several if found else f"there is no {self._noun(type_)} {end.text}"
            raise Unclear(end.offset, message, self._range(type_))
        return found[0]

    def _named(self, end: Piece) -> str:
        name = self.vocabulary.name(end.text)
        if name is None:
            raise Unclear(end.offset, f"there is no '{end.text}'", nearest(end.text, list(self.objects)))
        return name

    def _range_of(self, first: Piece, last: Piece, type_: str) -> Iterator[str]:
        low, high = int(first.value or 0), int(last.value or 0)
        if low > high:
            raise Unclear(first.offset, f"from {low} to {high} there is nothing", f"say {high} to {low}")
        self._numbered(last, type_)  # a wrong end is reported at its own place
        for number in range(low, high + 1):
            yield self._numbered(Piece(first.kind, str(number), first.offset, Fraction(number)), type_)

    def _names(self, first: Piece, last: Piece) -> Iterator[str]:
        low = ENDING.fullmatch(self._named(first))
        high = ENDING.fullmatch(
            f"{low[1]}{last.text}" if low and last.value is not None else self._named(last)
        )
        if low is None or high is None or low[1] != high[1]:
            raise Unclear(
                first.offset,
                f"{first.text} to {last.text} is not a range",
                "a range counts up, such as m1 to m12",
            )
        if int(low[2]) > int(high[2]):
            raise Unclear(
                first.offset, f"from {first.text} to {last.text} there is nothing", "exchange the two ends"
            )
        for number in range(int(low[2]), int(high[2]) + 1):
            yield self._named(Piece(last.kind, f"{low[1]}{number:0{len(low[2])}}", last.offset))

    def _is(self, name: str, type_: str) -> bool:
        return self.domain.is_subtype(self.objects[name], type_)

    def _of(self, type_: str) -> list[str]:
        found = [name for name in self.objects if self._is(name, type_)]
        return sorted(found, key=lambda name: natural_key(Function(name)))

    def _range(self, type_: str) -> str:
        names = self._of(type_)
        if not names:
            return f"give the command to a problem that has {self._article(type_)}: here there is none"
        shown = ", ".join(names) if len(names) <= 6 else f"{names[0]} to {names[-1]}"
        return f"there {'is' if len(names) == 1 else 'are'} {shown}"

    def _article(self, type_: str) -> str:
        return with_article(self._noun(type_))

    def _noun(self, type_: str) -> str:
        """What the sentence calls an object of a type; or else what the domain does."""
        return self.nouns.get(type_) or self.vocabulary.usual_noun(type_)


def _number(name: str) -> int | None:
    found = re.search(r"\d+$", name)
    return int(found[0]) if found else None
