"""Deductive operators compiled into effects: the symbolic consequences of each effect (language reference, Meaning 3)."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from cellwright.engine.formats.interop.pddl.export.background import NotLiftable
from cellwright.engine.formats.interop.pddl.export.conditions import Conditions, conjunction
from cellwright.engine.formats.interop.pddl.export.equations import Equations
from cellwright.kb.model.bindings import bind
from cellwright.kb.model.conditions import (
    TRUE,
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
from cellwright.kb.model.domain import Consequence, DeductiveOperator, Effect, Kind, Operator
from cellwright.kb.terms import ANYTHING, Atom, Function, Term, Variable, substitute_atom, variables


@dataclass(frozen=True, slots=True)
class Deduced:
    """An effect, and the numbers of the deductive operators that led to it."""

    effect: Effect
    behind: tuple[int, ...] = ()


class Closing:
    """The effects of one operator with all their consequences."""

    def __init__(self, conditions: Conditions, operator: Operator) -> None:
        self.conditions, self.operator = conditions, operator
        self.background = conditions.background
        self.types = {parameter.variable: parameter.type for parameter in operator.parameters}
        self.premises = premises(conditions, operator.precondition)

    def effects(self) -> Iterator[Effect]:
        """The operator's effects on fluents, with everything that follows from them. Raises `NotLiftable`."""
        waiting = [
            Deduced(each)
            for each in self.operator.effects
            if self.background.kinds.get(each.atom.name) is Kind.FLUENT
        ]
        added = {each.effect.atom for each in waiting if each.effect.adds}
        seen: set[Effect] = set()
        while waiting:
            deduced = waiting.pop(0)
            if deduced.effect in seen:
                continue
            seen.add(deduced.effect)
            yield deduced.effect
            if deduced.effect.adds or deduced.behind or not self._restored(deduced.effect.atom, added):
                waiting += self._consequences(deduced)

    def _restored(self, atom: Atom, added: set[Atom]) -> bool:
        """Whether a deleted atom is added again, so that it has no consequences. Raises `NotLiftable` if this is not certain."""
        triggers = {
            each.trigger.atom.name
            for each in self.background.domain.deductive_operators
            if not each.trigger.positive
        }
        if atom in added:
            return True
        if atom.name in triggers and any(other.name == atom.name for other in added):
            raise NotLiftable(f"{self.operator.name} deletes {atom.name} and adds it")
        return False

    def _consequences(self, deduced: Deduced) -> Iterator[Deduced]:
        for number, rule in enumerate(self.background.domain.deductive_operators):
            effect, trigger = deduced.effect, rule.trigger
            if trigger.positive != effect.adds or trigger.atom.name != effect.atom.name:
                continue
            if number in deduced.behind:
                raise NotLiftable(f"the deductive operator for {trigger} leads back to itself")
            starts = (effect,) if effect.adds else self._endings(effect)
            for start in starts:
                for consequence in rule.consequences:
                    found = self._follows(start, rule, consequence)
                    if found is not None:
                        yield Deduced(found, (*deduced.behind, number))

    def _endings(self, effect: Effect) -> Iterator[Effect]:
        """The atoms that an effect really ends: matching preconditions, or atoms that are true before.

        Every other atom that it denies is false before or ends without consequences: K302 checks that.
        """
        if effect.atom.name in self.premises.unknown:
            were = conjunction([effect.condition, Literal(effect.atom)])
            yield Effect(effect.atom, False, effect.parameters, were)
            return
        for atom in self.premises.certain:
            yield from self._ended(effect, atom, (), TRUE)
        for atom, parameters in self.premises.possible:
            apart = {p.variable: self.conditions.fresh.variable(p.variable.name) for p in parameters}
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
        condition = bind(conjunction([*guards, *tests, effect.condition, held]), bound)
        yield Effect(atom, False, (*left, *parameters), condition)

    def _follows(self, start: Effect, rule: DeductiveOperator, consequence: Consequence) -> Effect | None:
        body = (*rule.body, *consequence.body)
        typed = self.conditions.inferred(body) | {p.variable: p.type for p in consequence.parameters}
        for variable in variables(consequence.atom):
            typed.setdefault(variable, "object")
        apart = {v: self.conditions.fresh.variable(v.name) for v in sorted(typed, key=str) if v != ANYTHING}
        equations = Equations()
        if not equations.add(substitute_atom(rule.trigger.atom, apart), start.atom):
            return None
        bound = equations.bindings
        parameters = tuple(Parameter(apart[v], typed[v]) for v in apart)
        atom, extra = self._named(substitute_atom(substitute_atom(consequence.atom, apart), bound))
        guards = self._guards(parameters, bound, start)
        tests = [Comparison(a, "=", b) for a, b in equations.open]
        held = [bind(bind(part, apart), bound) for part in body]
        condition = conjunction([start.condition, *guards, *tests, *held])
        free = tuple(p for p in parameters if p.variable not in bound)
        return Effect(atom, consequence.implied, (*start.parameters, *free, *extra), condition)

    def _named(self, atom: Atom) -> tuple[Atom, tuple[Parameter, ...]]:
        """The atom with a variable for each `_`, because the effect changes all matching atoms."""
        types, extra, arguments = self.background.signature(atom.name), [], []
        for argument, type_ in zip(atom.arguments, types, strict=True):
            if argument == ANYTHING:
                argument = self.conditions.fresh.variable("any")
                extra.append(Parameter(argument, type_))
            elif ANYTHING in variables(argument):
                raise NotLiftable(f"'_' inside {argument}")
            arguments.append(argument)
        return Function(atom.name, tuple(arguments)), tuple(extra)

    def _guards(
        self, parameters: tuple[Parameter, ...], bound: Mapping[Variable, Term], start: Effect | None = None
    ) -> list[Condition]:
        """Type conditions for bound variables, unless the types of their values imply them."""
        types = dict(self.types)
        if start is not None:
            types |= {parameter.variable: parameter.type for parameter in start.parameters}
        found: list[Condition] = []
        for parameter in parameters:
            value = bound.get(parameter.variable)
            if value is None or parameter.type not in self.background.domain.types:
                continue
            if not self.background.domain.is_subtype(self._type(value, types), parameter.type):
                found.append(Literal(Function(parameter.type, (value,))))
        return found

    def _type(self, term: Term, types: Mapping[Variable, str]) -> str:
        if isinstance(term, Variable):
            return types.get(term, "object")
        if isinstance(term, Function) and term.arguments and term.name in self.background.domain.functions:
            return self.background.domain.functions[term.name].result
        return "object"


