"""What no command can say, whatever the phrases of the domain: negations, conditions, choices, questions; and other languages."""

import unicodedata
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

from cellwright.kb.commands.tokens import WORD, Piece


@dataclass(frozen=True, slots=True)
class Refusal:
    """Where a sentence says what no command can say, why it cannot, and what to try."""

    offset: int
    message: str
    hint: str


_NEGATIONS = "not never no without avoid neither nor nothing none cannot dont don't instead rather"
NEGATIONS = frozenset(_NEGATIONS.split())
NO_NEGATION = "is a negation, and a command can only say what is to be done"
INSTEAD = "say what should be so instead, or write a goal such as `not p(X)` in a problem file"

EXCEPT = ("except", "besides", "excluding", "but")

KINDS = {
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
        "join acts with 'and': those of different objects overlap where they can; what an act needs meanwhile is kept by the plan",
    ),
    "says how often, and a command says each act": (
        "twice thrice times repeat repeatedly often daily hourly every",
        "say the act as often as it is to be done",
    ),
    "says which object belongs to which act, and a command cannot": (
        "respectively alternately",
        "say one act for each object: 'put probe 1 into ..., put probe 2 into ...'",
    ),
    "says how, and only the phrases of the domain say that": (
        "quickly slowly carefully gently quietly fast faster slower immediately asap possible approximately about"
        " roughly almost exactly least most more less only just",
        "leave it out",
    ),
    "is a question or says what is so, and a command says what is to be done": (
        "what which who whom whose where why how is are was were does did has have ?",
        "write an act such as '{example}', or what 'should be' done; the state is in the problem file",
    ),
    "is no unit of the sentences of this domain: they know times and whole numbers": (
        "degree degrees celsius kelvin fahrenheit mm cm m km inch inches kg g mg bar rpm volt volts watt percent % °c"
        " weeks week months month years year",
        "times are in s, min, h or days",
    ),
    "is the place of an object, which a command cannot find here": (
        "first second third fourth fifth last leftmost rightmost former latter left right middle odd even half",
        "say its number or its name",
    ),
    "leaves objects out, and stands directly behind those that it is about": (
        " ".join(EXCEPT),
        "such as 'all probes except probe 2'",
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
        "name the objects together: 'probes 1 and 2'",
    ),
}
REASONS = {word: (reason, hint) for reason, (words, hint) in KINDS.items() for word in words.split()}
TOGETHER = "asks for two things at the same time, which a command cannot"
ORDER = "says in which order the objects come, and a command says it with 'then'"
SAYINGS = {
    TOGETHER: ("at the same time", "at once", "in parallel", "together", "side by side"),
    ORDER: (
        *("one after the other", "one after another", "one by one", "in turn", "in order", "separately"),
        *("in this order", "in that order", "in sequence"),
        *("individually", "beginning with", "starting with", "starting at", "beginning at"),
    ),
    "leaves a choice, and a command says which": ("one of", "two of", "one another", "everything else"),
    "says when by the clock, and a command only says what comes before what": (
        "no later than",
        "not later than",
    ),
}
HINTS = {
    TOGETHER: KINDS[TOGETHER][1],
    ORDER: "such as 'heat probe 1 for 5 min, then probe 2'",
    "leaves a choice, and a command says which": "name the objects",
    "says when by the clock, and a command only says what comes before what": "leave it out",
}

LANGUAGES = {
    "German": "der die das den dem des und dann danach nicht ein eine einen für fuer minuten stunden sekunden im ins mit"
    " auf alle zuerst bitte probe-1 nach lege öffne schließe schliesse messe bringe stelle erhitze kühle heize nimm in",
    "French": "le la les des et puis ensuite ne pas un une pour dans avec sur tous toutes minutes d'abord ouvrez ouvre"
    " fermez ferme mettez mets chauffez chauffe mesurez mesure du au",
    "Spanish": "el la los las y luego después despues entonces un una para por con en todos todas minutos abre cierra pon"
    " calienta mide la",
    "Italian": "il lo la gli e poi quindi un una per con nel nella tutti tutte minuti apri chiudi metti riscalda misura di",
    "Dutch": "de het en dan daarna niet een voor met op alle minuten open sluit zet verwarm meet",
    "Portuguese": "o os e depois então um uma para com no na todos todas minutos abra feche coloque aqueça meça",
}
VERBS = {  # of which one is enough to know the language
    "German": "erwärme erhitze heize kühle messe miss fülle öffne schließe schliesse verschließe stelle lege bringe nimm wiege"
    " prüfe lade hole setze räume",
    "French": "chauffer chauffez chauffe mesurer mesurez remplir remplissez remplis ouvrir ouvrez fermer fermez mettre mettez"
    " prendre prenez peser pesez refroidir refroidissez ranger rangez poser posez",
    "Spanish": "medir mide calentar calienta enfría abrir abre cerrar cierra llenar llena pesar poner tomar guardar guarda",
    "Italian": "misurare misura scaldare scalda riscaldare riscalda aprire apri chiudere chiudi riempire riempi mettere metti"
    " prendere prendi",
    "Dutch": "meten verwarm vul sluit weeg koel",
    "Portuguese": "meça aquecer aqueça feche encher encha coloque",
}
FOREIGN = {language: frozenset(words.split()) for language, words in LANGUAGES.items()}


