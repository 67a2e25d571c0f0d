"""What the goals of a problem can need, found backwards over operators with variables, before anything is grounded.

A pattern is an atom in which `_` stands for anything. A pattern is relevant if making it true, or false, may help to reach
a goal. Patterns only say what may be needed: they leave out types and static conditions, and so never too much.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property

from cellwright.engine.stages.grounding.program import Conditional, Schema, Vocabulary, conditionals, schemas
from cellwright.kb.model.conditions import BodyPart, Literal, StateAggregate, goal_parts, literals
from cellwright.kb.model.domain import Domain
from cellwright.kb.model.normalise import Normaliser
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Function,
    Operation,
    Substitution,
    Term,
    Variable,
    parts_of,
    substitute,
)

MOST = 400  # patterns; with more of them, all objects in them are left open


@dataclass(frozen=True, slots=True)
class Wanted:
    """A pattern that should be made true, or false."""

    pattern: Atom
    positive: bool = True


@dataclass
class Relevance:
    """The relevant patterns, the bindings under which each operator is relevant, and the static conditions that are read.

    `bindings` are by the name of the operator. A variable that is not bound may have any value.
    """

    wanted: dict[Wanted, None] = field(default_factory=dict)
    bindings: dict[str, dict[tuple[Term, ...], None]] = field(default_factory=dict)
    statics: dict[Atom, None] = field(default_factory=dict)

    @cached_property
    def _by_name(self) -> Mapping[str, list[Atom]]:
        return _grouped(each.pattern for each in self.wanted)

    @cached_property
    def _statics_by_name(self) -> Mapping[str, list[Atom]]:
        return _grouped(self.statics)

    def concerns(self, atom: Atom) -> bool:
        """Whether it matters if a fluent is true."""
        return any(overlap(each, atom) for each in self._by_name.get(atom.name, ()))

    def reads(self, fact: Atom) -> bool:
        """Whether a static condition of a relevant operator can ask for a fact."""
        return any(overlap(each, fact) for each in self._statics_by_name.get(fact.name, ()))

    @property
    def static_predicates(self) -> set[tuple[str, int]]:
        """The name and arity of every static predicate that is read."""
        return {(each.name, len(each.arguments)) for each in self.statics}


def relevance(problem: Problem) -> Relevance:
    """What the goals and the workflow of a problem can need."""
    found = _Search(problem, blurred=False).run()
    return found if len(found.wanted) <= MOST else _Search(problem, blurred=True).run()


class _Search:
    """A search backwards from the goals. If it is `blurred`, patterns have `_` in the place of every argument."""

    def __init__(self, problem: Problem, blurred: bool) -> None:
        self.problem, self.domain, self.blurred = problem, problem.domain, blurred
        normaliser, self.vocabulary = Normaliser(), Vocabulary(problem.domain)
        self.schemas: list[Schema] = list(schemas(self.domain, normaliser, self.vocabulary))
        self.conditionals: list[Conditional] = list(conditionals(self.domain, normaliser, self.vocabulary))
        self.goals = [d for part in goal_parts(problem.goal) for d in normaliser.disjuncts(part, {})]
        self.rules = [*self.domain.rules, *normaliser.rules]
        self.vocabulary = Vocabulary(self.domain, normaliser.rules)
        self.found, self.waiting = Relevance(), list[Wanted]()

    def run(self) -> Relevance:
        for disjunct in self.goals:
            self._need(disjunct, {})
        for chain in self.problem.chains:
            for stage in (part for each in chain.stages for part in parts_of(each)):
                self._want(Wanted(_opened(stage, {}), positive=True))
        while self.waiting and (self.blurred or len(self.found.wanted) <= MOST):
            self._supply(self.waiting.pop())
        return self.found

    def _want(self, wanted: Wanted) -> None:
        if self.blurred:
            pattern = Function(wanted.pattern.name, (ANYTHING,) * len(wanted.pattern.arguments))
            wanted = Wanted(pattern, wanted.positive)
        if wanted not in self.found.wanted:
            self.found.wanted[wanted] = None
            self.waiting.append(wanted)

    def _need(self, body: Iterable[BodyPart], bindings: Substitution, flipped: bool = False) -> None:
        """Want all dynamic literals of a body, and note its static ones."""
        for part in body:
            if isinstance(part, StateAggregate):
                for literal in literals(part):
                    for sign in (True, False):
                        self._need((Literal(literal.atom, sign),), bindings)
            if not isinstance(part, Literal):
                continue
            pattern = _opened(part.atom, bindings)
            if not self.vocabulary.is_dynamic(part.atom.name):
                self.found.statics[pattern] = None
            else:
                self._want(Wanted(pattern, part.positive is not flipped))

    def _supply(self, wanted: Wanted) -> None:
        """Note everything that may make a wanted pattern true, or false."""
        for schema in self.schemas:
            for effect in schema.operator.effects:
                if effect.adds is wanted.positive and (b := met(effect.atom, wanted.pattern)) is not None:
                    self._use(schema, b)
        self._deduce(wanted)
        for rule in self.rules:
            if (bindings := met(rule.head, wanted.pattern)) is not None:
                self._need(rule.body, bindings, flipped=not wanted.positive)

    def _deduce(self, wanted: Wanted) -> None:
        for deductive in self.domain.deductive_operators:
            for consequence in deductive.consequences:
                if consequence.implied is not wanted.positive:
                    continue
                bindings = met(consequence.atom, wanted.pattern)
                if bindings is not None:
                    self._need((deductive.trigger, *deductive.body, *consequence.body), bindings)

    def _use(self, schema: Schema, bindings: Substitution) -> None:
        operator = schema.operator
        own = {v: value for v, value in bindings.items() if v in schema.variables}
        key = tuple(ANYTHING if self.blurred else own.get(v, ANYTHING) for v in operator.variables)
        self.found.bindings.setdefault(operator.name, {})[key] = None
        self._need((*schema.literals, *schema.static), own)
        for each in self.conditionals:
            if each.operator is operator:
                self._need((*each.literals, *each.static), own)
        for name, arity in amounts(self.domain, schema):
            self.found.statics[Function(name, (ANYTHING,) * arity)] = None


def amounts(domain: Domain, schema: Schema) -> Iterator[tuple[str, int]]:
    """The static predicates that the duration and the cost of an operator name, with their arities, except for travel.

    Travel ties all places to one another, and changes no plan but only how long it lasts.
    """
    for term in (schema.operator.duration, schema.operator.cost):
        for part in _functions(term):
            if part.name in domain.predicates and part.name != domain.conventions.travel:
                yield part.name, len(domain.predicates[part.name].arguments)


def _functions(term: Term | None) -> Iterator[Function]:
    match term:
        case Operation(_, left, right):
            yield from _functions(left)
            yield from _functions(right)
        case Function(_, arguments):
            yield term
            for each in arguments:
                yield from _functions(each)
        case _:
            return


def _grouped(atoms: Iterable[Atom]) -> dict[str, list[Atom]]:
    found: dict[str, list[Atom]] = {}
    for each in atoms:
        found.setdefault(each.name, []).append(each)
    return found


def met(term: Term, pattern: Term) -> dict[Variable, Term] | None:
    """The bindings under which a term with variables is among what a pattern stands for; None if it never is.

    Where they are too hard to tell, a variable stays free.
    """
    bindings: dict[Variable, Term] = {}
    return bindings if _meets(term, pattern, bindings) else None


def _meets(term: Term, pattern: Term, bindings: dict[Variable, Term]) -> bool:
    if pattern == ANYTHING or term == ANYTHING or isinstance(term, Operation):
        return True
    if isinstance(term, Variable):
        return overlap(bindings.setdefault(term, pattern), pattern)
    if not isinstance(term, Function) or not isinstance(pattern, Function):
        return term == pattern
    return (
        term.name == pattern.name
        and len(term.arguments) == len(pattern.arguments)
        and all(_meets(a, b, bindings) for a, b in zip(term.arguments, pattern.arguments, strict=True))
    )


def overlap(one: Term, other: Term) -> bool:
    """Whether two patterns can stand for the same term."""
    if isinstance(one, Function) and isinstance(other, Function):
        return one is other or (
            one.name == other.name
            and len(one.arguments) == len(other.arguments)
            and all(map(overlap, one.arguments, other.arguments))
        )
    if ANYTHING in (one, other) or isinstance(one, Operation) or isinstance(other, Operation):
        return True
    return one == other


def _opened(atom: Atom, bindings: Substitution) -> Atom:
    """The pattern of an atom under bindings: what is still a variable becomes `_`."""
    return Function(atom.name, tuple(_open(substitute(argument, bindings)) for argument in atom.arguments))


def _open(term: Term) -> Term:
    match term:
        case Variable() | Operation():
            return ANYTHING
        case Function(name, arguments) if arguments:
            return Function(name, tuple(map(_open, arguments)))
        case _:
            return term
