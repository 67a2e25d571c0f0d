"""Warnings about what phrases and nouns leave open: two phrases or two things for one wording.

Each phrase is said once in every way, with what its slots can contain, and all phrases are asked
which of them it is.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from cellwright.kb.commands.domain_nouns import NounVocabulary
from cellwright.kb.commands.object_references import References
from cellwright.kb.commands.phrase_matching import Match, Matcher
from cellwright.kb.commands.phrase_meanings import PhraseMeaning, read_meanings
from cellwright.kb.commands.phrase_patterns import PatternSlot, PatternWord, expand_pattern
from cellwright.kb.commands.sentence import book_of
from cellwright.kb.commands.sentence_pieces import SentenceReader, UnclearReference
from cellwright.kb.diagnostics import Diagnostic
from cellwright.kb.model.domain_model import NUMERIC_TYPES, Domain
from cellwright.kb.terms import Function, Term, Variable, substitute_atom

MOST_SAID = 3000  # sentences that are tried


@dataclass(frozen=True, slots=True)
class _Example:
    """A sentence of a phrase, and how it is shown: with types for the slots, or with the words
    of one object.
    """

    said: str
    shown: str


def unclear_words(domain: Domain) -> Iterator[Diagnostic]:
    """Warnings about sentences that two phrases mean differently, and nouns that mean two
    things.
    """
    known_meanings = read_meanings(domain)
    vocabulary = NounVocabulary(domain, domain.objects)
    yield from _warn_of_phrases(known_meanings, vocabulary)
    yield from _warn_of_nouns(domain, known_meanings, vocabulary)


def _warn_of_phrases(
    known: Sequence[PhraseMeaning], vocabulary: NounVocabulary
) -> Iterator[Diagnostic]:
    book = book_of(known, vocabulary)
    parts = [
        part
        for meaning in known
        for expansion in expand_pattern(meaning.pattern)
        for part in expansion
    ]
    words = frozenset(part.text for part in parts if isinstance(part, PatternWord))
    types = frozenset(part.type for part in parts if isinstance(part, PatternSlot))
    sentences_left = MOST_SAID
    for number, meaning in enumerate(known):
        for example in _phrase_examples(meaning, vocabulary, words, types):
            sentences_left -= 1
            if sentences_left < 0:
                return
            matches = list(Matcher(book, SentenceReader(example.said), False).whole())
            own = {
                _reading_meaning(known, match, vocabulary)
                for match in matches
                if match.form.phrase == number
            }
            earlier = [match for match in matches if match.form.phrase < number]
            if earlier_match := next(
                (
                    match
                    for match in earlier
                    if _reading_meaning(known, match, vocabulary) not in own
                ),
                None,
            ):
                message = f"'{example.shown}' also fits an earlier phrase, which takes precedence"
                hint = f"the earlier phrase is: {known[earlier_match.form.phrase].phrase.say}"
                yield Diagnostic(meaning.phrase.where, "K605", message, hint, warning=True)
                break


def _reading_meaning(
    known: Sequence[PhraseMeaning], match: Match, vocabulary: NounVocabulary
) -> frozenset[Term]:
    """What a reading asks for, with the objects that it names, as far as the domain has them."""
    meaning, references = known[match.form.phrase], References(vocabulary)
    types = {slot.variable: slot.type for slot in meaning.slots}
    bound: dict[Variable, Term] = {}
    slots = [part.variable for part in match.form.parts if isinstance(part, PatternSlot)]
    for variable, words in zip(slots, match.values, strict=True):
        wording = Function(" ".join(piece.lower for piece in words.pieces))
        try:
            values = (
                references.resolve(words, types[variable]) if words.how != "value" else (wording,)
            )
        except UnclearReference:
            values = (wording,)
        bound[Variable(variable)] = (
            values[0] if len(values) == 1 else Function("all of", tuple(values))
        )
    signs = ((literal, "" if literal.positive else "not ") for literal in meaning.conditions)
    return frozenset(
        Function(sign, (substitute_atom(literal.atom, bound),)) for literal, sign in signs
    )


def _phrase_examples(
    meaning: PhraseMeaning, vocabulary: NounVocabulary, words: frozenset[str], types: frozenset[str]
) -> Iterator[_Example]:
    """Sentences of a phrase: each way of saying it, once with plain contents and once with each
    special content of a slot.

    Special is what can be taken for something else: a number alone, names and nouns with `words` of
    phrases in them, and the nouns of types below that have slots of their own (`types`).
    """
    for parts in expand_pattern(meaning.pattern):
        plain = [_plain_example(part, number, vocabulary) for number, part in enumerate(parts)]
        yield _join_examples(plain)
        for number, part in enumerate(parts):
            for special in _special_contents(part, number, vocabulary, words, types):
                yield _join_examples(
                    [*plain[:number], _Example(special, special), *plain[number + 1 :]]
                )


def _join_examples(parts: Sequence[_Example]) -> _Example:
    return _Example(" ".join(part.said for part in parts), " ".join(part.shown for part in parts))


def _plain_example(
    part: PatternWord | PatternSlot, number: int, vocabulary: NounVocabulary
) -> _Example:
    if isinstance(part, PatternWord):
        return _Example(part.text, part.text)
    if part.type in NUMERIC_TYPES:
        wording = f"{number + 1} min" if part.type == "time" else str(number + 1)
        return _Example(wording, f"<{'number' if part.type == 'int' else part.type}>")
    nouns = [
        noun
        for own_nouns in vocabulary.nouns(part.type).values()
        for noun, owner in own_nouns
        if owner == part.type
    ]
    noun = " ".join(nouns[0]) if nouns else part.type
    return _Example(f"{noun} {number + 1}", f"<{part.type}>")


def _special_contents(
    part: PatternWord | PatternSlot,
    number: int,
    vocabulary: NounVocabulary,
    words: frozenset[str],
    types: frozenset[str],
) -> Iterator[str]:
    """What a slot can contain that may be taken for something else."""
    if isinstance(part, PatternWord) or part.type in NUMERIC_TYPES:
        return
    called = [
        " ".join(noun)
        for own_nouns in vocabulary.called(part.type).values()
        for noun, _ in own_nouns
    ]
    names = [name for name in vocabulary.objects if vocabulary.is_a(name, part.type)]
    nouns = [
        (" ".join(noun), owner)
        for own_nouns in vocabulary.nouns(part.type).values()
        for noun, owner in own_nouns
    ]
    alone = dict.fromkeys([*called, *names, *(noun for noun, _ in nouns)])
    yield from (text for text in alone if words & {*text.split()})
    below = {
        owner: noun for noun, owner in reversed(nouns) if owner != part.type and owner in types
    }
    yield from (f"{noun} {number + 1}" for noun in below.values())
    yield "1"


def _warn_of_nouns(
    domain: Domain, known: Sequence[PhraseMeaning], vocabulary: NounVocabulary
) -> Iterator[Diagnostic]:
    """Warnings about a noun of two types or objects that one slot can contain."""
    told_nouns: set[str] = set()
    for meaning, slot in (
        (phrase_meaning, slot) for phrase_meaning in known for slot in phrase_meaning.slots
    ):
        if slot.type in NUMERIC_TYPES:
            continue
        owners: dict[tuple[str, ...], str] = {}
        for noun, owner in _noun_owners(slot.type, vocabulary):
            first, wording = owners.setdefault(noun, owner), " ".join(noun)
            if (
                first != owner
                and wording not in told_nouns
                and not _is_only_object(vocabulary, first, owner)
            ):
                told_nouns.add(wording)
                where = domain.types[owner].where if owner in domain.types else meaning.phrase.where
                message = f"'{wording}' means both {first} and {owner}; a sentence means {first}"
                yield Diagnostic(
                    where,
                    "K607",
                    message,
                    "give one of them another word under `words`",
                    warning=True,
                )


def _noun_owners(type_: str, vocabulary: NounVocabulary) -> Iterator[tuple[tuple[str, ...], str]]:
    """The nouns that a slot of a type can contain, those of single objects first."""
    for nouns in (vocabulary.called(type_), vocabulary.nouns(type_)):
        for own_nouns in nouns.values():
            yield from own_nouns


def _is_only_object(vocabulary: NounVocabulary, name: str, type_: str) -> bool:
    """Whether an object is the only one of a type, so that its noun is also that of the type."""
    if type_ not in vocabulary.domain.types:
        return False
    return [
        object_name for object_name in vocabulary.objects if vocabulary.is_a(object_name, type_)
    ] == [name]
