"""The relaxed task, without deletes, as an ASP program; also comparisons of quantities in it.

A step that breaks a comparison among the goals is of no use if nothing moves the quantity the other
way again.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

from cellwright.engine.stages.grounding.fluent_aggregates import expand_aggregates
from cellwright.engine.stages.grounding.grounding_program import (
    ChangingPredicates,
    Conditional,
    Schema,
    conditional_alternatives,
    conditional_body,
    consequence_body,
    deduction_rules,
    derived_rule,
    effect_rules,
    instance_atom,
    instance_body,
    instance_text,
    is_conditional,
    precondition_schemas,
    reachable_literal,
    rule_text,
)
from cellwright.engine.stages.grounding.numeric_quantities import (
    QuantitySetting,
    QuantityTest,
    SeparatedQuantities,
    without_quantities,
)
from cellwright.kb.asp.static_program import type_guard
from cellwright.kb.model.condition_forms import Normaliser
from cellwright.kb.model.conditions import Body, Comparison, Literal, goal_parts
from cellwright.kb.model.domain_model import UNLISTED_TYPES, Domain
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Function,
    Number,
    Operation,
    Term,
    Variable,
    is_ground,
    match_term,
    stage_parts,
    substitute_atom,
    substitute_term,
    term_variables,
)

CHANGED, VALUE, RAISED, LOWERED = "_changed", "_value", "_raised", "_lowered"
AUXILIARY_RULES = (
    CHANGED,
    VALUE,
    RAISED,
    LOWERED,
    "_but_",
    "_met_",
)  # how the names begin that only these rules use

Ways = list[list[str]]
"""Bodies of which one is enough."""


def measured_rules(
    name: str, head: Atom, body: Iterable[str], needed: Sequence[Ways], own: Body = ()
) -> Iterator[str]:
    """The rules for a head with a body and all that is `needed`, too. `name` is theirs alone.

    The body binds the variables of the head and of the literals in `own`.
    """
    if not needed:
        yield rule_text(str(head), body)
        return
    atoms = (head, *(literal.atom for literal in own if isinstance(literal, Literal)))
    variables_used = (
        variable for atom in atoms for variable in term_variables(atom) if variable != ANYTHING
    )
    arguments = tuple(dict.fromkeys(variables_used))
    rest = Function(f"_but_{name}", arguments)
    met = [Function(f"_met_{name}_{number}", arguments) for number, _ in enumerate(needed)]
    yield rule_text(str(rest), body)
    yield rule_text(str(head), map(str, met))
    for met_atom, ways in zip(met, needed, strict=True):
        yield from (rule_text(str(met_atom), [str(rest), *alternative]) for alternative in ways)


def change_rules(head: Atom, settings: Iterable[QuantitySetting]) -> Iterator[str]:
    """What an instance of an operator does to quantities: a value that it assigns, or any value."""
    for setting in settings:
        is_known = not _reads_quantities(setting.value, setting)
        value_fact = (
            f"{VALUE}({setting.quantity}, {setting.value})"
            if is_known
            else f"{CHANGED}({setting.quantity})"
        )
        yield rule_text(value_fact, [str(head)])


def move_rules(
    schema: Schema, settings: Iterable[QuantitySetting], vocabulary: ChangingPredicates
) -> Iterator[str]:
    """Whether an operator can raise or lower a quantity, within reach or not: what it needs may
    come by what it undoes.
    """
    operator = schema.operator
    plain = [
        e.atom
        for e in operator.effects
        if e.atom.name in vocabulary.events and not is_conditional(e)
    ]
    events = [Function(f"_v_{atom.name}", atom.arguments) for atom in plain]
    given_atoms = [
        literal.atom
        for literal in schema.static
        if isinstance(literal, Literal) and literal.positive
    ]
    body = [*type_guard(operator.parameters), *map(str, (*events, *given_atoms))]
    bound = {p.variable for p in operator.parameters if p.type not in UNLISTED_TYPES}
    bound |= {variable for atom in (*events, *given_atoms) for variable in term_variables(atom)}
    for setting in settings:
        step = _step_down(setting)
        sure = step is not None and set(term_variables(step)) <= bound
        yield rule_text(
            f"{RAISED}({setting.quantity})", [*body, *([f"{step} < 0"] if sure else [])]
        )
        yield rule_text(
            f"{LOWERED}({setting.quantity})", [*body, *([f"{step} > 0"] if sure else [])]
        )


def start_rules(taken: SeparatedQuantities) -> Iterator[str]:
    """The values at the start, which edits may add to."""
    yield f"#defined {CHANGED}/1. #defined {VALUE}/2. #defined {RAISED}/1. #defined {LOWERED}/1."
    for name, arity in sorted(
        {(initial_atom.name, len(initial_atom.arguments)) for initial_atom in taken.initial}
    ):
        arguments, value = tuple(Variable(f"X{place}") for place in range(arity)), Variable("Value")
        given_fact = reachable_literal(Function(name, (*arguments, value)))
        yield (
            f"#defined _r_{name}/{arity + 1}. {VALUE}({Function(name, arguments)}, {value}) :- "
            f"{given_fact}."
        )


def tests_in(body: Body, taken: SeparatedQuantities) -> list[Literal]:
    """The literals of a body that stand for comparisons."""
    return taken.literals_of([literal for literal in body if isinstance(literal, Literal)])


def possible_ways(literal: Literal, taken: SeparatedQuantities) -> Ways:
    """How a comparison can be as a literal wants it."""
    test = next(test for test in taken.tests if test.head.name == literal.atom.name)
    comparison, quantities = _tested_comparison(test, literal)
    values = [f"{VALUE}({quantity}, {variable})" for variable, quantity in quantities.items()]
    start = [*values, str(comparison) if literal.positive else f"not {comparison}"]
    return [start, *([f"{CHANGED}({quantity})"] for quantity in quantities.values())]


class GoalComparison(NamedTuple):
    """A goal: a quantity compared with a number."""

    quantity: Function
    relation: str
    number: Term


def goal_comparisons(goals: Iterable[Body], taken: SeparatedQuantities) -> Iterator[GoalComparison]:
    """The comparisons of one quantity with a number among goals without alternatives."""
    for literal in (
        literal_of_goal
        for body in goals
        for literal_of_goal in tests_in(body, taken)
        if literal_of_goal.positive
    ):
        test = next(test for test in taken.tests if test.head.name == literal.atom.name)
        comparison, quantities = _tested_comparison(test, literal)
        if len(quantities) == 1 and comparison.left in quantities and is_ground(comparison.right):
            yield GoalComparison(
                next(iter(quantities.values())), comparison.relation, comparison.right
            )


def goal_keeping_ways(
    settings: Iterable[QuantitySetting], goals: Sequence[GoalComparison]
) -> Iterator[Ways]:
    """What an instance of an operator needs so that it does not break a goal for good."""
    for setting in settings:
        if (step := _step_down(setting)) is not None:
            for goal in (goal for goal in goals if goal.quantity.name == setting.quantity.name):
                other_goal = (
                    [[f"{setting.quantity} != {goal.quantity}"]]
                    if setting.quantity != goal.quantity
                    else []
                )
                for harmless, relation, back in _HALF_TESTS.get(goal.relation, ()):
                    value_left = [
                        f"{VALUE}({goal.quantity}, _Left)",
                        f"_Left - {step} {relation} {goal.number}",
                    ]
                    yield [
                        *other_goal,
                        [f"{step} {harmless} 0"],
                        value_left,
                        [f"{back}({goal.quantity})"],
                    ]


# which steps do no harm, what has to hold after the others, and what may put it right again
_HALF_TESTS = {
    ">=": [("<=", ">=", RAISED)],
    ">": [("<=", ">", RAISED)],
    "<=": [(">=", "<=", LOWERED)],
    "<": [(">=", "<", LOWERED)],
    "=": [("<=", ">=", RAISED), (">=", "<=", LOWERED)],
}


def _tested_comparison(
    test: QuantityTest, literal: Literal
) -> tuple[Comparison, dict[Variable, Function]]:
    """The comparison that a literal stands for, and the quantities whose values its variables
    are.
    """
    bound = match_term(test.head, literal.atom, {}) or {}
    left_term, right = (
        substitute_term(side, bound) for side in (test.comparison.left, test.comparison.right)
    )
    quantities = {
        variable: substitute_atom(quantity, bound) for variable, quantity in test.values.items()
    }
    return Comparison(left_term, test.comparison.relation, right), quantities


def _step_down(setting: QuantitySetting) -> Term | None:
    """By how much a setting lowers its own quantity; None if it does something else."""
    match setting.value:
        case Operation("+" | "-" as sign, Variable() as own, by) if (
            setting.values.get(own) == setting.quantity
        ):
            if not _reads_quantities(by, setting):
                return by if sign == "-" else Operation("-", Number(0), by)
    return None


def _reads_quantities(term: Term, setting: QuantitySetting) -> bool:
    """Whether a term depends on values of quantities."""
    return any(variable in setting.values for variable in term_variables(term))


MISSED_PREDICATE = "_missed"
LOOSENED_PREDICATE = "_loosened"


def relaxed_rules(problem: Problem) -> str:
    """Everything but the static program and the initial state. `_missed(n)` says that goal n is out
    of reach.

    With `_loosened`, all defaults apply, whatever denies them. Comparisons of quantities hold as
    `measures` says; as conditions of effects they are taken to be true.
    """
    taken = without_quantities(problem)
    problem, normaliser = taken.problem, Normaliser()
    vocabulary = ChangingPredicates(problem.domain)
    tested = list(precondition_schemas(problem.domain, normaliser, vocabulary))
    untested = [
        replace(tested_schema, static=taken.without_tests(tested_schema.static))
        for tested_schema in tested
    ]
    effects = [
        replace(effect, static=taken.without_tests(effect.static))
        for effect in conditional_alternatives(problem.domain, normaliser, vocabulary)
    ]
    parts = [normaliser.disjuncts(part, {}) for part in goal_parts(problem.goal)]
    plain = expand_aggregates(
        problem.domain.rules, problem.domain, ChangingPredicates(problem.domain).is_dynamic
    )
    rules = (*plain.rules, *plain.reach, *normaliser.rules)
    derived = tuple(
        replace(derivation, body=taken.without_tests(derivation.body)) for derivation in rules
    )
    vocabulary = ChangingPredicates(problem.domain, derived)
    lines: list[str] = []
    asked = list(goal_comparisons((part[0] for part in parts if len(part) == 1), taken))
    for schema, whole in zip(untested, tested, strict=True):
        lines += [
            *_instance_rules(schema, tests_in(whole.static, taken), vocabulary, taken, asked),
            *effect_rules(schema, vocabulary),
            *_event_rules(schema, vocabulary),
        ]
    lines += _under_conditions(untested, effects, vocabulary)
    lines += [derived_rule(each, vocabulary) for each in derived]
    lines += [
        line
        for operator in problem.domain.deductive_operators
        for line in deduction_rules(operator)
    ]
    lines += _goal_rules(parts, vocabulary, taken)
    lines += [
        f"#defined {LOOSENED_PREDICATE}/0.",
        f"#defined {MISSED_PREDICATE}/1.",
        "#defined _goal/1.",
    ]
    lines += start_rules(taken)
    lines += _stage_rules(problem, vocabulary, len(parts))
    return "\n".join(
        [*lines, *_default_rules(problem), *_declaration_rules(problem.domain, vocabulary)]
    )


def _instance_rules(
    schema: Schema,
    tests: Sequence[Literal],
    vocabulary: ChangingPredicates,
    taken: SeparatedQuantities,
    goals: Sequence[GoalComparison],
) -> Iterator[str]:
    """When an instance of a schema is within reach and does no harm, and which quantities it
    changes.
    """
    body, head = instance_body(schema, vocabulary), instance_atom(schema)
    settings = taken.settings.get(schema.operator.name, ())
    needed = [*(possible_ways(test, taken) for test in tests), *goal_keeping_ways(settings, goals)]
    yield from measured_rules(f"o_{schema.number}", head, body, needed, tuple(tests))
    yield from change_rules(head, settings)
    yield from move_rules(schema, settings, vocabulary)


def _under_conditions(
    reachable_schemas: Sequence[Schema],
    effects: Iterable[Conditional],
    vocabulary: ChangingPredicates,
) -> Iterator[str]:
    """What conditional effects add, and the events that happen by them."""
    for effect in effects:
        for schema in reachable_schemas:
            if effect.operator is schema.operator and effect.effect.adds:
                happens = effect.effect.atom.name in vocabulary.events
                head = (
                    f"_h_{effect.effect.atom}" if happens else reachable_literal(effect.effect.atom)
                )
                yield rule_text(head, conditional_body(effect, schema))


def _goal_rules(
    goals: Iterable[Iterable[Body]], vocabulary: ChangingPredicates, taken: SeparatedQuantities
) -> Iterator[str]:
    """When each goal, a disjunction of bodies, is within reach."""
    for number, alternatives in enumerate(goals):
        for place, disjunct in enumerate(alternatives):
            literals, static = vocabulary.split(taken.without_tests(disjunct))
            body = [
                *(reachable_literal(literal.atom) for literal in literals if literal.positive),
                *map(str, static),
            ]
            head = Function("_goal", (Number(number),))
            tests = tests_in(disjunct, taken)
            needed = [possible_ways(test, taken) for test in tests]
            yield from measured_rules(f"g_{number}_{place}", head, body, needed, tuple(tests))
        yield f"{MISSED_PREDICATE}({number}) :- not _goal({number})."


def new_defaults(problem: Problem, atoms_held: dict[int, Sequence[Atom]]) -> Iterator[str]:
    """Defaults that apply only under a change.

    `held` are those that applied before; the initial state has them.
    """
    if problem.complete:
        return
    for number, default in enumerate(problem.domain.defaults):
        name, arity = f"_was_{number}", len(default.atom.arguments)
        yield f"#defined {name}/{arity}."
        yield from (f"{Function(name, atom.arguments)}." for atom in atoms_held[number])
        body = [*_body_lines(problem, number), f"not {Function(name, default.atom.arguments)}"]
        yield rule_text(reachable_literal(default.atom), body)


def denial_rules(problem: Problem) -> Iterator[str]:
    """No given fact may deny another one. The given facts are `_now(F)`."""
    for operator in problem.domain.deductive_operators:
        for consequence in operator.consequences:
            if operator.trigger.positive and not consequence.implied and not problem.complete:
                both = [f"_now({operator.trigger.atom})", f"_now({consequence.atom})"]
                yield f":- {', '.join([*both, *consequence_body(operator, consequence)])}."


def default_rule(problem: Problem, number: int) -> str:
    """The rule for `_default_n(...)`: what a default would add if nothing denied it."""
    atom = problem.domain.defaults[number].atom
    return rule_text(
        str(Function(f"_default_{number}", atom.arguments)), _body_lines(problem, number)
    )


def _body_lines(problem: Problem, number: int) -> list[str]:
    default = problem.domain.defaults[number]
    return [*type_guard(default.parameters), *map(str, default.body)]


def _default_rules(problem: Problem) -> Iterator[str]:
    if not problem.complete:
        for number, default in enumerate(problem.domain.defaults):
            yield rule_text(
                reachable_literal(default.atom), [*_body_lines(problem, number), LOOSENED_PREDICATE]
            )


def _event_rules(schema: Schema, vocabulary: ChangingPredicates) -> Iterator[str]:
    for effect in schema.operator.effects:
        if effect.adds and effect.atom.name in vocabulary.events and not is_conditional(effect):
            yield rule_text(f"_h_{effect.atom}", [instance_text(schema)])


def _stage_rules(problem: Problem, vocabulary: ChangingPredicates, first: int) -> Iterator[str]:
    stages = dict.fromkeys(
        part for c in problem.chains for stage in c.stages for part in stage_parts(stage)
    )
    for number, stage in enumerate(stages, first):
        if stage.name in vocabulary.events:
            yield f"_v_{stage}."
            yield f"_goal({number}) :- _h_{stage}."
        else:
            yield f"_goal({number}) :- {reachable_literal(stage)}."
        yield f"{MISSED_PREDICATE}({number}) :- not _goal({number})."


def _declaration_rules(domain: Domain, vocabulary: ChangingPredicates) -> Iterator[str]:
    for name, predicate in domain.predicates.items():
        prefixes = (
            ("_r_",)
            if vocabulary.is_dynamic(name)
            else ("_v_", "_h_")
            if name in vocabulary.events
            else ("",)
        )
        yield from (f"#defined {prefix}{name}/{len(predicate.arguments)}." for prefix in prefixes)
