"""Derived predicates of a task with times (PDDL 2.2): each use is replaced by the definition.

So a condition reads what its derived predicates follow from, and what changes that is apart from
it. Definitions that lead back to themselves have no such form, and are refused.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from cellwright.engine.formats.interop.pddl.declared_names import PddlScope, Variables
from cellwright.engine.formats.interop.pddl.expressions import Document, Group
from cellwright.kb.model.conditions import (
    And,
    Condition,
    Exists,
    ForAll,
    Not,
    Or,
    Parameter,
    substitute_part,
)
from cellwright.kb.terms import Term, Variable


@dataclass
class DerivedDefinitions:
    """The axioms of a domain by their predicates; `under_way` are those that are being replaced."""

    document: Document
    scope: PddlScope
    axioms: dict[str, list[Group]] = field(default_factory=dict)
    under_way: list[str] = field(default_factory=list)

    def collect(self, groups: Sequence[Group]) -> None:
        """Note the axioms of a domain, each `(:derived (predicate ?x ...) condition)`."""
        for group in groups:
            head = group.rest[0] if len(group.rest) == 2 else None
            if not isinstance(head, Group):
                said = "an axiom is (:derived (predicate ?x ...) condition)"
                self.document.add(group, "K801", said)
            elif head.head not in self.scope.predicates:
                self.document.add(head, "K101", f"unknown predicate '{head.head}'")
            else:
                self.axioms.setdefault(head.head, []).append(group)

    def parameters(self, axiom: Group, outer: Variables) -> dict[str, Parameter]:
        """The variables of an axiom, other ones than those of `outer`."""
        head = axiom.rest[0]
        assert isinstance(head, Group)
        own = self.scope.parameters(self.document, head.rest, outer)
        declared = self.scope.predicates[head.head]
        if len(own) != len(declared):
            said = f"{head.head} takes {len(declared)} arguments, not {len(own)}"
            self.document.add(head, "K102", said)
        for parameter, type_ in zip(own.values(), declared, strict=False):
            if not self.scope.is_subtype(type_, parameter.type):
                said = (
                    f"an axiom for some arguments of {head.head} only is not supported with times"
                )
                self.document.add(head, "K802", said, "give its variables the declared types")
        return own


def replace_variables(condition: Condition, bindings: Mapping[Variable, Term]) -> Condition:
    """The condition with terms in place of variables that no quantifier in it binds."""
    match condition:
        case And(parts):
            return And(tuple(replace_variables(part, bindings) for part in parts))
        case Or(parts):
            return Or(tuple(replace_variables(part, bindings) for part in parts))
        case Not(part):
            return Not(replace_variables(part, bindings))
        case Exists(parameters, part):
            return Exists(parameters, replace_variables(part, bindings))
        case ForAll(parameters, part):
            return ForAll(parameters, replace_variables(part, bindings))
        case _:
            return substitute_part(condition, bindings)
