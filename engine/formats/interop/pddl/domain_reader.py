"""Reads the domain file of a PDDL task: declarations, actions and axioms."""

import functools
from collections.abc import Iterator, Sequence

from cellwright.engine.formats.interop.pddl.declared_names import PddlScope, read_typed_list
from cellwright.engine.formats.interop.pddl.expressions import Document, Expression, Group, PddlWord
from cellwright.engine.formats.interop.pddl.number_reader import function_bindings
from cellwright.engine.formats.interop.pddl.numeric_functions import TaskFunctions
from cellwright.engine.formats.interop.pddl.pddl_conditions import ConditionReader
from cellwright.kb.model.condition_forms import Normaliser
from cellwright.kb.model.conditions import ALWAYS_TRUE, And, Condition, Literal, Parameter
from cellwright.kb.model.domain_model import (
    BUILT_IN_TYPES,
    OBJECT_TYPE,
    Domain,
    Kind,
    Operator,
    Predicate,
    Quantity,
    Rule,
    Type,
)
from cellwright.kb.terms import Function

PDDL_SECTIONS = (
    "domain", ":requirements", ":types", ":constants", ":predicates", ":functions", ":action",
    ":derived",
)  # fmt: skip


class DomainReader:
    """Reads a domain in two passes: declarations, then actions and axioms."""

    def __init__(self, document: Document) -> None:
        self.document, self.scope = document, PddlScope()
        self.conditions = ConditionReader(document, self.scope)
        self.groups = [part for part in document.root.rest if isinstance(part, Group)]
        self.constants: dict[str, str] = {}
        self.derived = {
            part.rest[0].head
            for part in self._all(":derived")
            if part.rest and isinstance(part.rest[0], Group)
        }
        self.changed = {
            name
            for action in self._all(":action")
            for name in _changeable_predicates(action.field(":effect"))
        }
        self.static: set[str] = set()
        self.functions = TaskFunctions()

    def _all(self, section: str) -> list[Group]:
        return [group for group in self.groups if group.head == section]

    def declare(self) -> None:
        """Types, constants, predicates and functions; sections that are not supported are
        refused.
        """
        if self.document.root.head != "define":
            self.document.add(self.document.root, "K801", "a PDDL file is one (define ...)")
        for group in self.groups:
            if group.head not in PDDL_SECTIONS:
                hint = "only classical planning is supported"
                self.document.add(
                    group, "K802", f"{group.head or 'this section'} is not supported", hint
                )
        for group in self._all(":types"):
            self._types(group.rest)
        for group in self._all(":constants"):
            self.declare_objects(self.document, group.rest, self.constants)
        for group in self._all(":predicates"):
            self._predicates(group.rest)
        for group in self._all(":functions"):
            self._functions(group.rest)

    def _types(self, parts: Sequence[Expression]) -> None:
        names, listed = self.scope.names, list(read_typed_list(self.document, parts))
        parents = [
            parent for _, parent in listed if isinstance(parent, PddlWord)
        ]  # a parent type needs no declaration of its own
        for word in (*(word for word, _ in listed), *parents):
            if word.text != "object":
                self.scope.types[names.of("type", word.text)] = Type(names.of("type", word.text))
        for word, parent in listed:
            if word.text != "object" and parent is not None:
                name = names.of("type", word.text)
                above = self.scope.type_of(self.document, parent)
                if self.scope.is_subtype(above, name) and above != OBJECT_TYPE:
                    self.document.add(word, "K109", f"type '{word.text}' is defined by itself")
                else:
                    self.scope.types[name] = Type(name, above, (), self.document.where(word))

    def declare_objects(
        self, document: Document, parts: Sequence[Expression], into: dict[str, str]
    ) -> None:
        """The objects of a typed list, by PDDL name."""
        for word, type_ in read_typed_list(document, parts):
            name = OBJECT_TYPE if type_ is None else self.scope.type_of(document, type_)
            known = self.scope.objects.get(word.text)
            if known is not None and known != name:
                document.add(word, "K104", f"object '{word.text}' is declared already")
            self.scope.objects[word.text] = into[word.text] = name

    def _predicates(self, parts: Sequence[Expression]) -> None:
        for part in parts:
            if not isinstance(part, Group) or not part.head:
                self.document.add(part, "K801", "a predicate is declared as (name ?x - type ...)")
                continue
            if part.head in self.scope.predicates:
                self.document.add(part, "K104", f"predicate '{part.head}' is declared twice")
            listed = self.scope.parameters(self.document, part.rest)
            self.scope.predicates[part.head] = tuple(parameter.type for parameter in listed)
        self.static = set(self.scope.predicates) - self.changed - self.derived

    def _functions(self, parts: Sequence[Expression]) -> None:
        for part in parts:
            if isinstance(part, Group) and part.head:
                listed = self.scope.parameters(self.document, part.rest)
                self.scope.functions[part.head] = tuple(parameter.type for parameter in listed)

    def domain(self, functions: TaskFunctions) -> Domain:
        """The domain: everything that was declared, with the actions and axioms; `functions`
        are those of the task.
        """
        names = self.scope.names
        self.functions = self.conditions.numbers.functions = functions
        operators = tuple(self._action(group) for group in self._all(":action"))
        rules = tuple(rule for group in self._all(":derived") for rule in self._axiom(group))
        constants = {names.of("object", name): type_ for name, type_ in self.constants.items()}
        return Domain(
            self._name(),
            self.scope.types,
            {},
            constants,
            {
                predicate.name: predicate
                for predicate in (*self._signatures(), *_universal_predicates(rules))
            },
            operators,
            rules=rules,
            asp=tuple(part for union in self.scope.unions.values() for part in union),
            path=self.document.file.path,
            quantities={
                name: Quantity(name, None, None)
                for name in map(self._predicate, sorted(functions.changing))
            },
        )

    def _predicate(self, name: str) -> str:
        return self.scope.names.of("predicate", name)

    def _name(self) -> str:
        group = next(iter(self._all("domain")), None)
        word = group.rest[0] if group and group.rest else None
        return word.text if isinstance(word, PddlWord) else "domain"

    def _signatures(self) -> Iterator[Predicate]:
        names = self.scope.names
        for name, types in self.scope.predicates.items():
            kind = (
                Kind.DERIVED
                if name in self.derived
                else Kind.FLUENT
                if name in self.changed
                else Kind.STATIC
            )
            yield Predicate(names.of("predicate", name), types, kind)
        for name, types in self.scope.functions.items():
            if name not in self.functions.ignored:
                kind = Kind.FLUENT if name in self.functions.changing else Kind.STATIC
                yield Predicate(names.of("predicate", name), (*types, "int"), kind)

    def _action(self, group: Group) -> Operator:
        word = group.rest[0] if group.rest else group
        if not isinstance(word, PddlWord):
            self.document.add(group, "K801", "an action needs a name")
        name = word.text if isinstance(word, PddlWord) else "action"
        listed = group.field(":parameters")
        parameters = self.scope.parameters(
            self.document, listed.parts if isinstance(listed, Group) else ()
        )
        types = {parameter.variable: parameter.type for parameter in parameters}
        needed, effect = group.field(":precondition"), group.field(":effect")
        numbers = self.conditions.numbers
        numbers.bound, numbers.outer = {}, frozenset(types)
        precondition: Condition = (
            ALWAYS_TRUE if needed is None else self.conditions.condition(needed, types)
        )
        effects = tuple(self.conditions.effects(effect, types)) if effect is not None else ()
        read = functools.partial(self.conditions.function, types=types)
        changes, apart = numbers.changes(effect, read)
        cost = numbers.cost(effect, read)
        body, values = function_bindings(numbers.bound)
        numbers.bound = None
        return Operator(
            self.scope.names.of("operator", name),
            (*parameters, *values),
            precondition,
            (*effects, *changes),
            (*body, *apart),
            (),
            None,
            cost,
            where=self.document.where(group),
        )

    def _axiom(self, group: Group) -> Iterator[Rule]:
        """The rule of a derived predicate, as one or more rules with simple bodies."""
        if len(group.rest) != 2 or not isinstance(group.rest[0], Group):
            self.document.add(group, "K801", "an axiom is (:derived (predicate ?x ...) condition)")
            return
        head, condition = group.rest[0], group.rest[1]
        parameters = self.scope.parameters(self.document, head.rest)
        types = {parameter.variable: parameter.type for parameter in parameters}
        atom = Function(
            self.scope.names.of("predicate", head.head), tuple(p.variable for p in parameters)
        )
        normaliser = Normaliser(prefix=f"axiom_{group.offset}")
        guards = tuple(_type_guard(parameter) for parameter in parameters)
        read = self.conditions.condition(condition, types)
        where = self.document.where(group)
        for disjunct in normaliser.disjuncts(And((read,)), types):
            yield Rule(atom, (*guards, *disjunct), where)
        yield from (Rule(rule.head, rule.body, where) for rule in normaliser.rules)


def _type_guard(parameter: Parameter) -> Literal:
    name = OBJECT_TYPE if parameter.type in BUILT_IN_TYPES else parameter.type
    return Literal(Function(name, (parameter.variable,)))


def _universal_predicates(rules: Sequence[Rule]) -> Iterator[Predicate]:
    """The predicates that normalisation adds for universal conditions."""
    for rule in rules:
        if rule.head.name.startswith("axiom_"):
            yield Predicate(rule.head.name, (OBJECT_TYPE,) * len(rule.head.arguments), Kind.DERIVED)


def _changeable_predicates(at: Expression | None) -> Iterator[str]:
    """The predicates that an effect can change."""
    if not isinstance(at, Group):
        return
    if at.head in ("and", "not"):
        for part in at.rest:
            yield from _changeable_predicates(part)
    elif at.head in ("when", "forall") and len(at.rest) == 2:
        yield from _changeable_predicates(at.rest[1])
    elif at.head:
        yield at.head
