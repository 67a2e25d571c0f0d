"""Typed lists, and the declared PDDL names: types, objects, predicates, static functions."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from cellwright.engine.formats.interop.pddl.expressions import Document, Expression, Group, Word
from cellwright.engine.formats.interop.pddl.names import NameMapping
from cellwright.kb.diagnostics import nearest
from cellwright.kb.model.conditions import Parameter
from cellwright.kb.model.domain import OBJECT, Type
from cellwright.kb.model.statement import Statement, derivation
from cellwright.kb.terms import Function, Variable


@dataclass
class Scope:
    """The declarations of a domain and its problem, by PDDL name."""

    names: NameMapping = field(default_factory=NameMapping)
    types: dict[str, Type] = field(default_factory=dict)  # by ASP name
    unions: dict[str, tuple[Statement, ...]] = field(default_factory=dict)  # types made of several
    objects: dict[str, str] = field(default_factory=dict)  # PDDL name: ASP name of its type
    predicates: dict[str, tuple[str, ...]] = field(default_factory=dict)  # PDDL name: ASP names of types
    functions: dict[str, tuple[str, ...]] = field(default_factory=dict)

    def is_subtype(self, name: str, ancestor: str) -> bool:
        """Whether one type is within another (both are ASP names)."""
        if ancestor == OBJECT:
            return True
        if ancestor in self.unions:
            return any(self.is_subtype(name, part) for part in self._parts(ancestor))
        seen = 0
        while name != ancestor and name in self.types and seen <= len(self.types):
            name, seen = self.types[name].parent, seen + 1
        return name == ancestor

    def overlaps(self, one: str, other: str) -> bool:
        """Whether a value of one type may also have the other type."""
        if one in self.unions:
            return any(self.overlaps(part, other) for part in self._parts(one))
        if other in self.unions:
            return any(self.overlaps(one, part) for part in self._parts(other))
        return self.is_subtype(one, other) or self.is_subtype(other, one)

    def _parts(self, union: str) -> list[str]:
        return [use.predicate[0] for each in self.unions[union] for use in each.uses]

    def type_of(self, document: Document, at: Expression) -> str:
        """The ASP name of a type as written; `(either a b)` becomes a type of its own."""
        if isinstance(at, Group):
            if at.head != "either" or not at.rest:
                document.add(at, "K801", "a type is a name or (either ...)")
                return OBJECT
            return self._union(sorted({self.type_of(document, part) for part in at.rest}))
        if at.text == "object":
            return OBJECT
        name = self.names.of("type", at.text)
        if name not in self.types:
            known = [self.names.original("type", each) for each in self.types]
            document.add(at, "K101", f"unknown type '{at.text}'", nearest(at.text, known))
            return OBJECT
        return name

    def _union(self, parts: list[str]) -> str:
        if len(parts) == 1 or OBJECT in parts:
            return OBJECT if OBJECT in parts else parts[0]
        name = f"either__{'__or__'.join(parts)}"
        self.types.setdefault(name, Type(name))
        value = (Variable("X"),)
        self.unions[name] = tuple(derivation(Function(name, value), [Function(p, value)]) for p in parts)
        return name

    def parameters(self, document: Document, parts: Sequence[Expression]) -> tuple[Parameter, ...]:
        """A typed list of variables."""
        found = []
        for word, type_ in typed(document, parts):
            if not word.text.startswith("?"):
                document.add(word, "K801", f"'{word.text}' should be a variable", f"write ?{word.text}")
            name = OBJECT if type_ is None else self.type_of(document, type_)
            found.append(Parameter(self.names.variable(word.text), name))
        return tuple(found)


def typed(document: Document, parts: Sequence[Expression]) -> Iterator[tuple[Word, Expression | None]]:
    """The words of a typed list, each with its type, if one is written."""
    waiting: list[Word] = []
    position = 0
    while position < len(parts):
        part = parts[position]
        if isinstance(part, Word) and part.text == "-" and position + 1 < len(parts):
            yield from ((word, parts[position + 1]) for word in waiting)
            waiting = []
            position += 2
            continue
        if isinstance(part, Group) or part.text == "-":
            document.add(part, "K801", "a typed list consists of names, then '-' and their type")
        else:
            waiting.append(part)
        position += 1
    yield from ((word, None) for word in waiting)
