"""Conditions of operators, effects and rules: literals, comparisons, quantifiers, aggregates.

The domain language and PDDL share this one language of formulas.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

from cellwright.kb.model.statement import Signature
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Function,
    Substitution,
    Term,
    Variable,
    substitute_atom,
    substitute_term,
    term_variables,
)


@dataclass(frozen=True, slots=True)
class Parameter:
    """A variable with the type it ranges over."""

    variable: Variable
    type: str

    def __str__(self) -> str:
        return f"{self.variable}: {self.type}"


@dataclass(frozen=True, slots=True)
class Literal:
    """An atom that must be true if `positive`, else false (closed world)."""

    atom: Atom
    positive: bool = True

    def __str__(self) -> str:
        return str(self.atom) if self.positive else f"not {self.atom}"


@dataclass(frozen=True, slots=True)
class Comparison:
    """A comparison of two terms, as ASP orders them; `=` binds or tests. If it is `exact`, sums
    do not wrap around.
    """

    left: Term
    relation: str  # = != < <= > >=
    right: Term
    exact: bool = field(default=False, compare=False)

    def __str__(self) -> str:
        return f"{self.left} {self.relation} {self.right}"


@dataclass(frozen=True, slots=True)
class Aggregate:
    """An ASP aggregate over statics, kept as text because only clingo evaluates it.

    `outer` are its variables that occur outside its braces. `binds` is the one of `outer` that
    takes the aggregate's value. `standing` are all variables, inside and outside, as often as they
    occur. `uses` are the predicates that it counts.
    """

    text: str
    outer: tuple[Variable, ...] = ()
    binds: Variable | None = field(default=None, compare=False)
    standing: tuple[Variable, ...] = field(default=(), compare=False)
    uses: tuple[Signature, ...] = field(default=(), compare=False)

    def __str__(self) -> str:
        return self.text


MIRRORED_RELATIONS = {
    "=": "=",
    "!=": "!=",
    "<": ">",
    "<=": ">=",
    ">": "<",
    ">=": "<=",
}  # with the sides exchanged


@dataclass(frozen=True, slots=True)
class Element:
    """What an aggregate collects: the tuple of `terms`, for every binding that satisfies `body`."""

    terms: tuple[Term, ...]
    body: tuple[Literal | Comparison, ...]

    def __str__(self) -> str:
        return f"{', '.join(map(str, self.terms))} : {', '.join(map(str, self.body))}"


@dataclass(frozen=True, slots=True)
class StateAggregate:
    """An ASP aggregate over what can change, in a rule: the `function` of a set of tuples, compared
    with the guards.

    Each guard is (relation, term): the value stands left of the relation. `outer` are its variables
    that occur outside its braces. It must be true if `positive`, else false.
    """

    function: str  # count sum min max
    elements: tuple[Element, ...]
    guards: tuple[tuple[str, Term], ...]
    outer: tuple[Variable, ...]
    positive: bool = True

    def __str__(self) -> str:
        *other_guards, (relation, term) = self.guards
        said = f"#{self.function} {{ {'; '.join(map(str, self.elements))} }} {relation} {term}"
        for relation, term in other_guards:
            said = f"{term} {MIRRORED_RELATIONS[relation]} {said}"
        return said if self.positive else f"not {said}"


BodyPart = Literal | Comparison | Aggregate | StateAggregate
Body = tuple[BodyPart, ...]


@dataclass(frozen=True, slots=True)
class And:
    """All parts hold; `And(())` is true."""

    parts: tuple["Condition", ...] = ()

    def __str__(self) -> str:
        return ", ".join(map(str, self.parts))


@dataclass(frozen=True, slots=True)
class Or:
    """Some part holds; `Or(())` is false."""

    parts: tuple["Condition", ...] = ()

    def __str__(self) -> str:
        return " | ".join(map(_in_brackets, self.parts))


@dataclass(frozen=True, slots=True)
class Not:
    """The part does not hold."""

    part: "Condition"

    def __str__(self) -> str:
        return f"not {_in_brackets(self.part)}"


@dataclass(frozen=True, slots=True)
class Exists:
    """Some binding of the parameters makes the part hold."""

    parameters: tuple[Parameter, ...]
    part: "Condition"

    def __str__(self) -> str:
        if isinstance(self.part, Literal) and self.part.positive:
            return str(
                substitute_atom(self.part.atom, {p.variable: ANYTHING for p in self.parameters})
            )
        return self._compared or f"some {', '.join(map(str, self.parameters))} ({self.part})"

    @property
    def _compared(self) -> str:
        """A comparison of quantities, as a person writes it; nothing if this is something else."""
        parts = self.part.parts if isinstance(self.part, And) else ()
        given = [
            part.atom
            for part in parts
            if isinstance(part, Literal) and part.positive and part.atom.arguments
        ]
        values: dict[Variable, Term] = {
            atom.arguments[-1]: Function(atom.name, atom.arguments[:-1])
            for atom in given
            if isinstance(atom.arguments[-1], Variable)
        }
        tests = [substitute_part(part, values) for part in parts if isinstance(part, Comparison)]
        own = set(values) == {parameter.variable for parameter in self.parameters}
        return ", ".join(map(str, tests)) if own and len(given) + len(tests) == len(parts) else ""


@dataclass(frozen=True, slots=True)
class ForAll:
    """Every binding of the parameters makes the part hold."""

    parameters: tuple[Parameter, ...]
    part: "Condition"

    def __str__(self) -> str:
        match self.part:
            case Or((Not(guard), claim)):
                return f"{claim} : {guard}"
            case _:
                return f"every {', '.join(map(str, self.parameters))} ({self.part})"


Condition = Literal | Comparison | Aggregate | StateAggregate | And | Or | Not | Exists | ForAll

ALWAYS_TRUE = And(())


def _in_brackets(condition: Condition) -> str:
    match condition:
        case And(parts) | Or(parts) if len(parts) > 1:
            return f"({condition})"
        case _:
            return str(condition)


def all_conditions(condition: Condition) -> Iterator[Condition]:
    """The condition and all its parts, from the outside to the inside."""
    yield condition
    match condition:
        case And(parts) | Or(parts):
            for part in parts:
                yield from all_conditions(part)
        case Not(part) | Exists(_, part) | ForAll(_, part):
            yield from all_conditions(part)
        case StateAggregate(_, elements):
            yield from (part for element in elements for part in element.body)
        case _:
            return


def literals_in(condition: Condition) -> Iterator[Literal]:
    """Every literal in the condition, in order of occurrence."""
    return (part for part in all_conditions(condition) if isinstance(part, Literal))


def goal_parts(goal: Condition) -> tuple[Condition, ...]:
    """The conjuncts of a condition, at any depth of nesting. A true condition has none."""
    if not isinstance(goal, And):
        return (goal,)
    return tuple(part for inner in goal.parts for part in goal_parts(inner))


def part_variables(part: BodyPart) -> Iterator[Variable]:
    """The variables of a part of a body, in order, repeated as they repeat."""
    match part:
        case Literal(atom):
            yield from term_variables(atom)
        case Comparison(left, _, right):
            yield from term_variables(left)
            yield from term_variables(right)
        case Aggregate(outer=outer) | StateAggregate(outer=outer):
            yield from outer


def substitute_part(part: BodyPart, bindings: Substitution) -> BodyPart:
    """A part of a body with its variables replaced; the same part if nothing is replaced."""
    match part:
        case Literal(atom, positive):
            made = substitute_atom(atom, bindings)
            return part if made is atom else Literal(made, positive)
        case Comparison(left, relation, right):
            return Comparison(
                substitute_term(left, bindings),
                relation,
                substitute_term(right, bindings),
                part.exact,
            )
        case Aggregate():
            return part
        case StateAggregate():
            return _substitute_aggregate(part, bindings)


def _substitute_aggregate(aggregate: StateAggregate, bindings: Substitution) -> StateAggregate:
    """An aggregate with its outer variables replaced."""
    own = {variable: term for variable, term in bindings.items() if variable in aggregate.outer}
    return StateAggregate(
        aggregate.function,
        tuple(
            Element(
                tuple(substitute_term(term, own) for term in element.terms),
                tuple(_substitute_inner(part, own) for part in element.body),
            )
            for element in aggregate.elements
        ),
        tuple((relation, substitute_term(term, own)) for relation, term in aggregate.guards),
        tuple(
            dict.fromkeys(
                v
                for outer_term in aggregate.outer
                for v in term_variables(substitute_term(outer_term, own))
            )
        ),
        aggregate.positive,
    )


def _substitute_inner(part: Literal | Comparison, bindings: Substitution) -> Literal | Comparison:
    if isinstance(part, Literal):
        return Literal(substitute_atom(part.atom, bindings), part.positive)
    left, right = substitute_term(part.left, bindings), substitute_term(part.right, bindings)
    return Comparison(left, part.relation, right, part.exact)
