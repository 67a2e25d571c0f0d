"""Numeric quantities: taken out of a problem before grounding, put into the ground task after it.

Each comparison with a quantity becomes a derived atom `_compared_n(variables)`, and the changes of
operators are kept apart. So clingo never sees the values.
"""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from cellwright.engine.kernels.bits import Bits, bitset
from cellwright.engine.model.ground_axioms import (
    UNBOUNDED_VALUE,
    Axioms,
    Comparing,
    Linear,
    Met,
    QuantityAssignment,
    QuantityLevel,
)
from cellwright.engine.model.ground_task import GroundOperator
from cellwright.engine.stages.grounding.numbered_atoms import Numbering, Universe
from cellwright.kb.arithmetic import evaluate_atom
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.condition_forms import free_variables
from cellwright.kb.model.conditions import (
    And,
    Body,
    BodyPart,
    Comparison,
    Condition,
    Exists,
    ForAll,
    Literal,
    Not,
    Or,
    goal_parts,
)
from cellwright.kb.model.domain_model import Domain, Operator, Rule
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.model.quantity_fluents import value_error
from cellwright.kb.terms import (
    Atom,
    Function,
    Number,
    Operation,
    Substitution,
    Term,
    Variable,
    match_term,
    substitute_atom,
    substitute_term,
)

COMPARISON_PREFIX = "_compared_"


@dataclass(frozen=True, slots=True)
class QuantityTest:
    """What the derived predicate of `head` stands for: a comparison, in which variables are the
    values of quantities.
    """

    head: Atom
    values: Mapping[Variable, Function]
    comparison: Comparison
    where: Source


@dataclass(frozen=True, slots=True)
class QuantitySetting:
    """An operator sets `quantity` to `value`, in which variables are the values of quantities."""

    quantity: Function
    value: Term
    values: Mapping[Variable, Function]


@dataclass
class SeparatedQuantities:
    """The comparisons and changes of a problem, and `problem` without them."""

    problem: Problem
    tests: list[QuantityTest] = field(default_factory=list)
    settings: dict[str, list[QuantitySetting]] = field(default_factory=dict)
    initial: dict[Function, int] = field(default_factory=dict)

    def without_tests(self, body: Body) -> Body:
        """A body without the literals that stand for comparisons."""
        return tuple(
            p
            for p in body
            if not (isinstance(p, Literal) and p.atom.name.startswith(COMPARISON_PREFIX))
        )

    def literals_of(self, literals: Sequence[Literal]) -> list[Literal]:
        """Those among some literals that stand for comparisons."""
        return [literal for literal in literals if literal.atom.name.startswith(COMPARISON_PREFIX)]


def without_quantities(problem: Problem) -> SeparatedQuantities:
    """A problem without quantities, and what was taken out.

    Raises `InvalidInput` if a quantity has no single value.
    """
    domain = problem.domain
    if not domain.quantities:
        return SeparatedQuantities(problem)
    separated = SeparatedQuantities(problem)
    taking = _Taking(domain, separated)
    operators = tuple(map(taking.operator, domain.operators))
    plain = dataclasses.replace(
        domain,
        operators=operators,
        rules=tuple(map(taking.rule, domain.rules)),
        predicates={
            n: predicate for n, predicate in domain.predicates.items() if n not in domain.quantities
        },
        quantities={},
    )
    facts = [atom for atom in problem.initial if atom.name in domain.quantities]
    _note_values(problem, facts, separated.initial)
    separated.problem = dataclasses.replace(
        problem,
        domain=plain,
        initial=tuple(atom for atom in problem.initial if atom.name not in domain.quantities),
        goal=taking.condition(problem.goal, problem.where),
    )
    return separated


def _note_values(problem: Problem, facts: Sequence[Atom], initial: dict[Function, int]) -> None:
    wrong: list[Diagnostic] = []
    for atom in facts:
        *rest, value = atom.arguments
        assert isinstance(value, Number)
        if (fault := value_error(atom, problem.domain.quantities[atom.name], initial)) is not None:
            wrong.append(Diagnostic(problem.where, *fault))
        initial[Function(atom.name, tuple(rest))] = value.value
    if wrong:
        raise InvalidInput(wrong)


