"""Translates a sentence to goals and chains: clauses, objects, acts, and their order."""

import itertools
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction

from cellwright.kb.commands.act_order import (
    NoOrder,
    SentenceAct,
    arrange_acts,
    asked_again,
    in_order_of_time,
)
from cellwright.kb.commands.clauses import (
    FRONT_LINKS,
    LINK_KINDS,
    Clause,
    NotUnderstood,
    read_clauses,
)
from cellwright.kb.commands.domain_nouns import NounVocabulary
from cellwright.kb.commands.everyday_wordings import Saying, sayings, swapping, verbs_meant
from cellwright.kb.commands.exclusion import Exclusion
from cellwright.kb.commands.object_references import References
from cellwright.kb.commands.phrase_matching import Book
from cellwright.kb.commands.phrase_meanings import (
    PhraseMeaning,
    literals_of_stage,
    quantified_goal,
    read_meanings,
)
from cellwright.kb.commands.phrase_patterns import (
    PARTICLES,
    PREPOSITIONS,
    PatternSlot,
    PatternWord,
    build_phrase_tree,
    readable_pattern,
)
from cellwright.kb.commands.refusals import explain_misunderstanding
from cellwright.kb.commands.sentence_pieces import SlotWords, UnclearReference
from cellwright.kb.commands.swaps import StartPlaces, swap_meanings
from cellwright.kb.commands.time_words import SaidTime
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.conditions import And, Condition, Literal
from cellwright.kb.model.domain_model import NUMERIC_TYPES, Domain, Kind
from cellwright.kb.model.planning_problem import Chain, Problem, lasting_fluents
from cellwright.kb.model.time_windows import PLAN, EventKind, EventPattern, Side, TimeWindow
from cellwright.kb.syntax import MAX_EXPRESSION_INTEGER, unit_seconds
from cellwright.kb.terms import (
    Atom,
    Function,
    Number,
    Term,
    Variable,
    is_ground,
    join_stage,
    substitute_atom,
)

MAX_COMMAND_LENGTH = 5_000
MAX_ACTS = 5_000


def understand_command(
    target: Problem | Domain, text: str, place: Callable[[int], Source] | None = None
) -> Problem:
    """The problem with the goal and chains of a command in words. For a domain, the problem starts
    from its defaults.

    `place` gives the place of character n of the text; without it, places are in the text itself.
    Raises `InvalidInput`.
    """
    problem = target if isinstance(target, Problem) else Problem("command", target)
    goal, chains, windows = read_sentence(problem, text, place or command_line_place(text))
    return replace(problem, goal=goal, chains=chains, windows=(*problem.windows, *windows))


def command_line_place(text: str) -> Callable[[int], Source]:
    """A function from a character of a text on the command line to its place."""

    def where(offset: int) -> Source:
        start = text.rfind("\n", 0, offset) + 1
        line = text[start:].partition("\n")[0]
        return Source("--command", text.count("\n", 0, offset) + 1, offset - start + 1, line)

    return where


def read_sentence(
    problem: Problem, text: str, place: Callable[[int], Source]
) -> tuple[Condition, tuple[Chain, ...], tuple[TimeWindow, ...]]:
    """The goal, the chains and the windows of time of a sentence. Raises `InvalidInput`."""
    domain = problem.domain
    if not domain.phrases:
        hint = "declare phrases under `commands:`, or give goals"
        raise InvalidInput(
            [Diagnostic(place(0), "K405", f"the domain {domain.name} has no phrases", hint)]
        )
    if len(text) > MAX_COMMAND_LENGTH:
        raise InvalidInput(
            [
                Diagnostic(
                    Source(place(0).path), "K007", f"longer than {MAX_COMMAND_LENGTH} characters"
                )
            ]
        )
    vocabulary = NounVocabulary(domain, {**domain.objects, **problem.objects}, problem.statics)
    known_meanings = read_meanings(domain)
    if swapping(text) is not None:
        known_meanings += swap_meanings(domain)
    book = book_of(known_meanings, vocabulary)
    try:
        clauses = read_clauses(book, text)
    except NotUnderstood as error:
        if (otherwise := _said_otherwise(book, text)) is None:
            raise InvalidInput([_explained(error, text, domain, vocabulary, place)]) from None
        saying, clauses = otherwise
        return _Sentence(
            problem, known_meanings, vocabulary, lambda offset: place(saying.original(offset))
        ).arranged(clauses)
    return _Sentence(problem, known_meanings, vocabulary, place).arranged(clauses)


