"""Writes a problem in flat terms as PDDL text."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from cellwright.engine.formats.interop.pddl.export.flat_problem import DerivedRule, FlatProblem
from cellwright.engine.formats.interop.pddl.export.pddl_names import PddlNames, Variables
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
    all_conditions,
)
from cellwright.kb.model.domain_model import OBJECT_TYPE, Effect, Operator
from cellwright.kb.terms import Atom, Number, Term, Variable


@dataclass
class LiftedWriter:
    """Writes one flat problem."""

    flat: FlatProblem
    names: PddlNames = field(default_factory=PddlNames)

    def __post_init__(self) -> None:
        # operators get the simplest names, because plans show them
        for operator in self.flat.operators:
            self.names.of("action", operator.name)
        for term in self.flat.objects:
            self.names.term(term)
        self._positions: dict[str, list[str]] = {}
        for atom in self.flat.facts:
            if not is_price(atom):
                self._use(atom, {})
        for condition, types in self._scopes():
            self._uses(condition, types)

    def domain(self) -> str:
        """The domain file."""
        flat = self.flat
        parts = [
            *(f"; {comment}" for comment in flat.comments),
            f"(define (domain {self.names.of('domain', flat.domain)})",
            f"  (:requirements {' '.join(self._requirements())})",
            *_section_lines(":types", list(self._types())),
            *_section_lines(":constants", list(self._objects(self._constants))),
            *_section_lines(":predicates", list(self._predicates())),
            *_section_lines(":functions", list(self._functions())),
            *(self._axiom(axiom) for axiom in flat.axioms),
            *(self._action(operator) for operator in flat.operators),
        ]
        return "\n".join(parts) + ")\n"

    def problem(self) -> str:
        """The problem file."""
        flat = self.flat
        others = [term for term in flat.objects if term not in self._constants]
        facts = [self._fact(atom) for atom in flat.facts]
        facts += ["(= (total-cost) 0)"] if flat.priced else []
        parts = [
            f"(define (problem {self.names.of('problem', flat.name)})",
            f"  (:domain {self.names.of('domain', flat.domain)})",
            *_section_lines(":objects", list(self._objects(others))),
            *(_section_lines(":init", sorted(facts)) or ["  (:init)"]),
            "  (:goal "
            f"{self._condition(flat.goal, Variables(), 4) if flat.goal != ALWAYS_TRUE else '(and)'})",
            *(["  (:metric minimize (total-cost))"] if flat.priced else []),
        ]
        return "\n".join(parts) + ")\n"

    def _scopes(self) -> Iterator[tuple[Condition, dict[Variable, str]]]:
        for operator in self.flat.operators:
            own = {p.variable: p.type for p in operator.parameters}
            yield operator.precondition, own
            for effect in operator.effects:
                inner = {**own, **{p.variable: p.type for p in effect.parameters}}
                yield And((Literal(effect.atom), effect.condition)), inner
        for axiom in self.flat.axioms:
            own = {p.variable: p.type for p in axiom.parameters}
            yield And((Literal(axiom_head(axiom)), axiom.condition)), own
        yield self.flat.goal, {}

    def _uses(self, condition: Condition, types: Mapping[Variable, str]) -> None:
        match condition:
            case Literal(atom):
                self._use(atom, types)
            case And(parts) | Or(parts):
                for part in parts:
                    self._uses(part, types)
            case Not(part):
                self._uses(part, types)
            case Exists(parameters, part) | ForAll(parameters, part):
                self._uses(part, {**types, **{p.variable: p.type for p in parameters}})
            case _:
                return

    def _use(self, atom: Atom, types: Mapping[Variable, str]) -> None:
        """Widen the argument types of a predicate to include the arguments of an atom."""
        terms = [
            types.get(a, OBJECT_TYPE)
            if isinstance(a, Variable)
            else self.flat.objects.get(a, OBJECT_TYPE)
            for a in atom.arguments
        ]
        known = self._positions.get(atom.name)
        self._positions[atom.name] = [*map(self._above, known, terms)] if known else terms

    def _above(self, first_type: str, second_type: str) -> str:
        """The lowest common ancestor of two types."""
        line = self._line(first_type)
        return next((name for name in self._line(second_type) if name in line), OBJECT_TYPE)

    def _line(self, name: str) -> list[str]:
        line = [name]
        while line[-1] in self.flat.types:
            line.append(self.flat.types[line[-1]])
        return line

    @property
    def _constants(self) -> list[Term]:
        """The objects that actions and axioms name."""
        constants: set[Term] = set()
        for condition, _ in list(self._scopes())[:-1]:
            for part in all_conditions(condition):
                match part:
                    case Literal(atom):
                        constants.update(atom.arguments)
                    case Comparison(left, _, right):
                        constants.update((left, right))
                    case _:
                        continue
        return [term for term in self.flat.objects if term in constants]

    def _requirements(self) -> list[str]:
        needed = {":strips": True, ":typing": True}
        everything = [part for condition, _ in self._scopes() for part in all_conditions(condition)]
        kinds = {type(part) for part in everything}
        needed[":negative-preconditions"] = any(
            isinstance(p, Not) or (isinstance(p, Literal) and not p.positive) for p in everything
        )
        needed[":equality"] = Comparison in kinds
        needed[":disjunctive-preconditions"] = Or in kinds or any(
            isinstance(p, Not) and not isinstance(p.part, Comparison) for p in everything
        )
        needed[":existential-preconditions"] = Exists in kinds
        needed[":universal-preconditions"] = ForAll in kinds
        effects = [effect for operator in self.flat.operators for effect in operator.effects]
        needed[":conditional-effects"] = any(
            e.parameters or e.condition != ALWAYS_TRUE for e in effects
        )
        needed[":derived-predicates"] = bool(self.flat.axioms)
        needed[":action-costs"] = self.flat.priced
        return [name for name, wanted in needed.items() if wanted]

    def _type(self, name: str) -> str:
        return name if name == OBJECT_TYPE else self.names.of("type", name)

    def _types(self) -> Iterator[str]:
        used = {type_ for type_ in self.flat.objects.values()}
        used |= {type_ for types in self._positions.values() for type_ in types}
        used |= {p.type for operator in self.flat.operators for p in operator.parameters}
        wanted = {above for name in used for above in self._line(name)} | set(self._quantified())
        for name, parent in self.flat.types.items():
            if name in wanted or not name.startswith("_"):
                yield f"{self._type(name)} - {self._type(parent)}"

    def _quantified(self) -> Iterator[str]:
        for condition, _ in self._scopes():
            for part in all_conditions(condition):
                if isinstance(part, Exists | ForAll):
                    yield from (parameter.type for parameter in part.parameters)
        for operator in self.flat.operators:
            yield from (p.type for effect in operator.effects for p in effect.parameters)

    def _objects(self, terms: Iterable[Term]) -> Iterator[str]:
        return (
            f"{self.names.term(term)} - {self._type(self.flat.objects[term])}" for term in terms
        )

    def _predicates(self) -> Iterator[str]:
        for name, types in self._positions.items():
            listed = (f" ?x{number} - {self._type(type_)}" for number, type_ in enumerate(types))
            yield f"({self.names.of('predicate', name)}{''.join(listed)})"

    def _functions(self) -> Iterator[str]:
        if self.flat.priced:
            yield "(total-cost) - number"
        for operator in self.flat.operators:
            for part in operator.body:
                if isinstance(part, Literal):
                    count = len(part.atom.arguments) - 1
                    listed = "".join(f" ?x{number} - object" for number in range(count))
                    yield f"({self.names.of('predicate', part.atom.name)}{listed}) - number"

    def _fact(self, atom: Atom) -> str:
        if is_price(atom):
            *arguments, value = atom.arguments
            return f"(= {self._words(atom.name, arguments, Variables())} {value})"
        return self._atom(atom, Variables())

    def _atom(self, atom: Atom, scope: Variables) -> str:
        return self._words(atom.name, atom.arguments, scope)

    def _words(self, name: str, arguments: Iterable[Term], scope: Variables) -> str:
        said = (self._term(argument, scope) for argument in arguments)
        return f"({' '.join([self.names.of('predicate', name), *said])})"

    def _term(self, term: Term, scope: Variables) -> str:
        return scope.of(term) if isinstance(term, Variable) else self.names.term(term)

    def _parameters(self, parameters: Iterable[Parameter], scope: Variables) -> str:
        return " ".join(f"{scope.of(p.variable)} - {self._type(p.type)}" for p in parameters)

    def _condition(self, condition: Condition, scope: Variables, margin: int) -> str:
        deeper = margin + 2
        match condition:
            case Literal(atom, positive):
                return self._atom(atom, scope) if positive else f"(not {self._atom(atom, scope)})"
            case Comparison(left, relation, right):
                equal = f"(= {self._term(left, scope)} {self._term(right, scope)})"
                return equal if relation == "=" else f"(not {equal})"
            case And(parts) | Or(parts):
                word = "and" if isinstance(condition, And) else "or"
                return _block_lines(
                    word, [self._condition(part, scope, deeper) for part in parts], margin
                )
            case Not(part):
                return f"(not {self._condition(part, scope, margin)})"
            case Exists(parameters, part) | ForAll(parameters, part):
                word = "exists" if isinstance(condition, Exists) else "forall"
                said = self._parameters(parameters, scope)
                return f"({word} ({said}) {self._condition(part, scope, deeper)})"
            case _:
                raise AssertionError(condition)

    def _action(self, operator: Operator) -> str:
        scope = Variables()
        # a cost is not an argument
        parameters = [p for p in operator.parameters if p.type != "int"]
        effects = [self._effect(effect, scope) for effect in operator.effects]
        effects += [self._price(operator, scope)] if self.flat.priced else []
        said = self._parameters(parameters, scope)
        lines = [f"  (:action {self.names.of('action', operator.name)}", f"   :parameters ({said})"]
        if operator.precondition != ALWAYS_TRUE:
            lines.append(f"   :precondition {self._condition(operator.precondition, scope, 4)}")
        return "\n".join([*lines, f"   :effect {_block_lines('and', effects, 4)})"])

    def _price(self, operator: Operator, scope: Variables) -> str:
        for part in operator.body:
            if isinstance(part, Literal):
                value = self._words(part.atom.name, part.atom.arguments[:-1], scope)
                return f"(increase (total-cost) {value})"
        value = str(operator.cost) if isinstance(operator.cost, Number) else "1"
        return f"(increase (total-cost) {value})"

    def _effect(self, effect: Effect, scope: Variables) -> str:
        said = self._atom(effect.atom, scope)
        said = said if effect.adds else f"(not {said})"
        if effect.condition != ALWAYS_TRUE:
            said = f"(when {self._condition(effect.condition, scope, 6)} {said})"
        if effect.parameters:
            said = f"(forall ({self._parameters(effect.parameters, scope)}) {said})"
        return said

    def _axiom(self, axiom: DerivedRule) -> str:
        scope = Variables()
        said = self._parameters(axiom.parameters, scope)
        head = f"({self.names.of('predicate', axiom.name)}{' ' + said if said else ''})"
        return f"  (:derived {head}\n    {self._condition(axiom.condition, scope, 4)})"


def is_price(atom: Atom) -> bool:
    """Whether a fact gives the cost of an operator."""
    return atom.name.startswith("_cost_")


def axiom_head(axiom: DerivedRule) -> Atom:
    """The derived predicate with a variable for each argument."""
    return Atom(axiom.name, tuple(parameter.variable for parameter in axiom.parameters))


def _block_lines(word: str, parts: list[str], margin: int) -> str:
    short = f"({' '.join([word, *parts])})"
    if len(short) + margin <= 100 and "\n" not in short:
        return short
    inner = " " * (margin + 2)
    return f"({word}\n" + "\n".join(f"{inner}{part}" for part in parts) + ")"


def _section_lines(key: str, parts: list[str]) -> list[str]:
    if not parts:
        return []
    short = f"  ({key} {' '.join(parts)})"
    if len(short) <= 100:
        return [short]
    return [f"  ({key}", *(f"    {part}" for part in parts[:-1]), f"    {parts[-1]})"]
