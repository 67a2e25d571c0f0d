"""Translates unified-planning expressions into conditions of the model.

A fluent whose value is an object, such as `position(r)`, becomes a predicate with one more
argument, `position(r, V)`. Inside another expression, a variable replaces the value of the fluent.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import count

from unified_planning import model as up
from unified_planning.model import FNode, OperatorKind

from cellwright.engine.formats.interop.pddl.declared_names import NameMapping
from cellwright.kb.model.conditions import (
    ALWAYS_TRUE,
    And,
    Comparison,
    Condition,
    Exists,
    ForAll,
    Literal,
    Or,
    Parameter,
)
from cellwright.kb.terms import Atom, Function, Term, Variable

FALSE = Or(())


class Unsupported(Exception):
    """A construct that is not supported."""

    def __str__(self) -> str:
        return f"not supported: {self.args[0]}"


@dataclass
class FluentLocals:
    """Variables for the values of fluents, with the conditions that bind them."""

    parameters: list[Parameter] = field(default_factory=list)
    literals: list[Condition] = field(default_factory=list)

    def around(self, condition: Condition) -> Condition:
        """The condition together with the conditions that bind these values."""
        if not self.parameters:
            return condition
        return Exists(tuple(self.parameters), And((*self.literals, condition)))


class ConditionTranslator:
    """Translates expressions with one set of names."""

    def __init__(self, names: NameMapping) -> None:
        self.names, self._fresh = names, count(1)
        # the quantified variables that may be named at a place
        self._bound: dict[up.Variable, Variable] = {}
        self._table: dict[OperatorKind, Callable[[FNode, bool], Condition]] = {
            OperatorKind.AND: lambda at, positive: self._joined(
                at, positive, And if positive else Or
            ),
            OperatorKind.OR: lambda at, positive: self._joined(
                at, positive, Or if positive else And
            ),
            OperatorKind.NOT: lambda at, positive: self.condition(at.args[0], not positive),
            OperatorKind.IMPLIES: self._implies,
            OperatorKind.IFF: self._iff,
            OperatorKind.EXISTS: lambda at, positive: self._some(
                at, positive, Exists if positive else ForAll
            ),
            OperatorKind.FORALL: lambda at, positive: self._some(
                at, positive, ForAll if positive else Exists
            ),
            OperatorKind.FLUENT_EXP: self._fluent,
            OperatorKind.BOOL_CONSTANT: lambda at, positive: (
                ALWAYS_TRUE if at.bool_constant_value() == positive else FALSE
            ),
            OperatorKind.EQUALS: self._equals,
        }

    def condition(self, at: FNode, positive: bool = True) -> Condition:
        """The condition that a Boolean expression is true, or false if `positive` is False. Only
        literals are negated.

        A fluent of objects has exactly one value. So a claim about it is false if the opposite
        holds for that value. Raises `Unsupported`.
        """
        if at.node_type not in self._table:
            raise Unsupported(f"the expression {at}")
        return self._table[at.node_type](at, positive)

    def _joined(self, at: FNode, positive: bool, join: type[And | Or]) -> Condition:
        return join(tuple(self.condition(part, positive) for part in at.args))

    def _some(self, at: FNode, positive: bool, quantifier: type[Exists | ForAll]) -> Condition:
        with self.quantified(at.variables()) as parameters:
            return quantifier(parameters, self.condition(at.args[0], positive))

    def _implies(self, at: FNode, positive: bool) -> Condition:
        premise, conclusion = at.args
        parts = (self.condition(premise, not positive), self.condition(conclusion, positive))
        return Or(parts) if positive else And(parts)

    def _iff(self, at: FNode, positive: bool) -> Condition:
        first, second = at.args
        return Or(
            tuple(
                And((self.condition(first, truth), self.condition(second, truth == positive)))
                for truth in (True, False)
            )
        )

    def _fluent(self, at: FNode, positive: bool) -> Condition:
        fluent_locals = FluentLocals()
        return fluent_locals.around(Literal(self.atom(at, fluent_locals), positive))

    def _equals(self, at: FNode, positive: bool) -> Condition:
        fluent_side, value_side = at.args if at.args[0].is_fluent_exp() else reversed(at.args)
        fluent_locals = FluentLocals()
        value = self.term(value_side, fluent_locals)
        if fluent_side.is_fluent_exp():
            return fluent_locals.around(
                Literal(self.atom(fluent_side, fluent_locals, value), positive)
            )
        return fluent_locals.around(
            Comparison(self.term(fluent_side, fluent_locals), "=" if positive else "!=", value)
        )

    def atom(self, at: FNode, fluent_locals: FluentLocals, *value: Term) -> Atom:
        """The atom of a fluent expression; `value` is the value claimed for a fluent of objects."""
        arguments = tuple(self.term(argument, fluent_locals) for argument in at.args)
        return Function(self.names.of("predicate", at.fluent().name), (*arguments, *value))

    def term(self, at: FNode, fluent_locals: FluentLocals) -> Term:
        """A term. Values of fluents become variables, which are added to `found`.

        Raises `Unsupported`.
        """
        if at.is_object_exp():
            return Function(self.names.of("object", at.object().name))
        if at.is_parameter_exp():
            return self.parameter(at.parameter()).variable
        if at.is_variable_exp():
            return self._bound[at.variable()]
        if not at.is_fluent_exp():
            raise Unsupported(f"the value {at}")
        fluent = at.fluent()
        fresh = self.fresh(fluent.name)
        atom = self.atom(at, fluent_locals, fresh)
        fluent_locals.parameters.append(Parameter(fresh, self.type(fluent.type)))
        fluent_locals.literals.append(Literal(atom))
        return fresh

    def fresh(self, like: str) -> Variable:
        """A variable that is used nowhere else."""
        return self.names.variable(f"{like} value {next(self._fresh)}")

    def parameter(self, parameter: up.Parameter) -> Parameter:
        """A parameter of an action."""
        return Parameter(self.names.variable(parameter.name), self.type(parameter.type))

    @contextmanager
    def quantified(self, variables: Iterable[up.Variable]) -> Iterator[tuple[Parameter, ...]]:
        """A context in which quantified variables stand for new parameters, which differ from
        all others of the same name.
        """
        outer = dict(self._bound)
        own = [
            (
                variable,
                Parameter(
                    self.names.another(f"{variable.name} quantified"), self.type(variable.type)
                ),
            )
            for variable in variables
        ]
        self._bound |= {each: parameter.variable for each, parameter in own}
        yield tuple(parameter for _, parameter in own)
        self._bound = outer

    def type(self, type_: up.Type) -> str:
        """The name of a user type. Raises `Unsupported` for numbers and truth values."""
        if not type_.is_user_type():
            raise Unsupported(f"the type {type_} of a parameter or value")
        return self.names.of("type", type_.name)
