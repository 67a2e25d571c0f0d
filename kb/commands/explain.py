"""Why a sentence is not understood: the word, the words that are possible there, and the nearest phrase."""

import difflib
from collections.abc import Callable, Collection, Iterator, Sequence

from kb.commands.grammar import NotUnderstood
from kb.commands.patterns import Slot, Word, expansions, read_pattern, readable
from kb.commands.tokens import NAME, NUMBER, TIME, UNKNOWN, Piece
from kb.diagnostics import Diagnostic, Source
from kb.model.domain import Domain

SHOWN = {
    NUMBER: "a number", TIME: "a time such as 15 min", NAME: "a name", "COMMA": "','", "SEMICOLON": "';'",
    "STOP": "'.'",
}  # fmt: skip
HIDDEN = ("DOTS", "DASH", "AMPERSAND", "SEMICOLON", "afterwards", "finally", "next", "these", "those", "they")
MOST = 12


def explain(
    error: NotUnderstood, text: str, domain: Domain, names: Collection[str], place: Callable[[int], Source]
) -> Diagnostic:
    """The diagnostic for a sentence that is not understood. `names` holds the known objects."""
    said, index = error.said, error.index
    near = ""
    if index < len(said):
        piece = said[index]
        message = f"'{piece.text}' is not understood here"
        offset = piece.offset
        near = _similar(piece, error.expected, names)
    else:
        message = "the command ends too early" if said else "the command is empty"
        offset = len(text.rstrip())
    hints = [near, _words(error.expected), _phrase(_clause(said, index, domain), domain)]
    return Diagnostic(place(offset), "K602", message, "; ".join(filter(None, hints)))


def _similar(piece: Piece, expected: frozenset[str], names: Collection[str]) -> str:
    if piece.kind == NUMBER and TIME in expected:
        return f"did you mean '{piece.text} min' or '{piece.text} s'?"
    words = sorted(word for word in expected if word.isalpha() and word.islower())
    if NAME in expected:
        words += sorted(names)
    near = difflib.get_close_matches(piece.text.lower(), words, n=1, cutoff=0.7)
    return f"did you mean '{near[0]}'?" if near else ""


def _words(expected: frozenset[str]) -> str:
    words = sorted(kind for kind in expected if kind not in SHOWN and kind not in HIDDEN)
    kinds = [shown for kind, shown in SHOWN.items() if kind in expected and kind not in HIDDEN]
    shown = [*(f"'{word}'" for word in words[:MOST]), *(["..."] if len(words) > MOST else []), *kinds]
    return f"possible here: {', '.join(shown)}"


def _clause(said: Sequence[Piece], index: int, domain: Domain) -> list[str]:
    """The words of the clause around a token: from a word that begins a phrase to the next such word."""
    starts = {part.text for first in _firsts(domain) for part in first if isinstance(part, Word)}
    kinds = [piece.text.lower() for piece in said]
    joins = ("and", "then", ",", ";", ".")
    begins = [n for n, word in enumerate(kinds) if word in starts and (n == 0 or kinds[n - 1] in joins)]
    begin = max((n for n in begins if n < index), default=0)
    if index < len(said) and index and kinds[index - 1] in joins:
        begin = index
    end = min((n for n in begins if n > max(index, begin)), default=len(said))
    return [
        kinds[n] for n in range(begin, end) if said[n].kind not in (NUMBER, NAME) or said[n].kind == UNKNOWN
    ]


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
