"""One sentence read in four stages: clauses from the grammar, objects from references, acts from phrases, and their order."""

import itertools
from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction

from kb.commands.explain import explain
from kb.commands.grammar import Clause, CommandGrammar, NotUnderstood, Words
from kb.commands.order import Act, NoOrder, arrange
from kb.commands.phrases import Meaning, condition, meanings
from kb.commands.references import References, Unclear
from kb.diagnostics import Diagnostic, InvalidInput, Source
from kb.model.conditions import And, Condition, Literal
from kb.model.domain import NUMERIC_TYPES, Domain, Kind
from kb.model.problem import Chain, Problem
from kb.syntax import unit_seconds
from kb.terms import Function, Number, Term, Variable, substitute_atom

MAX_LENGTH = 5_000
MAX_ACTS = 100_000


def read_sentence(
    problem: Problem, text: str, place: Callable[[int], Source]
) -> tuple[Condition, tuple[Chain, ...]]:
    """The goal and the chains of a sentence. Raises `InvalidInput`."""
    domain = problem.domain
    if not domain.phrases:
        hint = "declare phrases under `commands:`, or give goals"
        raise InvalidInput([Diagnostic(place(0), "K405", f"the domain {domain.name} has no phrases", hint)])
    if len(text) > MAX_LENGTH:
        raise InvalidInput(
            [Diagnostic(Source(place(0).path), "K007", f"longer than {MAX_LENGTH} characters")]
        )
    objects = {**domain.objects, **problem.objects}
    known = meanings(domain)
    grammar = CommandGrammar(domain, known, objects)
    try:
        clauses = grammar.parse(text)
    except NotUnderstood as error:
        raise InvalidInput([explain(error, text, domain, objects, place)]) from None
    return _Sentence(domain, known, References(domain, objects), place).arranged(clauses)


class _Sentence:
    """The translation of the clauses of one sentence to goals and chains. Every unclear reference is reported."""

    def __init__(
        self, domain: Domain, known: Sequence[Meaning], references: References, place: Callable[[int], Source]
    ) -> None:
        self.domain, self.known, self.references, self.place = domain, known, references, place
        self.found: list[Diagnostic] = []

    def arranged(self, clauses: Sequence[Clause]) -> tuple[Condition, tuple[Chain, ...]]:
        """The goal and the chains."""
        acts = [act for number, clause in enumerate(clauses) for act in self._acts(number, clause)]
        if self.found:
            raise InvalidInput(self.found)
        try:
            return arrange(acts)
        except NoOrder as error:
            clause = clauses[error.clause]
            meaning = self.known[clause.phrase]
            message = f"this act is part of an order, but its goal cannot be a stage: {meaning.phrase.goal}"
            where = self.place(clause.offset)
            hint = "give it as a separate command, without 'then'"
            raise InvalidInput([Diagnostic(where, "K604", message, hint)]) from None

    def _acts(self, number: int, clause: Clause) -> Iterator[Act]:
        meaning = self.known[clause.phrase]
        try:
            choices = [
                [
                    (Variable(slot.variable), value)
                    for value in self._values(clause.slots[slot.variable], slot.type)
                ]
                for slot in meaning.slots
            ]
        except Unclear as error:
            self.found.append(Diagnostic(self.place(error.offset), "K603", error.message, error.hint))
            return
        subject = next((Variable(s.variable) for s in meaning.slots if s.type not in NUMERIC_TYPES), None)
        for combination in itertools.islice(itertools.product(*choices), MAX_ACTS):
            yield self._act(number, clause, meaning, dict(combination), subject)

    def _values(self, words: Words, type_: str) -> Sequence[Term]:
        if words.how != "value":
            return self.references.resolve(words, type_)
        piece = words.pieces[0]
        value = piece.value or Fraction(0)
        if type_ == "time":
            value = value / (unit_seconds(self.domain.time_unit) or Fraction(1))
        if int(value) != value:
            message = f"'{piece.text}' is not a whole number of the domain's unit of time"
            raise Unclear(piece.offset, message, f"the unit is {self.domain.time_unit}")
        return (Number(int(value)),)

    def _act(
        self,
        number: int,
        clause: Clause,
        meaning: Meaning,
        bindings: dict[Variable, Term],
        subject: Variable | None,
    ) -> Act:
        literals = [
            Literal(substitute_atom(each.atom, bindings), each.positive) for each in meaning.conditions
        ]
        named = bindings[subject] if subject is not None else self._about(literals[0])
        stages = tuple(each.atom for each in literals) if all(map(self._can_be_stage, literals)) else None
        goal = [condition(each, self.domain) for each in literals]
        whole = goal[0] if len(goal) == 1 else And(tuple(goal))
        return Act(number, named, whole, stages, meaning.is_stage, subject is None, clause.then)

    def _can_be_stage(self, literal: Literal) -> bool:
        return literal.positive and self.domain.predicates[literal.atom.name].kind in (
            Kind.FLUENT,
            Kind.EVENT,
        )

    def _about(self, literal: Literal) -> Term:
        """The subject of an act without slots: the first object in its atom."""
        named = (
            a for a in literal.atom.arguments if isinstance(a, Function) and a.name in self.references.objects
        )
        return next(named, Function(literal.atom.name))