def _said_otherwise(book: Book, text: str) -> tuple[Saying, list[Clause]] | None:
    """The first everyday way to say the sentence that is understood, with its clauses."""
    for saying in sayings(text):
        try:
            return saying, read_clauses(book, saying.text)
        except NotUnderstood:
            continue
    return None


def _explained(
    error: NotUnderstood,
    text: str,
    domain: Domain,
    vocabulary: NounVocabulary,
    place: Callable[[int], Source],
) -> Diagnostic:
    """What is not understood, and what to say instead."""
    found = explain_misunderstanding(error, text, domain, vocabulary, place)
    begin = swapping(text)
    if begin is None or place(begin) != found.where:
        return _with_phrases_meant(found, error, text, domain)
    hint = (
        "swap two objects of a type that takes places: 'swap A and B'; or say where each of them "
        "goes"
    )
    return replace(found, message="this is no swap of two things that take places", hint=hint)


def _with_phrases_meant(
    found: Diagnostic, error: NotUnderstood, text: str, domain: Domain
) -> Diagnostic:
    """The diagnostic, with the phrases of the domain that come nearest to an everyday verb:
    "preheat the furnace" where only probes are heated.
    """
    offset = error.said[error.index].offset if error.index < len(error.said) else len(text)
    verbs = verbs_meant(text, offset)
    phrases = [
        readable_pattern(phrase.say)
        for phrase in domain.phrases
        if any(re.search(rf"(?<!\w){verb}(?!\w)", phrase.say) for verb in verbs)
    ]
    if not verbs or not phrases:
        return found
    said = text[offset:].split()[0]
    message = f"'{said}' is not understood here: no phrase of this domain says it of this"
    return replace(found, message=message, hint=f"say it as: {'; '.join(dict.fromkeys(phrases))}")


def book_of(known: Sequence[PhraseMeaning], vocabulary: NounVocabulary) -> Book:
    """The book of these phrases and nouns."""
    patterns = tuple(meaning.pattern for meaning in known)
    return Book(build_phrase_tree(patterns, False), build_phrase_tree(patterns, True), vocabulary)


