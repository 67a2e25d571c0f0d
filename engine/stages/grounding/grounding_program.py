"""ASP text of a problem's grounding: its literals, rules and operator schemas.

The text uses these predicates. `_r_p` holds the reachable atoms of dynamic predicate p. `_i_p`
holds the same atoms with their numbers. `_o_k` holds the instances of schema k. `_v_p` holds the
events that a workflow stage names. Reachability ignores negative conditions.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from cellwright.kb.asp.static_program import type_guard
from cellwright.kb.model.condition_forms import Normaliser, free_variables, variables_bound_by
from cellwright.kb.model.conditions import ALWAYS_TRUE, Body, BodyPart, Literal, Parameter
from cellwright.kb.model.domain_model import (
    UNLISTED_TYPES,
    Consequence,
    DeductiveOperator,
    Domain,
    Effect,
    Kind,
    Operator,
    Rule,
)
from cellwright.kb.terms import ANYTHING, Atom, Function, Variable


@dataclass(frozen=True, slots=True)
class Schema:
    """One alternative (disjunct) of an operator's precondition.

    `literals` are its dynamic conditions, `static` are the other ones.
    """

    operator: Operator
    number: int
    literals: tuple[Literal, ...]
    static: Body
    # the header's, then those that occur only in dynamic conditions
    variables: tuple[Variable, ...]


@dataclass(frozen=True, slots=True)
class Conditional:
    """One alternative (disjunct) of a conditional effect of an operator."""

    operator: Operator
    effect: Effect
    literals: tuple[Literal, ...]
    static: Body


class ChangingPredicates:
    """The predicates that can change: events, fluents and derived predicates."""

    def __init__(self, domain: Domain, invented: Iterable[Rule] = ()) -> None:
        self.domain = domain
        kinds = {name: predicate.kind for name, predicate in domain.predicates.items()}
        self.events = {name for name, kind in kinds.items() if kind is Kind.EVENT}
        self.fluents = {name for name, kind in kinds.items() if kind is Kind.FLUENT}
        self.derived = {name for name, kind in kinds.items() if kind is Kind.DERIVED}
        self.derived |= {rule.head.name for rule in invented}

    def is_dynamic(self, name: str) -> bool:
        """Whether the predicate can change."""
        return name in self.fluents or name in self.derived

    def split(self, parts: Iterable[BodyPart]) -> tuple[tuple[Literal, ...], Body]:
        """The dynamic literals among the parts of a body, and the static rest."""
        dynamic, static = [], []
        for part in parts:
            if isinstance(part, Literal) and self.is_dynamic(part.atom.name):
                dynamic.append(part)
            else:
                static.append(part)
        return tuple(dynamic), tuple(static)


def reachable_literal(atom: Atom) -> str:
    """The text of the literal that says that an atom can become true."""
    return str(Function(f"_r_{atom.name}", atom.arguments))


def numbered_literal(atom: Atom, number: str) -> str:
    """The text of the literal that binds the variable `number` to the number of an atom."""
    return str(Function(f"_i_{atom.name}", (*atom.arguments, Variable(number))))


def rule_text(head: str, body: Iterable[str]) -> str:
    """The text of one rule, or of one fact if the body is empty."""
    text = ", ".join(dict.fromkeys(body))
    return f"{head} :- {text}." if text else f"{head}."


def precondition_schemas(
    domain: Domain, normaliser: Normaliser, vocabulary: ChangingPredicates
) -> Iterator[Schema]:
    """The operators, one schema for each alternative of a precondition."""
    number = 0
    for operator in domain.operators:
        types = {parameter.variable: parameter.type for parameter in operator.parameters}
        for disjunct in normaliser.disjuncts(operator.precondition, types):
            vocabulary.derived |= {invented.head.name for invented in normaliser.rules}
            literals, static = vocabulary.split(disjunct)
            yield Schema(
                operator,
                number,
                literals,
                (*operator.body, *static),
                _header_variables(operator, literals),
            )
            number += 1


def _header_variables(operator: Operator, literals: tuple[Literal, ...]) -> tuple[Variable, ...]:
    used = (variable for literal in literals for variable in free_variables(literal))
    return tuple(dict.fromkeys([*operator.variables, *used]))


def conditional_alternatives(
    domain: Domain, normaliser: Normaliser, vocabulary: ChangingPredicates
) -> Iterator[Conditional]:
    """The effects that have conditions or parameters, one for each alternative of a condition."""
    for operator in domain.operators:
        types = {parameter.variable: parameter.type for parameter in operator.parameters}
        for effect in operator.effects:
            if not is_conditional(effect):
                continue
            inner = {
                **types,
                **{parameter.variable: parameter.type for parameter in effect.parameters},
            }
            for disjunct in normaliser.disjuncts(effect.condition, inner):
                vocabulary.derived |= {invented.head.name for invented in normaliser.rules}
                literals, static = vocabulary.split(disjunct)
                yield Conditional(
                    operator,
                    effect,
                    literals,
                    (
                        *static,
                        *(
                            _guard_literal(p)
                            for p in effect.parameters
                            if p.type not in UNLISTED_TYPES
                        ),
                    ),
                )


def _guard_literal(parameter: Parameter) -> Literal:
    return Literal(Function(parameter.type, (parameter.variable,)))


def is_conditional(effect: Effect) -> bool:
    """Whether an effect depends on the state or has quantified parameters."""
    return bool(effect.parameters) or effect.condition != ALWAYS_TRUE


def instance_text(schema: Schema) -> str:
    """The text of the atom that says that an instance of a schema is reachable."""
    return str(instance_atom(schema))


def instance_atom(schema: Schema) -> Function:
    """The atom that says that an instance of a schema is reachable."""
    return Function(f"_o_{schema.number}", schema.variables)


def instance_rule(schema: Schema, vocabulary: ChangingPredicates) -> str:
    """The rule that says when an instance of a schema is reachable."""
    return rule_text(instance_text(schema), instance_body(schema, vocabulary))


def instance_body(schema: Schema, vocabulary: ChangingPredicates) -> list[str]:
    """When an instance of a schema is reachable.

    A workflow stage must name each of its events. Of those that happen under conditions, a stage
    gives the numbers that nothing else binds.
    """
    effects = [e for e in schema.operator.effects if e.atom.name in vocabulary.events]
    named = [e.atom for e in effects if not is_conditional(e)]
    named += [
        _numbers_of(e.atom, schema)
        for e in effects
        if is_conditional(e) and _gives_values(e.atom, schema)
    ]
    body = [str(Function(f"_v_{event.name}", event.arguments)) for event in named]
    body += [reachable_literal(literal.atom) for literal in schema.literals if literal.positive]
    body += type_guard(schema.operator.parameters)
    return [*body, *map(str, schema.static)]


def _gives_values(event: Atom, schema: Schema) -> bool:
    """Whether a stage has to say which values a variable of the header takes: it is a number
    that nothing else binds.
    """
    return any(
        isinstance(argument, Variable)
        for argument in _numbers_of(event, schema).arguments
        if argument != ANYTHING
    )


def _numbers_of(event: Atom, schema: Schema) -> Atom:
    """An event with `_` for all arguments but numbers of the header that nothing else binds."""
    unlisted = {p.variable for p in schema.operator.parameters if p.type in UNLISTED_TYPES}
    bound = variables_bound_by((), (*schema.static, *schema.literals))
    wanted_variables = unlisted - bound
    return Function(
        event.name,
        tuple(
            argument if argument in wanted_variables else ANYTHING for argument in event.arguments
        ),
    )


def effect_rules(schema: Schema, vocabulary: ChangingPredicates) -> Iterator[str]:
    """The rules for the atoms that an instance adds unconditionally."""
    for effect in schema.operator.effects:
        if effect.adds and not is_conditional(effect) and effect.atom.name in vocabulary.fluents:
            yield rule_text(reachable_literal(effect.atom), [instance_text(schema)])


def conditional_body(conditional: Conditional, schema: Schema) -> list[str]:
    """The conditions under which a conditional effect of a schema's instance can happen."""
    return [
        str(Function(f"_o_{schema.number}", _projected_header(schema))),
        *(reachable_literal(literal.atom) for literal in conditional.literals if literal.positive),
        *map(str, conditional.static),
    ]


