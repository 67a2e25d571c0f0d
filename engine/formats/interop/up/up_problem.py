"""Translates a unified-planning problem into the model: fluents, actions, goals and costs."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations_with_replacement, product
from math import lcm

from unified_planning import model as up
from unified_planning.model.fluent import get_all_fluent_exp
from unified_planning.model.walkers import Simplifier

from cellwright.engine.formats.interop.pddl.declared_names import NameMapping
from cellwright.engine.formats.interop.up.up_conditions import (
    ConditionTranslator,
    FluentLocals,
    Unsupported,
)
from cellwright.engine.formats.interop.up.up_kinds import refuse_other_kinds
from cellwright.kb.model.condition_forms import bind_variables
from cellwright.kb.model.conditions import (
    ALWAYS_TRUE,
    And,
    Body,
    Comparison,
    Condition,
    Exists,
    Literal,
    Not,
    Parameter,
    goal_parts,
)
from cellwright.kb.model.domain_model import (
    OBJECT_TYPE,
    Domain,
    Effect,
    Kind,
    Operator,
    Predicate,
    Type,
)
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import (
    Atom,
    Function,
    Number,
    Term,
    Variable,
    substitute_atom,
    substitute_term,
)

Row = tuple[str, ...]  # names of objects


@dataclass(frozen=True, slots=True)
class CostTable:
    """The cost of an action for each choice of objects for its parameters at the positions
    `columns`.
    """

    columns: tuple[int, ...]
    costs: Mapping[Row, Fraction]


@dataclass(frozen=True, slots=True)
class ActionCosts:
    """The tables of all actions, and the factor that makes every cost a whole number."""

    tables: Mapping[str, CostTable]
    scale: int

    def of(self, action: str, objects: Row) -> Fraction:
        """The cost of an action with these objects."""
        table = self.tables[action]
        return table.costs[tuple(objects[column] for column in table.columns)]


def action_costs(problem: up.Problem) -> ActionCosts | None:
    """The costs that a problem minimises; None if every action costs the same. Raises
    `Unsupported`.
    """
    if len(problem.quality_metrics) > 1:
        raise Unsupported("more than one quality metric")
    metric = next(iter(problem.quality_metrics), None)
    if metric is None or not metric.is_minimize_action_costs():
        return None
    simplifier = Simplifier(problem.environment, problem)
    tables = {
        action.name: _cost_table(problem, action, metric, simplifier) for action in problem.actions
    }
    everything = [cost for table in tables.values() for cost in table.costs.values()]
    if any(cost < 0 for cost in everything):
        raise Unsupported("negative costs")
    return ActionCosts(tables, lcm(*(cost.denominator for cost in everything)))


def _cost_table(
    problem: up.Problem,
    action: up.Action,
    metric: up.metrics.MinimizeActionCosts,
    simplifier: Simplifier,
) -> CostTable:
    cost = metric.get_action_cost(action)
    if cost is None:
        return CostTable((), {(): Fraction(0)})
    used = set(_parameters_in(cost))
    columns = tuple(place for place, parameter in enumerate(action.parameters) if parameter in used)
    chosen = [action.parameters[place] for place in columns]
    rows: dict[Row, Fraction] = {}
    for objects in product(*(list(problem.objects(parameter.type)) for parameter in chosen)):
        value = simplifier.simplify(cost.substitute(dict(zip(chosen, objects, strict=True))))
        if not (value.is_int_constant() or value.is_real_constant()):
            raise Unsupported(f"the cost {cost}, which is not a static number")
        rows[tuple(chosen_object.name for chosen_object in objects)] = Fraction(
            value.constant_value()
        )
    return CostTable(columns, rows)


def _parameters_in(at: up.FNode) -> Iterator[up.Parameter]:
    if at.is_parameter_exp():
        yield at.parameter()
    for argument in at.args:
        yield from _parameters_in(argument)


@dataclass(frozen=True, slots=True)
class FluentAssignment:
    """The assignment of a value to a fluent of objects, for every binding of `parameters` that
    satisfies `condition`.

    `place` is the fluent without its value.
    """

    place: Atom
    value: Term
    type: str
    parameters: tuple[Parameter, ...]
    condition: Condition


class EffectTranslator:
    """Translates the effects of one action.

    Its `precondition` may name the values that fluents have before.
    """

    def __init__(self, conditions: ConditionTranslator, precondition: Condition) -> None:
        self.conditions, self.assignments = conditions, list[FluentAssignment]()
        self._given = [
            p.atom for p in goal_parts(precondition) if isinstance(p, Literal) and p.positive
        ]  # conditions that hold before

    def effects(self, effects: Sequence[up.Effect]) -> tuple[Effect, ...]:
        """All effects. Assignments are also stored, for `consistency`. Raises `Unsupported`."""
        return tuple(model_effect for effect in effects for model_effect in self._effect(effect))

    def _effect(self, effect: up.Effect) -> Iterator[Effect]:
        if not effect.is_assignment():
            raise Unsupported(f"the numeric effect {effect}")
        with self.conditions.quantified(effect.forall) as parameters:
            yield from self._under(effect, FluentLocals(list(parameters)))

    def _under(self, effect: up.Effect, found: FluentLocals) -> Iterator[Effect]:
        """An effect for each binding of the parameters in `found`."""
        condition = (
            self.conditions.condition(effect.condition) if effect.is_conditional() else ALWAYS_TRUE
        )
        atom = self.conditions.atom(effect.fluent, found)
        if effect.fluent.fluent().type.is_bool_type():
            yield from self._truth(atom, effect.value, found, condition)
        else:
            yield from self._assign(atom, effect, found, condition)

    def _truth(
        self, atom: Atom, value: up.FNode, fluent_locals: FluentLocals, condition: Condition
    ) -> Iterator[Effect]:
        """The effects that make a fluent true, false, or equal to the value that an expression
        had.
        """
        parameters = tuple(fluent_locals.parameters)
        if value.is_bool_constant():
            yield Effect(
                atom,
                value.bool_constant_value(),
                parameters,
                _conjoin(*fluent_locals.literals, condition),
            )
            return
        for truth in (True, False):
            reason = self.conditions.condition(value, truth)
            yield Effect(
                atom, truth, parameters, _conjoin(*fluent_locals.literals, condition, reason)
            )

    def _assign(
        self, place: Atom, effect: up.Effect, fluent_locals: FluentLocals, condition: Condition
    ) -> Iterator[Effect]:
        """Add the new value and delete every other value, or only the former value if it is
        known.
        """
        value, type_ = (
            self.conditions.term(effect.value, fluent_locals),
            self.conditions.type(effect.fluent.fluent().type),
        )
        parameters, condition = (
            tuple(fluent_locals.parameters),
            _conjoin(*fluent_locals.literals, condition),
        )
        self.assignments.append(FluentAssignment(place, value, type_, parameters, condition))
        yield Effect(_with_value(place, value), True, parameters, condition)
        former = [
            atom
            for atom in self._given
            if atom.name == place.name and atom.arguments[:-1] == place.arguments
        ]
        if former:
            yield Effect(former[0], False, parameters, condition)
            return
        other_value = self.conditions.fresh(place.name)
        differs = Comparison(other_value, "!=", value)
        yield Effect(
            _with_value(place, other_value),
            False,
            (*parameters, Parameter(other_value, type_)),
            _conjoin(condition, differs),
        )

    def consistency(self) -> Iterator[Condition]:
        """Conditions that no two assignments give a fluent different values.

        If they would, the action is not applicable.
        """
        for first, second in combinations_with_replacement(self.assignments, 2):
            if first.place.name == second.place.name and (first is not second or first.parameters):
                yield self._agree(first, second)

    def _agree(self, first: FluentAssignment, second: FluentAssignment) -> Condition:
        apart: dict[Variable, Term] = {
            p.variable: self.conditions.fresh(p.variable.name) for p in second.parameters
        }
        renamed = tuple(
            Parameter(variable, parameter.type)  # type: ignore[arg-type]
            for parameter, variable in zip(second.parameters, apart.values(), strict=True)
        )
        place, value = substitute_atom(second.place, apart), substitute_term(second.value, apart)
        same = (
            Comparison(a, "=", b)
            for a, b in zip(first.place.arguments, place.arguments, strict=True)
        )
        differs = Comparison(first.value, "!=", value)
        clash = _conjoin(first.condition, bind_variables(second.condition, apart), *same, differs)
        parameters = (*first.parameters, *renamed)
        return Not(Exists(parameters, clash) if parameters else clash)


def _with_value(place: Atom, value: Term) -> Atom:
    return Function(place.name, (*place.arguments, value))


def _conjoin(*parts: Condition) -> Condition:
    kept = tuple(part for part in parts if part != ALWAYS_TRUE)
    return kept[0] if len(kept) == 1 else And(kept)


UP_COST_VARIABLE = Variable("Cost__")


@dataclass(frozen=True, slots=True)
class Translated:
    """A problem in our model, with what is needed to translate plans back."""

    theirs: up.Problem
    ours: Problem
    names: NameMapping
    costs: ActionCosts | None


def translate_problem(problem: up.Problem) -> Translated:
    """The problem in our model.

    Raises `Unsupported` if it contains something that is not supported.
    """
    refuse_other_kinds(problem)
    return _Translation(problem).result()


class _Translation:
    def __init__(self, problem: up.Problem) -> None:
        self.problem, self.names = problem, NameMapping()
        self.conditions = ConditionTranslator(self.names)
        self.costs = action_costs(problem)
        self.static = problem.get_static_fluents()
        self.statics: list[Atom] = []
        self.initial: list[Atom] = []

    def result(self) -> Translated:
        """The translation. Names are given in a fixed order, so that the same problem always
        gets the same translation.
        """
        domain = Domain(
            "domain",
            {user_type.name: user_type for user_type in map(self._type, self.problem.user_types)},
            {},
            {
                self.names.of("object", problem_object.name): self.conditions.type(
                    problem_object.type
                )
                for problem_object in self.problem.all_objects
            },
            {predicate.name: predicate for predicate in self._predicates()},
            tuple(map(self._operator, self.problem.actions)),
        )
        for fluent in self.problem.fluents:
            facts = self.statics if fluent in self.static else self.initial
            facts += self._facts(fluent)
        goals = (
            self.conditions.condition(part_goal)
            for goal in self.problem.goals
            for part_goal in self._split(goal)
        )
        statics, initial = tuple(self.statics), tuple(self.initial)
        name = self.problem.name or "problem"
        ours = Problem(name, domain, {}, statics, initial, And(tuple(goals)), complete=True)
        return Translated(self.problem, ours, self.names, self.costs)

    def _type(self, type_: up.Type) -> Type:
        parent = self.conditions.type(type_.father) if type_.father else OBJECT_TYPE
        return Type(self.conditions.type(type_), parent)

    def _predicates(self) -> Iterator[Predicate]:
        for fluent in self.problem.fluents:
            if _is_in_state(fluent):
                types = [self.conditions.type(parameter.type) for parameter in fluent.signature]
                types += [] if fluent.type.is_bool_type() else [self.conditions.type(fluent.type)]
                kind = Kind.STATIC if fluent in self.static else Kind.FLUENT
                yield Predicate(self.names.of("predicate", fluent.name), tuple(types), kind)
        for name, table in self.costs.tables.items() if self.costs else ():
            action = self.problem.action(name)
            types = [
                self.conditions.type(action.parameters[column].type) for column in table.columns
            ]
            yield Predicate(self._price(name), (*types, "int"), Kind.STATIC)

    def _price(self, action: str) -> str:
        """The static predicate that holds the cost of an action."""
        return self.names.of("predicate", f"cost of {action}")

    def _facts(self, fluent: up.Fluent) -> Iterator[Atom]:
        """The true atoms of a fluent at the start.

        If it is false by default, only the explicit initial values are read.
        """
        if not _is_in_state(fluent):
            return
        truth = fluent.type.is_bool_type()
        default = self.problem.fluents_defaults.get(fluent)
        if truth and default is not None and default.is_false():
            values = {
                at: v
                for at, v in self.problem.explicit_initial_values.items()
                if at.fluent() == fluent
            }
        else:
            values = {
                at: self.problem.initial_value(at)
                for at in get_all_fluent_exp(self.problem, fluent)
            }
        for at, value in values.items():
            if truth and value.is_true():
                yield self.conditions.atom(at, FluentLocals())
            elif not truth:
                yield self.conditions.atom(
                    at, FluentLocals(), self.conditions.term(value, FluentLocals())
                )

    def _split(self, goal: up.FNode) -> Iterator[up.FNode]:
        """A universal goal as one goal per object, so that the ways to satisfy each need not be
        combined.
        """
        if goal.is_and():
            yield from (part_goal for part in goal.args for part_goal in self._split(part))
        elif goal.is_forall():
            chosen = goal.variables()
            for objects in product(
                *(list(self.problem.objects(variable.type)) for variable in chosen)
            ):
                yield from self._split(
                    goal.args[0].substitute(dict(zip(chosen, objects, strict=True)))
                )
        else:
            yield goal

    def _operator(self, action: up.Action) -> Operator:
        if not isinstance(action, up.InstantaneousAction) or action.simulated_effect is not None:
            raise Unsupported(
                f"the action {action.name}, which is not instantaneous or is simulated"
            )
        precondition = And(tuple(map(self.conditions.condition, action.preconditions)))
        effects = EffectTranslator(self.conditions, precondition)
        model_effects = effects.effects(action.effects)
        parameters = tuple(map(self.conditions.parameter, action.parameters))
        body, cost = self._cost(action.name, parameters)
        return Operator(
            self.names.of("operator", action.name),
            (*parameters, Parameter(UP_COST_VARIABLE, "int")) if body else parameters,
            And((*precondition.parts, *effects.consistency())),
            model_effects,
            body,
            cost=cost,
        )

    def _cost(self, action: str, parameters: tuple[Parameter, ...]) -> tuple[Body, Term | None]:
        """The cost of an action: a number, or a table over the parameters that determine it.

        Its facts are added to the statics.
        """
        if self.costs is None:
            return (), None
        table, name = self.costs.tables[action], self._price(action)
        whole = {row: Number(int(cost * self.costs.scale)) for row, cost in table.costs.items()}
        if not table.columns:
            return (), whole[()]
        for row, number in whole.items():
            objects = (Function(self.names.of("object", object_name)) for object_name in row)
            self.statics.append(Function(name, (*objects, number)))
        chosen = (parameters[column].variable for column in table.columns)
        return (Literal(Function(name, (*chosen, UP_COST_VARIABLE))),), UP_COST_VARIABLE


def _is_in_state(fluent: up.Fluent) -> bool:
    """Whether a fluent is part of the state.

    Static numbers are not: only costs use them, and costs are computed beforehand.
    """
    return bool(fluent.type.is_bool_type() or fluent.type.is_user_type())
