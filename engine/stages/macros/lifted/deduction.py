"""Deduction on operators with variables: what follows from the atoms that an operator adds or denies.

Each possible consequence has a guard over statics. An instance of the operator has the consequence if the
guard holds. A denial triggers `not` rules only if a positive precondition of the operator guarantees that the
atom held before. Grounding does the same; it reports a diagnostic for other atoms that the denial might end
(language reference, Meaning 3).
"""

import hashlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from cellwright.kb.model.conditions import (
    Aggregate,
    Body,
    Comparison,
    Literal,
    Parameter,
    part_variables,
    substitute_part,
)
from cellwright.kb.model.domain import BUILT_IN_TYPES, Consequence, DeductiveOperator
from cellwright.kb.model.normalise import type_literal
from cellwright.kb.terms import (
    Atom,
    Function,
    Substitution,
    Term,
    Variable,
    resolve,
    substitute_atom,
    unify,
    variables,
)

MAX_CONSEQUENCES = 400


class NotGeneral(Exception):
    """The plan cannot be generalised. The text names the part of the domain or plan that is the reason."""


@dataclass(frozen=True, slots=True)
class Following:
    """`atom` is added or denied for every binding that satisfies `guard`, if `needs` held before the step."""

    atom: Atom
    guard: Body = ()
    needs: Body = ()
    deduced: bool = True

    def renamed(self, bindings: Substitution) -> "Following":
        """The same consequence with other variables."""
        atom = substitute_atom(self.atom, bindings)
        return Following(
            atom, renamed_body(self.guard, bindings), renamed_body(self.needs, bindings), self.deduced
        )


def renamed_body(body: Body, bindings: Substitution) -> Body:
    """A body with other variables."""
    return tuple(substitute_part(part, bindings) for part in body)


def without_aggregates(body: Body, parameters: Iterable[Parameter]) -> Body:
    """The body itself.

    If it has aggregates, which only clingo can evaluate, one literal that stands for the body.
    """
    if not any(isinstance(part, Aggregate) for part in body):
        return body
    return (Literal(stand_in(body, parameters)),)


def stand_in(body: Body, parameters: Iterable[Parameter]) -> Atom:
    """The head of the rule that defines a body with aggregates."""
    digest = hashlib.sha256(", ".join(map(str, body)).encode()).hexdigest()[:12]
    return Function(f"_where_{digest}", tuple(parameter.variable for parameter in parameters))


def type_guards(parameters: Iterable[Parameter]) -> Body:
    """One literal per parameter that tests its type.

    Built-in types are left out: no facts list their members.
    """
    return tuple(type_literal(p) for p in parameters if p.type not in BUILT_IN_TYPES)


class DeductiveOperators:
    """The deductive operators of a domain. `fresh` makes a variable that is used nowhere else."""

    def __init__(self, rules: Iterable[DeductiveOperator], fresh: Callable[[Variable], Variable]) -> None:
        self._rules = tuple(rules)
        self._fresh = fresh

    def closure(
        self, adds: list[Following], denies: list[Following], held: list[Atom]
    ) -> tuple[list[Following], list[Following]]:
        """Everything that an operator adds and denies.

        `held` are the fluents that its precondition demands.
        """
        added, denied = dict.fromkeys(adds), dict.fromkeys(denies)
        waiting: list[tuple[bool, Following]] = [*((True, a) for a in adds), *((False, d) for d in denies)]
        while waiting:
            positive, each = waiting.pop(0)
            for implied, found in self._follows(positive, each, held):
                known = added if implied else denied
                if found not in known and not any(_same(found, other) for other in known):
                    known[found] = None
                    waiting.append((implied, found))
            if len(added) + len(denied) > MAX_CONSEQUENCES:
                raise NotGeneral(f"more than {MAX_CONSEQUENCES} consequences of one operator")
        return list(added), list(denied)

    def _follows(
        self, positive: bool, cause: Following, held: list[Atom]
    ) -> Iterator[tuple[bool, Following]]:
        for rule in self._rules:
            if rule.trigger.positive != positive or rule.trigger.atom.name != cause.atom.name:
                continue
            for consequence in rule.consequences:
                yield from self._consequences(rule, consequence, cause, held)

    def _consequences(
        self, rule: DeductiveOperator, consequence: Consequence, cause: Following, held: list[Atom]
    ) -> Iterator[tuple[bool, Following]]:
        body = without_aggregates((*rule.body, *consequence.body), consequence.parameters)
        own = [*variables(rule.trigger.atom), *variables(consequence.atom)]
        own += [p.variable for p in consequence.parameters]
        own += [v for part in body for v in part_variables(part)]
        fresh = {v: self._fresh(v) for v in dict.fromkeys(own)}
        trigger = substitute_atom(rule.trigger.atom, fresh)
        for before in [None] if rule.trigger.positive else held:
            found = unify(trigger, cause.atom, {})
            if before is not None and found is not None:
                found = unify(before, cause.atom, found) if before.name == cause.atom.name else None
            if found is None:
                continue
            guards = renamed_body((*type_guards(consequence.parameters), *body), fresh)
            yield consequence.implied, _bound(
                substitute_atom(consequence.atom, fresh), (*cause.guard, *guards), cause.needs, found,
                set(fresh.values()) | (_locals(cause) if before is not None else set()),
            )  # fmt: skip


def _locals(cause: Following) -> set[Variable]:
    return {variable for variable in variables(cause.atom) if "@" in variable.name}


def _bound(
    atom: Atom, guard: Body, needs: Body, found: dict[Variable, Term], own: set[Variable]
) -> Following:
    """The consequence under the unifier `found`.

    Bindings of variables that are not its `own` become part of the guard.
    """
    bindings = {variable: resolve(variable, found) for variable in found}
    for variable in list(bindings):
        value = bindings[variable]
        if variable not in own and isinstance(value, Variable) and value in own:
            bindings = {
                v: (variable if t == value else resolve(t, {value: variable})) for v, t in bindings.items()
            }
            bindings[value] = variable
    local = {variable: term for variable, term in bindings.items() if variable in own and term != variable}
    equations = tuple(
        Comparison(variable, "=", term)
        for variable, term in bindings.items()
        if variable not in own and term != variable
    )
    return Following(
        substitute_atom(atom, local),
        (*equations, *_distinct(renamed_body(guard, local))),
        renamed_body(needs, local),
    )


def _distinct(body: Body) -> Body:
    """The body without repeated parts and without equations of a term with itself."""
    kept = (p for p in body if not (isinstance(p, Comparison) and p.relation == "=" and p.left == p.right))
    return tuple(dict.fromkeys(kept))


def _same(one: Following, other: Following) -> bool:
    """Whether two consequences are equal except for the names of their local variables."""
    return one.deduced == other.deduced and _canonical(one) == _canonical(other)


def _canonical(each: Following) -> str:
    parts = (*each.guard, *each.needs)
    found = [*variables(each.atom), *(variable for part in parts for variable in part_variables(part))]
    local = [variable for variable in dict.fromkeys(found) if "@" in variable.name]
    names = {variable: Variable(f"L{number}@") for number, variable in enumerate(local)}
    renamed = each.renamed(names)
    return f"{renamed.atom} :- {', '.join(map(str, renamed.guard))} | {', '.join(map(str, renamed.needs))}"
