"""Which conditions of a domain cannot hold together, so that acts that ask for both are about one thing.

Read from the deductive operators and from what operators delete, without grounding. A constraint over statics that names no
object left open is looked up among the facts; what only a rule defines counts as false. So acts are joined only where one
surely undoes the other.
"""

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from cellwright.kb.arithmetic import compare
from cellwright.kb.model.conditions import And, Body, Comparison, Condition, Literal, Parameter
from cellwright.kb.model.domain import DeductiveOperator, Domain, Operator
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Function,
    Substitution,
    Term,
    Variable,
    is_ground,
    resolve,
    substitute,
    unify,
)

SOME = "_some_"  # begins the name of an object that stands for `_`
MOST = 200  # consequences that are followed for one atom


@dataclass(frozen=True, slots=True)
class _Pattern:
    """Atoms that an act makes true or false. A variable stands for anything that the comparisons allow."""

    atom: Atom
    where: tuple[Comparison, ...] = ()

    def allows(self, bindings: Substitution) -> bool:
        """Whether the comparisons may hold under bindings."""
        return all(_may_hold(each, bindings) for each in self.where)


class Exclusion:
    """Answers whether two conditions can hold together. `objects` maps names to types; `facts` are those of the problem."""

    def __init__(self, domain: Domain, objects: Mapping[str, str], facts: Iterable[Atom]) -> None:
        self.domain, self.objects = domain, objects
        stated = (statement.head for statement in domain.asp if not statement.body)
        self.facts = {*map(str, facts), *(head.replace(",", ", ").replace(",  ", ", ") for head in stated)}
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
        """Whether the first cannot hold when the other becomes true: every operator that makes it true needs what excludes it."""
        if not one.positive or not other.positive:
            return False
        first, second = self._open(one.atom), self._open(other.atom)
        needs = [each for operator in self.domain.operators for each in self._needs(operator, second)]
        return bool(needs) and all(
            any(self._undone(first, need) or self._undone(need, first) for need in each if _is_sure(need))
            for each in needs
        )

    def _needs(self, operator: Operator, made: Atom) -> Iterator[list[Atom]]:
        """What an operator needs when it adds an atom, once for each effect that adds it."""
        rename = self._renaming(operator.variables)
        conditions = [each.atom for each in _literals(operator.precondition) if each.positive]
        for effect in operator.effects:
            bindings = unify(_renamed(effect.atom, rename), made, {}) if effect.adds else None
            if bindings is not None and self._typed(operator.parameters, rename, bindings):
                yield [_atom(resolve(_renamed(each, rename), bindings)) for each in conditions]

    def _near(self, name: str) -> frozenset[str]:
        """The predicates that a change of one can change, directly or by deduction."""
        if name not in self._reach:
            found, waiting = {name}, [name]
            while waiting:
                last = waiting.pop()
                following = [c.atom.name for d in self._triggered(last) for c in d.consequences]
                if last == name:
                    following += [
                        e.atom.name for o in self.domain.operators for e in o.effects if _adds(o, name)
                    ]
                waiting += [each for each in dict.fromkeys(following) if each not in found]
                found.update(following)
            self._reach[name] = frozenset(found)
        return self._reach[name]

    def _triggered(self, name: str) -> list[DeductiveOperator]:
        return [each for each in self.domain.deductive_operators if each.trigger.atom.name == name]

    def _undone(self, made: Atom, other: Atom) -> bool:
        """Whether making one atom true makes the other false, whatever operator does it."""
        if self._denied([_Pattern(made)], [], other):
            return True
        makers = [each for operator in self.domain.operators for each in self._effects(operator, made)]
        return bool(makers) and all(self._denied(adds, deletes, other) for adds, deletes in makers)

    def _effects(self, operator: Operator, made: Atom) -> Iterator[tuple[list[_Pattern], list[_Pattern]]]:
        """What an operator that adds an atom also adds and surely deletes."""
        rename = self._renaming(operator.variables)
        always = [effect for effect in operator.effects if effect.condition == And(())]
        needed = [each.atom for each in _literals(operator.precondition) if each.positive]
        for effect in always:
            if not effect.adds:
                continue
            bindings = unify(_renamed(effect.atom, rename), made, {})
            if bindings is not None and self._typed(operator.parameters, rename, bindings):
                adds = [e.atom for e in always if e.adds]
                deletes = [e.atom for e in always if not e.adds and (e.atom in needed or not e.parameters)]
                found = (
                    [_Pattern(_atom(resolve(_renamed(a, rename), bindings))) for a in atoms]
                    for atoms in (adds, deletes)
                )
                yield next(found), next(found)

    def _denied(self, adds: Sequence[_Pattern], deletes: Sequence[_Pattern], other: Atom) -> bool:
        """Whether the adds and deletes, with all that follows from them, make an atom false."""
        waiting = [*((each, True) for each in adds), *((each, False) for each in deletes)]
        seen: set[tuple[_Pattern, bool]] = set()
        while waiting and len(seen) < MOST:
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
        for each in self.domain.deductive_operators:
            if each.trigger.positive != positive or each.trigger.atom.name != pattern.atom.name:
                continue
            own = [p.variable for consequence in each.consequences for p in consequence.parameters]
            rename = self._renaming([*(p.variable for p in each.parameters), *own])
            bindings = unify(_renamed(each.trigger.atom, rename), pattern.atom, {})
            if bindings is None or not pattern.allows(bindings):
                continue
            if not self._typed(each.parameters, rename, bindings) or not self._holds(
                each.body, rename, bindings
            ):
                continue
            for consequence in each.consequences:
                if self._holds(consequence.body, rename, bindings):
                    atom = _atom(resolve(_renamed(consequence.atom, rename), bindings))
                    where = _comparisons([*each.body, *consequence.body], rename, bindings)
                    yield _Pattern(atom, where), consequence.implied

    def _holds(self, body: Body, rename: Substitution, bindings: Substitution) -> bool:
        """Whether a body may hold. An atom without open variables must be a fact."""
        for part in body:
            if isinstance(part, Comparison):
                if not _may_hold(_compared(part, rename), bindings):
                    return False
            elif isinstance(part, Literal):
                atom = resolve(_renamed(part.atom, rename), bindings)
                if is_ground(atom) and (str(atom) in self.facts or self._has_type(atom)) != part.positive:
                    return False
            else:
                return False
        return True

    def _has_type(self, atom: Term) -> bool:
        """Whether an atom such as `laser(slra)` says a type that its object has."""
        if not isinstance(atom, Function) or atom.name not in self.domain.types or len(atom.arguments) != 1:
            return False
        return self._is(atom.arguments[0], atom.name)

    def _typed(self, parameters: Iterable[Parameter], rename: Substitution, bindings: Substitution) -> bool:
        """Whether the bound parameters are of their types."""
        bound = ((resolve(substitute(p.variable, rename), bindings), p.type) for p in parameters)
        return all(self._is(term, type_) for term, type_ in bound if isinstance(term, Function))

    def _is(self, term: Term, type_: str) -> bool:
        if not isinstance(term, Function):
            return True
        if term.name in self.domain.functions:
            return self.domain.is_subtype(self.domain.functions[term.name].result, type_)
        own = self.objects.get(term.name) or next(
            (each.name for each in self.domain.types.values() if term.name in each.constants), ""
        )
        return not own or self.domain.is_subtype(own, type_)

    def _open(self, atom: Atom) -> Atom:
        """The atom with an object for each `_`: the only one of its type, or one that may be any, but is no other."""
        types = self.domain.predicates[atom.name].arguments if atom.name in self.domain.predicates else ()
        return Function(
            atom.name, tuple(self._opened(a, t) for a, t in zip(atom.arguments, types, strict=True))
        )

    def _opened(self, term: Term, type_: str) -> Term:
        if term == ANYTHING:
            found = [name for name, own in self.objects.items() if self.domain.is_subtype(own, type_)]
            return Function(found[0] if len(found) == 1 else f"{SOME}{next(self._numbers)}")
        if isinstance(term, Function) and term.name in self.domain.functions:
            types = self.domain.functions[term.name].arguments
            return Function(
                term.name, tuple(self._opened(a, t) for a, t in zip(term.arguments, types, strict=True))
            )
        return term

    def _renaming(self, variables: Iterable[Variable]) -> dict[Variable, Term]:
        number = next(self._numbers)
        return {each: Variable(f"{each.name}_{number}") for each in variables}


