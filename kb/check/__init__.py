"""Finds faults that only a whole domain shows, such as predicates that nothing uses or makes true."""

from collections.abc import Collection, Iterator

from cellwright.kb.check.conventions import near_misses, read_by_engine
from cellwright.kb.check.oversights import misspelt_heads, never_given_back
from cellwright.kb.commands.ambiguity import unclear_words
from cellwright.kb.commands.phrases import spoken_of
from cellwright.kb.diagnostics import Diagnostic
from cellwright.kb.model.amounts import asked
from cellwright.kb.model.conditions import Aggregate, Condition, conditions, literals
from cellwright.kb.model.domain import Domain, Effect, Kind, Operator
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Atom, Term, is_ground, parts_of


def check_domain(
    domain: Domain, problems: Collection[Problem] = (), happening: Collection[str] = ()
) -> list[Diagnostic]:
    """Warnings about a domain, seen together with its problems; faults make the predicates of `happening` true."""
    near = near_misses(domain)
    told = {each.where for each in near}
    unused = (each for each in _unused(domain, problems) if each.where not in told)
    return [
        *unused,
        *_never_added(domain, problems, happening),
        *_not_held(domain),
        *near,
        *_overlooked(domain),
    ]


def _overlooked(domain: Domain) -> Iterator[Diagnostic]:
    yield from unclear_words(domain)
    yield from misspelt_heads(domain, {*_read(domain), *_counted(domain)})
    yield from never_given_back(domain)


def unreachable(
    domain: Domain, reached: Collection[str], happening: Collection[str] = ()
) -> list[Diagnostic]:
    """Warnings about operators that no problem can ever apply.

    Operators with events are left out, since a workflow may need them, and those that need what faults alone make true.
    """
    alone = {*happening} - {*_added(domain)}
    hint = "look at its types, its constraints, and at what adds its preconditions"
    return [
        Diagnostic(each.where, "K304", f"no problem can ever apply {each.header}", hint, warning=True)
        for each in domain.operators
        if each.name not in reached
        and not any(_is_event(domain, effect) for effect in each.effects)
        and not any(read.positive and read.atom.name in alone for read in literals(each.precondition))
    ]


def _unused(domain: Domain, problems: Collection[Problem]) -> Iterator[Diagnostic]:
    used = {*_read(domain), *_changed(domain), *_counted(domain), *_named(problems), *read_by_engine(domain)}
    used |= {literal.atom.name for literal in spoken_of(domain)}
    used |= {look.fact.name for o in domain.operators for look in o.online}
    used |= {each.name for o in domain.operators for term in _numbers(o) for each in asked(domain, term)}
    stated = {use for each in domain.asp for use in (each.defines, *(use for use, _ in each.uses))}
    for predicate in domain.predicates.values():
        if predicate.name not in used and (predicate.name, len(predicate.arguments)) not in stated:
            hint = "remove it, or use it"
            yield Diagnostic(predicate.where, "K309", f"nothing uses '{predicate.name}'", hint, warning=True)


def _numbers(operator: Operator) -> Iterator[Term | None]:
    """The terms of an operator that amount to a number."""
    yield from (operator.duration, operator.cost)
    if operator.command is not None and (measure := operator.command.measures) is not None:
        yield from (measure.nominal, measure.tolerance, measure.lower, measure.upper)
        yield from (measure.uncertainty, measure.risk, measure.worth)


def _named(problems: Collection[Problem]) -> Iterator[str]:
    """The predicates in the facts, goals and workflows of problems."""
    for problem in problems:
        stages = (part for chain in problem.chains for stage in chain.stages for part in parts_of(stage))
        yield from (atom.name for atom in (*problem.statics, *problem.initial, *stages))
        yield from (literal.atom.name for literal in literals(problem.goal))


def _never_added(
    domain: Domain, problems: Collection[Problem], happening: Collection[str]
) -> Iterator[Diagnostic]:
    made = {*_added(domain), *happening} | {fact.name for problem in problems for fact in problem.initial}
    for name in dict.fromkeys(_read(domain)):
        predicate = domain.predicates.get(name)
        if predicate and predicate.kind is Kind.FLUENT and name not in made:
            hint = "an operator, a deductive operator or a default must add it"
            message = f"'{name}' is a condition, but nothing makes it true"
            yield Diagnostic(predicate.where, "K310", message, hint, warning=True)


def _is_event(domain: Domain, effect: Effect) -> bool:
    return domain.predicates[effect.atom.name].kind is Kind.EVENT


def _not_held(domain: Domain) -> Iterator[Diagnostic]:
    """Warnings about an operator that reads an atom such as `free(gripper)` but does not hold the resource,
    although all other readers do.
    """
    readers: dict[Atom, list[Operator]] = {}
    for operator in domain.operators:
        for literal in literals(operator.precondition):
            if literal.positive and is_ground(literal.atom):
                readers.setdefault(literal.atom, []).append(operator)
    for atom, operators in readers.items():
        for resource in atom.arguments:
            without = [each for each in operators if resource not in each.resources]
            if len(without) == 1 and len(operators) > 2:
                message = f"{without[0].header} reads {atom} but does not hold {resource}; all others that read it do"
                hint = f"add `{resource}` to its resources, or two such steps may run at the same moment"
                yield Diagnostic(without[0].where, "K305", message, hint, warning=True)


def _read(domain: Domain) -> Iterator[str]:
    """The predicates in conditions, constraints and rules, except those inside aggregates."""
    yield from (literal.atom.name for each in _conditions(domain) for literal in literals(each))


def _counted(domain: Domain) -> Iterator[str]:
    """The predicates inside aggregates."""
    parts = (part for each in _conditions(domain) for part in conditions(each))
    yield from (name for part in parts if isinstance(part, Aggregate) for name, _ in part.uses)


def _conditions(domain: Domain) -> Iterator[Condition]:
    """Every condition of a domain, and every part of a body."""
    for operator in domain.operators:
        yield operator.precondition
        yield from (effect.condition for effect in operator.effects)
        yield from operator.body
    for deductive in domain.deductive_operators:
        yield from deductive.body
        yield from (part for consequence in deductive.consequences for part in consequence.body)
    yield from (part for rule in domain.rules for part in rule.body)
    yield from (part for default in domain.defaults for part in default.body)


def _changed(domain: Domain) -> Iterator[str]:
    yield from _added(domain)
    yield from (effect.atom.name for operator in domain.operators for effect in operator.effects)
    for deductive in domain.deductive_operators:
        yield deductive.trigger.atom.name
        yield from (consequence.atom.name for consequence in deductive.consequences)
    yield from (rule.head.name for rule in domain.rules)


def _added(domain: Domain) -> Iterator[str]:
    yield from (
        effect.atom.name for operator in domain.operators for effect in operator.effects if effect.adds
    )
    for deductive in domain.deductive_operators:
        yield from (consequence.atom.name for consequence in deductive.consequences if consequence.implied)
    yield from (default.atom.name for default in domain.defaults)
