"""Aggregates over fluents, replaced by derived predicates: one for what is collected, one for whether the value fits.

A rule with the aggregate A becomes a rule with the literal `_fits_n(outer variables)`. The atoms `_collected_n(outer variables,
tuple)` are true where a tuple belongs to the set. Which of them make `_fits_n` true, `cellwright.engine.stages.grounding.diagrams` says when
all atoms have numbers. Aggregates that give a variable its value get one atom for each value that the set may have.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.conditions import (
    Aggregate,
    Body,
    BodyPart,
    Comparison,
    Literal,
    StateAggregate,
    part_variables,
)
from cellwright.kb.model.domain import OBJECT, Domain, Rule
from cellwright.kb.terms import ANYTHING, Atom, Function, Term, Variable, is_ground, variables

TUPLE, COLLECTED, FITS = "_tuple", "_collected_", "_fits_"


@dataclass(frozen=True, slots=True)
class Fitting:
    """The aggregate that the derived predicate of `head` stands for; `collected` is the atom of a tuple in its set."""

    head: Atom
    collected: Atom
    aggregate: StateAggregate
    where: Source


@dataclass(frozen=True, slots=True)
class Expanded:
    """Rules without aggregates over fluents.

    `reach` say which atoms of `fittings` may become true; they are no definitions.
    """

    rules: tuple[Rule, ...]
    reach: tuple[Rule, ...] = ()
    fittings: tuple[Fitting, ...] = ()


def expanded(rules: Iterable[Rule], domain: Domain, is_dynamic: Callable[[str], bool]) -> Expanded:
    """The rules without aggregates over fluents, and the predicates that stand for these. Raises `InvalidInput`."""
    made: list[Rule] = []
    reach: list[Rule] = []
    fittings: list[Fitting] = []
    for rule in rules:
        aggregates = [part for part in rule.body if isinstance(part, StateAggregate)]
        if not aggregates:
            made.append(rule)
            continue
        expansion = _Expansion(rule, domain, is_dynamic)
        for aggregate in _in_order(aggregates, expansion.bound):
            fitting = expansion.replace(aggregate, len(fittings))
            fittings.append(fitting)
            made += expansion.collecting(fitting)
            reach += expansion.reaching(fitting)
            expansion.give(fitting)
        made.append(Rule(rule.head, tuple(expansion.body), rule.where))
    return Expanded(tuple(made), tuple(reach), tuple(fittings))


def _in_order(aggregates: list[StateAggregate], bound: set[Variable]) -> Iterator[StateAggregate]:
    """The aggregates in an order in which each has its outer variables, except for its own value, from the ones before."""
    waiting, known = list(aggregates), set(bound)
    while waiting:
        ready = (each for each in waiting if known.issuperset(set(each.outer) - {_assigned(each, known)}))
        chosen = next(ready, waiting[0])
        waiting.remove(chosen)
        known.update(chosen.outer)
        yield chosen


def _assigned(aggregate: StateAggregate, bound: set[Variable]) -> Variable | None:
    """The variable that takes the value of an aggregate, if there is one."""
    if not aggregate.positive:
        return None
    for relation, term in aggregate.guards:
        if relation == "=" and isinstance(term, Variable) and term not in bound:
            return term
    return None


class _Expansion:
    """One rule whose aggregates are replaced one after another. `bound` are the variables that have values so far."""

    def __init__(self, rule: Rule, domain: Domain, is_dynamic: Callable[[str], bool]) -> None:
        self.rule, self.domain, self.is_dynamic = rule, domain, is_dynamic
        self.body: list[BodyPart] = [p for p in rule.body if not isinstance(p, StateAggregate)]
        self.guard: list[BodyPart] = []
        self.bound: set[Variable] = set()
        self._bind()

    def _bind(self) -> None:
        """Note which variables the plain parts bind, and which parts can be tested by then."""
        for part in self.body:
            if isinstance(part, Literal) and part.positive:
                self.bound.update(v for v in variables(part.atom) if v != ANYTHING)
        while more := {v for part in self.body for v in _solved(part, self.bound)} - self.bound:
            self.bound |= more
        self.guard = [self._reachable(part) for part in self.body if self._is_known(part)]

    def _is_known(self, part: BodyPart) -> bool:
        if isinstance(part, Literal) and not part.positive:
            return not self.is_dynamic(part.atom.name)
        return self.bound.issuperset(v for v in part_variables(part) if v != ANYTHING)

    def _reachable(self, part: BodyPart) -> BodyPart:
        """A condition on what can become true, which is no condition on the state."""
        if isinstance(part, Literal) and self.is_dynamic(part.atom.name):
            return Literal(Function(f"_r_{part.atom.name}", part.atom.arguments))
        return part

    def replace(self, aggregate: StateAggregate, number: int) -> Fitting:
        """The predicates that stand for an aggregate."""
        value = _assigned(aggregate, self.bound)
        inside = {v for each in aggregate.elements for term in each.terms for v in variables(term)}
        inside |= {v for each in aggregate.elements for part in each.body for v in part_variables(part)}
        own = tuple(v for v in aggregate.outer if v in inside and v != value)
        collected = Function(f"{COLLECTED}{number}", (*own, Variable("_Tuple")))
        return Fitting(Function(f"{FITS}{number}", aggregate.outer), collected, aggregate, self.rule.where)

    def give(self, fitting: Fitting) -> None:
        """Put the literal for an aggregate into the body. What it binds is bound from now on."""
        self.body.append(Literal(fitting.head))
        self._bind()

    def collecting(self, fitting: Fitting) -> Iterator[Rule]:
        """The rules for the tuples in the set of an aggregate."""
        for each in fitting.aggregate.elements:
            arguments = (*fitting.collected.arguments[:-1], Function(TUPLE, each.terms))
            head, equations = _without_arithmetic(Function(fitting.collected.name, arguments))
            yield Rule(head, (*self.guard, *each.body, *equations), self.rule.where)

    def reaching(self, fitting: Fitting) -> Iterator[Rule]:
        """The rules for the values that an aggregate may have, or for the instances of its test."""
        value = _assigned(fitting.aggregate, self.bound)
        if value is None:
            yield Rule(fitting.head, tuple(self.guard), self.rule.where)
            return
        bodies = [(each.terms, self._standing(each.body)) for each in fitting.aggregate.elements]
        if fitting.aggregate.function in ("min", "max"):
            for terms, body in bodies:
                equation = Comparison(value, "=", terms[0])
                yield Rule(fitting.head, (*self.guard, *body, equation), self.rule.where)
            return
        texts = [(", ".join(map(str, terms)), terms[0], ", ".join(map(str, body))) for terms, body in bodies]
        if fitting.aggregate.function == "count":
            least, most = "0", f"#count {{ {'; '.join(f'{one} : {body}' for one, _, body in texts)} }}"
        else:
            least, most = (
                f"#sum {{ {'; '.join(f'{one} : {body}, {first} {sign} 0' for one, first, body in texts)} }}"
                for sign in "<>"
            )
        counted = f"_Least = {least}, _Most = {most}, {value} = _Least.._Most"
        yield Rule(fitting.head, (*self.guard, Aggregate(counted, (value,))), self.rule.where)

    def _standing(self, body: Iterable[BodyPart]) -> Body:
        """A body over types and statics that is true wherever the body may become true."""
        found: list[BodyPart] = []
        for part in body:
            if not isinstance(part, Literal) or not self.is_dynamic(part.atom.name):
                found.append(part)
            elif part.positive:
                types = self.domain.predicates[part.atom.name].arguments
                found += (
                    Literal(Function(type_, (term,)))
                    for term, type_ in zip(part.atom.arguments, types, strict=True)
                    if type_ != OBJECT and self.domain.is_subtype(type_, OBJECT) and term != ANYTHING
                )
        self._refuse_unbound(found, body)
        return tuple(found)

    def _refuse_unbound(self, found: list[BodyPart], body: Iterable[BodyPart]) -> None:
        given = {v for p in found if isinstance(p, Literal) and p.positive for v in variables(p.atom)}
        given |= self.bound
        while more := {v for part in found for v in _solved(part, given)} - given:
            given |= more
        lost = [v for part in body for v in part_variables(part) if v not in given and v != ANYTHING]
        if lost:
            message = f"only fluents bind {lost[0]}, so nobody can tell which values this aggregate may have"
            hint = f"bind {lost[0]} by a static in the braces, or compare the aggregate with a number"
            raise InvalidInput([Diagnostic(self.rule.where, "K202", message, hint)])


def _solved(part: BodyPart, bound: set[Variable]) -> Iterator[Variable]:
    """The variables that an equation binds."""
    if isinstance(part, Comparison) and part.relation == "=":
        for one, other in ((part.left, part.right), (part.right, part.left)):
            if isinstance(other, Variable | Function) and bound.issuperset(variables(one)):
                yield from (v for v in variables(other) if v != ANYTHING)


def _without_arithmetic(atom: Atom) -> tuple[Atom, list[Comparison]]:
    """An atom whose last argument has variables in place of computed values, and what these are."""
    *rest, last = atom.arguments
    assert isinstance(last, Function)
    equations: list[Comparison] = []
    terms: list[Term] = []
    for place, term in enumerate(last.arguments):
        if isinstance(term, Variable | Function) or is_ground(term):
            terms.append(term)
            continue
        terms.append(Variable(f"_Computed{place}"))
        equations.append(Comparison(terms[-1], "=", term))
    return Function(atom.name, (*rest, Function(TUPLE, tuple(terms)))), equations
