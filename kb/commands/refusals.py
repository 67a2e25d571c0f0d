"""Explains why a sentence is not understood: what no command can say, and the nearest phrase."""

import difflib
import re
import unicodedata
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

from cellwright.kb.commands.clauses import NotUnderstood
from cellwright.kb.commands.domain_nouns import NounVocabulary
from cellwright.kb.commands.phrase_patterns import (
    PatternSlot,
    PatternWord,
    expand_pattern,
    noun_plurals,
    read_pattern,
    readable_pattern,
)
from cellwright.kb.commands.sentence_pieces import (
    A_NAME,
    A_NUMBER,
    A_TIME,
    NUMBER,
    WORD,
    SentencePiece,
)
from cellwright.kb.diagnostics import Diagnostic, Source
from cellwright.kb.model.domain_model import Domain


@dataclass(frozen=True, slots=True)
class CommandRefusal:
    """Where a sentence says what no command can say, why it cannot, and what to try."""

    offset: int
    message: str
    hint: str


_NEGATIONS = "not never no without avoid neither nor nothing none cannot dont don't instead rather"
NEGATIONS = frozenset(_NEGATIONS.split())
NO_NEGATION = "is a negation, and a command can only say what is to be done"
INSTEAD = "say what should be so instead, or write a goal such as `not p(X)` in a problem file"

EXCEPT = ("except", "besides", "excluding", "but")

REFUSED_WORDS = {
    "is a condition, and a command is planned before anything is known": (
        "if unless whenever when once until till otherwise provided depending case soon",
        "say what is to be done; a plan for the other case is another command",
    ),
    "leaves a choice, and a command says which": (
        "or either any some one-of whichever anything something several few",
        "name the objects, or write a goal with `|` or `_` in a problem file",
    ),
    "asks for two things at the same time, which a command cannot": (
        "meanwhile while whilst simultaneously during concurrently",
        "join acts with 'and': those of different objects overlap where they can; what an act "
        "needs meanwhile is kept by the plan",
    ),
    "says how often, and a command says each act": (
        "twice thrice times repeat repeatedly often daily hourly every",
        "say the act as often as it is to be done",
    ),
    "says which object belongs to which act, and a command cannot": (
        "respectively alternately",
        "say one act for each object: 'put {noun} 1 into ..., put {noun} 2 into ...'",
    ),
    "says how, and only the phrases of the domain say that": (
        "quickly slowly carefully gently quietly fast faster slower immediately asap possible "
        "approximately about"
        " roughly almost exactly least most more less only just",
        "leave it out",
    ),
    "is a question or says what is so, and a command says what is to be done": (
        "what which who whom whose where why how is are was were does did has have ?",
        "write an act such as '{example}', or what 'should be' done; the state is in the "
        "problem file",
    ),
    "is no unit of the sentences of this domain: they know times and whole numbers": (
        "degree degrees celsius kelvin fahrenheit mm cm m km inch inches kg g mg bar rpm volt "
        "volts watt percent % °c"
        " weeks week months month years year",
        "times are in s, min, h or days",
    ),
    "is the place of an object, which a command cannot find here": (
        "first second third fourth fifth last leftmost rightmost former latter left right "
        "middle odd even half",
        "say its number or its name",
    ),
    "leaves objects out, and stands directly behind those that it is about": (
        " ".join(EXCEPT),
        "such as 'all {nouns} except {noun} 2'",
    ),
    "keeps something as it is, and a command only says what is to be done": (
        "keep keeps keeping leave leaves leaving remain remains stay stays hold holds",
        "say the act; what a later act needs is kept by the plan",
    ),
    "says when by the clock, and a command only says what comes before what": (
        "o'clock today tomorrow tonight morning evening noon midnight now ago within",
        "leave it out; `due` and `release` in a problem file give times of jobs",
    ),
    "is about a plan that runs, and a command only says what is to be done": (
        "stop abort cancel undo continue resume",
        "say the state that is wanted",
    ),
    "asks for a pause, and a plan has none of its own": (
        "wait pause sleep",
        "say the act that takes this long",
    ),
    "repeats other acts, and a command names each": (
        "do likewise ditto same",
        "name the objects together: '{nouns} 1 and 2'",
    ),
}
WORD_REASONS = {
    word: (reason, hint)
    for reason, (words, hint) in REFUSED_WORDS.items()
    for word in words.split()
}
AT_SAME_TIME = "asks for two things at the same time, which a command cannot"
OBJECT_ORDER = "says in which order the objects come, and a command says it with 'then'"
REFUSED_SAYINGS = {
    AT_SAME_TIME: ("at the same time", "at once", "in parallel", "together", "side by side"),
    OBJECT_ORDER: (
        *(
            "one after the other",
            "one after another",
            "one by one",
            "in turn",
            "in order",
            "separately",
        ),
        *("in this order", "in that order", "in sequence"),
        *("individually", "beginning with", "starting with", "starting at", "beginning at"),
    ),
    "leaves a choice, and a command says which": (
        "one of",
        "two of",
        "one another",
        "everything else",
    ),
    "says when by the clock, and a command only says what comes before what": (
        "no later than",
        "not later than",
    ),
}
SAYING_HINTS = {
    AT_SAME_TIME: REFUSED_WORDS[AT_SAME_TIME][1],
    OBJECT_ORDER: "such as '... {noun} 1, then {noun} 2'",
    "leaves a choice, and a command says which": "name the objects",
    "says when by the clock, and a command only says what comes before what": "leave it out",
}

