"""The symbol table of a domain or problem: types, functions, objects and predicates."""

import dataclasses
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

from cellwright.kb.diagnostics import Source, unknown_name
from cellwright.kb.loader.reader import Expression, LoadFindings
from cellwright.kb.model.domain_model import (
    BUILT_IN_TYPES,
    OBJECT_TYPE,
    UNLISTED_TYPES,
    FunctionSignature,
    Kind,
    Predicate,
    Quantity,
    Type,
)
from cellwright.kb.terms import Atom, Function

CONDITION_KINDS = (Kind.STATIC, Kind.FLUENT, Kind.DERIVED)
CHANGEABLE_KINDS = (Kind.FLUENT, Kind.EVENT)


@dataclass
class SymbolTable:
    """The symbol table of a domain, or of a problem and its domain."""

    findings: LoadFindings
    types: dict[str, Type] = field(default_factory=dict)
    functions: dict[str, FunctionSignature] = field(default_factory=dict)
    objects: dict[str, str] = field(default_factory=dict)
    predicates: dict[str, Predicate] = field(default_factory=dict)
    term_types: set[str] = field(default_factory=set)  # declared with the parent `term`
    closed_lists: set[str] = field(default_factory=set)
    quantities: dict[str, Quantity] = field(default_factory=dict)
    broken: set[str] = field(default_factory=set)  # declared with an error that is already reported
    missing: set[str] = field(
        default_factory=set
    )  # types that are used and not declared: each is reported once
    travel: str = ""  # what durations call the travel time, if the domain declares `motion:`
    derived: list[str] = field(
        default_factory=list
    )  # as declared; those that only read statics become static

    def extended(self, objects: Mapping[str, str]) -> "SymbolTable":
        """A separate table for a problem of this domain, with these objects."""
        return dataclasses.replace(self, objects=dict(objects))

    def known_type(self, name: str) -> bool:
        """Whether there is a type of this name."""
        return name in self.types or name in BUILT_IN_TYPES

    def is_subtype(self, name: str, ancestor: str) -> bool:
        """Whether `name` is `ancestor` or one of its subtypes.

        What a missing type is cannot be told: it fits everywhere.
        """
        if name in self.missing or ancestor in self.missing:
            return True
        if ancestor == OBJECT_TYPE:
            return name not in BUILT_IN_TYPES or name == OBJECT_TYPE
        seen = 0
        while name != ancestor:
            if name not in self.types or seen > len(self.types):
                return False
            name, seen = self.types[name].parent, seen + 1
        return True

    def miss_type(self, name: str, known: Collection[str], where: Source) -> None:
        """Report a type that is not declared, and take it as one from now on."""
        if name not in self.missing:
            diagnostic = unknown_name("type", name, known, where)
            hint = (
                diagnostic.hint
                if "did you mean" in diagnostic.hint
                else f"declare it under `types:`; {diagnostic.hint}"
            )
            self.findings.note(dataclasses.replace(diagnostic, hint=hint))
            self.missing.add(name)
            self.types[name] = Type(name, OBJECT_TYPE, (), where)

    def add_object(self, name: str, type_: str, where: Source) -> None:
        """Declare an object. It is reported if another object or a function has its name."""
        if name in self.objects:
            message = f"the object '{name}' is declared already, as {self.objects[name]}"
            self.findings.add(where, "K104", message, "leave one out, or choose another name")
        elif name in self.functions:
            hint = "give one of them another name"
            self.findings.add(where, "K104", f"'{name}' is a function already", hint)
        else:
            self.objects[name] = type_

    def examples(self, type_: str) -> str:
        """The hint for a place where a value of a type is expected."""
        if type_ in UNLISTED_TYPES:
            return f"write a {type_}" if type_ == "text" else "write a number"
        known = [name for name, own in self.objects.items() if self.is_subtype(own, type_)]
        shown = ", ".join(known[:5]) + (", ..." if len(known) > 5 else "")
        return f"of type {type_}: {shown}" if known else f"nothing of type {type_} is declared here"

    def is_term_type(self, name: str) -> bool:
        """Whether only compound terms have this type."""
        return any(self.is_subtype(name, term_type) for term_type in self.term_types)

    def predicate(
        self, atom: Atom, expression: Expression, kinds: Collection[Kind] = tuple(Kind)
    ) -> Predicate | None:
        """The predicate of an atom, after a check of arity and kind.

        A type is a static predicate with one argument.
        """
        predicate = self.predicates.get(atom.name)
        if predicate is None and self.known_type(atom.name) and atom.name not in UNLISTED_TYPES:
            predicate = Predicate(atom.name, (OBJECT_TYPE,), Kind.STATIC)
        if predicate is None and atom.name in self.broken:
            return None
        if predicate is None:
            known = [*self.predicates, *self.types]
            self.findings.note(unknown_name("predicate", atom.name, known, expression.place(atom)))
        elif len(atom.arguments) != len(predicate.arguments):
            signature = f"{predicate.name}({', '.join(predicate.arguments)})"
            hint = f"it is {signature}" if predicate.arguments else "write it without brackets"
            self.findings.add(
                expression.place(atom),
                "K102",
                argument_count_message(atom, len(predicate.arguments)),
                hint,
            )
        elif predicate.kind not in kinds:
            message = (
                f"'{atom.name}' is {_kind_with_article(predicate.kind)}; only "
                f"{_list_kinds(kinds)} is allowed here"
            )
            self.findings.add(expression.place(atom), "K108", message, _KIND_HINTS[predicate.kind])
        else:
            return predicate
        return None


def argument_count_message(term: Function, expected: int) -> str:
    """The message about a term with the wrong number of arguments."""
    return count_of(term.name, expected, len(term.arguments))


def count_of(name: str, expected: int, actual: int) -> str:
    """The message about a name with the wrong number of arguments."""
    return f"{name} takes {expected} argument{'' if expected == 1 else 's'}, not {actual}"


def _kind_with_article(kind: Kind) -> str:
    return f"a{'n' if kind is Kind.EVENT else ''} {_KIND_NAMES[kind]}"


def _list_kinds(kinds: Collection[Kind]) -> str:
    *others, last = map(_kind_with_article, kinds)
    return f"{', '.join(others)} or {last}" if others else last


_KIND_NAMES = {
    Kind.STATIC: "static predicate",
    Kind.FLUENT: "fluent",
    Kind.DERIVED: "derived predicate",
    Kind.EVENT: "event",
}
_KIND_HINTS = {
    Kind.STATIC: "statics never change; declare it under `fluents:` if it can change",
    Kind.FLUENT: "fluents can change: read them in `preconditions`, and list them in `initial`",
    Kind.DERIVED: "rules in .lp files decide when it holds: change the fluents that they read",
    Kind.EVENT: "events are a history: operators add them and workflows name them; use a fluent "
    "for "
    "a "
    "state that is read",
}
