"""Declared PDDL names (types, objects, predicates, functions), typed lists, and their ASP names."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from cellwright.engine.formats.interop.pddl.expressions import Document, Expression, Group, PddlWord
from cellwright.kb.diagnostics import nearest_hint
from cellwright.kb.model.conditions import Parameter
from cellwright.kb.model.domain_model import OBJECT_TYPE, Type
from cellwright.kb.model.statement import Statement, derivation_statement
from cellwright.kb.terms import Function, Variable

RESERVED_NAMES = {"not", "object", "int", "time", "text"}


@dataclass
class NameMapping:
    """A one-to-one mapping per kind of name.

    Types and predicates share one, because ASP does not distinguish them.
    """

    _given: dict[tuple[str, str], str] = field(default_factory=dict)
    _taken: dict[tuple[str, str], str] = field(default_factory=dict)

    def of(self, kind: str, name: str) -> str:
        """The ASP name of a PDDL name; `kind` is predicate, type, object, operator or variable."""
        given = self._given.get((kind, name))
        if given is None:
            given = self._given[(kind, name)] = self._fresh(kind, name)
        return given

    def variable(self, name: str) -> Variable:
        """The variable of `?name`."""
        return Variable(self.of("variable", name.removeprefix("?")))

    def original(self, kind: str, name: str) -> str:
        """The PDDL name of an ASP name, or the name itself if there is none."""
        return self._taken.get((_name_space(kind), name), name)

    def _fresh(self, kind: str, name: str) -> str:
        plain = re.sub(r"[^a-z0-9_]", "_", name.lower()).lstrip("_")
        plain = plain if re.match(r"[a-z]", plain) else f"n{plain}"
        if kind == "variable":
            plain = plain[0].upper() + plain[1:]
        candidate, number = plain, 2
        while candidate in RESERVED_NAMES or (_name_space(kind), candidate) in self._taken:
            candidate, number = f"{plain}_{number}", number + 1
        self._taken[(_name_space(kind), candidate)] = name
        return candidate


def _name_space(kind: str) -> str:
    return "predicate" if kind == "type" else kind


@dataclass
class PddlScope:
    """The declarations of a domain and its problem, by PDDL name."""

    names: NameMapping = field(default_factory=NameMapping)
    types: dict[str, Type] = field(default_factory=dict)  # by ASP name
    unions: dict[str, tuple[Statement, ...]] = field(default_factory=dict)  # types made of several
    objects: dict[str, str] = field(default_factory=dict)  # PDDL name: ASP name of its type
    # PDDL name: ASP names of types
    predicates: dict[str, tuple[str, ...]] = field(default_factory=dict)
    functions: dict[str, tuple[str, ...]] = field(default_factory=dict)

    def is_subtype(self, name: str, ancestor: str) -> bool:
        """Whether one type is within another (both are ASP names)."""
        if ancestor == OBJECT_TYPE:
            return True
        if ancestor in self.unions:
            return any(self.is_subtype(name, part) for part in self._parts(ancestor))
        seen = 0
        while name != ancestor and name in self.types and seen <= len(self.types):
            name, seen = self.types[name].parent, seen + 1
        return name == ancestor

    def overlaps(self, first: str, second: str) -> bool:
        """Whether a value of one type may also have the other type."""
        if first in self.unions:
            return any(self.overlaps(part, second) for part in self._parts(first))
        if second in self.unions:
            return any(self.overlaps(first, part) for part in self._parts(second))
        return self.is_subtype(first, second) or self.is_subtype(second, first)

    def _parts(self, union: str) -> list[str]:
        return [use.predicate[0] for statement in self.unions[union] for use in statement.uses]

    def type_of(self, document: Document, at: Expression) -> str:
        """The ASP name of a type as written; `(either a b)` becomes a type of its own."""
        if isinstance(at, Group):
            if at.head != "either" or not at.rest:
                document.add(at, "K801", "a type is a name or (either ...)")
                return OBJECT_TYPE
            return self._union(sorted({self.type_of(document, part) for part in at.rest}))
        if at.text == "object":
            return OBJECT_TYPE
        name = self.names.of("type", at.text)
        if name not in self.types:
            known = [self.names.original("type", declared) for declared in self.types]
            document.add(at, "K101", f"unknown type '{at.text}'", nearest_hint(at.text, known))
            return OBJECT_TYPE
        return name

    def _union(self, parts: list[str]) -> str:
        if len(parts) == 1 or OBJECT_TYPE in parts:
            return OBJECT_TYPE if OBJECT_TYPE in parts else parts[0]
        name = f"either__{'__or__'.join(parts)}"
        self.types.setdefault(name, Type(name))
        value = (Variable("X"),)
        self.unions[name] = tuple(
            derivation_statement(Function(name, value), [Function(p, value)]) for p in parts
        )
        return name

    def parameters(self, document: Document, parts: Sequence[Expression]) -> tuple[Parameter, ...]:
        """A typed list of variables."""
        typed_parameters = []
        for word, type_ in read_typed_list(document, parts):
            if not word.text.startswith("?"):
                document.add(
                    word, "K801", f"'{word.text}' should be a variable", f"write ?{word.text}"
                )
            name = OBJECT_TYPE if type_ is None else self.type_of(document, type_)
            typed_parameters.append(Parameter(self.names.variable(word.text), name))
        return tuple(typed_parameters)


def read_typed_list(
    document: Document, parts: Sequence[Expression]
) -> Iterator[tuple[PddlWord, Expression | None]]:
    """The words of a typed list, each with its type, if one is written."""
    waiting: list[PddlWord] = []
    position = 0
    while position < len(parts):
        part = parts[position]
        if isinstance(part, PddlWord) and part.text == "-" and position + 1 < len(parts):
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
