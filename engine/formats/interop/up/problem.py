"""Translation of a unified-planning problem into the model: types, fluents, actions, initial values, goals and costs."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

from unified_planning import model as up
from unified_planning.model.fluent import get_all_fluent_exp

from cellwright.engine.formats.interop.pddl.names import NameMapping
from cellwright.engine.formats.interop.up.conditions import ConditionTranslator, Locals, Unsupported
from cellwright.engine.formats.interop.up.costs import Costs, costs
from cellwright.engine.formats.interop.up.effects import EffectTranslator
from cellwright.kb.model.conditions import And, Body, Literal, Parameter
from cellwright.kb.model.domain import OBJECT, Domain, Kind, Operator, Predicate, Type
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Atom, Function, Number, Term, Variable

COST = Variable("Cost__")


@dataclass(frozen=True, slots=True)
class Translated:
    """A problem in our model, with what is needed to translate plans back."""

    theirs: up.Problem
    ours: Problem
    names: NameMapping
    costs: Costs | None


def translated(problem: up.Problem) -> Translated:
    """The problem in our model. Raises `Unsupported` if it contains something that is not supported."""
    return _Translation(problem).result()


class _Translation:
    def __init__(self, problem: up.Problem) -> None:
        self.problem, self.names = problem, NameMapping()
        self.conditions = ConditionTranslator(self.names)
        self.costs = costs(problem)
        self.static = problem.get_static_fluents()
        self.statics: list[Atom] = []
        self.initial: list[Atom] = []

    def result(self) -> Translated:
        """The translation. Names are given in a fixed order, so that the same problem always gets the same translation."""
        domain = Domain(
            "domain",
            {each.name: each for each in map(self._type, self.problem.user_types)},
            {},
            {
                self.names.of("object", each.name): self.conditions.type(each.type)
                for each in self.problem.all_objects
            },
            {each.name: each for each in self._predicates()},
            tuple(map(self._operator, self.problem.actions)),
        )
        for fluent in self.problem.fluents:
            facts = self.statics if fluent in self.static else self.initial
            facts += self._facts(fluent)
        goals = (self.conditions.condition(each) for goal in self.problem.goals for each in self._split(goal))
        statics, initial = tuple(self.statics), tuple(self.initial)
        name = self.problem.name or "problem"
        ours = Problem(name, domain, {}, statics, initial, And(tuple(goals)), complete=True)
        return Translated(self.problem, ours, self.names, self.costs)

    def _type(self, type_: up.Type) -> Type:
        parent = self.conditions.type(type_.father) if type_.father else OBJECT
        return Type(self.conditions.type(type_), parent)

    def _predicates(self) -> Iterator[Predicate]:
        for fluent in self.problem.fluents:
            if _counts(fluent):
                types = [self.conditions.type(each.type) for each in fluent.signature]
                types += [] if fluent.type.is_bool_type() else [self.conditions.type(fluent.type)]
                kind = Kind.STATIC if fluent in self.static else Kind.FLUENT
                yield Predicate(self.names.of("predicate", fluent.name), tuple(types), kind)
        for name, table in self.costs.tables.items() if self.costs else ():
            action = self.problem.action(name)
            types = [self.conditions.type(action.parameters[column].type) for column in table.columns]
            yield Predicate(self._price(name), (*types, "int"), Kind.STATIC)

    def _price(self, action: str) -> str:
        """The static predicate that holds the cost of an action."""
        return self.names.of("predicate", f"cost of {action}")

    def _facts(self, fluent: up.Fluent) -> Iterator[Atom]:
        """The true atoms of a fluent at the start. If it is false by default, only the explicit initial values are read."""
        if not _counts(fluent):
            return
        truth = fluent.type.is_bool_type()
        default = self.problem.fluents_defaults.get(fluent)
        if truth and default is not None and default.is_false():
            values = {
                at: v for at, v in self.problem.explicit_initial_values.items() if at.fluent() == fluent
            }
        else:
            values = {at: self.problem.initial_value(at) for at in get_all_fluent_exp(self.problem, fluent)}
        for at, value in values.items():
            if truth and value.is_true():
                yield self.conditions.atom(at, Locals())
            elif not truth:
                yield self.conditions.atom(at, Locals(), self.conditions.term(value, Locals()))

    def _split(self, goal: up.FNode) -> Iterator[up.FNode]:
        """A universal goal as one goal per object, so that the ways to satisfy each need not be combined."""
        if goal.is_and():
            yield from (each for part in goal.args for each in self._split(part))
        elif goal.is_forall():
            chosen = goal.variables()
            for objects in product(*(list(self.problem.objects(each.type)) for each in chosen)):
                yield from self._split(goal.args[0].substitute(dict(zip(chosen, objects, strict=True))))
        else:
            yield goal

    def _operator(self, action: up.Action) -> Operator:
        if not isinstance(action, up.InstantaneousAction) or action.simulated_effect is not None:
            raise Unsupported(f"the action {action.name}, which is not instantaneous or is simulated")
        precondition = And(tuple(map(self.conditions.condition, action.preconditions)))
        effects = EffectTranslator(self.conditions, precondition)
        made = effects.effects(action.effects)
        parameters = tuple(map(self.conditions.parameter, action.parameters))
        body, cost = self._cost(action.name, parameters)
        return Operator(
            self.names.of("operator", action.name),
            (*parameters, Parameter(COST, "int")) if body else parameters,
            And((*precondition.parts, *effects.consistency())),
            made,
            body,
            cost=cost,
        )

    def _cost(self, action: str, parameters: tuple[Parameter, ...]) -> tuple[Body, Term | None]:
        """The cost of an action: a number, or a table over the parameters that determine it. Its facts are added to the statics."""
        if self.costs is None:
            return (), None
        table, name = self.costs.tables[action], self._price(action)
        whole = {row: Number(int(cost * self.costs.scale)) for row, cost in table.costs.items()}
        if not table.columns:
            return (), whole[()]
        for row, number in whole.items():
            objects = (Function(self.names.of("object", each)) for each in row)
            self.statics.append(Function(name, (*objects, number)))
        chosen = (parameters[column].variable for column in table.columns)
        return (Literal(Function(name, (*chosen, COST))),), COST


def _counts(fluent: up.Fluent) -> bool:
    """Whether a fluent is part of the state. Static numbers are not: only costs use them, and costs are computed beforehand."""
    return bool(fluent.type.is_bool_type() or fluent.type.is_user_type())
