"""Digests of the parts of a domain that a proof depends on.

A MACROP is stale when one of these parts has changed.
"""

import dataclasses
import hashlib
from collections.abc import Iterable, Iterator, Mapping
from enum import Enum
from typing import Any

from cellwright.engine.stages.macros.lifted.schema import OperatorSchema
from cellwright.kb.model.conditions import Literal
from cellwright.kb.model.domain import Domain
from cellwright.kb.model.macro import Macrop
from cellwright.kb.terms import Function, Term

MEANINGLESS = frozenset({"where", "command", "weight"})  # source, controller command, order of search


class Digests:
    """The digests of one domain's parts, each computed once.

    The parts have these names. `operator p` is an operator. `deduction p` is all deductive operators that p
    triggers, so a new one changes the digest, too. `rules p` is the rules of a derived predicate. The
    other names, `predicate p`, `function f`, `object o` and `type t`, are declarations; an object or type
    includes every type above it.
    """

    def __init__(self, domain: Domain) -> None:
        self.domain = domain
        self._known: dict[str, str] = {}

    def of(self, part: str) -> str:
        """The digest of a named part; that of an empty text if the domain has no such part."""
        if part not in self._known:
            kind, _, name = part.partition(" ")
            text = "\n".join(map(canonical, self._parts(kind, name)))
            self._known[part] = hashlib.sha256(text.encode()).hexdigest()[:16]
        return self._known[part]

    def _parts(self, kind: str, name: str) -> Iterable[object]:
        domain = self.domain
        match kind:
            case "operator":
                return [each for each in domain.operators if each.name == name]
            case "deduction":
                return [each for each in domain.deductive_operators if each.trigger.atom.name == name]
            case "rules":
                return [each for each in domain.rules if each.head.name == name]
            case "predicate":
                return [domain.predicates[name]] if name in domain.predicates else []
            case "function":
                return [domain.functions[name]] if name in domain.functions else []
            case "object":
                return [domain.objects.get(name, ""), *_lineage(domain.objects.get(name, ""), domain)]
            case _:
                return _lineage(name, domain)

    def fresh(self, depends: Mapping[str, str]) -> bool:
        """Whether all parts in `depends` still have the same digest."""
        return all(self.of(part) == digest for part, digest in depends.items())

    def changed(self, depends: Mapping[str, str]) -> tuple[str, ...]:
        """The parts in `depends` that have changed, sorted."""
        return tuple(sorted(part for part, digest in depends.items() if self.of(part) != digest))


def _lineage(name: str, domain: Domain) -> list[object]:
    """The declaration of a type and of all types above it."""
    found: list[object] = []
    while name in domain.types:
        found.append(domain.types[name])
        name = domain.types[name].parent
    return found


def canonical(value: Any) -> str:
    """A text for a value. Two values have the same text exactly if they mean the same."""
    if dataclasses.is_dataclass(value):
        kept = (f.name for f in dataclasses.fields(value) if f.compare and f.name not in MEANINGLESS)
        return f"{type(value).__name__}({','.join(canonical(getattr(value, name)) for name in kept)})"
    if isinstance(value, Enum):
        return str(value.name)
    if isinstance(value, tuple):
        return f"({','.join(map(canonical, value))})"
    return repr(value)


def dependencies(
    macrop: Macrop, schemas: Iterable[OperatorSchema], digests: Digests, derived: Iterable[str]
) -> dict[str, str]:
    """The parts that a proof with these operators and derived predicates depends on, with their digests."""
    parts = {*_proved(schemas, digests.domain), *_declared(macrop, digests.domain)}
    parts |= {f"{kind} {name}" for name in derived for kind in ("rules", "predicate")}
    return {part: digests.of(part) for part in sorted(parts)}


def _proved(schemas: Iterable[OperatorSchema], domain: Domain) -> Iterator[str]:
    for schema in schemas:
        yield f"operator {schema.operator.name}"
        for each in (*schema.adds, *schema.denies):
            yield f"deduction {each.atom.name}"
            yield f"predicate {each.atom.name}"
        for body in schema.alternatives:
            yield from (
                f"predicate {p.atom.name}"
                for p in body
                if isinstance(p, Literal) and p.atom.name in domain.predicates
            )


def _declared(macrop: Macrop, domain: Domain) -> Iterator[str]:
    """The types that the MACROP tests, and its functions and constants, whose types need no test."""
    yield from (f"type {each.type}" for each in macrop.types)
    for name in _names(macrop):
        if name in domain.functions:
            yield f"function {name}"
        elif name in domain.objects:
            yield f"object {name}"
        else:
            yield from (f"type {each.name}" for each in domain.types.values() if name in each.constants)


def _names(macrop: Macrop) -> set[str]:
    atoms = [each.atom for each in (*macrop.goals, *macrop.preconditions)]
    atoms += [step.operator for step in macrop.steps]
    return {name for atom in atoms for argument in atom.arguments for name in _inside(argument)}


def _inside(term: Term) -> Iterator[str]:
    if isinstance(term, Function):
        yield term.name
        for argument in term.arguments:
            yield from _inside(argument)
