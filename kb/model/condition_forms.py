"""Forms of conditions: bound variables, disjunctive normal form, named values.

See Meaning 2 in the language reference.
"""

import itertools
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, field, replace

from cellwright.kb.model.conditions import (
    Aggregate,
    And,
    Body,
    BodyPart,
    Comparison,
    Condition,
    Element,
    Exists,
    ForAll,
    Literal,
    Not,
    Or,
    Parameter,
    StateAggregate,
    part_variables,
    substitute_part,
)
from cellwright.kb.model.domain_model import (
    BUILT_IN_TYPES,
    OBJECT_TYPE,
    UNLISTED_TYPES,
    Domain,
    Rule,
)
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Function,
    Operation,
    Substitution,
    Term,
    Variable,
    term_variables,
)


def free_variables(condition: Condition) -> tuple[Variable, ...]:
    """The variables that no quantifier inside binds, each once, in order of occurrence, without
    `_`.
    """
    return tuple(
        dict.fromkeys(variable for variable in _free_occurrences(condition) if variable != ANYTHING)
    )


def _free_occurrences(condition: Condition) -> Iterator[Variable]:
    match condition:
        case Literal() | Comparison() | Aggregate() | StateAggregate():
            yield from part_variables(condition)
        case And(parts) | Or(parts):
            for part in parts:
                yield from _free_occurrences(part)
        case Not(part):
            yield from _free_occurrences(part)
        case Exists(parameters, part) | ForAll(parameters, part):
            bound = {parameter.variable for parameter in parameters}
            yield from (variable for variable in _free_occurrences(part) if variable not in bound)


def bind_variables(condition: Condition, bindings: Substitution) -> Condition:
    """The condition with free variables replaced.

    A quantified variable hides a binding of the same name.
    """
    match condition:
        case Literal() | Comparison() | Aggregate() | StateAggregate():
            return substitute_part(condition, bindings)
        case And(parts) | Or(parts):
            return type(condition)(tuple(bind_variables(part, bindings) for part in parts))
        case Not(part):
            return Not(bind_variables(part, bindings))
        case Exists(parameters, part) | ForAll(parameters, part):
            return type(condition)(
                parameters, bind_variables(part, _unhidden_bindings(bindings, parameters))
            )


def _unhidden_bindings(
    bindings: Substitution, parameters: tuple[Parameter, ...]
) -> dict[Variable, Term]:
    hidden = {parameter.variable for parameter in parameters}
    return {variable: value for variable, value in bindings.items() if variable not in hidden}


def bound_by_atom(term: Term) -> Iterator[Variable]:
    """The variables that a positive atom binds: those that are not inside arithmetic."""
    match term:
        case Variable():
            yield term
        case Function(_, arguments):
            for argument in arguments:
                yield from bound_by_atom(argument)
        case _:
            return


def enumerable_parameters(parameters: Iterable[Parameter]) -> set[Variable]:
    """The parameters whose type has values that can be enumerated."""
    return {parameter.variable for parameter in parameters if parameter.type not in UNLISTED_TYPES}


def variables_bound_by(bound: Collection[Variable], parts: Iterable[Condition]) -> set[Variable]:
    """`bound`, and the variables that positive atoms, equations and counted sets among `parts`
    bind.
    """
    parts, known_variables = tuple(parts), set(bound)
    for part in parts:
        match part:
            case Literal(atom, True):
                known_variables.update(bound_by_atom(atom))
            case Aggregate(binds=Variable() as counted):
                known_variables.add(counted)
    equations = [part for part in parts if isinstance(part, Comparison) and part.relation == "="]
    while (
        more := {
            variable
            for equation in equations
            for variable in _solved_variables(equation, known_variables)
        }
        - known_variables
    ):
        known_variables |= more
    return known_variables


def _solved_variables(equation: Comparison, bound: set[Variable]) -> Iterator[Variable]:
    for bound_side, solved_side in (
        (equation.left, equation.right),
        (equation.right, equation.left),
    ):
        if bound.issuperset(term_variables(bound_side)):
            yield from bound_by_atom(solved_side)


Disjunct = tuple[BodyPart, ...]
RELATION_NEGATIONS = {"=": "!=", "!=": "=", "<": ">=", ">=": "<", ">": "<=", "<=": ">"}


