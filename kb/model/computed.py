"""Gives names to values that are computed inside an atom or a term: `p(N + 1)` becomes `p(V), V = N + 1`.

After that, arithmetic occurs only in comparisons, and the search for bindings can match atoms as they are.
"""

import itertools
from dataclasses import replace

from cellwright.kb.model.conditions import Body, BodyPart, Comparison, Element, Literal, StateAggregate
from cellwright.kb.model.domain import Domain, Rule
from cellwright.kb.terms import Atom, Function, Operation, Term, Variable


def with_named_values(domain: Domain) -> Domain:
    """The same domain, but no body or rule in it computes inside an atom."""
    named = _Naming()
    return replace(
        domain,
        operators=tuple(replace(each, body=named.body(each.body)) for each in domain.operators),
        deductive_operators=tuple(
            replace(
                each,
                body=named.body(each.body),
                consequences=tuple(replace(c, body=named.body(c.body)) for c in each.consequences),
            )
            for each in domain.deductive_operators
        ),
        defaults=tuple(replace(each, body=named.body(each.body)) for each in domain.defaults),
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
        found, self._equations = tuple(self._equations), []
        return (*parts, *found)

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
        found, self._equations = self._equations, outside
        return Element(element.terms, (*plain, *found))

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
