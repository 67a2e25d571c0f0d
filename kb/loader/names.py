"""What every name means: types, functions, objects and predicates; and the types of variables, inferred from atoms.

Only positive occurrences narrow a variable: `not part_of(Place, drawer)` holds for a place that is no depot at all.
"""

from collections.abc import Collection, Iterable
from dataclasses import dataclass, field

from kb.diagnostics import Source, unknown_name
from kb.loader.reader import Expression, Findings
from kb.model.conditions import (
    Aggregate,
    And,
    Comparison,
    Condition,
    Exists,
    ForAll,
    Literal,
    Not,
    Or,
    Parameter,
)
from kb.model.domain import BUILT_IN_TYPES, NUMERIC_TYPES, OBJECT, FunctionSignature, Kind, Predicate, Type
from kb.terms import ANYTHING, Atom, Function, Number, Operation, Term, Text, Variable, variables


@dataclass
class Names:
    """The symbol table of a domain or of a problem on top of it."""

    findings: Findings
    types: dict[str, Type] = field(default_factory=dict)
    functions: dict[str, FunctionSignature] = field(default_factory=dict)
    objects: dict[str, str] = field(default_factory=dict)
    predicates: dict[str, Predicate] = field(default_factory=dict)

    def known_type(self, name: str) -> bool:
        """Whether a type has this name."""
        return name in self.types or name in BUILT_IN_TYPES

    def is_subtype(self, name: str, ancestor: str) -> bool:
        """Whether `name` is `ancestor` or below it."""
        if ancestor == OBJECT:
            return name not in BUILT_IN_TYPES or name == OBJECT
        seen = 0
        while name != ancestor:
            if name not in self.types or seen > len(self.types):
                return False
            name, seen = self.types[name].parent, seen + 1
        return True

    def add_object(self, name: str, type_: str, where: Source) -> None:
        """Declare an object; names are unique among objects, types and predicates' constants."""
        if name in self.objects:
            self.findings.add(where, "K104", f"object '{name}' is declared already, as {self.objects[name]}")
        else:
            self.objects[name] = type_

    def predicate(self, atom: Atom, place: Source, kinds: Collection[Kind] = tuple(Kind)) -> Predicate | None:
        """The predicate of an atom, checked for arity and kind; types serve as unary static predicates."""
        predicate = self.predicates.get(atom.name)
        if predicate is None and self.known_type(atom.name):
            predicate = Predicate(atom.name, (OBJECT,), Kind.STATIC)
        if predicate is None:
            self.findings.diagnostics.append(
                unknown_name("predicate", atom.name, [*self.predicates, *self.types], place)
            )
            return None
        if len(atom.arguments) != len(predicate.arguments):
            signature = f"{predicate.name}({', '.join(predicate.arguments)})"
            self.findings.add(
                place, "K102", f"{atom.name} takes {len(predicate.arguments)} arguments", f"it is {signature}"
            )
            return None
        if predicate.kind not in kinds:
            allowed = " or ".join(kind.value for kind in kinds)
            self.findings.add(
                place, "K108", f"'{atom.name}' is {predicate.kind.value}; here stands a {allowed} predicate"
            )
            return None
        return predicate