LANGUAGES = {
    "German": "der die das den dem des und dann danach nicht ein eine einen für fuer minuten "
    "stunden "
    "sekunden im ins mit"
    " auf alle zuerst bitte probe-1 nach lege öffne schließe schliesse messe bringe stelle "
    "erhitze kühle heize nimm in",
    "French": "le la les des et puis ensuite ne pas un une pour dans avec sur tous toutes minutes "
    "d'abord ouvrez ouvre"
    " fermez ferme mettez mets chauffez chauffe mesurez mesure du au",
    "Spanish": "el la los las y luego después despues entonces un una para por con en todos todas "
    "minutos abre cierra pon"
    " calienta mide la",
    "Italian": "il lo la gli e poi quindi un una per con nel nella tutti tutte minuti apri chiudi "
    "metti riscalda misura di",
    "Dutch": "de het en dan daarna niet een voor met op alle minuten open sluit zet verwarm meet",
    "Portuguese": "o os e depois então um uma para com no na todos todas minutos abra feche "
    "coloque "
    "aqueça meça",
}
FOREIGN_VERBS = {  # of which one is enough to know the language
    "German": "erwärme erhitze heize kühle messe miss fülle öffne schließe schliesse verschließe "
    "stelle lege bringe nimm wiege"
    " prüfe lade hole setze räume",
    "French": "chauffer chauffez chauffe mesurer mesurez remplir remplissez remplis ouvrir ouvrez "
    "fermer fermez mettre mettez"
    " prendre prenez peser pesez refroidir refroidissez ranger rangez poser posez",
    "Spanish": "medir mide calentar calienta enfría abrir abre cerrar cierra llenar llena pesar "
    "poner "
    "tomar guardar guarda",
    "Italian": "misurare misura scaldare scalda riscaldare riscalda aprire apri chiudere chiudi "
    "riempire riempi mettere metti"
    " prendere prendi",
    "Dutch": "meten verwarm vul sluit weeg koel",
    "Portuguese": "meça aquecer aqueça feche encher encha coloque",
}
FOREIGN_WORDS = {language: frozenset(words.split()) for language, words in LANGUAGES.items()}


def find_refusal(
    said: Sequence[SentencePiece], index: int, known: Collection[str], example: str, noun: str
) -> CommandRefusal | None:
    """Why a sentence that is not understood from piece `index` on cannot be said; None if only its
    words are unknown.

    `known` are the words of the domain, which are never taken for anything else. `example` is one
    of its phrases, `noun` what people call one of its objects.
    """
    strange = [piece for piece in said if piece.lower not in known and piece.value is None]
    refused = next(_possible_refusals(said, index, strange, example), None)
    if refused is None:
        return None
    hint = refused.hint.replace("{noun}", noun).replace("{nouns}", noun_plurals(noun)[1])
    return replace(refused, hint=hint.replace("{example}", example))


