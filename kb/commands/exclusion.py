"""Mutual exclusion of conditions, read from the domain, so that acts about one thing are joined.

Read from the deductive operators and from what operators delete, without grounding. A constraint
over statics that names no object left open is looked up among the facts; what only a rule defines
counts as false. So acts are joined only where one surely undoes the other.
"""

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from cellwright.kb.arithmetic import compare_terms
from cellwright.kb.model.conditions import And, Body, Comparison, Condition, Literal, Parameter
from cellwright.kb.model.domain_model import DeductiveOperator, Domain, Operator
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Function,
    Substitution,
    Term,
    Variable,
    is_ground,
    resolve_term,
    substitute_term,
    unify,
)

SOME_OBJECT = "_some_"  # begins the name of an object that stands for `_`
MAX_FOLLOWED_CONSEQUENCES = 200  # consequences that are followed for one atom


@dataclass(frozen=True, slots=True)
class _Pattern:
    """Atoms that an act makes true or false.

    A variable stands for anything that the comparisons allow.
    """

    atom: Atom
    where: tuple[Comparison, ...] = ()

    def allows(self, bindings: Substitution) -> bool:
        """Whether the comparisons may hold under bindings."""
        return all(_may_hold(comparison, bindings) for comparison in self.where)


class Exclusion:
    """Answers whether two conditions can hold together.

    `objects` maps names to types; `facts` are those of the problem.
    """

    def __init__(self, domain: Domain, objects: Mapping[str, str], facts: Iterable[Atom]) -> None:
        self.domain, self.objects = domain, objects
        stated = (statement.head for statement in domain.asp if not statement.body)
        self.facts = {
            *map(str, facts),
            *(head.replace(",", ", ").replace(",  ", ", ") for head in stated),
        }
        self._numbers = itertools.count()
        self._reach: dict[str, frozenset[str]] = {}

    def apart(self, one: Literal, other: Literal) -> bool:
        """Whether the two cannot hold together."""
        if not one.positive or not other.positive:
            return (
                one.positive != other.positive
                and unify(self._open(one.atom), self._open(other.atom), {}) is not None
            )
        if other.atom.name not in self._near(one.atom.name) and one.atom.name not in self._near(
            other.atom.name
        ):
            return False
        first, second = self._open(one.atom), self._open(other.atom)
        return self._undone(first, second) or self._undone(second, first)

    def interrupted(self, one: Literal, other: Literal) -> bool:
        """Whether the first cannot hold when the other becomes true: every operator that makes
        it true needs what excludes it.
        """
        if not one.positive or not other.positive:
            return False
        first, second = self._open(one.atom), self._open(other.atom)
        needs = [
            atoms for operator in self.domain.operators for atoms in self._needs(operator, second)
        ]
        return bool(needs) and all(
            any(
                self._undone(first, need) or self._undone(need, first)
                for need in atoms
                if _is_sure(need)
            )
            for atoms in needs
        )

    def _needs(self, operator: Operator, made: Atom) -> Iterator[list[Atom]]:
        """What an operator needs when it adds an atom, once for each effect that adds it."""
        rename = self._renaming(operator.variables)
        conditions = [
            literal.atom for literal in _needed_literals(operator.precondition) if literal.positive
        ]
        for effect in operator.effects:
            bindings = unify(_rename_atom(effect.atom, rename), made, {}) if effect.adds else None
            if bindings is not None and self._typed(operator.parameters, rename, bindings):
                yield [
                    _as_atom(resolve_term(_rename_atom(condition, rename), bindings))
                    for condition in conditions
                ]

    def _near(self, name: str) -> frozenset[str]:
        """The predicates that a change of one can change, directly or by deduction."""
        if name not in self._reach:
            reached, waiting = {name}, [name]
            while waiting:
                last = waiting.pop()
                following = [c.atom.name for d in self._triggered(last) for c in d.consequences]
                if last == name:
                    following += [
                        e.atom.name
                        for o in self.domain.operators
                        for e in o.effects
                        if _adds_predicate(o, name)
                    ]
                waiting += [
                    predicate for predicate in dict.fromkeys(following) if predicate not in reached
                ]
                reached.update(following)
            self._reach[name] = frozenset(reached)
        return self._reach[name]

    def _triggered(self, name: str) -> list[DeductiveOperator]:
        return [
            deductive_operator
            for deductive_operator in self.domain.deductive_operators
            if deductive_operator.trigger.atom.name == name
        ]

    def _undone(self, made: Atom, other: Atom) -> bool:
        """Whether making one atom true makes the other false, whatever operator does it."""
        if self._denied([_Pattern(made)], [], other):
            return True
        makers = [
            effect for operator in self.domain.operators for effect in self._effects(operator, made)
        ]
        return bool(makers) and all(self._denied(adds, deletes, other) for adds, deletes in makers)

    def _effects(
        self, operator: Operator, made: Atom
    ) -> Iterator[tuple[list[_Pattern], list[_Pattern]]]:
        """What an operator that adds an atom also adds and surely deletes."""
        rename = self._renaming(operator.variables)
        always = [effect for effect in operator.effects if effect.condition == And(())]
        needed = [
            literal.atom for literal in _needed_literals(operator.precondition) if literal.positive
        ]
        for effect in always:
            if not effect.adds:
                continue
            bindings = unify(_rename_atom(effect.atom, rename), made, {})
            if bindings is not None and self._typed(operator.parameters, rename, bindings):
                adds = [e.atom for e in always if e.adds]
                deletes = [
                    e.atom for e in always if not e.adds and (e.atom in needed or not e.parameters)
                ]
                patterns = (
                    [
                        _Pattern(_as_atom(resolve_term(_rename_atom(a, rename), bindings)))
                        for a in atoms
                    ]
                    for atoms in (adds, deletes)
                )
                yield next(patterns), next(patterns)

    def _denied(self, adds: Sequence[_Pattern], deletes: Sequence[_Pattern], other: Atom) -> bool:
        """Whether the adds and deletes, with all that follows from them, make an atom false."""
        waiting = [*((added, True) for added in adds), *((deleted, False) for deleted in deletes)]
        seen: set[tuple[_Pattern, bool]] = set()
        while waiting and len(seen) < MAX_FOLLOWED_CONSEQUENCES:
            pattern, positive = waiting.pop(0)
            if (pattern, positive) in seen:
                continue
            seen.add((pattern, positive))
            if not positive:
                bindings = unify(pattern.atom, other, {})
                if bindings is not None and pattern.allows(bindings):
                    return True
            waiting += self._following(pattern, positive)
        return False

    def _following(self, pattern: _Pattern, positive: bool) -> Iterator[tuple[_Pattern, bool]]:
        """What the deductive operators make of an atom that is added or denied."""
        for deductive_operator in self.domain.deductive_operators:
            if (
                deductive_operator.trigger.positive != positive
                or deductive_operator.trigger.atom.name != pattern.atom.name
            ):
                continue
            own = [
                p.variable
                for consequence in deductive_operator.consequences
                for p in consequence.parameters
            ]
            rename = self._renaming([*(p.variable for p in deductive_operator.parameters), *own])
            bindings = unify(
                _rename_atom(deductive_operator.trigger.atom, rename), pattern.atom, {}
            )
            if bindings is None or not pattern.allows(bindings):
                continue
            if not self._typed(deductive_operator.parameters, rename, bindings) or not self._holds(
                deductive_operator.body, rename, bindings
            ):
                continue
            for consequence in deductive_operator.consequences:
                if self._holds(consequence.body, rename, bindings):
                    atom = _as_atom(resolve_term(_rename_atom(consequence.atom, rename), bindings))
                    where = _open_comparisons(
                        [*deductive_operator.body, *consequence.body], rename, bindings
                    )
                    yield _Pattern(atom, where), consequence.implied

    def _holds(self, body: Body, rename: Substitution, bindings: Substitution) -> bool:
        """Whether a body may hold. An atom without open variables must be a fact."""
        for part in body:
            if isinstance(part, Comparison):
                if not _may_hold(_rename_comparison(part, rename), bindings):
                    return False
            elif isinstance(part, Literal):
                atom = resolve_term(_rename_atom(part.atom, rename), bindings)
                if (
                    is_ground(atom)
                    and (str(atom) in self.facts or self._has_type(atom)) != part.positive
                ):
                    return False
            else:
                return False
        return True

    def _has_type(self, atom: Term) -> bool:
        """Whether an atom such as `laser(slra)` says a type that its object has."""
        if (
            not isinstance(atom, Function)
            or atom.name not in self.domain.types
            or len(atom.arguments) != 1
        ):
            return False
        return self._is(atom.arguments[0], atom.name)

    def _typed(
        self, parameters: Iterable[Parameter], rename: Substitution, bindings: Substitution
    ) -> bool:
        """Whether the bound parameters are of their types."""
        bound = (
            (resolve_term(substitute_term(p.variable, rename), bindings), p.type)
            for p in parameters
        )
        return all(self._is(term, type_) for term, type_ in bound if isinstance(term, Function))

    def _is(self, term: Term, type_: str) -> bool:
        if not isinstance(term, Function):
            return True
        if term.name in self.domain.functions:
            return self.domain.is_subtype(self.domain.functions[term.name].result, type_)
        own = self.objects.get(term.name) or next(
            (
                declared.name
                for declared in self.domain.types.values()
                if term.name in declared.constants
            ),
            "",
        )
        return not own or self.domain.is_subtype(own, type_)

    def _open(self, atom: Atom) -> Atom:
        """The atom with an object for each `_`: the only one of its type, or one that may be
        any, but is no other.
        """
        types = (
            self.domain.predicates[atom.name].arguments
            if atom.name in self.domain.predicates
            else ()
        )
        return Function(
            atom.name, tuple(self._opened(a, t) for a, t in zip(atom.arguments, types, strict=True))
        )

    def _opened(self, term: Term, type_: str) -> Term:
        if term == ANYTHING:
            candidates = [
                name for name, own in self.objects.items() if self.domain.is_subtype(own, type_)
            ]
            return Function(
                candidates[0] if len(candidates) == 1 else f"{SOME_OBJECT}{next(self._numbers)}"
            )
        if isinstance(term, Function) and term.name in self.domain.functions:
            types = self.domain.functions[term.name].arguments
            return Function(
                term.name,
                tuple(self._opened(a, t) for a, t in zip(term.arguments, types, strict=True)),
            )
        return term

    def _renaming(self, variables: Iterable[Variable]) -> dict[Variable, Term]:
        number = next(self._numbers)
        return {variable: Variable(f"{variable.name}_{number}") for variable in variables}