def _projected_header(schema: Schema) -> tuple[Variable, ...]:
    own = set(schema.operator.variables)
    return tuple(variable if variable in own else ANYTHING for variable in schema.variables)


def deduction_rules(operator: DeductiveOperator) -> Iterator[str]:
    """The rules for the atoms that follow from a reachable trigger, be it added or denied."""
    for consequence in operator.consequences:
        if consequence.implied:
            yield rule_text(
                reachable_literal(consequence.atom),
                [
                    reachable_literal(operator.trigger.atom),
                    *consequence_body(operator, consequence),
                ],
            )


def consequence_body(operator: DeductiveOperator, consequence: Consequence) -> list[str]:
    """The static conditions and types under which a consequence follows."""
    return [
        *type_guard(consequence.parameters),
        *map(str, operator.body),
        *map(str, consequence.body),
    ]


def derived_rule(rule_: Rule, vocabulary: ChangingPredicates) -> str:
    """The rule that says when a derived atom can become true."""
    literals, static = vocabulary.split(rule_.body)
    positives = (reachable_literal(literal.atom) for literal in literals if literal.positive)
    return rule_text(reachable_literal(rule_.head), [*positives, *map(str, static)])


def column_name(prefix: str, index: int) -> str:
    """The name of a variable that holds a number in a row.

    It differs from every name that an author may write, because the author's variables occur in the
    same rule.
    """
    return f"__{prefix}{index}"


def number_literals(literals: Iterable[Literal], prefix: str) -> tuple[list[str], list[str]]:
    """Body literals that bind a variable to the number of each literal's atom, and the variables'
    names.

    The number is -1 for a negated literal whose atom is unreachable.
    """
    body, names = [], []
    for index, literal in enumerate(literals):
        name = column_name(prefix, index)
        names.append(name)
        if literal.positive:
            body.append(numbered_literal(literal.atom, name))
        else:
            number_column = column_name(f"{prefix}N", index)
            body.append(
                f"{name} = #max {{ -1 ; {number_column} : "
                f"{numbered_literal(literal.atom, number_column)} }}"
            )
    return body, names


def signed_numbers(literals: Sequence[Literal], numbers: list[int]) -> tuple[int, ...]:
    """The signed numbers of literals.

    A negated atom that is never reachable (number -1) is always false, so it is left out.
    """
    pairs = zip(literals, numbers, strict=True)
    return tuple(
        n if literal.positive else ~n for literal, n in pairs if literal.positive or n >= 0
    )