def _object_noun(domain: Domain, vocabulary: NounVocabulary) -> str:
    """What people call an object of the first type that a phrase of the domain is about, and of
    which there is a first and a second one, if there is such a type.
    """
    slot_types = (
        type_ for phrase in domain.phrases for type_ in re.findall(r"\{\w+:(\w+)\}", phrase.say)
    )
    types = [type_ for type_ in slot_types if type_ in domain.types]
    rows = (type_ for type_ in types if vocabulary.numbered(type_, Fraction(2)))
    subject = next(rows, types[0] if types else "")
    return vocabulary.usual_noun(subject) if subject else "object"


def _possible_refusals(
    said: Sequence[SentencePiece], index: int, strange: Sequence[SentencePiece], example: str
) -> Iterator[CommandRefusal]:
    if (
        refused := _refuse_language(said, strange, example)
        or _refuse_foreign_verb(said, index, strange, example)
    ) is not None:
        yield refused
    yield from _refuse_sayings(said, index)
    for piece in strange:
        if piece.lower in NEGATIONS or piece.lower.endswith("n't"):
            yield CommandRefusal(piece.offset, f"'{piece.text}' {NO_NEGATION}", INSTEAD)
    piece_here = said[index] if index < len(said) else None
    before = said[index - 1] if 0 < index <= len(said) else None
    yield from _no_act(said, index)
    near = [
        piece for piece in (piece_here, before, *said[index + 1 : index + 3]) if piece is not None
    ]
    for piece in near:
        if (
            piece in strange
            and piece.lower in WORD_REASONS
            and not (piece is before and piece.lower in EXCEPT)
        ):
            reason, hint = WORD_REASONS[piece.lower]
            yield CommandRefusal(piece.offset, f"'{piece.text}' {reason}", hint)


def _refuse_sayings(said: Sequence[SentencePiece], index: int) -> Iterator[CommandRefusal]:
    """What several words together ask for, where the sentence fails: "at the same time", "one
    after the other".
    """
    words = [piece.lower for piece in said]
    for reason, sayings in REFUSED_SAYINGS.items():
        for saying_words in (saying.split() for saying in sayings):
            begins = range(max(0, index - len(saying_words)), min(index + 2, len(words)))
            if (
                begin := next(
                    (n for n in begins if words[n : n + len(saying_words)] == saying_words), None
                )
            ) is not None:
                yield CommandRefusal(
                    said[begin].offset, f"'{' '.join(saying_words)}' {reason}", SAYING_HINTS[reason]
                )


def _no_act(said: Sequence[SentencePiece], index: int) -> Iterator[CommandRefusal]:
    """What is no act behind "after" and its kin, if it fails there: "after 5 min", "once probe
    1 is warm".
    """
    words = [piece.lower for piece in said[: index + 1]]
    begin = max((n + 1 for n, word in enumerate(words) if word in SENTENCE_MARKS), default=0)
    place = max(
        (n for n in range(begin, len(words)) if words[n] in LINK_WORDS and n < index), default=None
    )
    if (
        place is None
        or not (index - place <= 2 or BE_WORDS & {*words[place:]})
        or words[-1] in {*WORD_REASONS} - BE_WORDS
    ):
        return
    word = "as soon as" if words[place] == "soon" else words[place]
    message = f"'{word}' needs an act behind it that the phrases of the domain know"
    hint = "say an act there, such as '{example}'; or use 'then'"
    yield CommandRefusal(said[place].offset, message, hint)


BE_WORDS = frozenset(("is", "are", "was", "were", "has", "have"))
LINK_WORDS = ("after", "before", "once", "when", "soon")
SENTENCE_MARKS = (",", ";", ".", "!")


def _refuse_language(
    said: Sequence[SentencePiece], strange: Sequence[SentencePiece], example: str
) -> CommandRefusal | None:
    """A refusal for a sentence in another language than the phrases of the domain."""
    words = [piece for piece in strange if piece.kind == WORD or piece.text[:1].isalpha()]
    for piece in words:
        script = unicodedata.name(piece.text[0], "LATIN").split()[0]
        if script != "LATIN":
            return _foreign_refusal(piece, f"{script.capitalize()} letters", example)
    counts = {
        name: sum(piece.lower in foreign for piece in words)
        for name, foreign in FOREIGN_WORDS.items()
    }
    language = max(counts, key=lambda name: counts[name])
    if counts[language] >= 2 and counts[language] > sum(
        piece.lower in ENGLISH_WORDS for piece in said
    ):
        first = next(piece for piece in words if piece.lower in FOREIGN_WORDS[language])
        return _foreign_refusal(first, language, example)
    return None


