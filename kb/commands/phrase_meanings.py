"""What phrases mean: goals and stages with slots, checked against the domain's signatures."""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from cellwright.kb.commands.phrase_patterns import (
    Pattern,
    PatternError,
    PatternSlot,
    PatternWord,
    expand_pattern,
    read_pattern,
)
from cellwright.kb.commands.sentence_pieces import is_spoken
from cellwright.kb.diagnostics import Diagnostic, Source, nearest_hint, unknown_name
from cellwright.kb.model.conditions import Condition, Exists, Literal, Not, Parameter
from cellwright.kb.model.domain_model import (
    BUILT_IN_TYPES,
    NUMERIC_TYPES,
    OBJECT_TYPE,
    Domain,
    Kind,
    Phrase,
)
from cellwright.kb.syntax import ExpressionError, Parsed, parse_expression
from cellwright.kb.terms import ANYTHING, Atom, Function, Number, Term, Text, Variable, stage_parts

Place = Callable[[tuple[str | int, ...], int], Source]
"""A function from a path under `commands:`, such as `("phrases", 3, "say")`, and a character in
its text to the place.
"""

MAX_WORDS = 5000  # in all lists together, because the grammar of every sentence contains them all
ALLOWED_KINDS = {"stage": (Kind.EVENT, Kind.FLUENT), "goal": (Kind.FLUENT, Kind.DERIVED)}


@dataclass(frozen=True, slots=True)
class PhraseMeaning:
    """A phrase ready for use: its pattern, its slots by variable, and the conditions that
    contain them.

    Of a `swap` the condition has a place that is open: that of the other object.
    """

    phrase: Phrase
    pattern: Pattern
    slots: tuple[PatternSlot, ...]
    conditions: tuple[Literal, ...]
    is_stage: bool = False
    subject: str = ""
    swap: bool = False


def read_meanings(domain: Domain) -> list[PhraseMeaning]:
    """The phrases of a domain. They must have been checked before."""
    return [_read_meaning(phrase, domain) for phrase in domain.phrases]


def _read_meaning(phrase: Phrase, domain: Domain) -> PhraseMeaning:
    pattern = read_pattern(phrase.say)
    field = "stage" if phrase.stage else "goal"
    parsed = _parse_field(phrase, field, domain)
    return PhraseMeaning(
        phrase, pattern, slots_of(pattern), parsed.value, field == "stage", phrase.subject
    )


def _parse_field(phrase: Phrase, field: str, domain: Domain) -> Parsed:
    if field == "stage" and not re.match(r"\s*not\s", phrase.stage):
        read = parse_expression("stages", phrase.stage, domain.time_unit)
        return Parsed(tuple(map(Literal, read.value)), read.places)
    parsed = parse_expression("conditions", getattr(phrase, field), domain.time_unit)
    if field == "stage" or not all(isinstance(part, Literal) for part in parsed.value):
        raise ExpressionError(0, f"a {field} can only contain atoms")
    return parsed


def spoken_of(domain: Domain) -> Iterator[Literal]:
    """The literals that the phrases of a domain stand for; its phrases have been checked."""
    return (
        part
        for meaning in read_meanings(domain)
        for literal in meaning.conditions
        for part in literals_of_stage(literal)
    )


def literals_of_stage(literal: Literal) -> tuple[Literal, ...]:
    """The literal, or those of a stage that is reached together."""
    return tuple(Literal(part, literal.positive) for part in stage_parts(literal.atom))


def slots_of(pattern: Pattern) -> tuple[PatternSlot, ...]:
    """The slots of a pattern, each variable once, in order of occurrence."""
    slots: dict[str, PatternSlot] = {}
    for expansion in expand_pattern(pattern):
        for part in expansion:
            if isinstance(part, PatternSlot):
                slots.setdefault(part.variable, part)
    return tuple(sorted(slots.values(), key=lambda slot: slot.offset))


def quantified_goal(literal: Literal, domain: Domain) -> Condition:
    """The literal as a goal. Each `_` means some value."""
    fresh: list[Parameter] = []
    expected = domain.predicates[literal.atom.name].arguments
    arguments = tuple(
        _fresh_term(a, t, fresh, domain)
        for a, t in zip(literal.atom.arguments, expected, strict=True)
    )
    if not fresh:
        return literal
    some = Exists(tuple(fresh), Literal(Function(literal.atom.name, arguments)))
    return some if literal.positive else Not(some)