def _is_sure(atom: Atom) -> bool:
    """Whether an atom names all its objects."""
    return is_ground(atom) and SOME_OBJECT not in str(atom)


def _adds_predicate(operator: Operator, name: str) -> bool:
    return any(effect.adds and effect.atom.name == name for effect in operator.effects)


def _rename_atom(atom: Atom, rename: Substitution) -> Atom:
    return _as_atom(substitute_term(atom, rename))


def _as_atom(term: Term) -> Atom:
    assert isinstance(term, Function)
    return term


def _rename_comparison(part: Comparison, rename: Substitution) -> Comparison:
    return Comparison(
        substitute_term(part.left, rename), part.relation, substitute_term(part.right, rename)
    )


def _open_comparisons(
    body: Body | Sequence[object], rename: Substitution, bindings: Substitution
) -> tuple[Comparison, ...]:
    """The comparisons of a body that bindings leave open."""
    renamed = (_rename_comparison(part, rename) for part in body if isinstance(part, Comparison))
    resolved = (
        Comparison(resolve_term(e.left, bindings), e.relation, resolve_term(e.right, bindings))
        for e in renamed
    )
    return tuple(
        comparison
        for comparison in resolved
        if not (is_ground(comparison.left) and is_ground(comparison.right))
    )


def _may_hold(part: Comparison, bindings: Substitution) -> bool:
    left, right = resolve_term(part.left, bindings), resolve_term(part.right, bindings)
    if SOME_OBJECT in str(left) or SOME_OBJECT in str(right):
        return False  # it may be the other one
    return not (is_ground(left) and is_ground(right)) or compare_terms(left, part.relation, right)


def _needed_literals(condition: Condition) -> Iterator[Literal]:
    """The literals that a condition needs."""
    match condition:
        case Literal():
            yield condition
        case And(parts):
            for part in parts:
                yield from _needed_literals(part)
        case _:
            return
