"""Resolves which objects a sentence means: numbers, names, ranges, rows, "all", pronouns."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction

from cellwright.kb.commands.domain_nouns import NounVocabulary
from cellwright.kb.commands.phrase_matching import ORDINAL_WORDS
from cellwright.kb.commands.phrase_patterns import with_article
from cellwright.kb.commands.sentence_pieces import (
    SentencePiece,
    SlotMention,
    SlotWords,
    UnclearReference,
)
from cellwright.kb.diagnostics import nearest_hint
from cellwright.kb.terms import Function, natural_key


@dataclass(frozen=True, slots=True)
class ObjectRows:
    """The rows of which "the last two" may speak: the objects `named` before, and the `whole` row
    of all.

    The named ones may have been `ranked` themselves: "heat the first two". `there` says which
    objects there are.
    """

    named: Sequence[str]
    whole: Sequence[str]
    ranked: bool
    there: str

    def chosen(self, mention: SlotMention, said: str) -> Sequence[str]:
        """The objects at the places that a mention names in the row that is meant. Raises
        `UnclearReference`.

        With a noun, as in "the first probe", both rows must agree. Without one, those that were
        named are meant, unless they were all named as the first or the last ones: then the others
        of the whole row are.
        """
        ends = mention.ends
        rows = [row for row in (self.named if len(self.named) > 1 else (), self.whole) if row]
        if not rows:
            hint = f"{self.there}; say its number or its name"
            raise UnclearReference(
                ends[0].offset, f"'{said}' of what? nothing here stands in a row", hint
            )
        chosen = list(
            dict.fromkeys(objects for row in rows if (objects := tuple(_at_places(row, ends))))
        )
        if not chosen:
            raise UnclearReference(ends[0].offset, f"there is no '{said}'", self.there)
        if self.ranked and len(chosen) > 1 and set(chosen[0]) == set(self.named):
            return chosen[1]
        if len(chosen) > 1 and (mention.owner or self.ranked):
            message = f"'{said}' can mean those that were named, or all that there are"
            raise UnclearReference(ends[0].offset, message, "say the numbers or names")
        if not mention.owner and self.named and not self.ranked:
            self._require_enough(ends, said)
        return chosen[0]

    def _require_enough(self, ends: Sequence[SentencePiece], said: str) -> None:
        """Raises `UnclearReference` if fewer were named than are asked for: nobody knows whether
        the others are meant, too.
        """
        if len(self.named) > 1 and _at_places(self.named, ends):
            return
        only = (
            f"only {' and '.join(self.named)} {'was' if len(self.named) == 1 else 'were'} named "
            "before"
        )
        raise UnclearReference(
            ends[0].offset, f"'{said}' of which? {only}", "say the numbers or names"
        )


def _at_places(row: Sequence[str], ends: Sequence[SentencePiece]) -> Sequence[str]:
    """The objects at the places that an ordinal and a count name: the first two, the third, the
    last; nothing if there are too few.
    """
    ordinal, count = ends[0].lower, int(ends[1].value or 1) if len(ends) > 1 else 1
    first = len(row) - count if ordinal == "last" else ORDINAL_WORDS.index(ordinal)
    return row[first : first + count] if 0 <= first <= len(row) - count else ()


NUMBER_ENDING = re.compile(r"(.*?)(\d+)")


class References:
    """The objects named so far, and the objects that a slot of a type may mean.

    `objects` maps names to types.
    """

    def __init__(self, vocabulary: NounVocabulary) -> None:
        self.vocabulary, self.domain, self.objects = (
            vocabulary,
            vocabulary.domain,
            vocabulary.objects,
        )
        self.named: list[tuple[str, ...]] = []
        self.nouns: dict[str, str] = {}  # what the sentence calls an object of a type
        # named by "each" or "every", so that "it" means each of them
        self.each: set[tuple[str, ...]] = set()
        self.ranked: set[tuple[str, ...]] = set()  # named as the first ones, the last ones, ...

    def resolve(self, words: SlotWords, type_: str) -> tuple[Function, ...]:
        """The objects meant, each once, in the order in which they are said.

        Raises `UnclearReference`.
        """
        self.nouns |= self.vocabulary.said_nouns(words)
        objects = self._left(words, type_, self._meant(words, type_))
        unique = tuple(dict.fromkeys(objects))
        for name in unique:
            if not self._is(name, type_):
                said = f"{name} is {self._article(self.objects[name])}, not {self._article(type_)}"
                raise UnclearReference(words.pieces[0].offset, said)
        if words.how not in ("pronoun", "omitted"):
            self.named.append(tuple(dict.fromkeys(objects)))
            if words.pieces[0].lower in ("each", "every"):
                self.each.add(self.named[-1])
            if [mention.how for mention in words.mentions] == ["ranked"]:
                self.ranked.add(self.named[-1])
        return tuple(map(Function, unique))

    def _left(self, words: SlotWords, type_: str, objects: Sequence[str]) -> Sequence[str]:
        """The objects without those that "except" names, each of which must be among them."""
        if not words.but:
            return objects
        gone = self._listed(words.but, words.owner or type_)
        if strange := [name for name in gone if name not in objects]:
            message = f"{strange[0]} is not among those from which it is left out"
            raise UnclearReference(
                words.but[0].pieces[0].offset, message, f"these are: {', '.join(objects)}"
            )
        if not (remaining := [name for name in objects if name not in gone]):
            raise UnclearReference(
                words.pieces[0].offset, f"there is no other {self._noun(words.owner or type_)}"
            )
        return remaining

    def _meant(self, words: SlotWords, type_: str) -> Sequence[str]:
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

    def _listed(self, mentions: Sequence[SlotMention], type_: str) -> list[str]:
        owner = type_
        objects: list[str] = []
        for mention in mentions:
            owner = mention.owner or owner  # "probes 1 and 2": the noun also belongs to the 2
            objects.extend(self._mention(mention, owner if owner in self.domain.types else type_))
        return objects

    def _all(self, words: SlotWords, offset: int) -> list[str]:
        objects = self._of(words.owner)
        for counted in words.mentions:
            self._check_count(counted, objects, words.owner)
        if not objects:
            raise UnclearReference(offset, f"there is no {self._noun(words.owner)}")
        named = {name for names in self.named for name in names if self._is(name, words.owner)}
        if words.how == "bare" and named and named != set(objects):
            message = (
                f"'all' can mean those that were named ({', '.join(sorted(named))}), or all "
                "that there are"
            )
            raise UnclearReference(
                offset, message, "say 'them', 'all of them', or 'all' with a noun"
            )
        return objects

    def _check_count(self, counted: SlotMention, objects: Sequence[str], owner: str) -> None:
        if counted.ends[0].value != len(objects):
            message = f"there are {len(objects)}, not {counted.ends[0].text}"
            raise UnclearReference(counted.ends[0].offset, message, self._range(owner))

    def _both(self, words: SlotWords, offset: int) -> list[str]:
        objects = self._of(words.owner)
        if len(objects) == 2:
            return objects
        last = self.named[-1] if self.named else ()
        if len(last) != 2 or not all(self._is(name, words.owner) for name in last):
            raise UnclearReference(
                offset, f"'both' means two, but there are {len(objects)}", self._range(words.owner)
            )
        return list(last)

    def _others(self, words: SlotWords, offset: int) -> list[str]:
        """All objects of the type that were not named so far."""
        named = {name for names in self.named for name in names if self._is(name, words.owner)}
        objects = [name for name in self._of(words.owner) if name not in named]
        wording = " ".join(piece.text for piece in words.pieces)
        if named and objects and self._is_one(words) and len(objects) > 1:
            raise UnclearReference(
                offset,
                f"which '{wording}'? there are {len(objects)}",
                f"these: {', '.join(objects)}",
            )
        for counted in words.mentions:
            if counted.ends[0].value != 1:
                self._check_count(counted, objects, words.owner)
        if not named:
            message = (
                f"'{wording}' means those that were not named, but no {self._noun(words.owner)} "
                "was named before"
            )
            raise UnclearReference(offset, message, self._range(words.owner))
        if not objects:
            raise UnclearReference(
                offset,
                f"'{wording}': there is no other {self._noun(words.owner)}",
                self._range(words.owner),
            )
        return objects

    def _is_one(self, words: SlotWords) -> bool:
        """Whether the words name one object: "the other one", "the other probe"."""
        last = words.pieces[-1].lower
        plurals = {
            noun[-1] for nouns in self.vocabulary.nouns(words.owner).values() for noun, _ in nouns
        }
        return last == "one" or any(
            plural in plurals and plural != last for plural in (f"{last}s", f"{last}es")
        )

    def _earlier(self, words: SlotWords, offset: int, type_: str) -> Sequence[str]:
        """The objects that a pronoun means: the last list of this type. "them" after single
        objects means all of them.
        """
        words_said = [piece.lower for piece in words.pieces]
        fitting = [names for names in self.named if all(self._is(name, type_) for name in names)]
        if not fitting:
            hint = f"name it: {self._range(type_)}" if self._of(type_) else self._range(type_)
            raise UnclearReference(
                offset, f"nothing before '{' '.join(words_said)}' is {self._article(type_)}", hint
            )
        last = fitting[-1]
        if words_said[0] in ("it", "this", "that"):
            if len(last) > 1 and last not in self.each:
                message = (
                    f"'{' '.join(words_said)}' means one object, but the last ones named were "
                    f"{', '.join(last)}"
                )
                raise UnclearReference(offset, message, "did you mean 'them'?")
            return last
        if words_said[0] == "same":
            return last
        meant = self._named_so_far(type_)
        if "both" in words_said and len(meant) != 2:
            raise UnclearReference(
                offset,
                f"'both' means two objects, but these were named: {', '.join(meant)}",
                "did you mean 'them'?",
            )
        return meant

    def _omitted(self, words: SlotWords, offset: int, type_: str) -> Sequence[str]:
        """The objects of the last act: "heat probe 1 for 15 min, cool for 5 min"."""
        fitting = [names for names in self.named if all(self._is(name, type_) for name in names)]
        if not fitting:
            message = f"'{words.pieces[-1].text}' what? {self._article(type_)} is missing behind it"
            raise UnclearReference(offset, message, self._range(type_))
        return fitting[-1]

    def _mention(self, mention: SlotMention, type_: str) -> Sequence[str]:
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

    def _by_noun(
        self, mention: SlotMention, ends: Sequence[SentencePiece], type_: str
    ) -> Sequence[str]:
        if mention.how == "ranked":
            return self._ranked(mention, type_)
        return self._sole(mention, type_) if not ends else self._counted(mention, ends[0], type_)

    def _sole(self, mention: SlotMention, type_: str) -> Sequence[str]:
        """The only object of a type, or the one that was named last: "heat probe 1, then cool
        the probe".
        """
        objects = self._of(type_)
        if len(objects) == 1:
            return objects
        fitting = [names for names in self.named if all(self._is(name, type_) for name in names)]
        if fitting and len(fitting[-1]) == 1:
            return fitting[-1]
        noun = mention.pieces[-1]
        if not objects:
            raise UnclearReference(noun.offset, f"there is no {noun.text}")
        hint = f"{self._range(type_)}; say which, or 'all'"
        raise UnclearReference(noun.offset, f"which {noun.text}? there are {len(objects)}", hint)

    def _counted(self, mention: SlotMention, count: SentencePiece, type_: str) -> Sequence[str]:
        """Exactly as many objects as there are, or as were named last: "the two probes"."""
        objects = self._of(type_)
        fitting = [names for names in self.named if all(self._is(name, type_) for name in names)]
        if count.value != 1 and fitting and len(fitting[-1]) == count.value:
            return fitting[-1]
        if count.value == len(objects):
            return objects
        wording = " ".join(piece.text for piece in mention.pieces)
        raise UnclearReference(
            count.offset, f"which {wording}? there are {len(objects)}", self._range(type_)
        )

    def _ranked(self, mention: SlotMention, type_: str) -> Sequence[str]:
        """The objects at places of a row: of those that were named, or else of all, if these
        are numbered from 1 on.
        """
        wording = " ".join(piece.text for piece in mention.pieces)
        named, whole = self._named_so_far(type_), self._of(type_)
        numbered = [_number_of_name(name) for name in whole] == [*range(1, len(whole) + 1)]
        ranked = named in self.ranked or all((name,) in self.ranked for name in named)
        rows = ObjectRows(named, whole if numbered else (), ranked, self._range(type_))
        return rows.chosen(mention, wording)

    def _named_so_far(self, type_: str) -> tuple[str, ...]:
        """The last list of objects of a type, as they were said; single ones together, in the
        order in which they were.
        """
        fitting = [names for names in self.named if all(self._is(name, type_) for name in names)]
        if fitting and len(fitting[-1]) > 1:
            return fitting[-1]
        return tuple(dict.fromkeys(name for names in fitting for name in names))

    def _numbered(self, end: SentencePiece, type_: str) -> str:
        objects = [name for name in self._of(type_) if _number_of_name(name) == end.value]
        if len(objects) != 1:
            several = f"{' and '.join(objects)} both have the number {end.text}"
            message = several if objects else f"there is no {self._noun(type_)} {end.text}"
            raise UnclearReference(end.offset, message, self._range(type_))
        return objects[0]

    def _named(self, end: SentencePiece) -> str:
        name = self.vocabulary.name(end.text)
        if name is None:
            raise UnclearReference(
                end.offset, f"there is no '{end.text}'", nearest_hint(end.text, list(self.objects))
            )
        return name

    def _range_of(self, first: SentencePiece, last: SentencePiece, type_: str) -> Iterator[str]:
        low, high = int(first.value or 0), int(last.value or 0)
        if low > high:
            raise UnclearReference(
                first.offset, f"from {low} to {high} there is nothing", f"say {high} to {low}"
            )
        self._numbered(last, type_)  # a wrong end is reported at its own place
        for number in range(low, high + 1):
            yield self._numbered(
                SentencePiece(first.kind, str(number), first.offset, Fraction(number)), type_
            )

    def _names(self, first: SentencePiece, last: SentencePiece) -> Iterator[str]:
        low = NUMBER_ENDING.fullmatch(self._named(first))
        high = NUMBER_ENDING.fullmatch(
            f"{low[1]}{last.text}" if low and last.value is not None else self._named(last)
        )
        if low is None or high is None or low[1] != high[1]:
            raise UnclearReference(
                first.offset,
                f"{first.text} to {last.text} is not a range",
                "a range counts up, such as m1 to m12",
            )
        if int(low[2]) > int(high[2]):
            raise UnclearReference(
                first.offset,
                f"from {first.text} to {last.text} there is nothing",
                "exchange the two ends",
            )
        for number in range(int(low[2]), int(high[2]) + 1):
            yield self._named(
                SentencePiece(last.kind, f"{low[1]}{number:0{len(low[2])}}", last.offset)
            )

    def _is(self, name: str, type_: str) -> bool:
        return self.domain.is_subtype(self.objects[name], type_)

    def _of(self, type_: str) -> list[str]:
        objects = [name for name in self.objects if self._is(name, type_)]
        return sorted(objects, key=lambda name: natural_key(Function(name)))

    def _range(self, type_: str) -> str:
        names = self._of(type_)
        if not names:
            return (
                f"give the command to a problem that has {self._article(type_)}: here there is none"
            )
        shown = ", ".join(names) if len(names) <= 6 else f"{names[0]} to {names[-1]}"
        return f"there {'is' if len(names) == 1 else 'are'} {shown}"

    def _article(self, type_: str) -> str:
        return with_article(self._noun(type_))

    def _noun(self, type_: str) -> str:
        """What the sentence calls an object of a type; or else what the domain does."""
        return self.nouns.get(type_) or self.vocabulary.usual_noun(type_)


def _number_of_name(name: str) -> int | None:
    match = re.search(r"\d+$", name)
    return int(match[0]) if match else None
