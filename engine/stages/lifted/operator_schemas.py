"""Operator schemas: all that the instances of an operator can add and deny, deduction included.

Each possible consequence has a guard over statics. An instance of the operator has the consequence
if the guard holds. A denial triggers `not` rules only if a positive precondition of the operator
guarantees that the atom held before. Grounding does the same; it reports a diagnostic for other
atoms that the denial might end (language reference, Meaning 3).
"""

import hashlib
import itertools
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

from cellwright.kb.graphs import strong_components
from cellwright.kb.model.condition_forms import Normaliser, type_literal
from cellwright.kb.model.conditions import (
    ALWAYS_TRUE,
    Aggregate,
    Body,
    BodyPart,
    Comparison,
    Condition,
    Literal,
    Parameter,
    part_variables,
    substitute_part,
)
from cellwright.kb.model.domain_model import (
    BUILT_IN_TYPES,
    Consequence,
    DeductiveOperator,
    Domain,
    Effect,
    Kind,
    Operator,
    Rule,
)
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Function,
    Substitution,
    Term,
    Variable,
    resolve_term,
    substitute_atom,
    term_variables,
    unify,
)

MAX_CONSEQUENCES = 400


class NotGeneral(Exception):
    """The plan cannot be generalised.

    The text names the part of the domain or plan that is the reason.
    """