class _Sentence:
    """The translation of the clauses of one sentence to goals and chains.

    Every unclear reference is reported.
    """

    def __init__(
        self,
        problem: Problem,
        known: Sequence[PhraseMeaning],
        vocabulary: NounVocabulary,
        place: Callable[[int], Source],
    ) -> None:
        self.domain: Domain = problem.domain
        self.facts = problem.statics
        self.start = StartPlaces(problem, vocabulary.objects)
        self.known, self.vocabulary, self.place = known, vocabulary, place

    def arranged(
        self, clauses: Sequence[Clause]
    ) -> tuple[Condition, tuple[Chain, ...], tuple[TimeWindow, ...]]:
        """The goal, the chains and the windows of time."""
        values, unclear = self._resolved(clauses)
        in_time = in_order_of_time(clauses, {})
        if unclear and in_time != list(clauses):  # "before storing it, heat probe 1"
            values, later = self._resolved(in_time)
            unclear = unclear if later else []
        if unclear:
            raise InvalidInput(unclear)
        asked = dict[int, list[SentenceAct]]()
        try:
            for clause in clauses:
                asked[clause.offset] = [*self._acts(clause, values[clause.offset], asked)]
            referred = _referred_acts(clauses, asked)
        except UnclearReference as error:
            raise InvalidInput(
                [Diagnostic(self.place(error.offset), "K603", error.message, error.hint)]
            ) from None
        _say_once(clauses, asked)
        in_time = in_order_of_time(clauses, referred)
        acts = [
            act
            for number, clause in enumerate(in_time)
            for act in _place_acts(number, clause, asked)
        ]
        self._refuse_repeated(acts, in_time)
        exclusion = Exclusion(self.domain, self.vocabulary.objects, self.facts)
        try:
            goal, chains = arrange_acts(acts, exclusion.apart, exclusion.interrupted)
            return goal, chains, tuple(self._windows(clauses, in_time, asked))
        except NoOrder as error:
            clause = in_time[error.clause]
            meaning = self.known[clause.form.phrase]
            message = (
                "this act is part of an order, but its goal cannot be a stage: "
                f"{meaning.phrase.goal}"
            )
            where = self.place(clause.offset)
            hint = (
                "give it as a separate command, or let its phrase mean a fluent that is true then"
            )
            raise InvalidInput([Diagnostic(where, "K604", message, hint)]) from None

    def _windows(
        self,
        clauses: Sequence[Clause],
        in_time: Sequence[Clause],
        asked: Mapping[int, Sequence[SentenceAct]],
    ) -> Iterator[TimeWindow]:
        """What is said of the time between acts."""
        for clause in clauses:
            if clause.time is None:
                continue
            for earlier, later in _timed_acts(clause, in_time, asked):
                for one, other in _of_one_subject(earlier, later):
                    yield self._window(clause.time, one, other)
            if not clause.link and in_time[0].offset == clause.offset:
                yield from (self._deadline(clause.time, act) for act in asked[clause.offset])

    def _window(self, time: SaidTime, earlier: SentenceAct, later: SentenceAct) -> TimeWindow:
        """The window between two acts: from an end of the earlier one to the start of the later
        one.
        """
        least, most = (
            None if limit is None else self._units(limit, time) for limit in (time.least, time.most)
        )
        return TimeWindow(
            self._event(earlier.literals[-1], time.side, time),
            self._event(later.literals[0], None, time),
            least,
            most,
            where=self.place(time.offset),
        )

    def _deadline(self, time: SaidTime, act: SentenceAct) -> TimeWindow:
        """The window from the start of the plan to the end of an act."""
        most = None if time.most is None else self._units(time.most, time)
        last = self._event(act.literals[-1], Side.END, time)
        start = EventPattern(EventKind.PLAN, PLAN, Side.START)
        return TimeWindow(start, last, None, most, where=self.place(time.offset))

    def _event(self, literal: Literal, side: Side | None, time: SaidTime) -> EventPattern:
        """The event of an act; without a side, events count from their start, facts from when they
        change.
        """
        kind = self.domain.predicates[literal.atom.name].kind
        if kind is Kind.EVENT:
            return EventPattern(EventKind.EVENT, literal.atom, side or Side.START)
        if kind is not Kind.FLUENT:
            message = f"no time can be counted with {literal.atom}, which no step makes true"
            hint = "name an act that is an event or changes a fact"
            raise InvalidInput([Diagnostic(self.place(time.offset), "K604", message, hint)])
        happens = EventKind.FACT if literal.positive else EventKind.ENDING
        return EventPattern(happens, literal.atom, side or Side.END)

    def _units(self, seconds: Fraction, time: SaidTime) -> int:
        unit = self.domain.time_unit
        value = seconds / (unit_seconds(unit) or Fraction(1))
        if int(value) == value and value <= MAX_EXPRESSION_INTEGER:
            return int(value)
        message = f"'{time.text}' is not a whole number of the domain's unit of time, or too large"
        raise InvalidInput(
            [Diagnostic(self.place(time.offset), "K603", message, f"the unit is {unit}")]
        )

    def _refuse_repeated(self, acts: Sequence[SentenceAct], clauses: Sequence[Clause]) -> None:
        repeated = asked_again(acts, lasting_fluents(self.domain))
        if repeated is not None:
            message = f"this asks again for {repeated.condition}, which stays once it is so"
            hint = "leave it out; what can be done several times is an event of the domain"
            where = self.place(clauses[repeated.clause].offset)
            raise InvalidInput([Diagnostic(where, "K604", message, hint)])

    def _resolved(
        self, clauses: Sequence[Clause]
    ) -> tuple[dict[int, dict[str, Sequence[Term]]], list[Diagnostic]]:
        """The objects, numbers and times that fill the slots of each clause; and what is
        unclear about them.
        """
        references = References(self.vocabulary)
        unclear: list[Diagnostic] = []
        values: dict[int, dict[str, Sequence[Term]]] = {}
        for number, clause in enumerate(clauses):
            types, following = self._types(clause), clauses[number + 1 :]
            try:
                values[clause.offset] = {
                    variable: self._values(
                        self._full(words, types[variable], references, following),
                        types[variable],
                        references,
                    )
                    for variable, words in clause.slots.items()
                }
            except UnclearReference as error:
                leaning = any(words.leans_back for words in clause.slots.values())
                if not (unclear and leaning):  # what it means is unclear itself, and told
                    unclear.append(
                        Diagnostic(self.place(error.offset), "K603", error.message, error.hint)
                    )
        return values, unclear

    def _types(self, clause: Clause) -> dict[str, str]:
        return {slot.variable: slot.type for slot in self.known[clause.form.phrase].slots}

    def _full(
        self, words: SlotWords, type_: str, references: References, following: Sequence[Clause]
    ) -> SlotWords:
        """The words that fill a slot; for those left out before any object is named, those of a
        later clause: "wash and dry part 1".
        """
        if words.how != "omitted" or references.named:
            return words
        for later_clause in itertools.takewhile(lambda clause: not clause.then, following):
            types = self._types(later_clause)
            fillings = [
                filling
                for variable, filling in later_clause.slots.items()
                if types[variable] == type_
            ]
            if fillings and fillings[0].how != "omitted":
                return words if fillings[0].how == "pronoun" else fillings[0]
        return words

    def _values(self, words: SlotWords, type_: str, references: References) -> Sequence[Term]:
        if words.how != "value":
            return references.resolve(words, type_)
        piece = words.pieces[0]
        value, shown = piece.value or Fraction(0), piece.text
        if type_ == "time":
            unit = self.domain.time_unit
            value = value / (unit_seconds(unit) or Fraction(1))
            if value == 0:
                raise UnclearReference(
                    piece.offset, f"'{shown}' is no time that an act can last", "give more than 0"
                )
            shown = f"{shown} = {value} {unit}"
            if int(value) != value:
                message = f"'{piece.text}' is not a whole number of the domain's unit of time"
                raise UnclearReference(piece.offset, message, f"the unit is {unit}")
        if value > MAX_EXPRESSION_INTEGER:
            raise UnclearReference(
                piece.offset,
                f"'{shown}' is too large",
                f"the largest number is {MAX_EXPRESSION_INTEGER}",
            )
        return (Number(int(value)),)

    def _acts(
        self,
        clause: Clause,
        values: Mapping[str, Sequence[Term]],
        earlier: Mapping[int, Sequence[SentenceAct]],
    ) -> Iterator[SentenceAct]:
        """One act for each combination of the objects that fill the slots; for a swap, one for each
        of its two objects. `earlier` acts may have moved these.
        """
        meaning = self.known[clause.form.phrase]
        if meaning.swap:
            yield from self._swapped(clause, meaning, values, earlier)
            return
        own = [slot.variable for slot in meaning.slots if slot.type not in NUMERIC_TYPES]
        count = math.prod(len(choices) for choices in values.values())
        if count > MAX_ACTS:
            message = f"this asks for {count} acts, more than {MAX_ACTS}"
            raise InvalidInput(
                [Diagnostic(self.place(clause.offset), "K007", message, "name fewer objects")]
            )
        for combination in itertools.product(*(values[slot.variable] for slot in meaning.slots)):
            bindings = dict(
                zip((slot.variable for slot in meaning.slots), combination, strict=True)
            )
            named = [bindings[variable] for variable in own]
            yield self._act(clause, meaning, bindings, named)

    def _swapped(
        self,
        clause: Clause,
        meaning: PhraseMeaning,
        values: Mapping[str, Sequence[Term]],
        earlier: Mapping[int, Sequence[SentenceAct]],
    ) -> Iterator[SentenceAct]:
        """The two acts of a swap: each object goes to the place of the other one."""
        things = list(dict.fromkeys(itertools.chain(*values.values())))
        if len(things) != 2:
            named = ", ".join(map(str, things))
            raise UnclearReference(
                clause.offset, f"a swap is of two things, and not of {named}", "name two of them"
            )
        fluent = meaning.conditions[0].atom.name
        places = [self._place(clause, thing, fluent, earlier) for thing in things]
        for thing, place in zip(things, reversed(places), strict=True):
            goal = Literal(Function(fluent, (thing, place)))
            yield self._act(clause, replace(meaning, conditions=(goal,)), {}, [thing])

    def _place(
        self, clause: Clause, thing: Term, fluent: str, earlier: Mapping[int, Sequence[SentenceAct]]
    ) -> Term:
        """Where a thing is when a clause is carried out. Raises `UnclearReference` if nobody says
        that.
        """
        place = self.start.of(thing, fluent)
        for act in (act for acts in earlier.values() for act in acts if act.subject == thing):
            own = [part.atom for part in act.literals if part.positive]
            to = [atom.arguments[1] for atom in own if atom.name == fluent and is_ground(atom)]
            place = to[0] if to else None
        if place is None:
            message = f"nobody can say where {thing} is then, so a swap names no place"
            hint = f"say where each of the two goes, or give {fluent}({thing}, ...) in the problem"
            raise UnclearReference(clause.offset, message, hint)
        return place

    def _act(
        self,
        clause: Clause,
        meaning: PhraseMeaning,
        bindings: Mapping[str, Term],
        named: Sequence[Term],
    ) -> SentenceAct:
        bound = {Variable(variable): value for variable, value in bindings.items()}
        asked = [
            Literal(substitute_atom(condition.atom, bound), condition.positive)
            for condition in meaning.conditions
        ]
        literals = tuple(part for literal in asked for part in literals_of_stage(literal))
        stages = self._stages(asked, meaning.is_stage)
        goal = [quantified_goal(literal, self.domain) for literal in literals]
        whole = goal[0] if len(goal) == 1 else And(tuple(goal))
        said_objects = [
            Function(named_object.object)
            for named_object in self.vocabulary.named(clause.form.parts)
        ]
        in_atoms = (
            []
            if named
            else [own_object for literal in literals for own_object in self._objects(literal.atom)]
        )
        about = [*named, *said_objects, *in_atoms]
        chosen = [bound[Variable(meaning.subject)]] if meaning.subject else []
        subject = (
            chosen
            or named
            or said_objects
            or _common_noun(clause)
            or in_atoms
            or [Function(literals[0].atom.name)]
        )[0]
        things = frozenset(about) - {subject}
        return SentenceAct(
            0,
            subject,
            things,
            literals,
            whole,
            stages,
            must=meaning.is_stage,
            lasts=not any(
                self.domain.predicates[literal.atom.name].kind is Kind.EVENT for literal in literals
            ),
            alone=not named,
            then=clause.then,
        )

    def _stages(self, asked: Sequence[Literal], in_order: bool) -> tuple[Atom, ...] | None:
        """The stages of an act: those of its phrase, or what its goals are together.

        None if it cannot be a stage.
        """
        kinds = {
            self.domain.predicates[part.atom.name].kind
            for literal in asked
            for part in literals_of_stage(literal)
        }
        if not kinds <= {Kind.FLUENT, Kind.EVENT} or not all(literal.positive for literal in asked):
            return None
        atoms = tuple(literal.atom for literal in asked)
        return atoms if in_order or len(atoms) == 1 else (join_stage(atoms),)

    def _objects(self, term: Term) -> Iterator[Function]:
        """The objects in an atom, in order."""
        for argument in term.arguments if isinstance(term, Function) else ():
            if isinstance(argument, Function) and argument.name in self.vocabulary.objects:
                yield argument
            yield from self._objects(argument)


