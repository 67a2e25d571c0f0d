"""The facts that would make the goals reachable in the relaxed task: abduction in ASP.

In the relaxed task no fact ever becomes false. Further facts may be assumed: those of every static predicate that is given
by facts, and those of every fluent that is not a goal. Sets of assumptions are enumerated by size. The planner finds out
which of them really give a plan.
"""

from collections.abc import Iterator, Sequence

from engine.stages.grounding.program import (
    Schema,
    Vocabulary,
    conditional_body,
    conditionals,
    deduction_rules,
    derived_rule,
    effect_rules,
    instance,
    instance_rule,
    reachable,
    rule,
    schemas,
)
from kb.asp import Grounder
from kb.asp.models import models
from kb.asp.vocabulary import VIOLATED, guard, static_program
from kb.model.conditions import Condition, goal_parts, literals
from kb.model.domain import NUMERIC_TYPES, Domain, Kind, Predicate
from kb.model.normalise import Normaliser
from kb.model.problem import Problem
from kb.terms import Atom, Function, Number, Term, Text, Variable

STATIC, INITIAL = "static", "initial"


def assumptions(
    problem: Problem, initial: Sequence[Atom], size: int, limit: int
) -> list[tuple[Function, ...]]:
    """Sets of `size` assumptions, `static(fact)` or `initial(fact)`, under each of which every goal is reachable."""
    text = [relaxed_program(problem, initial), *_new_defaults(problem), *_choices(problem)]
    text.append(f":- #count {{ F : _assumed(F) }} != {size}.")
    return list(models("\n".join(text), "_assumed", limit))


def relaxed_program(problem: Problem, initial: Sequence[Atom]) -> str:
    """The problem without denials and negative conditions, as a program. It has a model if all goals are reachable."""
    normaliser = Normaliser()
    vocabulary = Vocabulary(problem.domain)
    made = list(schemas(problem.domain, normaliser, vocabulary))
    effects = list(conditionals(problem.domain, normaliser, vocabulary))
    parts = goal_parts(problem.goal)
    goals = [normaliser.disjuncts(part, {}) for part in parts]
    vocabulary = Vocabulary(problem.domain, normaliser.rules)
    lines = [static_program(problem), *(f"{reachable(atom)}." for atom in initial), f":- {VIOLATED}(_)."]
    for schema in made:
        lines += [
            instance_rule(schema, vocabulary),
            *effect_rules(schema, vocabulary),
            *_events(schema, vocabulary),
        ]
    for each in effects:
        for schema in made:
            if each.operator is schema.operator and each.effect.adds:
                lines.append(rule(reachable(each.effect.atom), conditional_body(each, schema)))
    lines += [derived_rule(each, vocabulary) for each in (*problem.domain.rules, *normaliser.rules)]
    lines += [line for operator in problem.domain.deductive_operators for line in deduction_rules(operator)]
    for number, alternatives in enumerate(goals):
        for disjunct in alternatives:
            literals, static = vocabulary.split(disjunct)
            body = [*(reachable(each.atom) for each in literals if each.positive), *map(str, static)]
            lines.append(rule(f"_goal({number})", body))
        lines.append(f":- not _goal({number}).")
    return "\n".join([*lines, *_stages(problem, vocabulary), *_declared(problem.domain, vocabulary)])


def _new_defaults(problem: Problem) -> Iterator[str]:
    """Rules for defaults that apply only under the assumptions. All others are in the initial state already, or denied."""
    if problem.complete:
        return
    rules, bodies = [], []
    for number, default in enumerate(problem.domain.defaults):
        bodies.append([*guard(default.parameters), *map(str, default.body)])
        rules.append(rule(f"{Function(f'_was_{number}', default.atom.arguments)}", bodies[-1]))
    grounder = Grounder()
    grounder.ground("\n".join([static_program(problem), *rules]))
    for number, default in enumerate(problem.domain.defaults):
        name, arity = f"_was_{number}", len(default.atom.arguments)
        yield f"#defined {name}/{arity}."
        yield from (f"{Function(name, found)}." for found in grounder.atoms(name, arity))
        yield rule(
            reachable(default.atom), [*bodies[number], f"not {Function(name, default.atom.arguments)}"]
        )


def _events(schema: Schema, vocabulary: Vocabulary) -> Iterator[str]:
    for effect in schema.operator.effects:
        if effect.adds and effect.atom.name in vocabulary.events:
            yield rule(f"_h_{effect.atom}", [instance(schema)])


def _stages(problem: Problem, vocabulary: Vocabulary) -> Iterator[str]:
    for stage in dict.fromkeys(stage for chain in problem.chains for stage in chain.stages):
        if stage.name in vocabulary.events:
            yield f"_v_{stage}."
            yield f":- not _h_{stage}."
        else:
            yield f":- not {reachable(stage)}."


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


def _choices(problem: Problem) -> Iterator[str]:
    """The facts that may be assumed: static facts of extensional predicates, and initial facts that are no goals."""
    wanted = {name for part in goal_parts(problem.goal) for name in _names(part)}
    wanted |= {stage.name for chain in problem.chains for stage in chain.stages}
    yield from _values(problem)
    for predicate in problem.domain.predicates.values():
        atom = Function(
            predicate.name, tuple(Variable(f"X{index}") for index, _ in enumerate(predicate.arguments))
        )
        guards = ", ".join(_guards(predicate))
        condition = f" : {guards}" if guards else ""
        if predicate.kind is Kind.STATIC and extensional(problem.domain, predicate):
            yield f"{{ _assumed({STATIC}({atom})){condition} }}."
            yield f"{atom} :- _assumed({STATIC}({atom}))."
        elif predicate.kind is Kind.FLUENT and predicate.name not in wanted:
            yield f"{{ _assumed({INITIAL}({atom})){condition} }}."
            yield f"{reachable(atom)} :- _assumed({INITIAL}({atom}))."


def _names(condition: Condition) -> set[str]:
    return {literal.atom.name for literal in literals(condition)}


def extensional(domain: Domain, predicate: Predicate) -> bool:
    """Whether a static predicate is given by facts only, and not defined by rules."""
    signature = (predicate.name, len(predicate.arguments))
    return not any(each.defines == signature and each.body for each in domain.asp)


def _guards(predicate: Predicate) -> Iterator[str]:
    for index, type_ in enumerate(predicate.arguments):
        kind = "_number" if type_ in NUMERIC_TYPES else "_text" if type_ == "text" else type_
        yield f"{kind}(X{index})"


def _values(problem: Problem) -> Iterator[str]:
    """Facts for the values that may be assumed: numbers and texts in the static facts, and each number plus one."""
    grounder = Grounder()
    grounder.ground(static_program(problem))
    found = {inner for atom in grounder.everything() for inner in _leaves(atom)}
    numbers = {inner.value for inner in found if isinstance(inner, Number)}
    near = sorted(numbers | {number + 1 for number in numbers} | {0, 1})
    yield from (f"_number({number})." for number in near)
    yield from (
        f"_text({text})." for text in sorted(str(inner) for inner in found if isinstance(inner, Text))
    )
    yield "#defined _text/1."


def _leaves(term: Term) -> Iterator[Term]:
    if isinstance(term, Function):
        for argument in term.arguments:
            yield from _leaves(argument)
    yield term
