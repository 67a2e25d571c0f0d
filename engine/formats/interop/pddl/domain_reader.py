"""Reads the domain file of a PDDL task: declarations, actions and axioms."""

import functools
from collections.abc import Iterable, Iterator, Mapping, Sequence

from cellwright.engine.formats.interop.pddl.declared_names import PddlScope, read_typed_list, spaced
from cellwright.engine.formats.interop.pddl.expressions import Document, Expression, Group, PddlWord
from cellwright.engine.formats.interop.pddl.keywords import (
    ACTION_FIELDS,
    check_actions,
    check_sections,
)
from cellwright.engine.formats.interop.pddl.number_reader import function_bindings
from cellwright.engine.formats.interop.pddl.numeric_functions import TaskFunctions
from cellwright.engine.formats.interop.pddl.pddl_conditions import ConditionReader
from cellwright.kb.graphs import strong_components
from cellwright.kb.model.condition_forms import Normaliser
from cellwright.kb.model.conditions import ALWAYS_TRUE, And, Condition, Literal, Parameter
from cellwright.kb.model.domain_model import (
    BUILT_IN_TYPES,
    OBJECT_TYPE,
    Domain,
    Effect,
    Kind,
    Operator,
    Predicate,
    Quantity,
    Rule,
    Type,
)
from cellwright.kb.terms import Function, Variable


