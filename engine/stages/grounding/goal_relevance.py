"""Goal relevance: what the goals can need, found backwards over operators with variables.

A pattern is an atom in which `_` stands for anything. A pattern is relevant if making it true, or
false, may help to reach a goal. Patterns only say what may be needed: they leave out types and
static conditions, and so never too much.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property

from cellwright.engine.stages.grounding.grounding_program import (
    ChangingPredicates,
    Conditional,
    Schema,
    conditional_alternatives,
    precondition_schemas,
)
from cellwright.kb.model.condition_forms import Normaliser
from cellwright.kb.model.conditions import (
    BodyPart,
    Literal,
    StateAggregate,
    goal_parts,
    literals_in,
)
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Function,
    Operation,
    Substitution,
    Term,
    Variable,
    stage_parts,
    substitute_term,
)

MAX_RELEVANT_PATTERNS = 400  # patterns; with more of them, all objects in them are left open


@dataclass(frozen=True, slots=True)
class WantedPattern:
    """A pattern that should be made true, or false."""

    pattern: Atom
    positive: bool = True


@dataclass
class GoalRelevance:
    """The relevant patterns, the bindings under which each operator is relevant, and the static
    conditions that are read.

    `bindings` are by the name of the operator. A variable that is not bound may have any value.
    """

    wanted: dict[WantedPattern, None] = field(default_factory=dict)
    bindings: dict[str, dict[tuple[Term, ...], None]] = field(default_factory=dict)
    statics: dict[Atom, None] = field(default_factory=dict)

    @cached_property
    def _by_name(self) -> Mapping[str, list[Atom]]:
        return _group_by_name(wanted_pattern.pattern for wanted_pattern in self.wanted)

    @cached_property
    def _statics_by_name(self) -> Mapping[str, list[Atom]]:
        return _group_by_name(self.statics)

    def concerns(self, atom: Atom) -> bool:
        """Whether it matters if a fluent is true."""
        return any(patterns_overlap(pattern, atom) for pattern in self._by_name.get(atom.name, ()))

    def reads(self, fact: Atom) -> bool:
        """Whether a static condition of a relevant operator can ask for a fact."""
        return any(
            patterns_overlap(pattern, fact) for pattern in self._statics_by_name.get(fact.name, ())
        )

    @property
    def static_predicates(self) -> set[tuple[str, int]]:
        """The name and arity of every static predicate that is read."""
        return {(pattern.name, len(pattern.arguments)) for pattern in self.statics}


def find_relevance(problem: Problem) -> GoalRelevance:
    """What the goals and the workflow of a problem can need."""
    result = _RelevanceSearch(problem, blurred=False).run()
    return (
        result
        if len(result.wanted) <= MAX_RELEVANT_PATTERNS
        else _RelevanceSearch(problem, blurred=True).run()
    )


class _RelevanceSearch:
    """A search backwards from the goals.

    If it is `blurred`, patterns have `_` in the place of every argument.
    """

    def __init__(self, problem: Problem, blurred: bool) -> None:
        self.problem, self.domain, self.blurred = problem, problem.domain, blurred
        normaliser, self.vocabulary = Normaliser(), ChangingPredicates(problem.domain)
        self.schemas: list[Schema] = list(
            precondition_schemas(self.domain, normaliser, self.vocabulary)
        )
        self.conditionals: list[Conditional] = list(
            conditional_alternatives(self.domain, normaliser, self.vocabulary)
        )
        self.goals = [
            d for part in goal_parts(problem.goal) for d in normaliser.disjuncts(part, {})
        ]
        self.rules = [*self.domain.rules, *normaliser.rules]
        self.vocabulary = ChangingPredicates(self.domain, normaliser.rules)
        self.found, self.waiting = GoalRelevance(), list[WantedPattern]()

    def run(self) -> GoalRelevance:
        for disjunct in self.goals:
            self._need(disjunct, {})
        for chain in self.problem.chains:
            for stage in (
                part for chain_stage in chain.stages for part in stage_parts(chain_stage)
            ):
                self._want(WantedPattern(_open_pattern(stage, {}), positive=True))
        while self.waiting and (self.blurred or len(self.found.wanted) <= MAX_RELEVANT_PATTERNS):
            self._supply(self.waiting.pop())
        return self.found

    def _want(self, wanted: WantedPattern) -> None:
        if self.blurred:
            pattern = Function(wanted.pattern.name, (ANYTHING,) * len(wanted.pattern.arguments))
            wanted = WantedPattern(pattern, wanted.positive)
        if wanted not in self.found.wanted:
            self.found.wanted[wanted] = None
            self.waiting.append(wanted)

    def _need(
        self, body: Iterable[BodyPart], bindings: Substitution, flipped: bool = False
    ) -> None:
        """Want all dynamic literals of a body, and note its static ones."""
        for part in body:
            if isinstance(part, StateAggregate):
                for literal in literals_in(part):
                    for sign in (True, False):
                        self._need((Literal(literal.atom, sign),), bindings)
            if not isinstance(part, Literal):
                continue
            pattern = _open_pattern(part.atom, bindings)
            if not self.vocabulary.is_dynamic(part.atom.name):
                self.found.statics[pattern] = None
            else:
                self._want(WantedPattern(pattern, part.positive is not flipped))

    def _supply(self, wanted: WantedPattern) -> None:
        """Note everything that may make a wanted pattern true, or false."""
        for schema in self.schemas:
            for effect in schema.operator.effects:
                if (
                    effect.adds is wanted.positive
                    and (b := match_pattern(effect.atom, wanted.pattern)) is not None
                ):
                    self._use(schema, b)
        self._deduce(wanted)
        for rule in self.rules:
            if (bindings := match_pattern(rule.head, wanted.pattern)) is not None:
                self._need(rule.body, bindings, flipped=not wanted.positive)

    def _deduce(self, wanted: WantedPattern) -> None:
        for deductive in self.domain.deductive_operators:
            for consequence in deductive.consequences:
                if consequence.implied is not wanted.positive:
                    continue
                bindings = match_pattern(consequence.atom, wanted.pattern)
                if bindings is not None:
                    self._need((deductive.trigger, *deductive.body, *consequence.body), bindings)

    def _use(self, schema: Schema, bindings: Substitution) -> None:
        operator = schema.operator
        own = {v: value for v, value in bindings.items() if v in schema.variables}
        key = tuple(ANYTHING if self.blurred else own.get(v, ANYTHING) for v in operator.variables)
        self.found.bindings.setdefault(operator.name, {})[key] = None
        self._need((*schema.literals, *schema.static), own)
        for conditional in self.conditionals:
            if conditional.operator is operator:
                self._need((*conditional.literals, *conditional.static), own)
        for name, arity in amount_predicates(self.domain, schema):
            self.found.statics[Function(name, (ANYTHING,) * arity)] = None


def amount_predicates(domain: Domain, schema: Schema) -> Iterator[tuple[str, int]]:
    """The static predicates that the duration and the cost of an operator name, with their arities,
    except for travel.

    Travel ties all places to one another, and changes no plan but only how long it lasts.
    """
    for term in schema.operator.amounts:
        for part in _term_functions(term):
            if part.name in domain.predicates and part.name != domain.conventions.travel:
                yield part.name, len(domain.predicates[part.name].arguments)


def _term_functions(term: Term | None) -> Iterator[Function]:
    match term:
        case Operation(_, left, right):
            yield from _term_functions(left)
            yield from _term_functions(right)
        case Function(_, arguments):
            yield term
            for argument in arguments:
                yield from _term_functions(argument)
        case _:
            return


def _group_by_name(atoms: Iterable[Atom]) -> dict[str, list[Atom]]:
    atoms_by_name: dict[str, list[Atom]] = {}
    for atom in atoms:
        atoms_by_name.setdefault(atom.name, []).append(atom)
    return atoms_by_name


def match_pattern(term: Term, pattern: Term) -> dict[Variable, Term] | None:
    """The bindings under which a term with variables is among what a pattern stands for; None if it
    never is.

    Where they are too hard to tell, a variable stays free.
    """
    bindings: dict[Variable, Term] = {}
    return bindings if _extend_bindings(term, pattern, bindings) else None


def _extend_bindings(term: Term, pattern: Term, bindings: dict[Variable, Term]) -> bool:
    if pattern == ANYTHING or term == ANYTHING or isinstance(term, Operation):
        return True
    if isinstance(term, Variable):
        return patterns_overlap(bindings.setdefault(term, pattern), pattern)
    if not isinstance(term, Function) or not isinstance(pattern, Function):
        return term == pattern
    return (
        term.name == pattern.name
        and len(term.arguments) == len(pattern.arguments)
        and all(
            _extend_bindings(a, b, bindings)
            for a, b in zip(term.arguments, pattern.arguments, strict=True)
        )
    )


def patterns_overlap(first: Term, second: Term) -> bool:
    """Whether two patterns can stand for the same term."""
    if isinstance(first, Function) and isinstance(second, Function):
        return first is second or (
            first.name == second.name
            and len(first.arguments) == len(second.arguments)
            and all(map(patterns_overlap, first.arguments, second.arguments))
        )
    if ANYTHING in (first, second) or isinstance(first, Operation) or isinstance(second, Operation):
        return True
    return first == second


def _open_pattern(atom: Atom, bindings: Substitution) -> Atom:
    """The pattern of an atom under bindings: what is still a variable becomes `_`."""
    return Function(
        atom.name,
        tuple(_open_term(substitute_term(argument, bindings)) for argument in atom.arguments),
    )


def _open_term(term: Term) -> Term:
    match term:
        case Variable() | Operation():
            return ANYTHING
        case Function(name, arguments) if arguments:
            return Function(name, tuple(map(_open_term, arguments)))
        case _:
            return term