def _is_sure(atom: Atom) -> bool:
    """Whether an atom names all its objects."""
    return is_ground(atom) and SOME not in str(atom)


def _adds(operator: Operator, name: str) -> bool:
    return any(effect.adds and effect.atom.name == name for effect in operator.effects)


def _renamed(atom: Atom, rename: Substitution) -> Atom:
    return _atom(substitute(atom, rename))


def _atom(term: Term) -> Atom:
    assert isinstance(term, Function)
    return term


def _compared(part: Comparison, rename: Substitution) -> Comparison:
    return Comparison(substitute(part.left, rename), part.relation, substitute(part.right, rename))


def _comparisons(
    body: Body | Sequence[object], rename: Substitution, bindings: Substitution
) -> tuple[Comparison, ...]:
    """The comparisons of a body that bindings leave open."""
    found = (_compared(part, rename) for part in body if isinstance(part, Comparison))
    resolved = (Comparison(resolve(e.left, bindings), e.relation, resolve(e.right, bindings)) for e in found)
    return tuple(each for each in resolved if not (is_ground(each.left) and is_ground(each.right)))


def _may_hold(part: Comparison, bindings: Substitution) -> bool:
    left, right = resolve(part.left, bindings), resolve(part.right, bindings)
    if SOME in str(left) or SOME in str(right):
        return False  # it may be the other one
    return not (is_ground(left) and is_ground(right)) or compare(left, part.relation, right)


def _literals(condition: Condition) -> Iterator[Literal]:
    """The literals that a condition needs."""
    match condition:
        case Literal():
            yield condition
        case And(parts):
            for part in parts:
                yield from _literals(part)
        case _:
            return