def _common_noun(clause: Clause) -> list[Function]:
    """What a phrase without slots is about if its words name no object: the words behind the
    verb. "open the gate": gate.
    """
    words = [part.text for part in clause.form.parts if isinstance(part, PatternWord)]
    noun = [
        word for word in words[1:] if word not in PARTICLES | PREPOSITIONS and word.isidentifier()
    ]
    return (
        [Function("_".join(noun))]
        if noun and not any(isinstance(part, PatternSlot) for part in clause.form.parts)
        else []
    )


def _referred_acts(
    clauses: Sequence[Clause], asked: dict[int, list[SentenceAct]]
) -> dict[int, frozenset[int]]:
    """The clauses such as "once probe 1 is heated" that mean acts said before, and where those were
    said.

    What is only said in short gets the acts that it means.
    """
    referred: dict[int, frozenset[int]] = {}
    for number, clause in enumerate(clauses):
        if clause.link not in LINK_KINDS:
            continue
        known_acts = {
            _act_key(act, clause.again): (act, earlier_clause.offset)
            for earlier_clause in clauses[:number]
            if earlier_clause.offset not in referred
            for act in asked[earlier_clause.offset]
        }
        keys = [_act_key(act, clause.again) for act in asked[clause.offset]]
        lost = next(
            (a for a, key in zip(asked[clause.offset], keys, strict=True) if key not in known_acts),
            None,
        )
        if clause.again and lost is not None:
            message = f"this is said in short, but nothing before says it whole for {lost.subject}"
            raise UnclearReference(
                clause.offset, message, "say the act whole, with all that belongs to it"
            )
        if lost is None:
            asked[clause.offset] = [known_acts[key][0] for key in keys]
            referred[clause.offset] = frozenset(known_acts[key][1] for key in keys)
    return referred


