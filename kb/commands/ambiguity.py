"""What phrases and nouns of a domain leave open: sentences of two phrases, and nouns of two things. Told by `check`.

Each phrase is said once in every way, with what its slots can contain, and all phrases are asked which of them it is.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from cellwright.kb.commands.matching import Match, Matcher
from cellwright.kb.commands.patterns import Slot, Word, expansions
from cellwright.kb.commands.phrases import Meaning, meanings
from cellwright.kb.commands.reading import Said
from cellwright.kb.commands.references import References
from cellwright.kb.commands.sentence import book_of
from cellwright.kb.commands.vocabulary import Vocabulary
from cellwright.kb.commands.words import Unclear
from cellwright.kb.diagnostics import Diagnostic
from cellwright.kb.model.domain import NUMERIC_TYPES, Domain
from cellwright.kb.terms import Function, Term, Variable, substitute_atom

MOST_SAID = 3000  # sentences that are tried


@dataclass(frozen=True, slots=True)
class _Example:
    """A sentence of a phrase, and how it is shown: with types for the slots, or with the words of one object."""

    said: str
    shown: str


def unclear_words(domain: Domain) -> Iterator[Diagnostic]:
    """Warnings about sentences that two phrases mean differently, and nouns that mean two things."""
    known = meanings(domain)
    vocabulary = Vocabulary(domain, domain.objects)
    yield from _phrases(known, vocabulary)
    yield from _nouns(domain, known, vocabulary)


def _phrases(known: Sequence[Meaning], vocabulary: Vocabulary) -> Iterator[Diagnostic]:
    book = book_of(known, vocabulary)
    parts = [part for meaning in known for each in expansions(meaning.pattern) for part in each]
    words = frozenset(part.text for part in parts if isinstance(part, Word))
    types = frozenset(part.type for part in parts if isinstance(part, Slot))
    left = MOST_SAID
    for number, meaning in enumerate(known):
        for example in _examples(meaning, vocabulary, words, types):
            left -= 1
            if left < 0:
                return
            found = list(Matcher(book, Said(example.said), False).whole())
            own = {_meant(known, each, vocabulary) for each in found if each.form.phrase == number}
            earlier = [each for each in found if each.form.phrase < number]
            if other := next((each for each in earlier if _meant(known, each, vocabulary) not in own), None):
                message = f"'{example.shown}' also fits an earlier phrase, which takes precedence"
                hint = f"the earlier phrase is: {known[other.form.phrase].phrase.say}"
                yield Diagnostic(meaning.phrase.where, "K605", message, hint, warning=True)
                break


def _meant(known: Sequence[Meaning], match: Match, vocabulary: Vocabulary) -> frozenset[Term]:
    """What a reading asks for, with the objects that it names, as far as the domain has them."""
    meaning, references = known[match.form.phrase], References(vocabulary)
    types = {slot.variable: slot.type for slot in meaning.slots}
    bound: dict[Variable, Term] = {}
    slots = [part.variable for part in match.form.parts if isinstance(part, Slot)]
    for variable, words in zip(slots, match.values, strict=True):
        said = Function(" ".join(piece.lower for piece in words.pieces))
        try:
            found = references.resolve(words, types[variable]) if words.how != "value" else (said,)
        except Unclear:
            found = (said,)
        bound[Variable(variable)] = found[0] if len(found) == 1 else Function("all of", tuple(found))
    signs = ((literal, "" if literal.positive else "not ") for literal in meaning.conditions)
    return frozenset(Function(sign, (substitute_atom(literal.atom, bound),)) for literal, sign in signs)


def _examples(
    meaning: Meaning, vocabulary: Vocabulary, words: frozenset[str], types: frozenset[str]
) -> Iterator[_Example]:
    """Sentences of a phrase: each way of saying it, once with plain contents and once with each special content of a slot.

    Special is what can be taken for something else: a number alone, names and nouns with `words` of phrases in them, and
    the nouns of types below that have slots of their own (`types`).
    """
    for parts in expansions(meaning.pattern):
        plain = [_plain(part, number, vocabulary) for number, part in enumerate(parts)]
        yield _example(plain)
        for number, part in enumerate(parts):
            for special in _special(part, number, vocabulary, words, types):
                yield _example([*plain[:number], _Example(special, special), *plain[number + 1 :]])


def _example(parts: Sequence[_Example]) -> _Example:
    return _Example(" ".join(each.said for each in parts), " ".join(each.shown for each in parts))


def _plain(part: Word | Slot, number: int, vocabulary: Vocabulary) -> _Example:
    if isinstance(part, Word):
        return _Example(part.text, part.text)
    if part.type in NUMERIC_TYPES:
        said = f"{number + 1} min" if part.type == "time" else str(number + 1)
        return _Example(said, f"<{'number' if part.type == 'int' else part.type}>")
    nouns = [
        noun for each in vocabulary.nouns(part.type).values() for noun, owner in each if owner == part.type
    ]
    noun = " ".join(nouns[0]) if nouns else part.type
    return _Example(f"{noun} {number + 1}", f"<{part.type}>")


def _special(
    part: Word | Slot, number: int, vocabulary: Vocabulary, words: frozenset[str], types: frozenset[str]
) -> Iterator[str]:
    """What a slot can contain that may be taken for something else."""
    if isinstance(part, Word) or part.type in NUMERIC_TYPES:
        return
    called = [" ".join(noun) for each in vocabulary.called(part.type).values() for noun, _ in each]
    names = [name for name in vocabulary.objects if vocabulary.is_a(name, part.type)]
    nouns = [(" ".join(noun), owner) for each in vocabulary.nouns(part.type).values() for noun, owner in each]
    alone = dict.fromkeys([*called, *names, *(noun for noun, _ in nouns)])
    yield from (each for each in alone if words & {*each.split()})
    below = {owner: noun for noun, owner in reversed(nouns) if owner != part.type and owner in types}
    yield from (f"{noun} {number + 1}" for noun in below.values())
    yield "1"


def _nouns(domain: Domain, known: Sequence[Meaning], vocabulary: Vocabulary) -> Iterator[Diagnostic]:
    """Warnings about a noun of two types or objects that one slot can contain."""
    told: set[str] = set()
    for meaning, slot in ((each, slot) for each in known for slot in each.slots):
        if slot.type in NUMERIC_TYPES:
            continue
        owners: dict[tuple[str, ...], str] = {}
        for noun, owner in _owners(slot.type, vocabulary):
            first, said = owners.setdefault(noun, owner), " ".join(noun)
            if first != owner and said not in told and not _only(vocabulary, first, owner):
                told.add(said)
                where = domain.types[owner].where if owner in domain.types else meaning.phrase.where
                message = f"'{said}' means both {first} and {owner}; a sentence means {first}"
                yield Diagnostic(
                    where, "K607", message, "give one of them another word under `words`", warning=True
                )


def _owners(type_: str, vocabulary: Vocabulary) -> Iterator[tuple[tuple[str, ...], str]]:
    """The nouns that a slot of a type can contain, those of single objects first."""
    for nouns in (vocabulary.called(type_), vocabulary.nouns(type_)):
        for each in nouns.values():
            yield from each


def _only(vocabulary: Vocabulary, name: str, type_: str) -> bool:
    """Whether an object is the only one of a type, so that its noun is also that of the type."""
    if type_ not in vocabulary.domain.types:
        return False
    return [each for each in vocabulary.objects if vocabulary.is_a(each, type_)] == [name]