class _Taking:
    """Takes quantities out of the operators, rules and goals of a domain."""

    def __init__(self, domain: Domain, quantities: SeparatedQuantities) -> None:
        self.domain, self.found = domain, quantities

    def operator(self, operator: Operator) -> Operator:
        """The operator without quantities."""
        self.found.settings[operator.name] = [
            setting
            for effect in operator.effects
            if (setting := self._setting(effect.atom, effect.condition))
        ]
        effects = tuple(
            dataclasses.replace(effect, condition=self.condition(effect.condition, operator.where))
            for effect in operator.effects
            if effect.atom.name not in self.domain.quantities
        )
        precondition = self.condition(operator.precondition, operator.where)
        return dataclasses.replace(operator, precondition=precondition, effects=effects)

    def rule(self, rule: Rule) -> Rule:
        """The rule with derived atoms in the place of comparisons with quantities.

        Raises `InvalidInput`.
        """
        values = self._values(And(rule.body))
        if not values:
            return rule
        body: list[BodyPart] = []
        for part in rule.body:
            if isinstance(part, Literal) and part.atom.name in self.domain.quantities:
                continue  # it binds the variable of a value, which only comparisons read
            read = values.keys() & free_variables(part)
            if read and not isinstance(part, Comparison):
                message = f"the rule of '{rule.head.name}' reads values of quantities in {part}"
                raise InvalidInput(
                    [Diagnostic(rule.where, "K202", message, "compare them instead")]
                )
            body.append(
                self._test(values, part, rule.where)
                if read and isinstance(part, Comparison)
                else part
            )
        return dataclasses.replace(rule, body=tuple(body))

    def _setting(self, atom: Atom, condition: Condition) -> QuantitySetting | None:
        """The change that adds a new value; None for any other effect."""
        if atom.name not in self.domain.quantities:
            return None
        *rest, value = atom.arguments
        for part in goal_parts(condition):
            if isinstance(part, Comparison) and part.relation == "=" and part.left == value:
                return QuantitySetting(
                    Function(atom.name, tuple(rest)), part.right, self._values(condition)
                )
        return None

    def _values(self, condition: Condition) -> dict[Variable, Function]:
        """The quantities whose values the variables of a conjunction are."""
        values = {}
        for part in goal_parts(condition):
            if isinstance(part, Literal) and part.atom.name in self.domain.quantities:
                *rest, value = part.atom.arguments
                assert isinstance(value, Variable)
                values[value] = Function(part.atom.name, tuple(rest))
        return values

    def condition(self, condition: Condition, where: Source) -> Condition:
        """The condition with derived atoms in the place of comparisons with quantities."""
        match condition:
            case Exists(_, part) if values := self._values(part):
                tests = [
                    conjunct for conjunct in goal_parts(part) if isinstance(conjunct, Comparison)
                ]
                literals = tuple(self._test(values, test, where) for test in tests)
                return literals[0] if len(literals) == 1 else And(literals)
            case And(parts) | Or(parts):
                return type(condition)(tuple(self.condition(part, where) for part in parts))
            case Not(part):
                return Not(self.condition(part, where))
            case Exists(parameters, part) | ForAll(parameters, part):
                return type(condition)(parameters, self.condition(part, where))
            case _:
                return condition

    def _test(
        self, values: Mapping[Variable, Function], comparison: Comparison, where: Source
    ) -> Literal:
        own = {
            v: quantity_atom
            for v, quantity_atom in values.items()
            if v in free_variables(comparison)
        }
        free = [
            *free_variables(comparison),
            *(v for q in own.values() for v in free_variables(Literal(q))),
        ]
        outer = tuple(v for v in dict.fromkeys(free) if v not in own)
        head = Function(f"{COMPARISON_PREFIX}{len(self.found.tests)}", outer)
        self.found.tests.append(QuantityTest(head, own, comparison, where))
        return Literal(head)


