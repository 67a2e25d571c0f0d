"""Conditions that PDDL can express: without compound terms, and with derived predicates unfolded.

A compound term with variables, such as `rack(Tool)`, becomes a variable and a static relation `_is_rack(Tool, V)`.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import networkx as nx

from cellwright.engine.formats.interop.pddl.export.background import Background, Fresh, NotLiftable
from cellwright.engine.formats.interop.pddl.export.equations import Equations
from cellwright.kb.model.bindings import bind
from cellwright.kb.model.conditions import (
    TRUE,
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
    literals,
)
from cellwright.kb.model.domain import OBJECT, Kind, Rule
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Function,
    Operation,
    Term,
    Variable,
    is_ground,
    substitute,
    variables,
)

FALSE = Or(())


@dataclass
class Locals:
    """Variables that stand for compound terms, with the relations that bind them."""

    parameters: list[Parameter] = field(default_factory=list)
    relations: list[Literal] = field(default_factory=list)
    named: dict[Term, Variable] = field(default_factory=dict)


class Conditions:
    """Translates conditions. It notes which functions need a relation and which derived predicates remain."""

    def __init__(self, background: Background) -> None:
        self.background, self.fresh = background, Fresh()
        self.functions: dict[tuple[str, int], None] = {}
        self._rules: dict[str, list[Rule]] = {}
        for rule in background.domain.rules:
            self._rules.setdefault(rule.head.name, []).append(rule)
        self.recursive = frozenset(_recursive(background.domain.rules))

    def flat(self, condition: Condition, outer: Mapping[Term, Variable] = {}) -> Condition:
        """The condition in flat terms. `outer` holds the compound terms that already have a variable."""
        match condition:
            case Literal(atom, positive):
                return self._literal(atom, positive, outer)
            case Comparison(left, relation, right):
                return self._comparison(left, relation, right, outer)
            case Aggregate() | StateAggregate():
                raise NotLiftable(f"the aggregate {condition}")
            case And(parts) | Or(parts):
                join = conjunction if isinstance(condition, And) else disjunction
                return join(self.flat(part, outer) for part in parts)
            case Not(part):
                return negation(self.flat(part, outer))
            case Exists(parameters, part):
                return self.some(parameters, self.flat(part, outer))
            case ForAll(parameters, part):
                return negation(self.some(parameters, negation(self.flat(part, outer))))

    def some(self, parameters: Iterable[Parameter], part: Condition) -> Condition:
        """The condition that `part` holds for some binding. Types that PDDL cannot declare become conditions."""
        parameters = tuple(parameters)
        if part == FALSE or not parameters:
            return part
        guards = [guard for parameter in parameters for guard in self.guards(parameter)]
        return Exists(tuple(map(self.declared, parameters)), conjunction([*guards, part]))

    def declared(self, parameter: Parameter) -> Parameter:
        """The parameter with a type that PDDL can declare."""
        return Parameter(parameter.variable, self.background.plain(parameter.type))

    def guards(self, parameter: Parameter) -> list[Condition]:
        """The conditions that the declared type of a parameter does not express."""
        shared = parameter.type in self.background.shared
        return [Literal(Function(parameter.type, (parameter.variable,)))] if shared else []

    def term(self, term: Term, type_: str, found: Locals, outer: Mapping[Term, Variable]) -> Term:
        """A flat term. New variables and the conditions that bind them are added to `found`."""
        if term == ANYTHING:
            fresh = self.fresh.variable("any")
            found.parameters.append(Parameter(fresh, type_))
            return fresh
        if isinstance(term, Operation):
            raise NotLiftable(f"the arithmetic in {term}")
        if not isinstance(term, Function) or is_ground(term):
            return term
        known = outer.get(term) or found.named.get(term)
        return known or self._named(term, found, outer)

    def _named(self, term: Function, found: Locals, outer: Mapping[Term, Variable]) -> Variable:
        signature = self.background.domain.functions.get(term.name)
        types = signature.arguments if signature else (OBJECT,) * len(term.arguments)
        pairs = zip(term.arguments, types, strict=True)
        arguments = tuple(self.term(argument, type_, found, outer) for argument, type_ in pairs)
        fresh = self.fresh.variable(term.name)
        self.functions[(term.name, len(arguments))] = None
        found.parameters.append(Parameter(fresh, signature.result if signature else OBJECT))
        found.relations.append(Literal(Function(f"_is_{term.name}", (*arguments, fresh))))
        if ANYTHING not in variables(term):
            found.named[term] = fresh
        return fresh

    def atom(self, atom: Atom, found: Locals, outer: Mapping[Term, Variable]) -> Atom:
        """The atom with flat arguments."""
        types = self.background.signature(atom.name) or (OBJECT,) * len(atom.arguments)
        pairs = zip(atom.arguments, types, strict=True)
        return Function(atom.name, tuple(self.term(term, type_, found, outer) for term, type_ in pairs))

    def _literal(self, atom: Atom, positive: bool, outer: Mapping[Term, Variable]) -> Condition:
        found = Locals()
        flat = self.atom(atom, found, outer)
        inner = self.some(found.parameters, conjunction([*found.relations, self.plain(flat)]))
        return inner if positive else negation(inner)

    def plain(self, atom: Atom) -> Condition:
        """A flat atom as a condition: a ground static atom is evaluated; a derived atom is unfolded, unless it is recursive."""
        if self.background.is_static(atom.name) and all(map(is_ground, atom.arguments)):
            return TRUE if atom in self.background.known else FALSE
        if atom.name in self.recursive or atom.name not in self._derived:
            return Literal(atom)
        return disjunction(self.body(rule, atom.arguments) for rule in self._rules.get(atom.name, []))

    def fluents_behind(self, name: str) -> set[str]:
        """The fluents on which a recursive derived predicate depends."""
        reached: set[str] = set()
        waiting = [name] if name in self.recursive else []
        while waiting:
            rules = self._rules.get(waiting.pop(), [])
            used = {each.atom.name for rule in rules for part in rule.body for each in literals(part)}
            waiting += sorted(used - reached)
            reached |= used
        return {each for each in reached if self.background.kinds.get(each) is Kind.FLUENT}

    @property
    def _derived(self) -> frozenset[str]:
        return frozenset(name for name, kind in self.background.kinds.items() if kind is Kind.DERIVED)

    def body(self, rule: Rule, arguments: tuple[Term, ...]) -> Condition:
        """The condition under which a rule makes its head true for flat arguments, with some binding of its other variables."""
        own = {v for term in (rule.head, *_terms(rule.body)) for v in variables(term)} - {ANYTHING}
        apart = {variable: self.fresh.variable(variable.name) for variable in sorted(own, key=str)}
        types = {apart[v]: type_ for v, type_ in self.inferred(rule.body).items() if v in apart}
        equations = Equations()
        head = (substitute(term, apart) for term in rule.head.arguments)
        if not all([equations.add(term, value) for term, value in zip(head, arguments, strict=True)]):
            return FALSE
        parts = [bind(part, apart) for part in rule.body]
        bound = equations.bindings
        condition = And((*map(_as_comparison, equations.open), *parts))
        open_ = [v for v in apart.values() if v not in bound]
        inner = self.flat(bind(condition, bound))
        guards = [
            self.plain(Function(types[v], (value,)))
            for v, value in bound.items()
            if v in types and types[v] in self.background.domain.types and is_ground(value)
        ]
        return self.some([Parameter(v, types.get(v, OBJECT)) for v in open_], conjunction([*guards, inner]))

    def inferred(self, body: Iterable[BodyPart]) -> dict[Variable, str]:
        """The narrowest type that a positive literal gives to each variable."""
        found: dict[Variable, str] = {}
        for part in body:
            if isinstance(part, Literal) and part.positive:
                for variable, type_ in self._positions(part.atom, self.background.signature(part.atom.name)):
                    if variable not in found or self.background.is_subtype(type_, found[variable]):
                        found[variable] = type_
        return found

    def _positions(self, atom: Function, types: tuple[str, ...]) -> Iterator[tuple[Variable, str]]:
        for argument, type_ in zip(atom.arguments, types, strict=False):
            if isinstance(argument, Variable):
                yield argument, type_
            elif isinstance(argument, Function) and argument.name in self.background.domain.functions:
                yield from self._positions(
                    argument, self.background.domain.functions[argument.name].arguments
                )

    def _comparison(
        self, left: Term, relation: str, right: Term, outer: Mapping[Term, Variable]
    ) -> Condition:
        if relation not in ("=", "!="):
            raise NotLiftable(f"the comparison {left} {relation} {right}")
        found = Locals()
        one, other = (self.term(term, OBJECT, found, outer) for term in (left, right))
        if is_ground(one) and is_ground(other):
            return TRUE if (one == other) == (relation == "=") else FALSE
        equal = self.some(found.parameters, conjunction([*found.relations, Comparison(one, "=", other)]))
        return equal if relation == "=" else negation(equal)


def _as_comparison(pair: tuple[Term, Term]) -> Comparison:
    return Comparison(pair[0], "=", pair[1])


def _terms(body: Iterable[BodyPart]) -> Iterator[Term]:
    for part in body:
        match part:
            case Literal(atom):
                yield atom
            case Comparison(left, _, right):
                yield from (left, right)


def _recursive(rules: Iterable[Rule]) -> Iterator[str]:
    graph: nx.DiGraph[str] = nx.DiGraph()
    for rule in rules:
        used = (part.atom.name for part in rule.body if isinstance(part, Literal))
        graph.add_edges_from((rule.head.name, name) for name in used)
    for component in nx.strongly_connected_components(graph):
        if len(component) > 1 or graph.has_edge(*(2 * tuple(component))):
            yield from component


def conjunction(parts: Iterable[Condition]) -> Condition:
    """The conjunction of all parts, without nesting and without parts that are always true."""
    found: dict[Condition, None] = {}
    for part in parts:
        if part == FALSE:
            return FALSE
        found.update(dict.fromkeys(part.parts if isinstance(part, And) else (part,)))
    return next(iter(found)) if len(found) == 1 else And(tuple(found))


def disjunction(parts: Iterable[Condition]) -> Condition:
    """The disjunction of all parts, without nesting and without parts that are never true."""
    found: dict[Condition, None] = {}
    for part in parts:
        if part == TRUE:
            return TRUE
        found.update(dict.fromkeys(part.parts if isinstance(part, Or) else (part,)))
    return next(iter(found)) if len(found) == 1 else Or(tuple(found))


def negation(condition: Condition) -> Condition:
    """The negation of a condition, written with as few `not` as possible."""
    match condition:
        case Literal(atom, positive):
            return Literal(atom, not positive)
        case And(()):
            return FALSE
        case Or(()):
            return TRUE
        case Not(part):
            return part
        case Exists(parameters, Not(part)):
            return ForAll(parameters, part)
        case Exists(parameters, Literal(atom, False)):
            return ForAll(parameters, Literal(atom))
        case _:
            return Not(condition)
