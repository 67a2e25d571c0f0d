"""Rewrites operators for PDDL: constraints become tables of facts, consequences become effects."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from cellwright.engine.formats.interop.pddl.export.chain_counters import ChainCounters
from cellwright.engine.formats.interop.pddl.export.export_statics import NotLiftable
from cellwright.engine.formats.interop.pddl.export.flat_conditions import (
    FALSE_CONDITION,
    Conditions,
    Equations,
    FlatLocals,
    conjoin_conditions,
)
from cellwright.kb.model.condition_forms import bind_variables, free_variables
from cellwright.kb.model.conditions import (
    ALWAYS_TRUE,
    Aggregate,
    And,
    BodyPart,
    Comparison,
    Condition,
    Exists,
    ForAll,
    Literal,
    Not,
    Or,
    Parameter,
    goal_parts,
)
from cellwright.kb.model.domain_model import (
    NUMERIC_TYPES,
    Consequence,
    DeductiveOperator,
    Effect,
    Kind,
    Operator,
)
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Function,
    Number,
    Operation,
    Term,
    Variable,
    substitute_atom,
    term_variables,
)


@dataclass(frozen=True, slots=True)
class DeducedEffect:
    """An effect, and the numbers of the deductive operators that led to it."""

    effect: Effect
    behind: tuple[int, ...] = ()


class Closing:
    """The effects of one operator with all their consequences."""

    def __init__(self, conditions: Conditions, operator: Operator) -> None:
        self.conditions, self.operator = conditions, operator
        self.background = conditions.background
        self.types = {parameter.variable: parameter.type for parameter in operator.parameters}
        self.premises = premises_of(conditions, operator.precondition)

    def effects(self) -> Iterator[Effect]:
        """The operator's effects on fluents, with everything that follows from them.

        Raises `NotLiftable`.
        """
        waiting = [
            DeducedEffect(operator_effect)
            for operator_effect in self.operator.effects
            if self.background.kinds.get(operator_effect.atom.name) is Kind.FLUENT
        ]
        added = {first_effect.effect.atom for first_effect in waiting if first_effect.effect.adds}
        seen: set[Effect] = set()
        while waiting:
            deduced = waiting.pop(0)
            if deduced.effect in seen:
                continue
            seen.add(deduced.effect)
            yield deduced.effect
            if (
                deduced.effect.adds
                or deduced.behind
                or not self._restored(deduced.effect.atom, added)
            ):
                waiting += self._consequences(deduced)

    def _restored(self, atom: Atom, added: set[Atom]) -> bool:
        """Whether a deleted atom is added again, so that it has no consequences.

        Raises `NotLiftable` if this is not certain.
        """
        triggers = {
            rule.trigger.atom.name
            for rule in self.background.domain.deductive_operators
            if not rule.trigger.positive
        }
        if atom in added:
            return True
        if atom.name in triggers and any(addition.name == atom.name for addition in added):
            raise NotLiftable(f"{self.operator.name} deletes {atom.name} and adds it")
        return False

    def _consequences(self, deduced: DeducedEffect) -> Iterator[DeducedEffect]:
        for number, rule in enumerate(self.background.domain.deductive_operators):
            effect, trigger = deduced.effect, rule.trigger
            if trigger.positive != effect.adds or trigger.atom.name != effect.atom.name:
                continue
            if number in deduced.behind:
                raise NotLiftable(f"the deductive operator for {trigger} leads back to itself")
            starts = (effect,) if effect.adds else self._endings(effect)
            for start in starts:
                for consequence in rule.consequences:
                    following = self._follows(start, rule, consequence)
                    if following is not None:
                        yield DeducedEffect(following, (*deduced.behind, number))

    def _endings(self, effect: Effect) -> Iterator[Effect]:
        """The atoms that an effect really ends: matching preconditions, or atoms that are true
        before.

        Every other atom that it denies is false before or ends without consequences: K302 checks
        that.
        """
        if effect.atom.name in self.premises.unknown:
            were = conjoin_conditions([effect.condition, Literal(effect.atom)])
            yield Effect(effect.atom, False, effect.parameters, were)
            return
        for atom in self.premises.certain:
            yield from self._ended(effect, atom, (), ALWAYS_TRUE)
        for atom, parameters in self.premises.possible:
            apart = {
                p.variable: self.conditions.fresh.variable(p.variable.name) for p in parameters
            }
            renamed = tuple(Parameter(apart[p.variable], p.type) for p in parameters)
            atom = substitute_atom(atom, apart)
            yield from self._ended(effect, atom, renamed, Literal(atom))

    def _ended(
        self, effect: Effect, atom: Atom, parameters: tuple[Parameter, ...], held: Condition
    ) -> Iterator[Effect]:
        own = {parameter.variable for parameter in effect.parameters}
        equations = Equations()
        if atom.name != effect.atom.name or not equations.add(effect.atom, atom):
            return
        bound = {v: value for v, value in equations.bindings.items() if v in own}
        others = [(v, value) for v, value in equations.bindings.items() if v not in own]
        tests = [Comparison(a, "=", b) for a, b in (*others, *equations.open) if a != b]
        left = tuple(p for p in effect.parameters if p.variable not in bound)
        guards = self._guards(effect.parameters, bound)
        condition = bind_variables(
            conjoin_conditions([*guards, *tests, effect.condition, held]), bound
        )
        yield Effect(atom, False, (*left, *parameters), condition)

    def _follows(
        self, start: Effect, rule: DeductiveOperator, consequence: Consequence
    ) -> Effect | None:
        body = (*rule.body, *consequence.body)
        typed = self.conditions.inferred(body) | {
            p.variable: p.type for p in consequence.parameters
        }
        for variable in term_variables(consequence.atom):
            typed.setdefault(variable, "object")
        apart = {
            v: self.conditions.fresh.variable(v.name)
            for v in sorted(typed, key=str)
            if v != ANYTHING
        }
        equations = Equations()
        if not equations.add(substitute_atom(rule.trigger.atom, apart), start.atom):
            return None
        bound = equations.bindings
        parameters = tuple(Parameter(apart[v], typed[v]) for v in apart)
        atom, extra = self._named(substitute_atom(substitute_atom(consequence.atom, apart), bound))
        guards = self._guards(parameters, bound, start)
        tests = [Comparison(a, "=", b) for a, b in equations.open]
        held = [bind_variables(bind_variables(part, apart), bound) for part in body]
        condition = conjoin_conditions([start.condition, *guards, *tests, *held])
        free = tuple(p for p in parameters if p.variable not in bound)
        return Effect(atom, consequence.implied, (*start.parameters, *free, *extra), condition)

    def _named(self, atom: Atom) -> tuple[Atom, tuple[Parameter, ...]]:
        """The atom with a variable for each `_`, because the effect changes all matching atoms."""
        types, extra, arguments = self.background.signature(atom.name), [], []
        for argument, type_ in zip(atom.arguments, types, strict=True):
            if argument == ANYTHING:
                argument = self.conditions.fresh.variable("any")
                extra.append(Parameter(argument, type_))
            elif ANYTHING in term_variables(argument):
                raise NotLiftable(f"'_' inside {argument}")
            arguments.append(argument)
        return Function(atom.name, tuple(arguments)), tuple(extra)

    def _guards(
        self,
        parameters: tuple[Parameter, ...],
        bound: Mapping[Variable, Term],
        start: Effect | None = None,
    ) -> list[Condition]:
        """Type conditions for bound variables, unless the types of their values imply them."""
        types = dict(self.types)
        if start is not None:
            types |= {parameter.variable: parameter.type for parameter in start.parameters}
        guards: list[Condition] = []
        for parameter in parameters:
            value = bound.get(parameter.variable)
            if value is None or parameter.type not in self.background.domain.types:
                continue
            if not self.background.domain.is_subtype(self._type(value, types), parameter.type):
                guards.append(Literal(Function(parameter.type, (value,))))
        return guards

    def _type(self, term: Term, types: Mapping[Variable, str]) -> str:
        if isinstance(term, Variable):
            return types.get(term, "object")
        if (
            isinstance(term, Function)
            and term.arguments
            and term.name in self.background.domain.functions
        ):
            return self.background.domain.functions[term.name].result
        return "object"


@dataclass(frozen=True, slots=True)
class Premises:
    """What the precondition of an operator says about the state before its effects.

    The `certain` atoms were true. The `possible` atoms may have been true; they come with the types
    of their variables. Any atom of the predicates in `unknown` may have been true.
    """

    certain: tuple[Atom, ...]
    possible: tuple[tuple[Atom, tuple[Parameter, ...]], ...]
    unknown: frozenset[str]


def premises_of(conditions: Conditions, precondition: Condition) -> Premises:
    """The fluents that a precondition names, directly or through derived predicates."""
    kinds = conditions.background.kinds
    certain, others = [], []
    for part in goal_parts(precondition):
        plain = (
            isinstance(part, Literal) and part.positive and kinds.get(part.atom.name) is Kind.FLUENT
        )
        if plain and isinstance(part, Literal) and ANYTHING not in term_variables(part.atom):
            certain.append(part.atom)
        else:
            others += list(_atoms_within(conditions.flat(part), ()))
    possible = [(atom, own) for atom, own in others if kinds.get(atom.name) is Kind.FLUENT]
    behind = (name for atom, _ in others for name in conditions.fluents_behind(atom.name))
    return Premises(tuple(certain), tuple(dict.fromkeys(possible)), frozenset(behind))


def _atoms_within(
    condition: Condition, own: tuple[Parameter, ...]
) -> Iterator[tuple[Atom, tuple[Parameter, ...]]]:
    """Every atom in a condition, with the quantified variables around it."""
    match condition:
        case Literal(atom):
            used = set(term_variables(atom))
            yield atom, tuple(p for p in own if p.variable in used)
        case And(parts) | Or(parts):
            for part in parts:
                yield from _atoms_within(part, own)
        case Not(part):
            yield from _atoms_within(part, own)
        case Exists(parameters, part) | ForAll(parameters, part):
            yield from _atoms_within(part, (*own, *parameters))
        case _:
            return


COST_VARIABLE = Variable("Cost__")


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
class OperatorFlattener:
    """Flattens operators, and collects the static facts that the flat operators need."""

    conditions: Conditions
    stages: ChainCounters
    facts: dict[Atom, None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.background = self.conditions.background
        self.instances: dict[str, dict[Function, int]] = {}
        for operator in self.background.task.operators:
            self.instances.setdefault(operator.instance.name, {})[operator.instance] = operator.cost
        self.priced = any(
            operator.cost is not None for operator in self.background.domain.operators
        )

    def flat(self, operator: Operator) -> FlatOperator:
        """The operator in a form that PDDL can express. Raises `NotLiftable`."""
        local_terms = FlatLocals()
        self._hoist(operator, local_terms)
        outer = local_terms.named
        effects = list(Closing(self.conditions, operator).effects())
        events = tuple(
            e.atom for e in operator.effects if self.background.kinds.get(e.atom.name) is Kind.EVENT
        )
        if any(
            e.atom in events and (e.parameters or e.condition != ALWAYS_TRUE)
            for e in operator.effects
        ):
            raise NotLiftable(f"events of {operator.name} that happen under conditions")
        named = [self.stages.happening(number, event) for number, event in enumerate(events)]
        parameters = (
            *operator.parameters,
            *local_terms.parameters,
            *(p for _, own, _ in named for p in own),
        )
        static, dynamic = self._constraints(operator, events)
        precondition = conjoin_conditions(
            [
                *(guard for parameter in parameters for guard in self.conditions.guards(parameter)),
                *(self.conditions.flat(part, outer) for part in static),
                *local_terms.relations,
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
            parameters + ((Parameter(COST_VARIABLE, "int"),) if price else ()),
            precondition,
            tuple(dict.fromkeys(effects)),
            body=price,
            cost=cost,
        )
        return FlatOperator(flat, len(operator.parameters), outer, events)

    def _hoist(self, operator: Operator, local_terms: FlatLocals) -> None:
        """Parameters for the compound terms that every instance needs, in its preconditions and
        adds.
        """
        atoms = [
            p.atom
            for p in goal_parts(operator.precondition)
            if isinstance(p, Literal) and p.positive
        ]
        kinds = self.background.kinds
        atoms = [atom for atom in atoms if kinds.get(atom.name) is Kind.FLUENT]
        atoms += [
            e.atom
            for e in operator.effects
            if e.adds and not e.parameters and e.condition == ALWAYS_TRUE
        ]
        for atom in atoms:
            if ANYTHING not in term_variables(atom):
                self.conditions.atom(atom, local_terms, local_terms.named)

    def _constraints(
        self, operator: Operator, events: Iterable[Atom]
    ) -> tuple[list[Condition], list[Condition]]:
        """The static constraints, as literals or as a table of the possible instances, and the
        other constraints.
        """
        header = set(operator.variables)
        static, dynamic = list[Condition](operator.body), list[Condition]()
        for part in goal_parts(operator.precondition):
            (static if self._is_static(part) else dynamic).append(part)
        bound = {v for event in events for v in term_variables(event)}
        loose = [p for p in operator.parameters if p.type in (*NUMERIC_TYPES, "text")]
        if all(_is_sayable(part, header) for part in static) and all(
            p.variable in bound for p in loose
        ):
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
        local_terms = FlatLocals()
        atom = self.conditions.atom(effect.atom, local_terms, outer)
        parameters = (*effect.parameters, *local_terms.parameters)
        guards = [guard for parameter in parameters for guard in self.conditions.guards(parameter)]
        condition = conjoin_conditions(
            [*guards, *local_terms.relations, self.conditions.flat(effect.condition, outer)]
        )
        if condition != FALSE_CONDITION:
            yield Effect(
                atom, effect.adds, tuple(map(self.conditions.declared, parameters)), condition
            )

    def _cost(self, operator: Operator) -> tuple[tuple[BodyPart, ...], Term | None]:
        """The cost of an instance: a number, or a table over the parameters that determine it."""
        if operator.cost is None:
            return (), Number(1) if self.priced else None
        if isinstance(operator.cost, Number):
            return (), operator.cost
        used = set(term_variables(operator.cost))
        columns = [place for place, v in enumerate(operator.variables) if v in used]
        for instance, cost in self.instances.get(operator.name, {}).items():
            row = tuple(instance.arguments[place] for place in columns)
            self.facts[Function(f"_cost_{operator.name}", (*row, Number(cost)))] = None
        chosen = tuple(operator.variables[place] for place in columns)
        return (
            Literal(Function(f"_cost_{operator.name}", (*chosen, COST_VARIABLE))),
        ), COST_VARIABLE


def _is_sayable(part: Condition, header: set[Variable]) -> bool:
    """Whether PDDL can express a static part of a body without change."""
    match part:
        case Literal(atom):
            plain = not any(_is_computed(argument) for argument in atom.arguments)
            return plain and set(term_variables(atom)) <= header
        case Comparison(left, relation, right):
            return relation in ("=", "!=") and not _is_computed(left) and not _is_computed(right)
        case _:
            return False


def _is_computed(term: Term) -> bool:
    match term:
        case Operation():
            return True
        case Function(_, arguments):
            return any(map(_is_computed, arguments))
        case _:
            return False