def _fresh_term(term: Term, type_: str, fresh: list[Parameter], domain: Domain) -> Term:
    if term == ANYTHING:
        fresh.append(Parameter(Variable(f"_Any{len(fresh) + 1}"), type_))
        return fresh[-1].variable
    if isinstance(term, Function) and term.arguments:
        inner = zip(term.arguments, domain.functions[term.name].arguments, strict=True)
        return Function(term.name, tuple(_fresh_term(a, t, fresh, domain) for a, t in inner))
    return term


def check_phrases(domain: Domain, place: Place | None = None) -> list[Diagnostic]:
    """All errors in the words and phrases of a domain."""
    diagnostics = list(_check_words(domain, place))
    for index, phrase in enumerate(domain.phrases):
        if not phrase.goal and not phrase.stage:
            continue  # the loader reports its wrong shape
        diagnostics.extend(_PhraseCheck(domain, index, phrase, place).run())
    return diagnostics


def _check_words(domain: Domain, place: Place | None) -> Iterator[Diagnostic]:
    known = [*domain.types, *domain.objects]
    listed = 0
    for key, nouns in domain.words.items():
        where = place(("words", key), 0) if place else Source(domain.path)
        listed += len(nouns)
        if listed > MAX_WORDS:
            message, hint = (
                f"more than {MAX_WORDS} words",
                "list fewer: objects can always be called by their names",
            )
            yield Diagnostic(where, "K007", message, hint)
            return
        if key not in known:
            yield unknown_name("type or object", key, known, where)
        for number, noun in enumerate(nouns):
            if not noun.split() or not all(map(is_spoken, noun.split())):
                where = place(("words", key, number), 0) if place else where
                yield Diagnostic(
                    where, "K606", f"'{noun}' is not a word that a sentence can contain", WORDS_HINT
                )


WORDS_HINT = "words consist of letters, and of hyphens between letters"


