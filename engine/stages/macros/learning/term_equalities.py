"""Equalities between terms, collected by unification, and simplification of conditions on terms."""

from collections.abc import Iterable, Mapping

from cellwright.engine.stages.lifted.operator_schemas import NotGeneral
from cellwright.kb.arithmetic import compare_terms
from cellwright.kb.model.conditions import Body, BodyPart, Comparison, substitute_part
from cellwright.kb.terms import Function, Operation, Term, Variable, is_ground, unify


class Equalities:
    """The terms that variables stand for: a unifier that is extended in place."""

    def __init__(self) -> None:
        self.bindings: dict[Variable, Term] = {}
        self._resolved: dict[Variable, Term] = {}  # a cache; cleared when terms become equal

    def join(self, one: Term, other: Term) -> bool:
        """Make two terms equal.

        Returns whether that was new. Raises `NotGeneral` if they cannot be equal.
        """
        one, other = self._root(one), self._root(other)
        if one == other:
            return False
        if isinstance(one, Variable):
            return self._bind(one, other)
        if isinstance(other, Variable):
            return self._bind(other, one)
        if (
            isinstance(one, Function)
            and isinstance(other, Function)
            and (one.name, len(one.arguments)) == (other.name, len(other.arguments))
        ):
            pairs = zip(one.arguments, other.arguments, strict=True)
            return any([self.join(left, right) for left, right in pairs])
        raise NotGeneral(f"{one} cannot be equal to {other}")

    def _bind(self, variable: Variable, term: Term) -> bool:
        self.bindings[variable] = term
        self._resolved.clear()
        return True

    def _root(self, term: Term) -> Term:
        while isinstance(term, Variable) and term in self.bindings:
            term = self.bindings[term]
        return term

    def resolved(self, term: Term) -> Term:
        """The term with every variable replaced by the term that it stands for."""
        if isinstance(term, Variable):
            result = self._resolved.get(term)
            if result is None:
                result = self._resolved[term] = self._followed(self._root(term))
            return result
        return self._followed(term)

    def _followed(self, term: Term) -> Term:
        if isinstance(term, Function) and term.arguments:
            return Function(term.name, tuple(map(self.resolved, term.arguments)))
        if isinstance(term, Operation):
            return Operation(term.operator, self.resolved(term.left), self.resolved(term.right))
        return term

    def part(self, part: BodyPart, variables: Iterable[Variable]) -> BodyPart:
        """A part of a body with these variables resolved."""
        return substitute_part(part, {variable: self.resolved(variable) for variable in variables})


def weakest_equations(pairs: Iterable[tuple[Term, Term]]) -> dict[Variable, Term] | None:
    """The weakest equations that make all pairs equal; None if there are none.

    No variable that an equation binds occurs on a right side.
    """
    bindings: dict[Variable, Term] | None = {}
    for left, right in pairs:
        bindings = unify(left, right, bindings) if bindings is not None else None
    if bindings is None:
        return None
    return {variable: _follow_bindings(variable, bindings) for variable in bindings}


def _follow_bindings(term: Term, bindings: Mapping[Variable, Term]) -> Term:
    while isinstance(term, Variable) and term in bindings:
        term = bindings[term]
    if isinstance(term, Function) and term.arguments:
        return Function(
            term.name, tuple(_follow_bindings(argument, bindings) for argument in term.arguments)
        )
    return term


def comparison_truth(part: BodyPart) -> bool | None:
    """Whether a comparison is true or false, if that does not depend on its variables; None if
    it does.
    """
    if not isinstance(part, Comparison):
        return None
    if part.relation not in ("=", "!="):
        ground = is_ground(part.left) and is_ground(part.right)
        return compare_terms(part.left, part.relation, part.right) if ground else None
    same = _same_terms(part.left, part.right)
    return None if same is None else same == (part.relation == "=")


def _same_terms(left: Term, right: Term) -> bool | None:
    if left == right:
        return True
    if is_ground(left) and is_ground(right):
        return compare_terms(left, "=", right)
    if isinstance(left, Operation) or isinstance(right, Operation):
        return None
    return None if unify(left, right, {}) is not None else False


def make_disequality(left: Term, right: Term) -> Comparison:
    """`left != right`. If compound terms differ in only one argument, the comparison is of this
    argument.
    """
    while (
        isinstance(left, Function)
        and isinstance(right, Function)
        and left.name == right.name
        and len(left.arguments) == len(right.arguments)
    ):
        open_pairs = [
            (a, b) for a, b in zip(left.arguments, right.arguments, strict=True) if a != b
        ]
        if len(open_pairs) != 1:
            break
        left, right = open_pairs[0]
    return (
        Comparison(left, "!=", right) if str(left) <= str(right) else Comparison(right, "!=", left)
    )


def simplify_body(body: Body) -> Body | None:
    """The parts of a body that are not always true; None if one is always false."""
    kept_parts: list[BodyPart] = []
    for part in body:
        truth = comparison_truth(part)
        if truth is False:
            return None
        if truth is None:
            kept_parts.append(part)
    return tuple(dict.fromkeys(kept_parts))