def _refuse_foreign_verb(
    said: Sequence[SentencePiece], index: int, strange: Sequence[SentencePiece], example: str
) -> CommandRefusal | None:
    """A refusal for a sentence that fails at a verb of another language, or at a word with
    letters that are not English.
    """
    piece = said[index] if index < len(said) else None
    if piece is None or piece not in strange:
        return None
    named = next(
        (name for name, verbs in FOREIGN_VERBS.items() if piece.lower in verbs.split()), ""
    )
    if not named and piece.text[:1].isalpha() and not piece.text.isascii():
        named = "another language"
    return _foreign_refusal(piece, named, example) if named else None


_ENGLISH = "the and then for into with after before of it them all both please an"
ENGLISH_WORDS = frozenset(_ENGLISH.split())


def _foreign_refusal(piece: SentencePiece, language: str, example: str) -> CommandRefusal:
    message = f"this looks like {language}; commands are understood in the words of the domain"
    return CommandRefusal(piece.offset, message, f"a phrase of this domain is: {example}")


EXPECTED_KINDS = {
    A_NUMBER: "a number",
    A_TIME: "a time such as 15 min",
    A_NAME: "a name",
    ",": "','",
    ";": "';'",
    ".": "'.'",
}
SHOWN_WORDS = (
    "and",
    "then",
    "all",
    "both",
    "it",
    "them",
)  # words of every language of phrases that are worth showing
MAX_SHOWN_WORDS = 12


def explain_misunderstanding(
    error: NotUnderstood,
    text: str,
    domain: Domain,
    vocabulary: NounVocabulary,
    place: Callable[[int], Source],
) -> Diagnostic:
    """The diagnostic for a sentence that is not understood."""
    said, index = error.said, error.index
    example = readable_pattern(domain.phrases[0].say)
    if (
        refused := find_refusal(
            said,
            index,
            _known_words(domain, vocabulary),
            example,
            _object_noun(domain, vocabulary),
        )
    ) is not None:
        return Diagnostic(place(refused.offset), "K602", refused.message, refused.hint)
    near = ""
    if index < len(said):
        piece = said[index]
        message = f"'{piece.text}' is not understood here"
        offset = piece.offset
        near = (
            _decimal_hint(said, index)
            or _family_hint(piece, vocabulary)
            or _spelling_hint(piece, error.expected, domain, vocabulary)
        )
    else:
        message = "the command ends too early" if said else "the command is empty"
        offset = len(text.rstrip())
    hints = [
        near,
        _expected_words(error.expected, domain, vocabulary),
        _nearest_phrase(_clause_words(said, index, domain), domain),
    ]
    return Diagnostic(place(offset), "K602", message, "; ".join(filter(None, hints)))


def _known_words(domain: Domain, vocabulary: NounVocabulary) -> frozenset[str]:
    """The words of the domain's phrases, nouns and objects."""
    parts = (
        part
        for phrase in domain.phrases
        for expansion in expand_pattern(read_pattern(phrase.say))
        for part in expansion
    )
    words = {part.text for part in parts if isinstance(part, PatternWord)}
    words |= {word for noun in vocabulary.things for word in noun}
    return frozenset(words | {word for type_ in domain.types for word in vocabulary.nouns(type_)})


def _decimal_hint(said: Sequence[SentencePiece], index: int) -> str:
    """The hint for "1,5 hours"."""
    parts = said[index : index + 4]
    if [piece.kind for piece in parts[:3]] != [NUMBER, "mark", NUMBER] or parts[1].text != ",":
        return ""
    return f"did you mean '{parts[0].text}.{parts[2].text} {parts[-1].text}'? decimals have a point"


def _family_hint(piece: SentencePiece, vocabulary: NounVocabulary) -> str:
    """The objects that are called as a word with a number behind it, for "wall 3" and "both
    walls".
    """
    stems = (piece.lower, piece.lower.removesuffix("s"))
    family = [name for name in vocabulary.objects if piece.lower and _without_number(name) in stems]
    return f"there are {', '.join(sorted(family))}" if len(family) > 1 else ""


