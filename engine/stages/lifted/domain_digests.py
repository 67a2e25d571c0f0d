"""Digests of the parts of a domain that a proof depends on.

A MACROP is stale when one of these parts has changed.
"""

import dataclasses
import hashlib
from collections.abc import Iterable, Iterator, Mapping
from enum import Enum
from typing import Any

from cellwright.engine.stages.lifted.operator_schemas import OperatorSchema
from cellwright.kb.model.conditions import Literal
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.model.plan_model import Macrop
from cellwright.kb.terms import Function, Term

# source, controller command, order of search
IGNORED_FIELDS = frozenset({"where", "command", "weight"})


class DomainDigests:
    """The digests of one domain's parts, each computed once.

    The parts have these names. `operator p` is an operator. `deduction p` is all deductive
    operators that p triggers, so a new one changes the digest, too. `rules p` is the rules of a
    derived predicate. The other names, `predicate p`, `function f`, `object o` and `type t`, are
    declarations; an object or type includes every type above it.
    """

    def __init__(self, domain: Domain) -> None:
        self.domain = domain
        self._known: dict[str, str] = {}

    def of(self, part: str) -> str:
        """The digest of a named part; that of an empty text if the domain has no such part."""
        if part not in self._known:
            kind, _, name = part.partition(" ")
            text = "\n".join(map(canonical_text, self._parts(kind, name)))
            self._known[part] = hashlib.sha256(text.encode()).hexdigest()[:16]
        return self._known[part]

    def _parts(self, kind: str, name: str) -> Iterable[object]:
        domain = self.domain
        match kind:
            case "operator":
                return [operator for operator in domain.operators if operator.name == name]
            case "deduction":
                return [
                    deductive_operator
                    for deductive_operator in domain.deductive_operators
                    if deductive_operator.trigger.atom.name == name
                ]
            case "rules":
                return [rule for rule in domain.rules if rule.head.name == name]
            case "predicate":
                return [domain.predicates[name]] if name in domain.predicates else []
            case "function":
                return [domain.functions[name]] if name in domain.functions else []
            case "object":
                return [
                    domain.objects.get(name, ""),
                    *_type_lineage(domain.objects.get(name, ""), domain),
                ]
            case _:
                return _type_lineage(name, domain)

    def fresh(self, depends: Mapping[str, str]) -> bool:
        """Whether all parts in `depends` still have the same digest."""
        return all(self.of(part) == digest for part, digest in depends.items())

    def changed(self, depends: Mapping[str, str]) -> tuple[str, ...]:
        """The parts in `depends` that have changed, sorted."""
        return tuple(sorted(part for part, digest in depends.items() if self.of(part) != digest))


def _type_lineage(name: str, domain: Domain) -> list[object]:
    """The declaration of a type and of all types above it."""
    declarations: list[object] = []
    while name in domain.types:
        declarations.append(domain.types[name])
        for further in domain.further_parents.get(name, ()):
            declarations += [further, *_type_lineage(further, domain)]
        name = domain.types[name].parent
    return declarations


def canonical_text(value: Any) -> str:
    """A text for a value. Two values have the same text exactly if they mean the same."""
    if dataclasses.is_dataclass(value):
        field_names = (
            f.name for f in dataclasses.fields(value) if f.compare and f.name not in IGNORED_FIELDS
        )
        return f"{type(value).__name__}({','.join(canonical_text(getattr(value, name)) for name in field_names)})"
    if isinstance(value, Enum):
        return str(value.name)
    if isinstance(value, tuple):
        return f"({','.join(map(canonical_text, value))})"
    return repr(value)


def proof_dependencies(
    macrop: Macrop,
    schemas: Iterable[OperatorSchema],
    digests: DomainDigests,
    derived: Iterable[str],
) -> dict[str, str]:
    """The parts that a proof with these operators and derived predicates depends on, with their
    digests.
    """
    parts = {*_proof_parts(schemas, digests.domain), *_declared_types(macrop, digests.domain)}
    parts |= {f"{kind} {name}" for name in derived for kind in ("rules", "predicate")}
    return {part: digests.of(part) for part in sorted(parts)}


def _proof_parts(schemas: Iterable[OperatorSchema], domain: Domain) -> Iterator[str]:
    for schema in schemas:
        yield f"operator {schema.operator.name}"
        for guarded in (*schema.adds, *schema.denies):
            yield f"deduction {guarded.atom.name}"
            yield f"predicate {guarded.atom.name}"
        for body in schema.alternatives:
            yield from (
                f"predicate {p.atom.name}"
                for p in body
                if isinstance(p, Literal) and p.atom.name in domain.predicates
            )


def _declared_types(macrop: Macrop, domain: Domain) -> Iterator[str]:
    """The types that the MACROP tests, and its functions and constants, whose types need no
    test.
    """
    yield from (f"type {type_test.type}" for type_test in macrop.types)
    for name in _macro_names(macrop):
        if name in domain.functions:
            yield f"function {name}"
        elif name in domain.objects:
            yield f"object {name}"
        else:
            yield from (
                f"type {declared_type.name}"
                for declared_type in domain.types.values()
                if name in declared_type.constants
            )


def _macro_names(macrop: Macrop) -> set[str]:
    atoms = [literal.atom for literal in (*macrop.goals, *macrop.preconditions)]
    atoms += [step.operator for step in macrop.steps]
    return {
        name for atom in atoms for argument in atom.arguments for name in _names_inside(argument)
    }


def _names_inside(term: Term) -> Iterator[str]:
    if isinstance(term, Function):
        yield term.name
        for argument in term.arguments:
            yield from _names_inside(argument)