@dataclass
class TaskQuantities:
    """The quantities of a ground task whose atoms are `names`."""

    taken: SeparatedQuantities
    domain: Domain
    names: list[Atom]
    levels: dict[Function, QuantityLevel] = field(default_factory=dict)
    _met: Met = field(default_factory=dict)
    _changes: dict[Function, tuple[QuantityAssignment, ...]] = field(default_factory=dict)

    @property
    def start(self) -> int:
        """The atoms of the values at the start."""
        level_bits = 0
        for quantity, value in self.taken.initial.items():
            level_bits |= self._level(quantity).bit(value)
        return level_bits

    def comparing(self, universe: Universe, numbering: Numbering) -> Iterator[Comparing]:
        """The derived atoms that compare quantities and have numbers. Raises `InvalidInput`."""
        tests = {test.head.name: test for test in self.taken.tests}
        for atom, signed in universe.index.items():
            if (test := tests.get(atom.name)) is None:
                continue
            if signed not in numbering.added and ~signed not in numbering.added:
                continue
            bindings = match_term(test.head, atom, {}) or {}
            difference = Operation("-", test.comparison.left, test.comparison.right)
            linear_sum = self._linear(difference, test.values, bindings, test.where)
            yield Comparing(numbering.number(signed), linear_sum, test.comparison.relation)

    def changing(self, operator: GroundOperator) -> GroundOperator:
        """The operator with what it does to quantities."""
        settings = self.taken.settings.get(operator.instance.name)
        if not settings:
            return operator
        if operator.instance not in self._changes:
            schema = next(
                candidate
                for candidate in self.domain.operators
                if candidate.name == operator.instance.name
            )
            bindings = dict(zip(schema.variables, operator.instance.arguments, strict=True))
            self._changes[operator.instance] = tuple(
                QuantityAssignment(
                    self._level(substitute_atom(setting.quantity, bindings)),
                    self._linear(setting.value, setting.values, bindings, schema.where),
                )
                for setting in settings
            )
        return dataclasses.replace(operator, changes=self._changes[operator.instance])

    def _level(self, quantity: Function) -> QuantityLevel:
        evaluated = evaluate_atom(quantity) or quantity
        if evaluated not in self.taken.initial:
            message = f"nothing says what {evaluated} is at the start"
            hint = (
                f"add {Function(evaluated.name, (*evaluated.arguments, Number(0)))}, or its "
                "true value, under `initial:`"
            )
            raise InvalidInput([Diagnostic(self.taken.problem.where, "K115", message, hint)])
        if evaluated not in self.levels:
            bounds = self.domain.quantities[evaluated.name]
            low = -UNBOUNDED_VALUE if bounds.low is None else bounds.low
            high = UNBOUNDED_VALUE if bounds.high is None else bounds.high
            self.levels[evaluated] = QuantityLevel(
                evaluated, low, high, self.names, self._met, len(self.levels)
            )
        return self.levels[evaluated]

    def _linear(
        self, term: Term, values: Mapping[Variable, Function], bindings: Substitution, where: Source
    ) -> Linear:
        factors: dict[QuantityLevel, int] = {}

        def read(part: Term) -> tuple[dict[QuantityLevel, int], int]:
            match part:
                case Number(value):
                    return {}, value
                case Variable() if part in values:
                    return {self._level(substitute_atom(values[part], bindings)): 1}, 0
                case Operation(sign, left, right):
                    return _combine_sums(sign, read(left), read(right), part, where)
                case _:
                    message, hint = f"{part} is no number", "compare quantities with numbers"
                    raise InvalidInput([Diagnostic(where, "K103", message, hint)])

        factors, constant = read(substitute_term(term, bindings))
        return Linear(
            tuple((level, factor) for level, factor in factors.items() if factor), constant
        )


Sum = tuple[dict[QuantityLevel, int], int]


def _combine_sums(sign: str, left: Sum, right: Sum, term: Term, where: Source) -> Sum:
    """Two sums put together. Raises `InvalidInput` if the result is no sum."""
    (first_factors, first), (second_factors, second) = left, right
    if sign in ("+", "-"):
        factor = 1 if sign == "+" else -1
        keys = dict.fromkeys((*first_factors, *second_factors))
        return {
            k: first_factors.get(k, 0) + factor * second_factors.get(k, 0) for k in keys
        }, first + factor * second
    if sign == "*" and not (first_factors and second_factors):
        if not first_factors:
            first_factors, first, second = second_factors, second, first
        return {k: factor * second for k, factor in first_factors.items()}, first * second
    if not first_factors and not second_factors:
        value = evaluate_atom(Function("", (Operation(sign, Number(first), Number(second)),)))
        if value is not None and isinstance(value.arguments[0], Number):
            return {}, value.arguments[0].value
    message = f"{term} is not linear: quantities can be added, and multiplied by numbers"
    raise InvalidInput([Diagnostic(where, "K107", message, "write it as a sum")])


def unsatisfiable_tests(tests: tuple[Comparing, ...], numbering: Numbering) -> Bits:
    """The atoms of comparisons that never hold, whatever the values are within their ranges."""
    never = [test.atom for test in tests if test.settled is False]
    always = {test.atom for test in tests if test.settled is True}
    return bitset([*never, *(c for a, c in numbering.complements.items() if a in always)])


def with_tests(
    axioms: Axioms | None, tests: tuple[Comparing, ...], numbering: Numbering, size: int
) -> Axioms | None:
    """The axioms together with the comparisons of quantities."""
    if not tests:
        return axioms
    if axioms is None:
        atoms = bitset([test.atom for test in tests])
        own = {a: c for a, c in _complement_pairs(numbering).items() if atoms >> a & 1}
        return Axioms(size, (), {}, own, tests)
    return dataclasses.replace(axioms, tests=tests)


def _complement_pairs(numbering: Numbering) -> dict[int, int]:
    return {
        numbering.number(~signed): number
        for signed, number in list(numbering.added.items())
        if signed < 0
    }