def _say_once(clauses: Sequence[Clause], asked: dict[int, list[SentenceAct]]) -> None:
    """Take out what is only said again to put it first: "store all probes, but probe 2 first"
    stores probe 2 once.
    """
    for number, clause in enumerate(clauses):
        if clause.link not in FRONT_LINKS:
            continue
        first = {act.literals for act in asked[clause.offset]}
        for earlier_clause in clauses[:number]:
            acts_left = [act for act in asked[earlier_clause.offset] if act.literals not in first]
            asked[earlier_clause.offset] = acts_left or asked[earlier_clause.offset]


def _timed_acts(
    clause: Clause, in_time: Sequence[Clause], asked: Mapping[int, Sequence[SentenceAct]]
) -> list[tuple[Sequence[SentenceAct], Sequence[SentenceAct]]]:
    """The earlier and the later acts between which the time passes that a clause says."""
    own = asked[clause.offset]
    if clause.link:
        mains = (main for main in in_time if clause.offset in main.waits)
        return [(own, asked[main.offset]) for main in mains]
    offsets = [other.offset for other in in_time]
    before = [asked[offset] for offset in offsets[: offsets.index(clause.offset)]]
    return [(_last_acts(before, own), own)]


def _last_acts(
    before: Sequence[Sequence[SentenceAct]], own: Sequence[SentenceAct]
) -> Sequence[SentenceAct]:
    """The acts of the last clause before that has one of the same subjects; else of the last."""
    subjects = {act.subject for act in own}
    same = [acts for acts in before if subjects & {act.subject for act in acts}]
    return (same or before)[-1] if before else ()