@dataclass
class Normaliser:
    """Turns conditions into disjuncts, and collects the rules of the new predicates."""

    rules: list[Rule] = field(default_factory=list)
    prefix: str = "_violated"
    _counter: Iterator[int] = field(default_factory=itertools.count)

    def disjuncts(self, condition: Condition, types: dict[Variable, str]) -> list[Disjunct]:
        """The alternatives of `condition`; `types` are those of its free variables."""
        return self._positive(condition, types)

    def _positive(self, condition: Condition, types: dict[Variable, str]) -> list[Disjunct]:
        match condition:
            case And(parts):
                return _combine_choices([self._positive(part, types) for part in parts])
            case Or(parts):
                return [disjunct for part in parts for disjunct in self._positive(part, types)]
            case Not(part):
                return self._negative(part, types)
            case Exists(parameters, part):
                parameters, part = self._renamed_apart(parameters, part)
                inner = {**types, **{p.variable: p.type for p in parameters}}
                guards = tuple(
                    type_literal(p)
                    for p in parameters
                    if p.type not in BUILT_IN_TYPES or p.type == OBJECT_TYPE
                )
                return [(*guards, *disjunct) for disjunct in self._positive(part, inner)]
            case ForAll(parameters, part):
                return [(self._no(Exists(parameters, Not(part)), types),)]
            case _:
                return [(condition,)]

    def _renamed_apart(
        self, parameters: tuple[Parameter, ...], part: Condition
    ) -> tuple[tuple[Parameter, ...], Condition]:
        """The same part with variables that occur nowhere else, because disjuncts join their
        variables.
        """
        fresh = {p.variable: Variable(f"{p.variable}__{next(self._counter)}") for p in parameters}
        return tuple(Parameter(fresh[p.variable], p.type) for p in parameters), bind_variables(
            part, fresh
        )

    def _negative(self, condition: Condition, types: dict[Variable, str]) -> list[Disjunct]:
        match condition:
            case Literal(atom, positive):
                return [(Literal(atom, not positive),)]
            case Comparison(left, relation, right):
                return [(Comparison(left, RELATION_NEGATIONS[relation], right, condition.exact),)]
            case And(parts):
                return [disjunct for part in parts for disjunct in self._negative(part, types)]
            case Or(parts):
                return _combine_choices([self._negative(part, types) for part in parts])
            case Not(part):
                return self._positive(part, types)
            case ForAll(parameters, part):
                return self._positive(Exists(parameters, Not(part)), types)
            case _:
                return [(self._no(condition, types),)]

    def _no(self, condition: Condition, types: dict[Variable, str]) -> Literal:
        """The literal that is true when `condition` is false for the values of its free
        variables.
        """
        parameters = [
            Parameter(variable, types.get(variable, OBJECT_TYPE))
            for variable in free_variables(condition)
        ]
        head = Function(
            f"{self.prefix}_{len(self.rules)}_{len(parameters)}",
            tuple(p.variable for p in parameters),
        )
        guards = tuple(
            type_literal(p)
            for p in parameters
            if p.type not in BUILT_IN_TYPES or p.type == OBJECT_TYPE
        )
        # keeps the name unique while inner conditions are compiled
        self.rules.append(Rule(head, ()))
        own = len(self.rules) - 1
        alternatives = self._positive(condition, types)
        self.rules[own : own + 1] = [Rule(head, (*guards, *body)) for body in alternatives]
        return Literal(head, positive=False)


def _combine_choices(choices: list[list[Disjunct]]) -> list[Disjunct]:
    disjuncts: list[Disjunct] = [()]
    for alternatives in choices:
        disjuncts = [(*before, *after) for before in disjuncts for after in alternatives]
    return disjuncts


def type_literal(parameter: Parameter) -> Literal:
    """`type(Variable)`."""
    return Literal(Function(parameter.type, (parameter.variable,)))


def with_named_values(domain: Domain) -> Domain:
    """The same domain, but no body or rule in it computes inside an atom."""
    named = _Naming()
    return replace(
        domain,
        operators=tuple(
            replace(operator, body=named.body(operator.body)) for operator in domain.operators
        ),
        deductive_operators=tuple(
            replace(
                deductive,
                body=named.body(deductive.body),
                consequences=tuple(
                    replace(c, body=named.body(c.body)) for c in deductive.consequences
                ),
            )
            for deductive in domain.deductive_operators
        ),
        defaults=tuple(
            replace(default, body=named.body(default.body)) for default in domain.defaults
        ),
        rules=tuple(map(named.rule, domain.rules)),
    )


class _Naming:
    """Names computed values. Each gets a variable that is used nowhere else."""

    def __init__(self) -> None:
        self._counter = itertools.count(1)
        self._equations: list[Comparison] = []

    def body(self, body: Body) -> Body:
        """The body without computed values in atoms. Comparisons at its end name the values."""
        parts = tuple(map(self._part, body))
        equations, self._equations = tuple(self._equations), []
        return (*parts, *equations)

    def rule(self, rule: Rule) -> Rule:
        """The rule without computed values in atoms, in its head and in its body."""
        return replace(rule, head=self._atom(rule.head), body=self.body(rule.body))

    def _part(self, part: BodyPart) -> BodyPart:
        match part:
            case Literal(atom, positive):
                return Literal(self._atom(atom), positive)
            case Comparison(left, relation, right):
                return Comparison(self._side(left), relation, self._side(right), part.exact)
            case StateAggregate(elements=elements):
                return replace(part, elements=tuple(map(self._element, elements)))
            case _:
                return part

    def _element(self, element: Element) -> Element:
        """What an aggregate collects; the equations for its computed values are its own."""
        outside, self._equations = self._equations, []
        parts = tuple(map(self._part, element.body))
        plain = tuple(part for part in parts if isinstance(part, Literal | Comparison))
        equations, self._equations = self._equations, outside
        return Element(element.terms, (*plain, *equations))

    def _side(self, term: Term) -> Term:
        return term if isinstance(term, Operation) else self._term(term)

    def _atom(self, atom: Atom) -> Atom:
        return Function(atom.name, tuple(map(self._term, atom.arguments)))

    def _term(self, term: Term) -> Term:
        match term:
            case Operation():
                value = Variable(f"_Value__{next(self._counter)}")
                self._equations.append(Comparison(value, "=", term))
                return value
            case Function(_, arguments) if arguments:
                return self._atom(term)
            case _:
                return term
