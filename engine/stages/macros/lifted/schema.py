"""Schemas: operators with variables, and all that their instances can add and deny, deduction included."""

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from cellwright.engine.stages.macros.lifted.deduction import (
    DeductiveOperators,
    Following,
    NotGeneral,
    renamed_body,
    stand_in,
    type_guards,
    without_aggregates,
)
from cellwright.kb.graphs import components
from cellwright.kb.model.conditions import TRUE, Body, BodyPart, Condition, Literal, part_variables
from cellwright.kb.model.domain import DeductiveOperator, Domain, Effect, Kind, Operator, Rule
from cellwright.kb.model.normalise import Normaliser
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Function,
    Substitution,
    Term,
    Variable,
    substitute_atom,
    variables,
)


@dataclass(frozen=True, slots=True)
class OperatorSchema:
    """An operator: the alternatives of its precondition and all that it may add, deny and let happen.

    `batches` are the events that happen under conditions. `universal` is whether one of its conditions speaks of all objects.
    """

    operator: Operator
    body: Body
    alternatives: tuple[Body, ...]
    adds: tuple[Following, ...]
    denies: tuple[Following, ...]
    events: tuple[Atom, ...]
    universal: bool = False
    batches: tuple[Following, ...] = ()

    def renamed(self, bindings: Substitution) -> "OperatorSchema":
        """The same schema with other variables. `bindings` must contain the variables of the header."""
        return OperatorSchema(
            self.operator,
            renamed_body(self.body, bindings),
            tuple(renamed_body(each, bindings) for each in self.alternatives),
            tuple(each.renamed(bindings) for each in self.adds),
            tuple(each.renamed(bindings) for each in self.denies),
            tuple(substitute_atom(each, bindings) for each in self.events),
            self.universal,
            tuple(each.renamed(bindings) for each in self.batches),
        )

    def variables(self) -> Iterator[Variable]:
        """All variables of the schema, except `_`."""
        found = dict.fromkeys(self.operator.variables)
        bodies = [self.body, *self.alternatives]
        for each in (*self.adds, *self.denies):
            bodies += [each.guard, each.needs]
            found.update(dict.fromkeys(variables(each.atom)))
        for body in bodies:
            found.update((variable, None) for part in body for variable in part_variables(part))
        return (variable for variable in found if variable != ANYTHING)


class Schemas:
    """The operator schemas of a domain. Each is made at its first use."""

    def __init__(self, domain: Domain) -> None:
        self.domain = domain
        self.kinds = {name: predicate.kind for name, predicate in domain.predicates.items()}
        self._operators = {each.name: each for each in domain.operators}
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
        return isinstance(part, Literal) and self.kinds.get(part.atom.name) in (Kind.FLUENT, Kind.DERIVED)

    def is_derived(self, atom: Atom) -> bool:
        """Whether rules over fluents define the predicate of an atom."""
        return self.kinds.get(atom.name) is Kind.DERIVED

    def is_recursive(self) -> bool:
        """Whether a derived predicate of the domain builds on itself."""
        if self._recursive[0] != len(self.rules):
            reads: dict[str, set[str]] = {}
            for rule in self.rules:
                used = (p.atom for p in rule.body if isinstance(p, Literal) and self.is_derived(p.atom))
                reads.setdefault(rule.head.name, set()).update(each.name for each in used)
            loops = (len(each) > 1 or each[0] in reads.get(each[0], ()) for each in components(reads))
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
        """The alternatives of a condition. Each is a body in which every `_` is replaced by a new variable.

        Raises `NotGeneral` for a condition on all objects: it may be true of these objects and false for
        others.
        """
        found = self._goals.disjuncts(condition, types)
        if self._goals.rules:
            self._goals.rules.clear()
            raise NotGeneral(f"the condition is about all objects: {condition}")
        return tuple(tuple(self._named_apart(part) for part in body) for body in found)

    def _alternatives(self, condition: Condition, types: dict[Variable, str]) -> tuple[Body, ...]:
        """The same, with a derived predicate of its own for what is said of all objects."""
        known = len(self._normaliser.rules)
        found = self._normaliser.disjuncts(condition, types)
        new = self._normaliser.rules[known:]
        self.kinds.update((each.head.name, Kind.DERIVED) for each in new)
        self.rules += tuple(map(self._rule_apart, new))
        return tuple(tuple(self._named_apart(part) for part in body) for body in found)

    def _rule_apart(self, rule: Rule) -> Rule:
        return Rule(self._closed(rule.head), tuple(map(self._named_apart, rule.body)))

    def _deductive_apart(self, each: DeductiveOperator) -> DeductiveOperator:
        consequences = tuple(
            replace(c, atom=self._closed(c.atom), body=tuple(map(self._named_apart, c.body)))
            for c in each.consequences
        )
        trigger = Literal(self._closed(each.trigger.atom), each.trigger.positive)
        body = tuple(map(self._named_apart, each.body))
        return replace(each, trigger=trigger, body=body, consequences=consequences)

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
        known = len(self.rules)
        alternatives = self._alternatives(operator.precondition, types)
        explicit = [self._explicit(effect.atom, effect, types) for effect in operator.effects]
        events = tuple(e.atom for e in operator.effects if self._is_event(e.atom) and not _conditional(e))
        plain = [(e, each) for e, found in zip(operator.effects, explicit, strict=True) for each in found]
        adds = [each for effect, each in plain if effect.adds and not self._is_event(each.atom)]
        batches = tuple(each for e, each in plain if self._is_event(each.atom) and _conditional(e))
        held = {
            part.atom
            for body in alternatives
            for part in body
            if isinstance(part, Literal) and part.positive and self.kinds.get(part.atom.name) is Kind.FLUENT
        }
        first = [
            each for effect, each in plain if not effect.adds and each.atom not in {a.atom for a in adds}
        ]
        added, denied = self._deduction.closure(adds, first, sorted(held, key=str))
        body = (*type_guards(operator.parameters), *without_aggregates(operator.body, operator.parameters))
        universal = len(self.rules) > known
        return OperatorSchema(
            operator, body, alternatives, tuple(added), tuple(denied), events, universal, batches
        )

    def _is_event(self, atom: Atom) -> bool:
        return self.kinds.get(atom.name) is Kind.EVENT

    def _explicit(self, atom: Atom, effect: Effect, types: dict[Variable, str]) -> list[Following]:
        if not _conditional(effect):
            return [Following(atom, deduced=False)]
        fresh = {p.variable: self.fresh(p.variable) for p in effect.parameters}
        inner = {**types, **{p.variable: p.type for p in effect.parameters}}
        found = []
        for body in self._alternatives(effect.condition, inner):
            parts = renamed_body((*type_guards(effect.parameters), *body), fresh)
            needs = tuple(part for part in parts if self.is_dynamic(part))
            guard = tuple(part for part in parts if not self.is_dynamic(part))
            found.append(Following(substitute_atom(atom, fresh), guard, needs, deduced=False))
        return found


def _conditional(effect: Effect) -> bool:
    return bool(effect.parameters) or effect.condition != TRUE


__all__ = ["Following", "NotGeneral", "OperatorSchema", "Schemas", "stand_in", "type_guards"]