@dataclass(frozen=True, slots=True)
class Premises:
    """What the precondition of an operator says about the state before its effects.

    The `certain` atoms were true. The `possible` atoms may have been true; they come with the types of their variables. Any
    atom of the predicates in `unknown` may have been true.
    """

    certain: tuple[Atom, ...]
    possible: tuple[tuple[Atom, tuple[Parameter, ...]], ...]
    unknown: frozenset[str]


def premises(conditions: Conditions, precondition: Condition) -> Premises:
    """The fluents that a precondition names, directly or through derived predicates."""
    kinds = conditions.background.kinds
    certain, others = [], []
    for part in goal_parts(precondition):
        plain = isinstance(part, Literal) and part.positive and kinds.get(part.atom.name) is Kind.FLUENT
        if plain and isinstance(part, Literal) and ANYTHING not in variables(part.atom):
            certain.append(part.atom)
        else:
            others += list(_named(conditions.flat(part), ()))
    possible = [(atom, own) for atom, own in others if kinds.get(atom.name) is Kind.FLUENT]
    behind = (name for atom, _ in others for name in conditions.fluents_behind(atom.name))
    return Premises(tuple(certain), tuple(dict.fromkeys(possible)), frozenset(behind))


def _named(condition: Condition, own: tuple[Parameter, ...]) -> Iterator[tuple[Atom, tuple[Parameter, ...]]]:
    """Every atom in a condition, with the quantified variables around it."""
    match condition:
        case Literal(atom):
            used = set(variables(atom))
            yield atom, tuple(p for p in own if p.variable in used)
        case And(parts) | Or(parts):
            for part in parts:
                yield from _named(part, own)
        case Not(part):
            yield from _named(part, own)
        case Exists(parameters, part) | ForAll(parameters, part):
            yield from _named(part, (*own, *parameters))
        case _:
            return
