"""The task without denials and negative conditions, as an ASP program: what could be reached at most.

Static rules are evaluated exactly; only what changes is relaxed.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from cellwright.engine.pipelines.explanation.measures import (
    Kept,
    changes,
    keeping,
    kept,
    measured,
    moves,
    possible,
    starts,
    tests_in,
)
from cellwright.engine.stages.grounding.aggregates import expanded
from cellwright.engine.stages.grounding.numeric import Quantities, without_quantities
from cellwright.engine.stages.grounding.program import (
    Conditional,
    Schema,
    Vocabulary,
    conditional_body,
    conditionals,
    consequence_body,
    deduction_rules,
    derived_rule,
    effect_rules,
    instance,
    instance_atom,
    instance_body,
    is_conditional,
    reachable,
    rule,
    schemas,
)
from cellwright.kb.asp.vocabulary import guard
from cellwright.kb.model.conditions import Body, Literal, goal_parts
from cellwright.kb.model.domain import Domain
from cellwright.kb.model.normalise import Normaliser
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Atom, Function, Number, parts_of

MISSED = "_missed"
LOOSENED = "_loosened"


def relaxed_rules(problem: Problem) -> str:
    """Everything but the static program and the initial state. `_missed(n)` says that goal n is out of reach.

    With `_loosened`, all defaults apply, whatever denies them. Comparisons of quantities hold as `measures` says; as conditions
    of effects they are taken to be true.
    """
    taken = without_quantities(problem)
    problem, normaliser = taken.problem, Normaliser()
    vocabulary = Vocabulary(problem.domain)
    tested = list(schemas(problem.domain, normaliser, vocabulary))
    made = [replace(each, static=taken.without_tests(each.static)) for each in tested]
    effects = [
        replace(each, static=taken.without_tests(each.static))
        for each in conditionals(problem.domain, normaliser, vocabulary)
    ]
    parts = [normaliser.disjuncts(part, {}) for part in goal_parts(problem.goal)]
    plain = expanded(problem.domain.rules, problem.domain, Vocabulary(problem.domain).is_dynamic)
    derived = (*plain.rules, *plain.reach, *normaliser.rules)
    vocabulary = Vocabulary(problem.domain, derived)
    lines: list[str] = []
    asked = list(kept((part[0] for part in parts if len(part) == 1), taken))
    for schema, whole in zip(made, tested, strict=True):
        lines += [
            *_instances(schema, tests_in(whole.static, taken), vocabulary, taken, asked),
            *effect_rules(schema, vocabulary),
            *_events(schema, vocabulary),
        ]
    lines += _under_conditions(made, effects, vocabulary)
    lines += [derived_rule(each, vocabulary) for each in derived]
    lines += [line for operator in problem.domain.deductive_operators for line in deduction_rules(operator)]
    lines += _goals(parts, vocabulary, taken)
    lines += [f"#defined {LOOSENED}/0.", f"#defined {MISSED}/1.", "#defined _goal/1."]
    lines += starts(taken)
    lines += _stages(problem, vocabulary, len(parts))
    return "\n".join([*lines, *_defaults(problem), *_declared(problem.domain, vocabulary)])


def _instances(
    schema: Schema,
    tests: Sequence[Literal],
    vocabulary: Vocabulary,
    taken: Quantities,
    goals: Sequence[Kept],
) -> Iterator[str]:
    """When an instance of a schema is within reach and does no harm, and which quantities it changes."""
    body, head = instance_body(schema, vocabulary), instance_atom(schema)
    settings = taken.settings.get(schema.operator.name, ())
    needed = [*(possible(each, taken) for each in tests), *keeping(settings, goals)]
    yield from measured(f"o_{schema.number}", head, body, needed, tuple(tests))
    yield from changes(head, settings)
    yield from moves(schema, settings, vocabulary)


def _under_conditions(
    made: Sequence[Schema], effects: Iterable[Conditional], vocabulary: Vocabulary
) -> Iterator[str]:
    """What conditional effects add, and the events that happen by them."""
    for each in effects:
        for schema in made:
            if each.operator is schema.operator and each.effect.adds:
                happens = each.effect.atom.name in vocabulary.events
                head = f"_h_{each.effect.atom}" if happens else reachable(each.effect.atom)
                yield rule(head, conditional_body(each, schema))


def _goals(goals: Iterable[Iterable[Body]], vocabulary: Vocabulary, taken: Quantities) -> Iterator[str]:
    """When each goal, a disjunction of bodies, is within reach."""
    for number, alternatives in enumerate(goals):
        for place, disjunct in enumerate(alternatives):
            literals, static = vocabulary.split(taken.without_tests(disjunct))
            body = [*(reachable(each.atom) for each in literals if each.positive), *map(str, static)]
            head = Function("_goal", (Number(number),))
            tests = tests_in(disjunct, taken)
            needed = [possible(each, taken) for each in tests]
            yield from measured(f"g_{number}_{place}", head, body, needed, tuple(tests))
        yield f"{MISSED}({number}) :- not _goal({number})."


def new_defaults(problem: Problem, held: dict[int, Sequence[Atom]]) -> Iterator[str]:
    """Defaults that apply only under a change. `held` are those that applied before; the initial state has them."""
    if problem.complete:
        return
    for number, default in enumerate(problem.domain.defaults):
        name, arity = f"_was_{number}", len(default.atom.arguments)
        yield f"#defined {name}/{arity}."
        yield from (f"{Function(name, atom.arguments)}." for atom in held[number])
        body = [*_body(problem, number), f"not {Function(name, default.atom.arguments)}"]
        yield rule(reachable(default.atom), body)


def denials(problem: Problem) -> Iterator[str]:
    """No given fact may deny another one. The given facts are `_now(F)`."""
    for operator in problem.domain.deductive_operators:
        for each in operator.consequences:
            if operator.trigger.positive and not each.implied and not problem.complete:
                both = [f"_now({operator.trigger.atom})", f"_now({each.atom})"]
                yield f":- {', '.join([*both, *consequence_body(operator, each)])}."


def default_rule(problem: Problem, number: int) -> str:
    """The rule for `_default_n(...)`: what a default would add if nothing denied it."""
    atom = problem.domain.defaults[number].atom
    return rule(str(Function(f"_default_{number}", atom.arguments)), _body(problem, number))


def _body(problem: Problem, number: int) -> list[str]:
    default = problem.domain.defaults[number]
    return [*guard(default.parameters), *map(str, default.body)]


def _defaults(problem: Problem) -> Iterator[str]:
    if not problem.complete:
        for number, default in enumerate(problem.domain.defaults):
            yield rule(reachable(default.atom), [*_body(problem, number), LOOSENED])


def _events(schema: Schema, vocabulary: Vocabulary) -> Iterator[str]:
    for effect in schema.operator.effects:
        if effect.adds and effect.atom.name in vocabulary.events and not is_conditional(effect):
            yield rule(f"_h_{effect.atom}", [instance(schema)])


def _stages(problem: Problem, vocabulary: Vocabulary, first: int) -> Iterator[str]:
    stages = dict.fromkeys(part for c in problem.chains for stage in c.stages for part in parts_of(stage))
    for number, stage in enumerate(stages, first):
        if stage.name in vocabulary.events:
            yield f"_v_{stage}."
            yield f"_goal({number}) :- _h_{stage}."
        else:
            yield f"_goal({number}) :- {reachable(stage)}."
        yield f"{MISSED}({number}) :- not _goal({number})."


def _declared(domain: Domain, vocabulary: Vocabulary) -> Iterator[str]:
    for name, predicate in domain.predicates.items():
        prefixes = (
            ("_r_",)
            if vocabulary.is_dynamic(name)
            else ("_v_", "_h_")
            if name in vocabulary.events
            else ("",)
        )
        yield from (f"#defined {prefix}{name}/{len(predicate.arguments)}." for prefix in prefixes)