class _PhraseCheck:
    """The check of one phrase against the signatures of its domain."""

    def __init__(self, domain: Domain, index: int, phrase: Phrase, place: Place | None) -> None:
        self.domain, self.index, self.phrase, self.place = domain, index, phrase, place
        self.found: list[Diagnostic] = []
        self.parsed = Parsed(())
        self.field = "stage" if phrase.stage else "goal"

    def run(self) -> list[Diagnostic]:
        try:
            pattern = read_pattern(self.phrase.say)
        except PatternError as error:
            self._report("say", error.offset, "K601", error.message, error.hint)
            return self.found
        self._slots(pattern)
        for word in sorted(
            {
                p.text
                for expansion in expand_pattern(pattern)
                for p in expansion
                if isinstance(p, PatternWord)
            }
        ):
            if not is_spoken(word):
                offset = self.phrase.say.lower().find(word)
                self._report(
                    "say",
                    offset,
                    "K601",
                    f"'{word}' is not a word that a sentence can contain",
                    WORDS_HINT,
                )
        try:
            self.parsed = _parse_field(self.phrase, self.field, self.domain)
        except ExpressionError as error:
            self._report(self.field, error.offset, error.code, error.message, error.hint)
            return self.found
        self.types = {Variable(slot.variable): slot.type for slot in slots_of(pattern)}
        self._subject()
        for literal in self.parsed.value:
            parts = stage_parts(literal.atom)
            for part in parts:
                self._atom(part, len(parts) == 1)
        return self.found

    def _subject(self) -> None:
        said = self.phrase.subject
        if said and self.types.get(Variable(said), "int") in NUMERIC_TYPES:
            known = [
                str(variable)
                for variable, type_ in self.types.items()
                if type_ not in NUMERIC_TYPES
            ]
            hint = nearest_hint(said, known) or f"its slots: {', '.join(known) or 'none'}"
            self._report(
                "subject", 0, "K105", f"'{said}' is no slot for an object of the phrase", hint
            )

    def _report(self, field: str, offset: int, code: str, message: str, hint: str = "") -> None:
        where = (
            self.place(("phrases", self.index, field), offset) if self.place else self.phrase.where
        )
        self.found.append(Diagnostic(where, code, message, hint))

    def _slots(self, pattern: Pattern) -> None:
        known = self._known_types()
        bound = expand_pattern(pattern)
        for slot in slots_of(pattern):
            if slot.type not in known:
                hint = nearest_hint(slot.type, known)
                self._report("say", slot.offset, "K101", f"unknown type '{slot.type}'", hint)
            for variable in bound:
                times = [part.variable for part in variable if isinstance(part, PatternSlot)].count(
                    slot.variable
                )
                if times != 1:
                    said = " ".join(
                        part.text if isinstance(part, PatternWord) else f"{{{part.variable}}}"
                        for part in variable
                    )
                    message = f"slot {slot.variable} occurs {times} times in '{said}'"
                    self._report(
                        "say",
                        slot.offset,
                        "K601",
                        message,
                        "every alternative needs the slot exactly once",
                    )
                    break

    def _known_types(self) -> list[str]:
        return [*self.domain.types, *BUILT_IN_TYPES]

    def _atom(self, atom: Atom, alone: bool) -> None:
        predicate = self.domain.predicates.get(atom.name)
        if predicate is None:
            hint = nearest_hint(atom.name, list(self.domain.predicates))
            self._wrong(atom, "K101", f"unknown predicate '{atom.name}'", hint)
        elif predicate.kind not in ALLOWED_KINDS[self.field]:
            allowed = " or ".join(kind.value for kind in ALLOWED_KINDS[self.field])
            self._wrong(
                atom,
                "K108",
                f"'{atom.name}' is {predicate.kind.value}; a {self.field} is {allowed}",
            )
        elif predicate.kind is Kind.EVENT and not alone:
            self._wrong(
                atom, "K108", "an event is no state, so nothing can be reached together with it"
            )
        elif len(predicate.arguments) != len(atom.arguments):
            self._wrong(atom, "K102", f"{atom.name} takes {len(predicate.arguments)} arguments")
        else:
            self._arguments(atom, predicate.arguments)

    def _arguments(self, term: Function, expected: tuple[str, ...]) -> None:
        for argument, type_ in zip(term.arguments, expected, strict=True):
            for actual in self._actual(argument, type_):
                if not self._fits(actual, type_):
                    self._wrong(
                        argument,
                        "K103",
                        f"{argument} is {actual}, but {term.name} takes {type_} here",
                    )

    def _fits(self, actual: str, expected: str) -> bool:
        if expected in NUMERIC_TYPES:
            return actual in NUMERIC_TYPES
        return self.domain.is_subtype(actual, expected)

    def _actual(self, term: Term, expected: str) -> Iterator[str]:
        """The type of a term if it has one. Errors in the term are reported."""
        match term:
            case Variable():
                yield from self._variable(term)
            case Number():
                yield "int"
            case Text():
                yield "text"
            case Function(name, ()) if name not in self.domain.functions:
                yield from self._object(term, expected)
            case Function():
                yield from self._compound(term)

    def _variable(self, variable: Variable) -> Iterator[str]:
        if variable in self.types:
            if self.types[variable] in self._known_types():
                yield self.types[variable]
        elif variable != ANYTHING:
            known = ", ".join(map(str, self.types)) or "none"
            message = f"variable {variable} is not a slot of the phrase"
            self._wrong(variable, "K105", message, f"its slots: {known}")
        elif self.field == "stage":
            self._wrong(
                variable, "K105", "a stage cannot contain '_'", "use a slot for it, or write a goal"
            )

    def _object(self, term: Function, expected: str) -> Iterator[str]:
        if term.name in self.domain.objects:
            yield self.domain.objects[term.name]
        else:
            hint = nearest_hint(term.name, self._names(expected))
            self._wrong(term, "K101", f"unknown object '{term.name}'", hint)

    def _compound(self, term: Function) -> Iterator[str]:
        signature = self.domain.functions.get(term.name)
        if signature is None:
            hint = nearest_hint(term.name, list(self.domain.functions))
            self._wrong(term, "K101", f"unknown function '{term.name}'", hint)
        elif len(term.arguments) != len(signature.arguments):
            self._wrong(term, "K102", f"{term.name} takes {len(signature.arguments)} arguments")
        else:
            self._arguments(term, signature.arguments)
            yield signature.result

    def _names(self, type_: str) -> list[str]:
        return [
            name
            for name, own in self.domain.objects.items()
            if type_ == OBJECT_TYPE or self._fits(own, type_)
        ]

    def _wrong(self, term: Term, code: str, message: str, hint: str = "") -> None:
        inner = term if isinstance(term, Function | Variable) else None
        offset = self.parsed.places.get(inner, 0) if inner is not None else 0
        self._report(self.field, offset, code, message, hint)