def refusal(said: Sequence[Piece], index: int, known: Collection[str], example: str) -> Refusal | None:
    """Why a sentence that is not understood from piece `index` on cannot be said; None if only its words are unknown.

    `known` are the words of the domain, which are never taken for anything else. `example` is one of its phrases.
    """
    strange = [piece for piece in said if piece.lower not in known and piece.value is None]
    found = next(_reasons(said, index, strange, example), None)
    return None if found is None else replace(found, hint=found.hint.replace("{example}", example))


def _reasons(said: Sequence[Piece], index: int, strange: Sequence[Piece], example: str) -> Iterator[Refusal]:
    if (found := _language(said, strange, example) or _verb(said, index, strange, example)) is not None:
        yield found
    yield from _sayings(said, index)
    for piece in strange:
        if piece.lower in NEGATIONS or piece.lower.endswith("n't"):
            yield Refusal(piece.offset, f"'{piece.text}' {NO_NEGATION}", INSTEAD)
    here = said[index] if index < len(said) else None
    before = said[index - 1] if 0 < index <= len(said) else None
    yield from _no_act(said, index)
    near = [piece for piece in (here, before, *said[index + 1 : index + 3]) if piece is not None]
    for piece in near:
        if piece in strange and piece.lower in REASONS and not (piece is before and piece.lower in EXCEPT):
            reason, hint = REASONS[piece.lower]
            yield Refusal(piece.offset, f"'{piece.text}' {reason}", hint)


def _sayings(said: Sequence[Piece], index: int) -> Iterator[Refusal]:
    """What several words together ask for, where the sentence fails: "at the same time", "one after the other"."""
    words = [piece.lower for piece in said]
    for reason, sayings in SAYINGS.items():
        for each in (saying.split() for saying in sayings):
            begins = range(max(0, index - len(each)), min(index + 2, len(words)))
            if (begin := next((n for n in begins if words[n : n + len(each)] == each), None)) is not None:
                yield Refusal(said[begin].offset, f"'{' '.join(each)}' {reason}", HINTS[reason])


def _no_act(said: Sequence[Piece], index: int) -> Iterator[Refusal]:
    """What is no act behind "after" and its kin, if it fails there: "after 5 min", "once probe 1 is warm"."""
    words = [piece.lower for piece in said[: index + 1]]
    begin = max((n + 1 for n, word in enumerate(words) if word in MARKS), default=0)
    place = max((n for n in range(begin, len(words)) if words[n] in LINKS and n < index), default=None)
    if place is None or not (index - place <= 2 or BE & {*words[place:]}) or words[-1] in {*REASONS} - BE:
        return
    word = "as soon as" if words[place] == "soon" else words[place]
    message = f"'{word}' needs an act behind it that the phrases of the domain know"
    hint = f"such as '{word} probe 1 is heated for 5 min, store it'; or use 'then'"
    yield Refusal(said[place].offset, message, hint)


BE = frozenset(("is", "are", "was", "were", "has", "have"))
LINKS = ("after", "before", "once", "when", "soon")
MARKS = (",", ";", ".", "!")


def _language(said: Sequence[Piece], strange: Sequence[Piece], example: str) -> Refusal | None:
    """A refusal for a sentence in another language than the phrases of the domain."""
    words = [piece for piece in strange if piece.kind == WORD or piece.text[:1].isalpha()]
    for piece in words:
        script = unicodedata.name(piece.text[0], "LATIN").split()[0]
        if script != "LATIN":
            return _foreign(piece, f"{script.capitalize()} letters", example)
    counts = {name: sum(piece.lower in foreign for piece in words) for name, foreign in FOREIGN.items()}
    language = max(counts, key=lambda name: counts[name])
    if counts[language] >= 2 and counts[language] > sum(piece.lower in ENGLISH for piece in said):
        first = next(piece for piece in words if piece.lower in FOREIGN[language])
        return _foreign(first, language, example)
    return None


def _verb(said: Sequence[Piece], index: int, strange: Sequence[Piece], example: str) -> Refusal | None:
    """A refusal for a sentence that fails at a verb of another language, or at a word with letters that are not English."""
    piece = said[index] if index < len(said) else None
    if piece is None or piece not in strange:
        return None
    named = next((name for name, verbs in VERBS.items() if piece.lower in verbs.split()), "")
    if not named and piece.text[:1].isalpha() and not piece.text.isascii():
        named = "another language"
    return _foreign(piece, named, example) if named else None


_ENGLISH = "the and then for into with after before of it them all both please an"
ENGLISH = frozenset(_ENGLISH.split())


def _foreign(piece: Piece, language: str, example: str) -> Refusal:
    message = f"this looks like {language}; commands are understood in the words of the domain"
    return Refusal(piece.offset, message, f"a phrase of this domain is: {example}")