class DomainReader:
    """Reads a domain in two passes: declarations, then actions and axioms."""

    kind = "domain"  # of file, for the sections that it may have

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
        check_sections(self.document, self.kind)
        check_actions(
            self.document, [group for group in self.groups if group.head in ACTION_FIELDS]
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
        """The types, and their parents, which need no declaration of their own.

        All parents of a type count.
        """
        names, listed = self.scope.names, list(read_typed_list(self.document, parts))
        above = [(word, parent) for word, at in listed for parent in _parents(at)]
        for word in (*(word for word, _ in listed), *(parent for _, parent in above)):
            if word.text != OBJECT_TYPE:
                name = names.of("type", word.text)
                self.scope.types.setdefault(
                    name, Type(name, OBJECT_TYPE, (), self.document.where(word))
                )
        for _, at in listed:
            if isinstance(at, Group) and at.head != "either":
                self.document.add(at, "K801", "a type is a name or (either ...)")
        for word, parent in above:
            self._put_under(word, parent)

    def _put_under(self, word: PddlWord, parent: PddlWord) -> None:
        """Make a type a part of another one."""
        names = self.scope.names
        if parent.text == OBJECT_TYPE:
            return
        if word.text == OBJECT_TYPE:
            self.document.add(
                word, "K109", f"object is above every type, also above '{parent.text}'"
            )
        elif self.scope.is_subtype(
            names.of("type", parent.text), name := names.of("type", word.text)
        ):
            self.document.add(word, "K109", f"type '{word.text}' is defined by itself")
        else:
            self.scope.put_under(name, names.of("type", parent.text))

    def declare_objects(
        self, document: Document, parts: Sequence[Expression], into: dict[str, str]
    ) -> None:
        """The objects of a typed list, by PDDL name.

        An object that is declared under several types is of all of them.
        """
        for word, at in read_typed_list(document, parts):
            if isinstance(at, Group) and at.head == "either":
                hint = "name the types of the object one by one"
                document.add(
                    at, "K802", "an object of an undecided type (either ...) is not supported", hint
                )
                continue
            type_ = OBJECT_TYPE if at is None else self.scope.type_of(document, at)
            if (known := self.scope.objects.get(word.text)) is not None:
                type_ = self.scope.common((known, type_))
            self.scope.objects[word.text] = type_
            (self.constants if word.text in self.constants else into)[word.text] = type_

    def _predicates(self, parts: Sequence[Expression]) -> None:
        for part in parts:
            if not isinstance(part, Group) or not part.head:
                self.document.add(part, "K801", "a predicate is declared as (name ?x - type ...)")
                continue
            if part.head in self.scope.predicates:
                self.document.add(part, "K104", f"predicate '{part.head}' is declared twice")
            self.scope.predicates[part.head] = self.scope.signature(self.document, part.rest)
        self.static = set(self.scope.predicates) - self.changed - self.derived

    def _functions(self, parts: Sequence[Expression]) -> None:
        """The functions, each of which is a number. Functions that are objects are refused."""
        waiting: list[Group] = []  # those whose type has not come yet
        rest = iter(spaced(parts))
        for part in rest:
            if isinstance(part, Group) and part.head:
                waiting.append(part)
            elif isinstance(part, PddlWord) and part.text == "-":
                self._numeric(part, next(rest, None), waiting)
                waiting = []
            else:
                hint = "write (:functions (name ?x - type ...) ...)"
                self.document.add(part, "K801", "a function is declared in parentheses", hint)
        for part in (each for each in parts if isinstance(each, Group) and each.head):
            if part.head in self.scope.functions:
                self.document.add(part, "K104", f"function '{part.head}' is declared twice")
            self.scope.functions[part.head] = self.scope.signature(self.document, part.rest)

    def _numeric(
        self, hyphen: PddlWord, type_: Expression | None, functions: Sequence[Group]
    ) -> None:
        """Refuse functions of another type than `number`."""
        if type_ is None or not functions:
            self.document.add(hyphen, "K801", "'-' stands between functions and their type")
        elif not isinstance(type_, PddlWord) or type_.text != "number":
            hint = "no times, preferences, constraints and object fluents are read"
            self.document.add(type_, "K802", "object fluents are not supported", hint)

    def domain(self, functions: TaskFunctions) -> Domain:
        """The domain: everything that was declared, with the actions and axioms; `functions`
        are those of the task.
        """
        names = self.scope.names
        self.functions = self.conditions.numbers.functions = functions
        operators = tuple(
            operator for group in self._all(":action") for operator in self._action(group)
        )
        read = [(group, tuple(self._axiom(group))) for group in self._all(":derived")]
        rules = tuple(rule for _, own in read for rule in own)
        self._refuse_cycles(read, rules)
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
            path=self.document.file.path,
            quantities={
                name: Quantity(name, None, None)
                for name in (names.of("function", part) for part in sorted(functions.changing))
            },
            unit_of_cost=functions.unit_of_cost,
            further_parents=self.scope.further,
        )

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
                yield Predicate(names.of("function", name), (*types, "int"), kind)
            if name in self.functions.changing & self.functions.partial:
                yield Predicate(names.of("predicate", f"{name} has a value"), types, Kind.FLUENT)

    def _action(self, group: Group) -> Iterator[Operator]:
        """The action as operators: one for each way in which the numbers that it changes may be
        the same one.
        """
        word = group.rest[0] if group.rest else group
        if not isinstance(word, PddlWord):
            self.document.add(group, "K801", "an action needs a name")
        name = word.text if isinstance(word, PddlWord) else "action"
        listed = group.field(":parameters")
        known = self.scope.parameters(
            self.document, listed.parts if isinstance(listed, Group) else ()
        )
        parameters = tuple(known.values())
        types = {parameter.variable: parameter.type for parameter in parameters}
        needed, effect = group.field(":precondition"), group.field(":effect")
        numbers = self.conditions.numbers
        numbers.bound, numbers.outer, numbers.needed = {}, frozenset(types), True
        precondition: Condition = (
            ALWAYS_TRUE if needed is None else self.conditions.condition(needed, known)
        )
        numbers.needed = False
        effects = tuple(self.conditions.effects(effect, known)) if effect is not None else ()
        self._refuse_derived(effects, effect or group)
        read = functools.partial(self.conditions.function, known=known)
        numbers.needed = True
        changes = numbers.changes(effect, read, functools.partial(self._may_be_same, types))
        cost = numbers.cost(effect, read)
        body, values = function_bindings(numbers.bound)
        numbers.bound = None
        for number, change in enumerate(changes):
            yield Operator(
                (self.scope.names.variant if number else self.scope.names.of)("operator", name),
                (*parameters, *values),
                And((*change.defined, precondition)) if change.defined else precondition,
                (*effects, *change.effects),
                (*body, *change.body),
                (),
                None,
                cost,
                where=self.document.where(group),
            )

    def _refuse_derived(self, effects: Iterable[Effect], at: Expression) -> None:
        """Report effects on derived predicates: only axioms say where these are true (Edelkamp
        & Hoffmann 2004).
        """
        changed = {self.scope.names.original("predicate", effect.atom.name) for effect in effects}
        for name in sorted(changed & self.derived):
            message = f"'{name}' is derived: no effect can change it"
            self.document.add(at, "K103", message, "change what it follows from")

    def _may_be_same(self, types: Mapping[Variable, str], one: Function, other: Function) -> bool:
        pairs = zip(one.arguments, other.arguments, strict=True)
        return all(self.scope.may_be_same(*pair, types) for pair in pairs)

    def _refuse_cycles(
        self, read: Sequence[tuple[Group, Sequence[Rule]]], rules: Sequence[Rule]
    ) -> None:
        """Report axioms whose predicate depends on its own negation.

        A predicate under `forall` is read by two negations.
        """
        graph: dict[str, list[str]] = {}
        for rule in rules:
            graph.setdefault(rule.head.name, []).extend(each.atom.name for each in _literals(rule))
        places = {
            name: place for place, part in enumerate(strong_components(graph)) for name in part
        }
        for group, own in read:
            for rule in own:
                place = places[rule.head.name]
                if any(
                    not each.positive and places.get(each.atom.name) == place
                    for each in _literals(rule)
                ):
                    message = (
                        "this axiom is not supported: it depends on itself under 'not' or 'forall'"
                    )
                    self.document.add(
                        group, "K802", message, "let it depend on itself only as it is"
                    )
                    break

    def _axiom(self, group: Group) -> Iterator[Rule]:
        """The rule of a derived predicate, as one or more rules with simple bodies."""
        if len(group.rest) != 2 or not isinstance(group.rest[0], Group):
            self.document.add(group, "K801", "an axiom is (:derived (predicate ?x ...) condition)")
            return
        head, condition = group.rest[0], group.rest[1]
        known = self.scope.parameters(self.document, head.rest)
        parameters = tuple(known.values())
        types = {parameter.variable: parameter.type for parameter in parameters}
        atom = Function(
            self.scope.names.of("predicate", head.head), tuple(p.variable for p in parameters)
        )
        normaliser = Normaliser(prefix=f"axiom_{group.offset}")
        guards = tuple(_type_guard(parameter) for parameter in parameters)
        read = self.conditions.condition(condition, known)
        where = self.document.where(group)
        for disjunct in normaliser.disjuncts(And((read,)), types):
            yield Rule(atom, (*guards, *disjunct), where)
        yield from (Rule(rule.head, rule.body, where) for rule in normaliser.rules)


def _literals(rule: Rule) -> Iterator[Literal]:
    return (part for part in rule.body if isinstance(part, Literal))


def _parents(at: Expression | None) -> Iterator[PddlWord]:
    """The parents in a list of types: a name, or all in `(either ...)`."""
    if isinstance(at, PddlWord):
        yield at
    elif at is not None and at.head == "either":
        yield from (part for part in at.rest if isinstance(part, PddlWord))


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