class Typing:
    """The types of the variables of one operator, rule or goal, narrowed atom by atom."""

    def __init__(self, names: Names, types: dict[Variable, str] | None = None) -> None:
        self.names = names
        self.types: dict[Variable, str] = dict(types or {})
        self.weak: dict[Variable, str] = {}  # from negative occurrences

    def nested(self) -> "Typing":
        """A scope inside this one: what it narrows is not seen outside."""
        inner = Typing(self.names, self.types)
        inner.weak = dict(self.weak)
        return inner

    def type_of(self, variable: Variable) -> str | None:
        """The type found for a variable, or None when no atom gives one."""
        return self.types.get(variable, self.weak.get(variable))

    def atom(
        self, atom: Atom, expression: Expression, kinds: Collection[Kind] = tuple(Kind), positive: bool = True
    ) -> None:
        """Check an atom's name, arity, kind and arguments, and narrow its variables."""
        predicate = self.names.predicate(atom, expression.place(atom), kinds)
        if predicate is None:
            return
        if atom.name in self.names.types and atom.name not in self.names.predicates:
            expected: tuple[str, ...] = (atom.name,) if positive else (OBJECT,)
        else:
            expected = predicate.arguments
        for argument, type_ in zip(atom.arguments, expected, strict=True):
            self.term(argument, type_, expression, atom, positive)

    def term(
        self, term: Term, expected: str, expression: Expression, atom: Atom, positive: bool = True
    ) -> None:
        """Check that a term can be of the expected type."""
        match term:
            case Variable():
                self._narrow(term, expected, expression, atom, positive)
            case Number() | Operation():
                if expected not in NUMERIC_TYPES:
                    self._mismatch(str(term), "a number", expected, expression, atom)
            case Text():
                if expected != "text":
                    self._mismatch(str(term), "a text", expected, expression, atom)
            case Function(name, arguments) if arguments or name in self.names.functions:
                self._compound(term, expected, expression, atom, positive)
            case Function(name):
                self._constant(term, name, expected, expression, atom)

    def _constant(self, term: Function, name: str, expected: str, expression: Expression, atom: Atom) -> None:
        actual = self.names.objects.get(name)
        if actual is None:
            known = [
                each for each, type_ in self.names.objects.items() if self.names.is_subtype(type_, expected)
            ]
            where = expression.place(term)
            self.names.findings.diagnostics.append(
                unknown_name("object", name, known or self.names.objects, where)
            )
        elif not self.names.is_subtype(actual, expected):
            self._mismatch(name, actual, expected, expression, atom)

    def _compound(
        self, term: Function, expected: str, expression: Expression, atom: Atom, positive: bool
    ) -> None:
        function = self.names.functions.get(term.name)
        if function is None:
            where = expression.place(term)
            self.names.findings.diagnostics.append(
                unknown_name("function", term.name, self.names.functions, where)
            )
            return
        if len(term.arguments) != len(function.arguments):
            message = f"{term.name} takes {len(function.arguments)} arguments"
            self.names.findings.add(expression.place(term), "K102", message)
            return
        if not self.names.is_subtype(function.result, expected):
            self._mismatch(str(term), function.result, expected, expression, atom)
        for argument, type_ in zip(term.arguments, function.arguments, strict=True):
            self.term(argument, type_, expression, atom, positive)

    def _narrow(
        self, variable: Variable, expected: str, expression: Expression, atom: Atom, positive: bool
    ) -> None:
        if variable == ANYTHING:
            return
        if not positive:
            self.weak.setdefault(variable, expected)
            return
        known = self.types.get(variable, expected)
        if self.names.is_subtype(expected, known):
            self.types[variable] = expected
        elif not self.names.is_subtype(known, expected):
            self._mismatch(str(variable), known, expected, expression, atom)

    def _mismatch(self, term: str, actual: str, expected: str, expression: Expression, atom: Atom) -> None:
        place = expression.place(atom)
        self.names.findings.add(place, "K103", f"{term} is {actual}, but {atom.name} takes {expected} here")

    def condition(
        self, condition: Condition, expression: Expression, kinds: Collection[Kind], positive: bool = True
    ) -> None:
        """Check every atom of a condition and narrow variables by the positive ones."""
        match condition:
            case Literal(atom, sign):
                self.atom(atom, expression, kinds, positive and sign)
            case And(parts) | Or(parts):
                for part in parts:
                    self.condition(part, expression, kinds, positive)
            case Not(part):
                self.condition(part, expression, kinds, not positive)
            case Exists(_, part) | ForAll(_, part):
                self.condition(part, expression, kinds, positive)
            case Comparison() | Aggregate():
                return

    def parameters(
        self, wanted: Iterable[Variable], expression: Expression, code: str = "K105"
    ) -> tuple[Parameter, ...]:
        """Typed parameters; a variable without a type is unsafe."""
        found = []
        for variable in wanted:
            type_ = self.type_of(variable)
            if type_ is None:
                hint = "use it in an atom that binds it, or name its type under `types:`"
                self.names.findings.add(
                    expression.place(variable), code, f"nothing gives variable {variable} a type", hint
                )
            found.append(Parameter(variable, type_ or OBJECT))
        return tuple(found)

    def quantified(self, condition: Condition, expression: Expression) -> Condition:
        """The condition with typed quantifiers, each `_` of a positive or negative literal being some value."""
        match condition:
            case Literal(atom, positive) if ANYTHING in variables(atom):
                return self._some(atom, positive)
            case And(parts):
                return And(tuple(self.quantified(part, expression) for part in parts))
            case Or(parts):
                return Or(tuple(self.quantified(part, expression) for part in parts))
            case Not(part):
                return Not(self.quantified(part, expression))
            case ForAll(parameters, part):
                typed = self.parameters([parameter.variable for parameter in parameters], expression)
                return ForAll(typed, self.quantified(part, expression))
            case _:
                return condition

    def _some(self, atom: Atom, positive: bool) -> Condition:
        fresh: list[Parameter] = []
        predicate = self.names.predicates.get(atom.name)
        expected = predicate.arguments if predicate else (OBJECT,) * len(atom.arguments)
        arguments = tuple(self._renamed(a, t, fresh) for a, t in zip(atom.arguments, expected, strict=False))
        some = Exists(tuple(fresh), Literal(Function(atom.name, arguments)))
        return some if positive else Not(some)

    def _renamed(self, term: Term, type_: str, fresh: list[Parameter]) -> Term:
        if term == ANYTHING:
            fresh.append(Parameter(Variable(f"_Any{len(fresh) + 1}"), type_))
            return fresh[-1].variable
        if isinstance(term, Function) and term.arguments:
            function = self.names.functions.get(term.name)
            expected = function.arguments if function else (OBJECT,) * len(term.arguments)
            inner = zip(term.arguments, expected, strict=False)
            return Function(term.name, tuple(self._renamed(a, t, fresh) for a, t in inner))
        return term