@dataclass(frozen=True, slots=True)
class GuardedAtom:
    """`atom` is added or denied for every binding that satisfies `guard`, if `needs` held
    before the step.
    """

    atom: Atom
    guard: Body = ()
    needs: Body = ()
    deduced: bool = True

    def renamed(self, bindings: Substitution) -> "GuardedAtom":
        """The same consequence with other variables."""
        atom = substitute_atom(self.atom, bindings)
        return GuardedAtom(
            atom,
            renamed_body(self.guard, bindings),
            renamed_body(self.needs, bindings),
            self.deduced,
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

    def __init__(
        self, rules: Iterable[DeductiveOperator], fresh: Callable[[Variable], Variable]
    ) -> None:
        self._rules = tuple(rules)
        self._fresh = fresh

    def closure(
        self, adds: list[GuardedAtom], denies: list[GuardedAtom], demanded: list[Atom]
    ) -> tuple[list[GuardedAtom], list[GuardedAtom]]:
        """Everything that an operator adds and denies.

        `held` are the fluents that its precondition demands.
        """
        added, denied = dict.fromkeys(adds), dict.fromkeys(denies)
        waiting: list[tuple[bool, GuardedAtom]] = [
            *((True, a) for a in adds),
            *((False, d) for d in denies),
        ]
        while waiting:
            positive, cause = waiting.pop(0)
            for implied, consequence in self._follows(positive, cause, demanded):
                collected = added if implied else denied
                if consequence not in collected and not any(
                    _same_consequence(consequence, earlier) for earlier in collected
                ):
                    collected[consequence] = None
                    waiting.append((implied, consequence))
            if len(added) + len(denied) > MAX_CONSEQUENCES:
                raise NotGeneral(f"more than {MAX_CONSEQUENCES} consequences of one operator")
        return list(added), list(denied)

    def _follows(
        self, positive: bool, cause: GuardedAtom, demanded: list[Atom]
    ) -> Iterator[tuple[bool, GuardedAtom]]:
        for rule in self._rules:
            if rule.trigger.positive != positive or rule.trigger.atom.name != cause.atom.name:
                continue
            for consequence in rule.consequences:
                yield from self._consequences(rule, consequence, cause, demanded)

    def _consequences(
        self,
        rule: DeductiveOperator,
        consequence: Consequence,
        cause: GuardedAtom,
        demanded: list[Atom],
    ) -> Iterator[tuple[bool, GuardedAtom]]:
        body = without_aggregates((*rule.body, *consequence.body), consequence.parameters)
        own = [*term_variables(rule.trigger.atom), *term_variables(consequence.atom)]
        own += [p.variable for p in consequence.parameters]
        own += [v for part in body for v in part_variables(part)]
        fresh = {v: self._fresh(v) for v in dict.fromkeys(own)}
        trigger = substitute_atom(rule.trigger.atom, fresh)
        for before in [None] if rule.trigger.positive else demanded:
            unifier = unify(trigger, cause.atom, {})
            if before is not None and unifier is not None:
                unifier = (
                    unify(before, cause.atom, unifier) if before.name == cause.atom.name else None
                )
            if unifier is None:
                continue
            guards = renamed_body((*type_guards(consequence.parameters), *body), fresh)
            yield consequence.implied, _bind_consequence(
                substitute_atom(consequence.atom, fresh), (*cause.guard, *guards), cause.needs, unifier,
                set(fresh.values()) | (_local_variables(cause) if before is not None else set()),
            )  # fmt: skip


def _local_variables(cause: GuardedAtom) -> set[Variable]:
    return {variable for variable in term_variables(cause.atom) if "@" in variable.name}


def _bind_consequence(
    atom: Atom, guard: Body, needs: Body, unifier: dict[Variable, Term], own: set[Variable]
) -> GuardedAtom:
    """The consequence under the unifier `found`.

    Bindings of variables that are not its `own` become part of the guard.
    """
    bindings = {variable: resolve_term(variable, unifier) for variable in unifier}
    for variable in list(bindings):
        value = bindings[variable]
        if variable not in own and isinstance(value, Variable) and value in own:
            bindings = {
                v: (variable if t == value else resolve_term(t, {value: variable}))
                for v, t in bindings.items()
            }
            bindings[value] = variable
    local = {
        variable: term
        for variable, term in bindings.items()
        if variable in own and term != variable
    }
    equations = tuple(
        Comparison(variable, "=", term)
        for variable, term in bindings.items()
        if variable not in own and term != variable
    )
    return GuardedAtom(
        substitute_atom(atom, local),
        (*equations, *_distinct_parts(renamed_body(guard, local))),
        renamed_body(needs, local),
    )


def _distinct_parts(body: Body) -> Body:
    """The body without repeated parts and without equations of a term with itself."""
    parts = (
        p
        for p in body
        if not (isinstance(p, Comparison) and p.relation == "=" and p.left == p.right)
    )
    return tuple(dict.fromkeys(parts))


def _same_consequence(first: GuardedAtom, second: GuardedAtom) -> bool:
    """Whether two consequences are equal except for the names of their local variables."""
    return first.deduced == second.deduced and _canonical_form(first) == _canonical_form(second)


def _canonical_form(guarded: GuardedAtom) -> str:
    parts = (*guarded.guard, *guarded.needs)
    all_variables = [
        *term_variables(guarded.atom),
        *(variable for part in parts for variable in part_variables(part)),
    ]
    local = [variable for variable in dict.fromkeys(all_variables) if "@" in variable.name]
    names = {variable: Variable(f"L{number}@") for number, variable in enumerate(local)}
    renamed = guarded.renamed(names)
    return (
        f"{renamed.atom} :- {', '.join(map(str, renamed.guard))} | "
        f"{', '.join(map(str, renamed.needs))}"
    )


@dataclass(frozen=True, slots=True)
class OperatorSchema:
    """An operator: the alternatives of its precondition and all that it may add, deny and let
    happen.

    `batches` are the events that happen under conditions. `universal` is whether one of its
    conditions speaks of all objects.
    """

    operator: Operator
    body: Body
    alternatives: tuple[Body, ...]
    adds: tuple[GuardedAtom, ...]
    denies: tuple[GuardedAtom, ...]
    events: tuple[Atom, ...]
    universal: bool = False
    batches: tuple[GuardedAtom, ...] = ()

    def renamed(self, bindings: Substitution) -> "OperatorSchema":
        """The same schema with other variables.

        `bindings` must contain the variables of the header.
        """
        return OperatorSchema(
            self.operator,
            renamed_body(self.body, bindings),
            tuple(renamed_body(alternative, bindings) for alternative in self.alternatives),
            tuple(addition.renamed(bindings) for addition in self.adds),
            tuple(denial.renamed(bindings) for denial in self.denies),
            tuple(substitute_atom(event, bindings) for event in self.events),
            self.universal,
            tuple(batch.renamed(bindings) for batch in self.batches),
        )

    def variables(self) -> Iterator[Variable]:
        """All variables of the schema, except `_`."""
        all_variables = dict.fromkeys(self.operator.variables)
        bodies = [self.body, *self.alternatives]
        for guarded in (*self.adds, *self.denies):
            bodies += [guarded.guard, guarded.needs]
            all_variables.update(dict.fromkeys(term_variables(guarded.atom)))
        for body in bodies:
            all_variables.update(
                (variable, None) for part in body for variable in part_variables(part)
            )
        return (variable for variable in all_variables if variable != ANYTHING)


class OperatorSchemas:
    """The operator schemas of a domain. Each is made at its first use."""

    def __init__(self, domain: Domain) -> None:
        self.domain = domain
        self.kinds = {name: predicate.kind for name, predicate in domain.predicates.items()}
        self._operators = {operator.name: operator for operator in domain.operators}
        self._made: dict[str, OperatorSchema] = {}
        self._fresh = itertools.count(1)
        self._recursive: tuple[int, bool] = (0, False)  # for so many rules
        self._normaliser, self._goals = Normaliser(), Normaliser()
        self.rules = tuple(map(self._rule_apart, domain.rules))
        self._deduction = DeductiveOperators(
            map(self._deductive_apart, domain.deductive_operators), self.fresh
        )

    def is_dynamic(self, part: BodyPart) -> bool:
        """Whether a part of a body depends on the state."""
        return isinstance(part, Literal) and self.kinds.get(part.atom.name) in (
            Kind.FLUENT,
            Kind.DERIVED,
        )

    def is_derived(self, atom: Atom) -> bool:
        """Whether rules over fluents define the predicate of an atom."""
        return self.kinds.get(atom.name) is Kind.DERIVED

    def is_recursive(self) -> bool:
        """Whether a derived predicate of the domain builds on itself."""
        if self._recursive[0] != len(self.rules):
            reads: dict[str, set[str]] = {}
            for rule in self.rules:
                used = (
                    p.atom for p in rule.body if isinstance(p, Literal) and self.is_derived(p.atom)
                )
                reads.setdefault(rule.head.name, set()).update(atom.name for atom in used)
            loops = (
                len(component) > 1 or component[0] in reads.get(component[0], ())
                for component in strong_components(reads)
            )
            self._recursive = len(self.rules), any(loops)
        return self._recursive[1]

    def rests_on_rules(self, body: Iterable[BodyPart]) -> bool:
        """Whether a body contains a predicate that is derived from fluents."""
        return any(isinstance(part, Literal) and self.is_derived(part.atom) for part in body)

    def fresh(self, variable: Variable) -> Variable:
        """A variable that is used nowhere else."""
        return Variable(f"{variable.name.split('@')[0]}@{next(self._fresh)}")

    def named(self, name: str) -> OperatorSchema:
        """The schema of the operator with this name. Raises `NotGeneral` if there is none."""
        if name not in self._operators:
            raise NotGeneral(f"there is no operator {name}")
        if name not in self._made:
            self._made[name] = self._make(self._operators[name])
        return self._made[name]

    def disjuncts(self, condition: Condition, types: dict[Variable, str]) -> tuple[Body, ...]:
        """The alternatives of a condition. Each is a body in which every `_` is replaced by a new
        variable.

        Raises `NotGeneral` for a condition on all objects: it may be true of these objects and
        false for others.
        """
        disjuncts = self._goals.disjuncts(condition, types)
        if self._goals.rules:
            self._goals.rules.clear()
            raise NotGeneral(f"the condition is about all objects: {condition}")
        return tuple(tuple(self._named_apart(part) for part in body) for body in disjuncts)

    def _alternatives(self, condition: Condition, types: dict[Variable, str]) -> tuple[Body, ...]:
        """The same, with a derived predicate of its own for what is said of all objects."""
        rules_before = len(self._normaliser.rules)
        disjuncts = self._normaliser.disjuncts(condition, types)
        new = self._normaliser.rules[rules_before:]
        self.kinds.update((rule.head.name, Kind.DERIVED) for rule in new)
        self.rules += tuple(map(self._rule_apart, new))
        return tuple(tuple(self._named_apart(part) for part in body) for body in disjuncts)

    def _rule_apart(self, rule: Rule) -> Rule:
        return Rule(self._closed(rule.head), tuple(map(self._named_apart, rule.body)))

    def _deductive_apart(self, deductive: DeductiveOperator) -> DeductiveOperator:
        consequences = tuple(
            replace(c, atom=self._closed(c.atom), body=tuple(map(self._named_apart, c.body)))
            for c in deductive.consequences
        )
        trigger = Literal(self._closed(deductive.trigger.atom), deductive.trigger.positive)
        body = tuple(map(self._named_apart, deductive.body))
        return replace(deductive, trigger=trigger, body=body, consequences=consequences)

    def _named_apart(self, part: BodyPart) -> BodyPart:
        if not isinstance(part, Literal):
            return part
        return Literal(self._closed(part.atom), part.positive)

    def _closed(self, atom: Atom) -> Atom:
        return Function(atom.name, tuple(map(self._no_wildcards, atom.arguments)))

    def _no_wildcards(self, term: Term) -> Term:
        if term == ANYTHING:
            return self.fresh(Variable("Any"))
        if isinstance(term, Function) and term.arguments:
            return self._closed(term)
        return term

    def _make(self, operator: Operator) -> OperatorSchema:
        types = {parameter.variable: parameter.type for parameter in operator.parameters}
        rules_before = len(self.rules)
        alternatives = self._alternatives(operator.precondition, types)
        explicit = [self._explicit(effect.atom, effect, types) for effect in operator.effects]
        events = tuple(
            e.atom
            for e in operator.effects
            if self._is_event(e.atom) and not _is_conditional_effect(e)
        )
        plain = [
            (e, guarded)
            for e, explicit_changes in zip(operator.effects, explicit, strict=True)
            for guarded in explicit_changes
        ]
        adds = [
            guarded for effect, guarded in plain if effect.adds and not self._is_event(guarded.atom)
        ]
        batches = tuple(
            guarded
            for e, guarded in plain
            if self._is_event(guarded.atom) and _is_conditional_effect(e)
        )
        possible_atoms = {
            part.atom
            for body in alternatives
            for part in body
            if isinstance(part, Literal)
            and part.positive
            and self.kinds.get(part.atom.name) is Kind.FLUENT
        }
        first = [
            guarded
            for effect, guarded in plain
            if not effect.adds and guarded.atom not in {a.atom for a in adds}
        ]
        added, denied = self._deduction.closure(adds, first, sorted(possible_atoms, key=str))
        body = (
            *type_guards(operator.parameters),
            *without_aggregates(operator.body, operator.parameters),
        )
        universal = len(self.rules) > rules_before
        return OperatorSchema(
            operator, body, alternatives, tuple(added), tuple(denied), events, universal, batches
        )

    def _is_event(self, atom: Atom) -> bool:
        return self.kinds.get(atom.name) is Kind.EVENT

    def _explicit(
        self, atom: Atom, effect: Effect, types: dict[Variable, str]
    ) -> list[GuardedAtom]:
        if not _is_conditional_effect(effect):
            return [GuardedAtom(atom, deduced=False)]
        fresh = {p.variable: self.fresh(p.variable) for p in effect.parameters}
        inner = {**types, **{p.variable: p.type for p in effect.parameters}}
        changes = []
        for body in self._alternatives(effect.condition, inner):
            parts = renamed_body((*type_guards(effect.parameters), *body), fresh)
            needs = tuple(part for part in parts if self.is_dynamic(part))
            guard = tuple(part for part in parts if not self.is_dynamic(part))
            changes.append(GuardedAtom(substitute_atom(atom, fresh), guard, needs, deduced=False))
        return changes


def _is_conditional_effect(effect: Effect) -> bool:
    return bool(effect.parameters) or effect.condition != ALWAYS_TRUE


__all__ = [
    "GuardedAtom",
    "NotGeneral",
    "OperatorSchema",
    "OperatorSchemas",
    "stand_in",
    "type_guards",
]
