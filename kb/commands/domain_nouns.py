"""The nouns of a domain: how people call the objects of each type, and single objects."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

from cellwright.kb.commands.phrase_patterns import (
    ARTICLES,
    PatternWord,
    Variant,
    noun_plurals,
    spoken_words,
)
from cellwright.kb.commands.sentence_pieces import SlotWords, is_spoken
from cellwright.kb.model.domain_model import BUILT_IN_TYPES, Domain
from cellwright.kb.terms import Atom, Text

Noun = tuple[str, ...]
"""The words of a noun, in small letters, without an article before them."""

Nouns = Mapping[str, tuple[tuple[Noun, str], ...]]
"""Nouns by their first words, each with the type or object that it names."""


@dataclass(frozen=True, slots=True)
class NamedObject:
    """An object that the words of a phrase name, and the numbers of the first and last part
    that name it.
    """

    object: str
    first: int
    last: int


class NounVocabulary:
    """The nouns of the types and objects of a domain.

    `objects` maps the names of all objects to their types.
    """

    def __init__(
        self, domain: Domain, objects: Mapping[str, str], facts: Iterable[Atom] = ()
    ) -> None:
        self.domain, self.objects = domain, objects
        self._names = _names_given(domain, facts)
        self._nouns: dict[str, Nouns] = {}
        self._called: dict[str, Nouns] = {}
        self._numbers: dict[str, frozenset[Fraction]] = {}
        self._folded = {name.lower(): name for name in reversed(list(objects))}

    def nouns(self, type_: str) -> Nouns:
        """The nouns for objects of a type, each with the type that it belongs to (the type
        itself or one below it).
        """
        if type_ not in self._nouns:
            own = [type_] if type_ in BUILT_IN_TYPES else []
            below = (
                *own,
                *(
                    subtype
                    for subtype in self.domain.types
                    if self.domain.is_subtype(subtype, type_)
                ),
            )
            self._nouns[type_] = _by_first(
                (noun, subtype) for subtype in below for noun in self._said(subtype)
            )
        return self._nouns[type_]

    def called(self, type_: str) -> Nouns:
        """The nouns of single objects of a type, each with its object."""
        if type_ not in self._called:
            names = (name for name in self.objects if self.is_a(name, type_))
            self._called[type_] = _by_first(
                (noun, name) for name in names for noun in self._own(name)
            )
        return self._called[type_]

    def name(self, said: str) -> str | None:
        """The object with this name, in small or capital letters; None if there is none."""
        return said if said in self.objects else self._folded.get(said.lower())

    def is_a(self, name: str, type_: str) -> bool:
        """Whether an object is of a type."""
        return self.domain.is_subtype(self.objects[name], type_)

    @cached_property
    def things(self) -> Mapping[Noun, str]:
        """The objects by their names and nouns, as the words of a phrase may contain them; no
        constants of closed lists.
        """
        constants = {
            constant for type_ in self.domain.types.values() for constant in type_.constants
        }
        nouns: dict[Noun, str] = {}
        for name in (object_name for object_name in self.objects if object_name not in constants):
            for noun in ((name.lower(),), *self._own(name)):
                nouns.setdefault(noun, name)
        return nouns

    def named(self, parts: Variant) -> tuple[NamedObject, ...]:
        """The objects that the words of a phrase name, in order; of several readings, the
        longest noun.
        """
        longest = max(map(len, self.things), default=0)
        words = tuple(part.text if isinstance(part, PatternWord) else "" for part in parts)
        named: list[NamedObject] = []
        for place in range(len(words)):
            if named and place <= named[-1].last:
                continue
            ends = range(min(len(words), place + longest), place, -1)
            end = next((end for end in ends if words[place:end] in self.things), None)
            if end is not None:
                named.append(NamedObject(self.things[words[place:end]], place, end - 1))
        return tuple(named)

    def numbered(self, type_: str, value: Fraction | None) -> bool:
        """Whether an object of a type has a name that ends with this number."""
        if type_ not in self._numbers:
            ends = (re.search(r"\d+$", name) for name in self.objects if self.is_a(name, type_))
            self._numbers[type_] = frozenset(Fraction(end[0]) for end in ends if end)
        return value in self._numbers[type_]

    def said_nouns(self, words: SlotWords) -> dict[str, str]:
        """What the content of a slot calls an object of a type, by its type."""
        parts = (
            (words.owner, words.pieces),
            *((mention.owner, mention.pieces) for mention in words.mentions),
        )
        nouns = (
            (owner, self._singular(owner, [piece.lower for piece in pieces]))
            for owner, pieces in parts
        )
        return {owner: noun for owner, noun in nouns if noun}

    def _singular(self, type_: str, said: Sequence[str]) -> str:
        """The noun of a type that stands among these words, as one says it of one object; empty
        if none does.
        """
        known_nouns = list(self._said(type_)) if type_ in self.domain.types else []
        contained = [noun for noun in known_nouns if _contains_noun(said, noun)]
        if not contained:
            return ""
        longest = max(map(" ".join, contained), key=len)
        return min(
            (noun for noun in map(" ".join, known_nouns) if longest in noun_plurals(noun)), key=len
        )

    def usual_noun(self, type_: str) -> str:
        """What an object of a type is called where nobody has said it: the noun that all their
        names begin with, else the first noun of the type.
        """
        names = [name for name in self.objects if self.is_a(name, type_)]
        stems = {tuple(re.sub(r"_?\d+$", "", name).lower().split("_")) for name in names}
        common = stems & set(self._said(type_)) if len(stems) == 1 else ()
        return " ".join(next(iter(sorted(common)), next(self._said(type_))))

    def _said(self, type_: str) -> Iterator[Noun]:
        plain = type_.replace("_", " ")
        for wording in self.domain.words.get(type_, noun_plurals(plain)):
            yield _without_article(spoken_words(wording))

    def _own(self, name: str) -> Iterator[Noun]:
        """The nouns of one object: those listed under `words`, its name with blanks, and its name
        before the noun of its type: "the left station" is `left`.
        """
        if name not in self.domain.types:
            yield from (
                _without_article(spoken_words(wording))
                for wording in self.domain.words.get(name, ())
            )
            for given in map(spoken_words, self._names.get(name, ())):
                yield given
                # "sample A17"
                yield from ((*noun, *given) for noun in self._said(self.objects[name]))
        parts = tuple(name.lower().split("_"))
        if (
            len(parts) > 1
            and all(parts)
            and not (parts[-1].isdecimal() and self._is_noun(name, parts[:-1]))
        ):
            yield parts
        numbered = not name or name[-1].isdecimal()
        if not numbered and all(map(is_spoken, parts)) and name not in self.domain.types:
            for noun in self._said(self.objects[name]):
                if "_".join((*parts, *noun)) not in self._folded and parts[-1] != noun[-1]:
                    yield (*parts, *noun)

    def _is_noun(self, name: str, stem: Noun) -> bool:
        """Whether the beginning of a name is a noun of its type, so that "probe 1" says it
        anyway.
        """
        return any(stem == noun for noun in self._said(self.objects[name]))


def _names_given(domain: Domain, facts: Iterable[Atom]) -> dict[str, list[str]]:
    """What people call each object, as facts of a static say whose name ends with `name` or
    `label`: `sample_name(probe_1, "A17")`.
    """
    found: dict[str, list[str]] = {}
    for fact in facts:
        declared = domain.predicates.get(fact.name)
        named = re.search(r"(?:^|_)(?:name|label)s?$", fact.name) and len(fact.arguments) == 2
        if named and declared is not None and declared.arguments[1] == "text":
            thing, said = fact.arguments
            if (
                isinstance(said, Text)
                and said.value.split()
                and all(map(is_spoken, said.value.split()))
            ):
                found.setdefault(str(thing), []).append(said.value)
    return found


def _by_first(owned_nouns: Iterable[tuple[Noun, str]]) -> Nouns:
    nouns: dict[str, list[tuple[Noun, str]]] = {}
    for noun, owner in owned_nouns:
        if noun and (noun, owner) not in nouns.setdefault(noun[0], []):
            nouns[noun[0]].append((noun, owner))
    return {first: tuple(own_nouns) for first, own_nouns in nouns.items()}


def _contains_noun(said: Sequence[str], noun: Noun) -> bool:
    places = range(len(said) - len(noun) + 1)
    return any(tuple(said[place : place + len(noun)]) == noun for place in places)


def _without_article(noun: Noun) -> Noun:
    """The noun without an article before it."""
    return noun[1:] if noun[1:] and noun[0] in ARTICLES else noun
