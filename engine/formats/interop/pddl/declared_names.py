"""Declared PDDL names (types, objects, predicates, functions), typed lists, and their ASP names."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from cellwright.engine.formats.interop.pddl.expressions import Document, Expression, Group, PddlWord
from cellwright.kb.diagnostics import nearest_hint
from cellwright.kb.model.conditions import Parameter
from cellwright.kb.model.domain_model import OBJECT_TYPE, Type
from cellwright.kb.terms import Function, Term, Variable

RESERVED_NAMES = {"not", "object", "int", "time", "text"}


@dataclass
class NameMapping:
    """A mapping per kind of name. Types, predicates and functions share one, because ASP does not
    distinguish them.

    A name has one ASP name, and more where something needs several (`another`, `variant`). Each of
    these has one original.
    """

    _given: dict[tuple[str, str], str] = field(default_factory=dict)
    _taken: dict[tuple[str, str], str] = field(default_factory=dict)

    def of(self, kind: str, name: str) -> str:
        """The ASP name of a PDDL name; `kind` is predicate, function, type, object, operator or
        variable.
        """
        given = self._given.get((kind, name))
        if given is None:
            given = self._given[(kind, name)] = self._fresh(kind, name)
        return given

    def variable(self, name: str) -> Variable:
        """The variable of `?name`."""
        return Variable(self.of("variable", name.removeprefix("?")))

    def another(self, name: str) -> Variable:
        """A variable for `?name` that was given to nobody else."""
        return Variable(self._fresh("variable", name.removeprefix("?")))

    def variant(self, kind: str, name: str) -> str:
        """One more ASP name of a PDDL name."""
        return self._fresh(kind, name)

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
    return "predicate" if kind in ("type", "function") else kind


# the variables that may be named at a place, by their PDDL names
Variables = Mapping[str, Parameter]


@dataclass
class PddlScope:
    """The declarations of a domain and its problem, by PDDL name."""

    names: NameMapping = field(default_factory=NameMapping)
    types: dict[str, Type] = field(default_factory=dict)  # by ASP name
    # parents beside the first one
    further: dict[str, tuple[str, ...]] = field(default_factory=dict)
    objects: dict[str, str] = field(default_factory=dict)  # PDDL name: ASP name of its type
    # PDDL name: ASP names of types
    predicates: dict[str, tuple[str, ...]] = field(default_factory=dict)
    functions: dict[str, tuple[str, ...]] = field(default_factory=dict)

    def above(self, name: str) -> tuple[str, ...]:
        """The types right above a type."""
        return (self.types[name].parent, *self.further.get(name, ())) if name in self.types else ()

    def is_subtype(self, name: str, ancestor: str) -> bool:
        """Whether one type is within another (both are ASP names)."""
        return ancestor in (OBJECT_TYPE, name) or any(
            self.is_subtype(parent, ancestor) for parent in self.above(name)
        )

    def overlaps(self, first: str, second: str) -> bool:
        """Whether a value of one type may also have the other type."""
        if self.is_subtype(first, second) or self.is_subtype(second, first):
            return True
        return any(
            self.is_subtype(each, first) and self.is_subtype(each, second) for each in self.types
        )

    def may_be_same(self, one: Term, other: Term, types: Mapping[Variable, str]) -> bool:
        """Whether two arguments may have one value; `types` are those of the variables."""
        if isinstance(one, Function) and isinstance(other, Function):
            return one == other
        return self.overlaps(self._type_of_term(one, types), self._type_of_term(other, types))

    def _type_of_term(self, term: Term, types: Mapping[Variable, str]) -> str:
        if isinstance(term, Variable):
            return types.get(term, OBJECT_TYPE)
        return self.objects.get(self.names.original("object", str(term)), OBJECT_TYPE)

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
        """The type above all `parts`."""
        if len(parts) == 1 or OBJECT_TYPE in parts:
            return OBJECT_TYPE if OBJECT_TYPE in parts else parts[0]
        name = self._made("either", parts)
        self.types.setdefault(name, Type(name))
        for part in parts:
            self.put_under(part, name)
        return name

    def common(self, parts: Sequence[str]) -> str:
        """A type of what has all the types in `parts`."""
        lowest = [
            part
            for part in dict.fromkeys(parts)
            if not any(self.is_subtype(each, part) for each in parts if each != part)
        ]
        if len(lowest) <= 1:
            return lowest[0] if lowest else OBJECT_TYPE
        name = self._made("both", sorted(lowest))
        self.types.setdefault(name, Type(name))
        for part in sorted(lowest):
            self.put_under(name, part)
        return name

    def _made(self, kind: str, parts: Sequence[str]) -> str:
        """The name of a type that is made of others.

        No PDDL name can be equal to it, because it has spaces.
        """
        return self.names.of("type", f"{kind} {' '.join(parts)}")

    def put_under(self, name: str, parent: str) -> None:
        """Make one type a part of another, beside what is above it already."""
        if parent == OBJECT_TYPE or parent in self.above(name):
            return
        known = self.types[name]
        if known.parent == OBJECT_TYPE:
            self.types[name] = Type(name, parent, (), known.where)
        else:
            self.further[name] = (*self.further.get(name, ()), parent)

    def parameters(
        self, document: Document, parts: Sequence[Expression], outer: Variables | None = None
    ) -> dict[str, Parameter]:
        """A typed list of variables, by their PDDL names.

        One that hides a variable of `outer` is another variable of the model.
        """
        listed: dict[str, Parameter] = {}
        for word, type_ in self._variables(document, parts):
            if word.text in listed:
                document.add(word, "K104", f"variable {word.text} is declared twice in one list")
            hides = outer is not None and word.text in outer
            variable = (self.names.another if hides else self.names.variable)(word.text)
            listed[word.text] = Parameter(variable, type_)
        return listed

    def signature(self, document: Document, parts: Sequence[Expression]) -> tuple[str, ...]:
        """The types in a typed list of variables."""
        return tuple(type_ for _, type_ in self._variables(document, parts))

    def _variables(
        self, document: Document, parts: Sequence[Expression]
    ) -> Iterator[tuple[PddlWord, str]]:
        for word, type_ in read_typed_list(document, parts):
            if not word.text.startswith("?"):
                document.add(
                    word, "K801", f"'{word.text}' should be a variable", f"write ?{word.text}"
                )
            yield word, OBJECT_TYPE if type_ is None else self.type_of(document, type_)


def read_typed_list(
    document: Document, parts: Sequence[Expression]
) -> Iterator[tuple[PddlWord, Expression | None]]:
    """The words of a typed list, each with its type, if one is written."""
    waiting: list[PddlWord] = []
    parts = list(spaced(parts))
    position = 0
    while position < len(parts):
        part = parts[position]
        if isinstance(part, PddlWord) and part.text == "-" and position + 1 < len(parts):
            if not waiting:
                document.add(part, "K801", "no name stands before this '-'", "write name - type")
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


def spaced(parts: Sequence[Expression]) -> Iterator[Expression]:
    """The parts of a typed list, with `-type` as `-` and `type`: no name begins with a hyphen."""
    for part in parts:
        if isinstance(part, PddlWord) and part.text.startswith("-") and len(part.text) > 1:
            yield PddlWord("-", part.offset)
            yield PddlWord(part.text[1:], part.offset + 1)
        else:
            yield part
