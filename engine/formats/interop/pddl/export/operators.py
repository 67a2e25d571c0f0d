"""Flat operators: with plain parameters, tables instead of constraints, all consequences of effects, and the workflow."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from cellwright.engine.formats.interop.pddl.export.background import NotLiftable
from cellwright.engine.formats.interop.pddl.export.conditions import FALSE, Conditions, Locals, conjunction
from cellwright.engine.formats.interop.pddl.export.deduction import Closing
from cellwright.engine.formats.interop.pddl.export.stages import Stages
from cellwright.kb.model.bindings import free_variables
from cellwright.kb.model.conditions import (
    TRUE,
    Aggregate,
    BodyPart,
    Comparison,
    Condition,
    Literal,
    Parameter,
    goal_parts,
)
from cellwright.kb.model.domain import NUMERIC_TYPES, Effect, Kind, Operator
from cellwright.kb.terms import ANYTHING, Atom, Function, Number, Operation, Term, Variable, variables

COST = Variable("Cost__")


@dataclass
class FlatOperator:
    """An operator in flat terms; the first `header` parameters are the original ones."""

    operator: Operator
    header: int
    terms: Mapping[
        Term, Variable
    ]  # compound terms of the header's variables, and the parameters that stand for them
    events: tuple[Atom, ...] = ()


@dataclass
class Operators:
    """Flattens operators, and collects the static facts that the flat operators need."""

    conditions: Conditions
    stages: Stages
    facts: dict[Atom, None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.background = self.conditions.background
        self.instances: dict[str, dict[Function, int]] = {}
        for each in self.background.task.operators:
            self.instances.setdefault(each.instance.name, {})[each.instance] = each.cost
        self.priced = any(each.cost is not None for each in self.background.domain.operators)

    def flat(self, operator: Operator) -> FlatOperator:
        """The operator in a form that PDDL can express. Raises `NotLiftable`."""
        found = Locals()
        self._hoist(operator, found)
        outer = found.named
        effects = list(Closing(self.conditions, operator).effects())
        events = tuple(
            e.atom for e in operator.effects if self.background.kinds.get(e.atom.name) is Kind.EVENT
        )
        if any(e.atom in events and (e.parameters or e.condition != TRUE) for e in operator.effects):
            raise NotLiftable(f"events of {operator.name} that happen under conditions")
        named = [self.stages.happening(number, event) for number, event in enumerate(events)]
        parameters = (*operator.parameters, *found.parameters, *(p for _, own, _ in named for p in own))
        static, dynamic = self._constraints(operator, events)
        precondition = conjunction(
            [
                *(guard for parameter in parameters for guard in self.conditions.guards(parameter)),
                *(self.conditions.flat(part, outer) for part in static),
                *found.relations,
                *(condition for condition, _, _ in named),
                *(self.conditions.flat(part, outer) for part in dynamic),
            ]
        )
        effects = [e for effect in effects for e in self._effect(effect, outer)]
        effects += [effect for _, _, own in named for effect in own]
        parameters = tuple(map(self.conditions.declared, parameters))
        price, cost = self._cost(operator)
        flat = Operator(
            operator.name,
            parameters + ((Parameter(COST, "int"),) if price else ()),
            precondition,
            tuple(dict.fromkeys(effects)),
            body=price,
            cost=cost,
        )
        return FlatOperator(flat, len(operator.parameters), outer, events)

    def _hoist(self, operator: Operator, found: Locals) -> None:
        """Parameters for the compound terms that every instance needs, in its preconditions and adds."""
        atoms = [p.atom for p in goal_parts(operator.precondition) if isinstance(p, Literal) and p.positive]
        kinds = self.background.kinds
        atoms = [atom for atom in atoms if kinds.get(atom.name) is Kind.FLUENT]
        atoms += [e.atom for e in operator.effects if e.adds and not e.parameters and e.condition == TRUE]
        for atom in atoms:
            if ANYTHING not in variables(atom):
                self.conditions.atom(atom, found, found.named)

    def _constraints(
        self, operator: Operator, events: Iterable[Atom]
    ) -> tuple[list[Condition], list[Condition]]:
        """The static constraints, as literals or as a table of the possible instances, and the other constraints."""
        header = set(operator.variables)
        static, dynamic = list[Condition](operator.body), list[Condition]()
        for part in goal_parts(operator.precondition):
            (static if self._is_static(part) else dynamic).append(part)
        bound = {v for event in events for v in variables(event)}
        loose = [p for p in operator.parameters if p.type in (*NUMERIC_TYPES, "text")]
        if all(_sayable(part, header) for part in static) and all(p.variable in bound for p in loose):
            return static, dynamic
        used = {v for part in static for v in free_variables(part)} | {p.variable for p in loose}
        columns = [place for place, v in enumerate(operator.variables) if v in used]
        for instance in self.instances.get(operator.name, {}):
            row = tuple(instance.arguments[place] for place in columns)
            self.facts[Function(f"_where_{operator.name}", row)] = None
        chosen = tuple(operator.variables[place] for place in columns)
        return [Literal(Function(f"_where_{operator.name}", chosen))], dynamic

    def _is_static(self, part: Condition) -> bool:
        match part:
            case Literal(atom):
                return self.background.is_static(atom.name)
            case Comparison() | Aggregate():
                return True
            case _:
                return False

    def _effect(self, effect: Effect, outer: Mapping[Term, Variable]) -> Iterator[Effect]:
        found = Locals()
        atom = self.conditions.atom(effect.atom, found, outer)
        parameters = (*effect.parameters, *found.parameters)
        guards = [guard for parameter in parameters for guard in self.conditions.guards(parameter)]
        condition = conjunction([*guards, *found.relations, self.conditions.flat(effect.condition, outer)])
        if condition != FALSE:
            yield Effect(atom, effect.adds, tuple(map(self.conditions.declared, parameters)), condition)

    def _cost(self, operator: Operator) -> tuple[tuple[BodyPart, ...], Term | None]:
        """The cost of an instance: a number, or a table over the parameters that determine it."""
        if operator.cost is None:
            return (), Number(1) if self.priced else None
        if isinstance(operator.cost, Number):
            return (), operator.cost
        used = set(variables(operator.cost))
        columns = [place for place, v in enumerate(operator.variables) if v in used]
        for instance, cost in self.instances.get(operator.name, {}).items():
            row = tuple(instance.arguments[place] for place in columns)
            self.facts[Function(f"_cost_{operator.name}", (*row, Number(cost)))] = None
        chosen = tuple(operator.variables[place] for place in columns)
        return (Literal(Function(f"_cost_{operator.name}", (*chosen, COST))),), COST


def _sayable(part: Condition, header: set[Variable]) -> bool:
    """Whether PDDL can express a static part of a body without change."""
    match part:
        case Literal(atom):
            plain = not any(_computed(argument) for argument in atom.arguments)
            return plain and set(variables(atom)) <= header
        case Comparison(left, relation, right):
            return relation in ("=", "!=") and not _computed(left) and not _computed(right)
        case _:
            return False


def _computed(term: Term) -> bool:
    match term:
        case Operation():
            return True
        case Function(_, arguments):
            return any(map(_computed, arguments))
        case _:
            return False
