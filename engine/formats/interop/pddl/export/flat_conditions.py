"""Conditions that PDDL can express: without compound terms, derived predicates unfolded."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import networkx as nx

from cellwright.engine.formats.interop.pddl.export.export_statics import (
    Background,
    FreshVariables,
    NotLiftable,
)
from cellwright.kb.model.condition_forms import bind_variables
from cellwright.kb.model.conditions import (
    ALWAYS_TRUE,
    Aggregate,
    And,
    BodyPart,
    Comparison,
    Condition,
    Exists,
    ForAll,
    Literal,
    Not,
    Or,
    Parameter,
    StateAggregate,
    literals_in,
)
from cellwright.kb.model.domain_model import OBJECT_TYPE, Kind, Rule
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Function,
    Operation,
    Term,
    Variable,
    is_ground,
    substitute_term,
    term_variables,
)


@dataclass
class Equations:
    """A pattern matched against terms with variables of their own.

    `bindings` belong to the variables of the pattern. `open` holds the equations that depend on the
    other variables.
    """

    bindings: dict[Variable, Term] = field(default_factory=dict)
    open: list[tuple[Term, Term]] = field(default_factory=list)

    def add(self, pattern: Term, value: Term) -> bool:
        """Add an equation; False if it can never hold."""
        match pattern, value:
            case _ if pattern == ANYTHING or value == ANYTHING:
                return True
            case Variable(), _ if pattern not in self.bindings:
                self.bindings[pattern] = value
                return True
            case Variable(), _:
                return self._equal(self.bindings[pattern], value)
            case Function(name, parts), Function(other, values) if parts or values:
                same = name == other and len(parts) == len(values)
                return same and all([self.add(*pair) for pair in zip(parts, values, strict=True)])
            case _:
                return self._equal(pattern, value)

    def _equal(self, one: Term, other: Term) -> bool:
        if one != other:
            if is_ground(one) and is_ground(other):
                return False
            self.open.append((one, other))
        return True


FALSE_CONDITION = Or(())


@dataclass
class FlatLocals:
    """Variables that stand for compound terms, with the relations that bind them."""

    parameters: list[Parameter] = field(default_factory=list)
    relations: list[Literal] = field(default_factory=list)
    named: dict[Term, Variable] = field(default_factory=dict)


class Conditions:
    """Translates conditions.

    It notes which functions need a relation and which derived predicates remain.
    """

    def __init__(self, background: Background) -> None:
        self.background, self.fresh = background, FreshVariables()
        self.functions: dict[tuple[str, int], None] = {}
        self._rules: dict[str, list[Rule]] = {}
        for rule in background.domain.rules:
            self._rules.setdefault(rule.head.name, []).append(rule)
        self.recursive = frozenset(_recursive_predicates(background.domain.rules))

    def flat(self, condition: Condition, outer: Mapping[Term, Variable] = {}) -> Condition:
        """The condition in flat terms.

        `outer` holds the compound terms that already have a variable.
        """
        match condition:
            case Literal(atom, positive):
                return self._literal(atom, positive, outer)
            case Comparison(left, relation, right):
                return self._comparison(left, relation, right, outer)
            case Aggregate() | StateAggregate():
                raise NotLiftable(f"the aggregate {condition}")
            case And(parts) | Or(parts):
                join = conjoin_conditions if isinstance(condition, And) else disjoin_conditions
                return join(self.flat(part, outer) for part in parts)
            case Not(part):
                return negate_condition(self.flat(part, outer))
            case Exists(parameters, part):
                return self.some(parameters, self.flat(part, _outside(parameters, outer)))
            case ForAll(parameters, part):
                inner = self.flat(part, _outside(parameters, outer))
                return negate_condition(self.some(parameters, negate_condition(inner)))

    def some(self, parameters: Iterable[Parameter], part: Condition) -> Condition:
        """The condition that `part` holds for some binding.

        Types that PDDL cannot declare become conditions.
        """
        parameters = tuple(parameters)
        if part == FALSE_CONDITION or not parameters:
            return part
        guards = [guard for parameter in parameters for guard in self.guards(parameter)]
        return Exists(tuple(map(self.declared, parameters)), conjoin_conditions([*guards, part]))

    def declared(self, parameter: Parameter) -> Parameter:
        """The parameter with a type that PDDL can declare."""
        return Parameter(parameter.variable, self.background.plain(parameter.type))

    def guards(self, parameter: Parameter) -> list[Condition]:
        """The conditions that the declared type of a parameter does not express."""
        shared = parameter.type in self.background.shared
        return [Literal(Function(parameter.type, (parameter.variable,)))] if shared else []

    def term(
        self, term: Term, type_: str, local_terms: FlatLocals, outer: Mapping[Term, Variable]
    ) -> Term:
        """A flat term. New variables and the conditions that bind them are added to `found`."""
        if term == ANYTHING:
            fresh = self.fresh.variable("any")
            local_terms.parameters.append(Parameter(fresh, type_))
            return fresh
        if isinstance(term, Operation):
            raise NotLiftable(f"the arithmetic in {term}")
        if not isinstance(term, Function) or is_ground(term):
            return term
        known = outer.get(term) or local_terms.named.get(term)
        return known or self._named(term, local_terms, outer)

    def _named(
        self, term: Function, local_terms: FlatLocals, outer: Mapping[Term, Variable]
    ) -> Variable:
        signature = self.background.domain.functions.get(term.name)
        types = signature.arguments if signature else (OBJECT_TYPE,) * len(term.arguments)
        pairs = zip(term.arguments, types, strict=True)
        arguments = tuple(
            self.term(argument, type_, local_terms, outer) for argument, type_ in pairs
        )
        fresh = self.fresh.variable(term.name)
        self.functions[(term.name, len(arguments))] = None
        local_terms.parameters.append(
            Parameter(fresh, signature.result if signature else OBJECT_TYPE)
        )
        local_terms.relations.append(Literal(Function(f"_is_{term.name}", (*arguments, fresh))))
        if ANYTHING not in term_variables(term):
            local_terms.named[term] = fresh
        return fresh

    def atom(self, atom: Atom, local_terms: FlatLocals, outer: Mapping[Term, Variable]) -> Atom:
        """The atom with flat arguments."""
        types = self.background.signature(atom.name) or (OBJECT_TYPE,) * len(atom.arguments)
        pairs = zip(atom.arguments, types, strict=True)
        return Function(
            atom.name, tuple(self.term(term, type_, local_terms, outer) for term, type_ in pairs)
        )

    def _literal(self, atom: Atom, positive: bool, outer: Mapping[Term, Variable]) -> Condition:
        local_terms = FlatLocals()
        flat = self.atom(atom, local_terms, outer)
        inner = self.some(
            local_terms.parameters, conjoin_conditions([*local_terms.relations, self.plain(flat)])
        )
        return inner if positive else negate_condition(inner)

    def plain(self, atom: Atom) -> Condition:
        """A flat atom as a condition: a ground static atom is evaluated; a derived atom is
        unfolded, unless it is recursive.
        """
        if self.background.is_static(atom.name) and all(map(is_ground, atom.arguments)):
            return ALWAYS_TRUE if atom in self.background.known else FALSE_CONDITION
        if atom.name in self.recursive or atom.name not in self._derived:
            return Literal(atom)
        return disjoin_conditions(
            self.body(rule, atom.arguments) for rule in self._rules.get(atom.name, [])
        )

    def fluents_behind(self, name: str) -> set[str]:
        """The fluents on which a recursive derived predicate depends."""
        reached: set[str] = set()
        waiting = [name] if name in self.recursive else []
        while waiting:
            rules = self._rules.get(waiting.pop(), [])
            used = {
                part_literal.atom.name
                for rule in rules
                for part in rule.body
                for part_literal in literals_in(part)
            }
            waiting += sorted(used - reached)
            reached |= used
        return {
            predicate
            for predicate in reached
            if self.background.kinds.get(predicate) is Kind.FLUENT
        }

    @property
    def _derived(self) -> frozenset[str]:
        return frozenset(
            name for name, kind in self.background.kinds.items() if kind is Kind.DERIVED
        )

    def body(self, rule: Rule, arguments: tuple[Term, ...]) -> Condition:
        """The condition under which a rule makes its head true for flat arguments, with some
        binding of its other variables.
        """
        own = {v for term in (rule.head, *_body_terms(rule.body)) for v in term_variables(term)} - {
            ANYTHING
        }
        apart = {variable: self.fresh.variable(variable.name) for variable in sorted(own, key=str)}
        types = {apart[v]: type_ for v, type_ in self.inferred(rule.body).items() if v in apart}
        equations = Equations()
        head = (substitute_term(term, apart) for term in rule.head.arguments)
        if not all(
            [equations.add(term, value) for term, value in zip(head, arguments, strict=True)]
        ):
            return FALSE_CONDITION
        parts = [bind_variables(part, apart) for part in rule.body]
        bound = equations.bindings
        condition = And((*map(_as_comparison, equations.open), *parts))
        open_ = [v for v in apart.values() if v not in bound]
        inner = self.flat(bind_variables(condition, bound))
        guards = [
            self.plain(Function(types[v], (value,)))
            for v, value in bound.items()
            if v in types and types[v] in self.background.domain.types and is_ground(value)
        ]
        return self.some(
            [Parameter(v, types.get(v, OBJECT_TYPE)) for v in open_],
            conjoin_conditions([*guards, inner]),
        )

    def inferred(self, body: Iterable[BodyPart]) -> dict[Variable, str]:
        """The narrowest type that a positive literal gives to each variable."""
        types: dict[Variable, str] = {}
        for part in body:
            if isinstance(part, Literal) and part.positive:
                for variable, type_ in self._positions(
                    part.atom, self.background.signature(part.atom.name)
                ):
                    if variable not in types or self.background.is_subtype(type_, types[variable]):
                        types[variable] = type_
        return types

    def _positions(self, atom: Function, types: tuple[str, ...]) -> Iterator[tuple[Variable, str]]:
        for argument, type_ in zip(atom.arguments, types, strict=False):
            if isinstance(argument, Variable):
                yield argument, type_
            elif (
                isinstance(argument, Function) and argument.name in self.background.domain.functions
            ):
                yield from self._positions(
                    argument, self.background.domain.functions[argument.name].arguments
                )

    def _comparison(
        self, left: Term, relation: str, right: Term, outer: Mapping[Term, Variable]
    ) -> Condition:
        if relation not in ("=", "!="):
            raise NotLiftable(f"the comparison {left} {relation} {right}")
        local_terms = FlatLocals()
        first, second = (self.term(term, OBJECT_TYPE, local_terms, outer) for term in (left, right))
        if is_ground(first) and is_ground(second):
            return ALWAYS_TRUE if (first == second) == (relation == "=") else FALSE_CONDITION
        equal = self.some(
            local_terms.parameters,
            conjoin_conditions([*local_terms.relations, Comparison(first, "=", second)]),
        )
        return equal if relation == "=" else negate_condition(equal)


def _outside(
    parameters: Iterable[Parameter], outer: Mapping[Term, Variable]
) -> Mapping[Term, Variable]:
    """The compound terms that mean the same below a quantifier: those without its variables."""
    own = {parameter.variable for parameter in parameters}
    return {
        term: variable for term, variable in outer.items() if own.isdisjoint(term_variables(term))
    }


def _as_comparison(pair: tuple[Term, Term]) -> Comparison:
    return Comparison(pair[0], "=", pair[1])


def _body_terms(body: Iterable[BodyPart]) -> Iterator[Term]:
    for part in body:
        match part:
            case Literal(atom):
                yield atom
            case Comparison(left, _, right):
                yield from (left, right)


def _recursive_predicates(rules: Iterable[Rule]) -> Iterator[str]:
    graph: nx.DiGraph[str] = nx.DiGraph()
    for rule in rules:
        used = (part.atom.name for part in rule.body if isinstance(part, Literal))
        graph.add_edges_from((rule.head.name, name) for name in used)
    for component in nx.strongly_connected_components(graph):
        if len(component) > 1 or graph.has_edge(*(2 * tuple(component))):
            yield from component


def conjoin_conditions(parts: Iterable[Condition]) -> Condition:
    """The conjunction of all parts, without nesting and without parts that are always true."""
    conjuncts: dict[Condition, None] = {}
    for part in parts:
        if part == FALSE_CONDITION:
            return FALSE_CONDITION
        conjuncts.update(dict.fromkeys(part.parts if isinstance(part, And) else (part,)))
    return next(iter(conjuncts)) if len(conjuncts) == 1 else And(tuple(conjuncts))


def disjoin_conditions(parts: Iterable[Condition]) -> Condition:
    """The disjunction of all parts, without nesting and without parts that are never true."""
    disjuncts: dict[Condition, None] = {}
    for part in parts:
        if part == ALWAYS_TRUE:
            return ALWAYS_TRUE
        disjuncts.update(dict.fromkeys(part.parts if isinstance(part, Or) else (part,)))
    return next(iter(disjuncts)) if len(disjuncts) == 1 else Or(tuple(disjuncts))


def negate_condition(condition: Condition) -> Condition:
    """The negation of a condition, written with as few `not` as possible."""
    match condition:
        case Literal(atom, positive):
            return Literal(atom, not positive)
        case And(()):
            return FALSE_CONDITION
        case Or(()):
            return ALWAYS_TRUE
        case Not(part):
            return part
        case Exists(parameters, Not(part)):
            return ForAll(parameters, part)
        case Exists(parameters, Literal(atom, False)):
            return ForAll(parameters, Literal(atom))
        case _:
            return Not(condition)