def _of_one_subject(
    earlier: Sequence[SentenceAct], later: Sequence[SentenceAct]
) -> list[tuple[SentenceAct, SentenceAct]]:
    """The pairs of acts about the same thing; all pairs if there are none."""
    pairs = list(itertools.product(earlier, later))
    return [(one, other) for one, other in pairs if one.subject == other.subject] or pairs


def _act_key(act: SentenceAct, again: bool) -> object:
    """What two acts have in common if they are the same, or if one is said in short."""
    return (
        (act.subject, *(literal.atom.name for literal in act.literals)) if again else act.literals
    )


def _place_acts(
    number: int, clause: Clause, asked: Mapping[int, Sequence[SentenceAct]]
) -> Iterator[SentenceAct]:
    """The acts of a clause with their place in the order of time."""
    own = {act.subject for act in asked[clause.offset]}
    groups = [asked[offset] for offset in sorted(clause.waits)]
    # each object goes on by itself
    alone = [{act.subject for act in group} <= own for group in groups]
    for act in asked[clause.offset]:
        waits = frozenset(
            awaited_act.literals
            for group, is_alone in zip(groups, alone, strict=True)
            for awaited_act in group
            if not is_alone or awaited_act.subject == act.subject
        )
        yield replace(act, clause=number, then=clause.then, waits=waits)