def _without_number(name: str) -> str:
    return name.rstrip("0123456789").rstrip("_").lower() if name[-1:].isdigit() else ""


def _spelling_hint(
    piece: SentencePiece, expected: frozenset[str], domain: Domain, vocabulary: NounVocabulary
) -> str:
    if piece.kind == NUMBER and A_TIME in expected:
        return f"did you mean '{piece.text} min' or '{piece.text} s'?"
    if piece.lower in {*SHOWN_WORDS, *_known_words(domain, vocabulary)}:
        return ""
    words = sorted(word for word in expected if word.isalpha() and word.islower())
    own = [
        word for word in words if word in _known_words(domain, vocabulary)
    ]  # "seel" is "seal", not the "see" of any sentence
    if A_NAME in expected:
        own += sorted(vocabulary.objects)
    near = [
        word for word in (*words, *own) if len(word) > 2 and sorted(word) == sorted(piece.lower)
    ]
    for candidates in (own, words):
        near = near or difflib.get_close_matches(piece.lower, candidates, n=1, cutoff=0.7)
    return f"did you mean '{near[0]}'?" if near else ""


def _expected_words(expected: frozenset[str], domain: Domain, vocabulary: NounVocabulary) -> str:
    own = {*SHOWN_WORDS, *_known_words(domain, vocabulary)}
    words = sorted(word for word in expected if word in own)
    kinds = [shown for kind, shown in EXPECTED_KINDS.items() if kind in expected]
    shown = [
        *(f"'{word}'" for word in words[:MAX_SHOWN_WORDS]),
        *(["..."] if len(words) > MAX_SHOWN_WORDS else []),
        *kinds,
    ]
    return f"possible here: {', '.join(shown)}" if shown else ""


def _clause_words(said: Sequence[SentencePiece], index: int, domain: Domain) -> list[str]:
    """The words of the clause around a piece: from a word that begins a phrase to the next such
    word.
    """
    starts = {
        part.text
        for first in _first_parts(domain)
        for part in first
        if isinstance(part, PatternWord)
    }
    kinds = [piece.lower for piece in said]
    joins = ("and", "then", ",", ";", ".")
    begins = [
        n for n, word in enumerate(kinds) if word in starts and (n == 0 or kinds[n - 1] in joins)
    ]
    begin = max((n for n in begins if n < index), default=0)
    if index < len(said) and index and kinds[index - 1] in joins:
        begin = index
    end = min((n for n in begins if n > max(index, begin)), default=len(said))
    return [kinds[n] for n in range(begin, end) if said[n].kind != NUMBER]


def _first_parts(domain: Domain) -> Iterator[tuple[PatternWord | PatternSlot, ...]]:
    for phrase in domain.phrases:
        yield tuple(expansion[0] for expansion in expand_pattern(read_pattern(phrase.say)))


def _nearest_phrase(clause: Sequence[str], domain: Domain) -> str:
    scored = [
        (_phrase_score(clause, phrase.say, domain), -number)
        for number, phrase in enumerate(domain.phrases)
    ]
    score, number = max(scored)
    return (
        f"the nearest phrase is: {readable_pattern(domain.phrases[-number].say)}"
        if score > 0
        else ""
    )


def _phrase_score(clause: Sequence[str], say: str, domain: Domain) -> float:
    """The share of a phrase, in its best reading, that the clause contains; 0 if they have
    nothing in common.
    """
    return max(
        _parts_agreement(clause, expansion, domain)
        for expansion in expand_pattern(read_pattern(say))
    )


def _parts_agreement(
    clause: Sequence[str], parts: Sequence[PatternWord | PatternSlot], domain: Domain
) -> float:
    words = [part.text for part in parts if isinstance(part, PatternWord)]
    slots = [part for part in parts if isinstance(part, PatternSlot)]
    hits = sum(bool(difflib.get_close_matches(word, clause, n=1, cutoff=0.75)) for word in words)
    if not hits:
        return 0.0
    meant = sum(any(word in domain.words.get(slot.type, ()) for word in clause) for slot in slots)
    return (2 * hits + meant) / (2 * len(words) + len(slots) + len(clause))
