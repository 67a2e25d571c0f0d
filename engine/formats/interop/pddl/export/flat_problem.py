"""A whole problem in flat terms, simplified: the content of a PDDL domain and problem file.

With fewer conditional effects, more planners and heuristics accept the export.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

from cellwright.engine.formats.interop.pddl.export.chain_counters import BEGIN, REACH, ChainCounters
from cellwright.engine.formats.interop.pddl.export.export_statics import (
    CHAIN,
    NUMERAL,
    WORDS,
    Background,
)
from cellwright.engine.formats.interop.pddl.export.flat_conditions import (
    FALSE_CONDITION,
    Conditions,
    conjoin_conditions,
    disjoin_conditions,
    negate_condition,
)
from cellwright.engine.formats.interop.pddl.export.flat_operators import (
    FlatOperator,
    OperatorFlattener,
)
from cellwright.engine.model.ground_task import GroundTask
from cellwright.kb.model.conditions import (
    ALWAYS_TRUE,
    And,
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
from cellwright.kb.model.domain_model import OBJECT_TYPE, Effect, Operator
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function, Term, Variable, is_ground, substitute_atom

Scope = Mapping[Variable, str]


class Simplifier:
    """Simplifies flat operators and conditions, given the types of their variables."""

    def __init__(self, background: Background) -> None:
        self.background = background

    def operator(self, operator: Operator) -> Operator:
        """The operator with simpler conditions; effects that cannot happen are dropped."""
        scope = _scope_inside({}, operator.parameters)
        added = {
            e.atom
            for e in operator.effects
            if e.adds and not e.parameters and e.condition == ALWAYS_TRUE
        }
        effects = (self._effect(_without_exceptions(e, added), scope) for e in operator.effects)
        return replace(
            operator,
            precondition=self.condition(operator.precondition, scope),
            effects=tuple(effect for effect in effects if effect.condition != FALSE_CONDITION),
        )

    def _effect(self, effect: Effect, scope: Scope) -> Effect:
        return replace(
            effect,
            condition=self.condition(effect.condition, _scope_inside(scope, effect.parameters)),
        )

    def condition(self, condition: Condition, scope: Scope) -> Condition:
        """An equivalent condition without type conditions that the declared types of its
        variables imply.
        """
        match condition:
            case Literal(Function(name, (Variable() as variable,)), positive):
                return (
                    (ALWAYS_TRUE if positive else FALSE_CONDITION)
                    if self._known(name, variable, scope)
                    else condition
                )
            case And(parts):
                return conjoin_conditions(self.condition(part, scope) for part in parts)
            case Or(parts):
                return disjoin_conditions(self.condition(part, scope) for part in parts)
            case Not(part):
                return negate_condition(self.condition(part, scope))
            case Exists(parameters, part):
                inner = self.condition(part, _scope_inside(scope, parameters))
                return FALSE_CONDITION if inner == FALSE_CONDITION else Exists(parameters, inner)
            case ForAll(parameters, part):
                inner = self.condition(part, _scope_inside(scope, parameters))
                return ALWAYS_TRUE if inner == ALWAYS_TRUE else ForAll(parameters, inner)
            case _:
                return condition

    def _known(self, name: str, variable: Variable, scope: Scope) -> bool:
        known = scope.get(variable)
        return (
            name in self.background.domain.types
            and known is not None
            and self.background.is_subtype(known, name)
        )


def _without_exceptions(effect: Effect, added: Collection[Atom]) -> Effect:
    """The same delete without exceptions.

    That is safe for atoms that are always added, because PDDL adds after it deletes.
    """
    if effect.adds:
        return effect
    own = {parameter.variable for parameter in effect.parameters}
    kept = (
        p for p in goal_parts(effect.condition) if not _is_exception(p, effect.atom, own, added)
    )
    return replace(effect, condition=conjoin_conditions(kept))


def _is_exception(
    part: Condition, atom: Atom, own: Collection[Variable], added: Collection[Atom]
) -> bool:
    """Whether a condition excludes a value for which the atom is among the added ones."""
    match part:
        case Not(Comparison(left, "=", right)):
            pairs = ((left, right), (right, left))
            return any(
                isinstance(variable, Variable)
                and variable in own
                and substitute_atom(atom, {variable: value}) in added
                for variable, value in pairs
            )
        case _:
            return False


def _scope_inside(scope: Scope, parameters: Iterable[Parameter]) -> dict[Variable, str]:
    return {**scope, **{parameter.variable: parameter.type for parameter in parameters}}


@dataclass(frozen=True, slots=True)
class DerivedRule:
    """A derived predicate with the condition that makes it true."""

    name: str
    parameters: tuple[Parameter, ...]
    condition: Condition


@dataclass(frozen=True, slots=True)
class FlatProblem:
    """The content of an export: types with parents, objects with types, operators, axioms, facts
    and the goal.

    `comments` say what the PDDL leaves out.
    """

    name: str
    domain: str
    types: dict[str, str]
    objects: dict[Term, str]
    operators: tuple[Operator, ...]
    axioms: tuple[DerivedRule, ...]
    facts: tuple[Atom, ...]
    goal: Condition
    priced: bool
    origins: tuple[FlatOperator, ...] = ()
    comments: tuple[str, ...] = ()


def flatten_problem(problem: Problem, task: GroundTask) -> FlatProblem:
    """The problem in flat terms; `task` is its ground task. Raises `NotLiftable`."""
    background = Background(problem, task)
    conditions = Conditions(background)
    stages = ChainCounters(background, conditions.fresh)
    operators = OperatorFlattener(conditions, stages)
    origins = tuple(operators.flat(operator) for operator in problem.domain.operators)
    simplifier = Simplifier(background)
    reachings = (
        replace(reaching, parameters=tuple(map(conditions.declared, reaching.parameters)))
        for reaching in stages.reachings()
    )
    all_operators = (
        *(simplifier.operator(origin.operator) for origin in origins),
        *reachings,
        *stages.beginnings(),
    )
    axioms = tuple(_derived_rules(conditions, simplifier))
    goal = simplifier.condition(
        conjoin_conditions([conditions.flat(problem.goal), *stages.goals()]), {}
    )
    names = frozenset(
        _used_predicates(
            [*_all_conditions(all_operators), *(axiom.condition for axiom in axioms), goal]
        )
    )
    facts = dict.fromkeys((*operators.facts, *stages.facts(), *stages.initial(), *stages.waiting()))
    facts |= dict.fromkeys(_relation_facts(conditions, background))
    facts |= dict.fromkeys(
        fact
        for name in sorted(names)
        if background.is_static(name)
        for fact in background.facts.get(name, ())
    )
    facts |= dict.fromkeys(atom for atom in background.initial)
    objects = dict.fromkeys(
        (*background.terms, *_fact_terms(facts), *_used_constants(all_operators, goal, axioms))
    )
    return FlatProblem(
        problem.name,
        problem.domain.name,
        _declared_types(background),
        {term: background.type_of(term) for term in objects},
        all_operators,
        axioms,
        tuple(facts),
        goal,
        operators.priced
        or any(operator.name.startswith((BEGIN, REACH)) for operator in all_operators),
        origins,
        tuple(_left_out(problem)),
    )


def _declared_types(background: Background) -> dict[str, str]:
    parents = {
        name: background.plain(type_.parent)
        if type_.parent in background.domain.types
        else OBJECT_TYPE
        for name, type_ in background.domain.types.items()
        if name not in background.shared
    }
    return parents | {NUMERAL: OBJECT_TYPE, WORDS: OBJECT_TYPE, CHAIN: OBJECT_TYPE}


def _derived_rules(conditions: Conditions, simplifier: Simplifier) -> Iterator[DerivedRule]:
    for name in sorted(conditions.recursive):
        types = conditions.background.signature(name)
        parameters = tuple(Parameter(conditions.fresh.variable("x"), type_) for type_ in types)
        arguments = tuple(parameter.variable for parameter in parameters)
        rules = (rule for rule in conditions.background.domain.rules if rule.head.name == name)
        condition = disjoin_conditions(conditions.body(rule, arguments) for rule in rules)
        declared = tuple(map(conditions.declared, parameters))
        known = {parameter.variable: parameter.type for parameter in declared}
        yield DerivedRule(name, declared, simplifier.condition(condition, known))


def _relation_facts(conditions: Conditions, background: Background) -> Iterator[Atom]:
    """The facts of the relations that replace compound terms."""
    for term in background.terms:
        if isinstance(term, Function) and (term.name, len(term.arguments)) in conditions.functions:
            yield Function(f"_is_{term.name}", (*term.arguments, term))


def _all_conditions(operators: Iterable[Operator]) -> Iterator[Condition]:
    for operator in operators:
        yield operator.precondition
        yield from (effect.condition for effect in operator.effects)


def _used_predicates(conditions: Iterable[Condition]) -> Iterator[str]:
    return (atom.name for condition in conditions for atom in condition_atoms(condition))


def condition_atoms(condition: Condition) -> Iterator[Atom]:
    """Every atom in a condition."""
    match condition:
        case Literal(atom):
            yield atom
        case And(parts) | Or(parts):
            for part in parts:
                yield from condition_atoms(part)
        case Not(part) | Exists(_, part) | ForAll(_, part):
            yield from condition_atoms(part)
        case Comparison(left, _, right):
            yield Function("=", (left, right))
        case _:
            return


def _fact_terms(facts: Iterable[Atom]) -> Iterator[Term]:
    for fact in facts:
        arguments = fact.arguments[:-1] if fact.name.startswith("_cost_") else fact.arguments
        yield from arguments


def _used_constants(
    operators: Iterable[Operator], goal: Condition, axioms: Iterable[DerivedRule]
) -> Iterator[Term]:
    everything = [*_all_conditions(operators), goal, *(axiom.condition for axiom in axioms)]
    used_atoms = [atom for condition in everything for atom in condition_atoms(condition)]
    used_atoms += [effect.atom for operator in operators for effect in operator.effects]
    return (term for atom in used_atoms for term in atom.arguments if is_ground(term))


def _left_out(problem: Problem) -> Iterator[str]:
    timed = [operator for operator in problem.domain.operators if operator.duration is not None]
    if timed:
        yield (
            "durations and resources are left out: "
            f"{', '.join(operator.name for operator in timed)}"
        )
    if problem.all_windows or problem.all_calendars:
        yield "windows and calendars are left out: plans of other planners may break them"
