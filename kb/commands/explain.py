"""Why a sentence is not understood: the word, the words that are possible there, and the nearest phrase."""

import difflib
from collections.abc import Callable, Iterator, Sequence

from cellwright.kb.commands.clauses import NotUnderstood
from cellwright.kb.commands.patterns import Slot, Word, expansions, read_pattern, readable
from cellwright.kb.commands.reading import A_NAME, A_NUMBER, A_TIME
from cellwright.kb.commands.tokens import NUMBER, Piece
from cellwright.kb.commands.unsaid import refusal
from cellwright.kb.commands.vocabulary import Vocabulary
from cellwright.kb.diagnostics import Diagnostic, Source
from cellwright.kb.model.domain import Domain

KINDS = {
    A_NUMBER: "a number",
    A_TIME: "a time such as 15 min",
    A_NAME: "a name",
    ",": "','",
    ";": "';'",
    ".": "'.'",
}
SHOWN = (
    "and",
    "then",
    "all",
    "both",
    "it",
    "them",
)  # words of every language of phrases that are worth showing
MOST = 12


def explain(
    error: NotUnderstood, text: str, domain: Domain, vocabulary: Vocabulary, place: Callable[[int], Source]
) -> Diagnostic:
    """The diagnostic for a sentence that is not understood."""
    said, index = error.said, error.index
    example = readable(domain.phrases[0].say)
    if (found := refusal(said, index, _known(domain, vocabulary), example)) is not None:
        return Diagnostic(place(found.offset), "K602", found.message, found.hint)
    near = ""
    if index < len(said):
        piece = said[index]
        message = f"'{piece.text}' is not understood here"
        offset = piece.offset
        near = (
            _decimal(said, index)
            or _family(piece, vocabulary)
            or _similar(piece, error.expected, domain, vocabulary)
        )
    else:
        message = "the command ends too early" if said else "the command is empty"
        offset = len(text.rstrip())
    hints = [near, _words(error.expected, domain, vocabulary), _phrase(_clause(said, index, domain), domain)]
    return Diagnostic(place(offset), "K602", message, "; ".join(filter(None, hints)))


def _known(domain: Domain, vocabulary: Vocabulary) -> frozenset[str]:
    """The words of the domain's phrases, nouns and objects."""
    parts = (
        part for phrase in domain.phrases for each in expansions(read_pattern(phrase.say)) for part in each
    )
    found = {part.text for part in parts if isinstance(part, Word)}
    found |= {word for noun in vocabulary.things for word in noun}
    return frozenset(found | {word for type_ in domain.types for word in vocabulary.nouns(type_)})


def _decimal(said: Sequence[Piece], index: int) -> str:
    """The hint for "1,5 hours"."""
    parts = said[index : index + 4]
    if [piece.kind for piece in parts[:3]] != [NUMBER, "mark", NUMBER] or parts[1].text != ",":
        return ""
    return f"did you mean '{parts[0].text}.{parts[2].text} {parts[-1].text}'? decimals have a point"


def _family(piece: Piece, vocabulary: Vocabulary) -> str:
    """The objects that are called as a word with a number behind it, for "wall 3" and "both walls"."""
    stems = (piece.lower, piece.lower.removesuffix("s"))
    found = [name for name in vocabulary.objects if piece.lower and _without_number(name) in stems]
    return f"there are {', '.join(sorted(found))}" if len(found) > 1 else ""


def _without_number(name: str) -> str:
    return name.rstrip("0123456789").rstrip("_").lower() if name[-1:].isdigit() else ""


def _similar(piece: Piece, expected: frozenset[str], domain: Domain, vocabulary: Vocabulary) -> str:
    if piece.kind == NUMBER and A_TIME in expected:
        return f"did you mean '{piece.text} min' or '{piece.text} s'?"
    if piece.lower in {*SHOWN, *_known(domain, vocabulary)}:
        return ""
    words = sorted(word for word in expected if word.isalpha() and word.islower())
    own = [
        word for word in words if word in _known(domain, vocabulary)
    ]  # "seel" is "seal", not the "see" of any sentence
    if A_NAME in expected:
        own += sorted(vocabulary.objects)
    near = [word for word in (*words, *own) if len(word) > 2 and sorted(word) == sorted(piece.lower)]
    for known in (own, words):
        near = near or difflib.get_close_matches(piece.lower, known, n=1, cutoff=0.7)
    return f"did you mean '{near[0]}'?" if near else ""


def _words(expected: frozenset[str], domain: Domain, vocabulary: Vocabulary) -> str:
    own = {*SHOWN, *_known(domain, vocabulary)}
    words = sorted(word for word in expected if word in own)
    kinds = [shown for kind, shown in KINDS.items() if kind in expected]
    shown = [*(f"'{word}'" for word in words[:MOST]), *(["..."] if len(words) > MOST else []), *kinds]
    return f"possible here: {', '.join(shown)}" if shown else ""


def _clause(said: Sequence[Piece], index: int, domain: Domain) -> list[str]:
    """The words of the clause around a piece: from a word that begins a phrase to the next such word."""
    starts = {part.text for first in _firsts(domain) for part in first if isinstance(part, Word)}
    kinds = [piece.lower for piece in said]
    joins = ("and", "then", ",", ";", ".")
    begins = [n for n, word in enumerate(kinds) if word in starts and (n == 0 or kinds[n - 1] in joins)]
    begin = max((n for n in begins if n < index), default=0)
    if index < len(said) and index and kinds[index - 1] in joins:
        begin = index
    end = min((n for n in begins if n > max(index, begin)), default=len(said))
    return [kinds[n] for n in range(begin, end) if said[n].kind != NUMBER]


def _firsts(domain: Domain) -> Iterator[tuple[Word | Slot, ...]]:
    for phrase in domain.phrases:
        yield tuple(each[0] for each in expansions(read_pattern(phrase.say)))


def _phrase(clause: Sequence[str], domain: Domain) -> str:
    scored = [(_score(clause, phrase.say, domain), -number) for number, phrase in enumerate(domain.phrases)]
    score, number = max(scored)
    return f"the nearest phrase is: {readable(domain.phrases[-number].say)}" if score > 0 else ""


def _score(clause: Sequence[str], say: str, domain: Domain) -> float:
    """The share of a phrase, in its best reading, that the clause contains; 0 if they have nothing in common."""
    return max(_agreement(clause, each, domain) for each in expansions(read_pattern(say)))


def _agreement(clause: Sequence[str], parts: Sequence[Word | Slot], domain: Domain) -> float:
    words = [part.text for part in parts if isinstance(part, Word)]
    slots = [part for part in parts if isinstance(part, Slot)]
    hits = sum(bool(difflib.get_close_matches(word, clause, n=1, cutoff=0.75)) for word in words)
    if not hits:
        return 0.0
    meant = sum(any(word in domain.words.get(slot.type, ()) for word in clause) for slot in slots)
    return (2 * hits + meant) / (2 * len(words) + len(slots) + len(clause))
