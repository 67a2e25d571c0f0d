"""Warnings about a whole domain, such as predicates that nothing uses or makes true."""

from collections.abc import Collection, Iterator

from cellwright.kb.check.near_misses import (
    misspelt_heads,
    near_misses,
    never_given_back,
    read_by_engine,
)
from cellwright.kb.check.time_window_check import (
    contradictory_windows,
    idle_calendars,
    idle_windows,
)
from cellwright.kb.commands.ambiguous_phrases import unclear_words
from cellwright.kb.commands.phrase_meanings import spoken_of
from cellwright.kb.diagnostics import Diagnostic
from cellwright.kb.model.conditions import Aggregate, Condition, all_conditions, literals_in
from cellwright.kb.model.domain_model import Domain, Effect, Kind, Operator
from cellwright.kb.model.operator_amounts import number_terms
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.model.time_windows import TimeWindow
from cellwright.kb.terms import Atom, Term, is_ground, stage_parts


def check_domain(
    domain: Domain, problems: Collection[Problem] = (), happening: Collection[str] = ()
) -> list[Diagnostic]:
    """Warnings about a domain, seen together with its problems; faults make the predicates of
    `happening` true.
    """
    near = near_misses(domain)
    told_places = {diagnostic.where for diagnostic in near}
    unused = (
        diagnostic
        for diagnostic in _unused_predicates(domain, problems)
        if diagnostic.where not in told_places
    )
    return [
        *unused,
        *_never_added(domain, problems, happening),
        *_not_held(domain),
        *near,
        *_find_oversights(domain),
    ]


def _find_oversights(domain: Domain) -> Iterator[Diagnostic]:
    yield from unclear_words(domain)
    yield from misspelt_heads(domain, {*_read_predicates(domain), *_aggregated_predicates(domain)})
    yield from never_given_back(domain)


def unreachable_operators(
    domain: Domain, reached: Collection[str], happening: Collection[str] = ()
) -> list[Diagnostic]:
    """Warnings about operators that no problem can ever apply.

    Operators with events are left out, since a workflow may need them, and those that need what
    faults alone make true.
    """
    alone = {*happening} - {*_added_predicates(domain)}
    hint = "look at its types, its constraints, and at what adds its preconditions"
    return [
        Diagnostic(
            operator.where,
            "K304",
            f"no problem can ever apply {operator.header}",
            hint,
            warning=True,
        )
        for operator in domain.operators
        if operator.name not in reached
        and not any(_is_event(domain, effect) for effect in operator.effects)
        and not any(
            read.positive and read.atom.name in alone for read in literals_in(operator.precondition)
        )
    ]


def _unused_predicates(domain: Domain, problems: Collection[Problem]) -> Iterator[Diagnostic]:
    used = {
        *_read_predicates(domain),
        *_changed_predicates(domain),
        *_aggregated_predicates(domain),
        *_timed_predicates(domain.windows),
        *_problem_predicates(problems),
        *read_by_engine(domain),
    }
    used |= {literal.atom.name for literal in spoken_of(domain)}
    used |= {look.fact.name for o in domain.operators for look in o.online}
    used |= {
        atom.name
        for o in domain.operators
        for term in _number_terms(o)
        for atom in number_terms(domain, term)
    }
    stated = {
        use
        for statement in domain.asp
        for use in (statement.defines, *(use for use, _ in statement.uses))
    }
    for predicate in domain.predicates.values():
        if predicate.name not in used and (predicate.name, len(predicate.arguments)) not in stated:
            hint = "remove it, or use it"
            yield Diagnostic(
                predicate.where, "K309", f"nothing uses '{predicate.name}'", hint, warning=True
            )


def _number_terms(operator: Operator) -> Iterator[Term | None]:
    """The terms of an operator that amount to a number."""
    yield from operator.amounts
    if operator.command is not None and (measure := operator.command.measures) is not None:
        yield from (measure.nominal, measure.tolerance, measure.lower, measure.upper)
        yield from (measure.uncertainty, measure.risk, measure.worth)


def _problem_predicates(problems: Collection[Problem]) -> Iterator[str]:
    """The predicates in the facts, goals and workflows of problems."""
    for problem in problems:
        stages = (
            part
            for chain in problem.chains
            for stage in chain.stages
            for part in stage_parts(stage)
        )
        yield from (atom.name for atom in (*problem.statics, *problem.initial, *stages))
        yield from (literal.atom.name for literal in literals_in(problem.goal))
        yield from _timed_predicates(problem.windows)


def _timed_predicates(windows: Collection[TimeWindow]) -> Iterator[str]:
    """The predicates that windows of time are about."""
    return (pattern.atom.name for w in windows for pattern in (w.earlier, w.later))


def _never_added(
    domain: Domain, problems: Collection[Problem], happening: Collection[str]
) -> Iterator[Diagnostic]:
    added = {*_added_predicates(domain), *happening} | {
        fact.name for problem in problems for fact in problem.initial
    }
    yield from idle_windows(domain, problems, added)
    yield from contradictory_windows(domain, problems)
    yield from idle_calendars(domain, problems)
    for name in dict.fromkeys(_read_predicates(domain)):
        predicate = domain.predicates.get(name)
        if predicate and predicate.kind is Kind.FLUENT and name not in added:
            hint = "an operator, a deductive operator or a default must add it"
            message = f"'{name}' is a condition, but nothing makes it true"
            yield Diagnostic(predicate.where, "K310", message, hint, warning=True)


def _is_event(domain: Domain, effect: Effect) -> bool:
    return domain.predicates[effect.atom.name].kind is Kind.EVENT


def _not_held(domain: Domain) -> Iterator[Diagnostic]:
    """Warnings about an operator that reads an atom such as `free(gripper)` but does not hold the
    resource, although all other readers do.
    """
    readers: dict[Atom, list[Operator]] = {}
    for operator in domain.operators:
        for literal in literals_in(operator.precondition):
            if literal.positive and is_ground(literal.atom):
                readers.setdefault(literal.atom, []).append(operator)
    for atom, operators in readers.items():
        for resource in atom.arguments:
            without = [operator for operator in operators if resource not in operator.resources]
            if len(without) == 1 and len(operators) > 2:
                message = (
                    f"{without[0].header} reads {atom} but does not hold {resource}; all others "
                    "that read it do"
                )
                hint = (
                    f"add `{resource}` to its resources, or two such steps may run at the same "
                    "moment"
                )
                yield Diagnostic(without[0].where, "K305", message, hint, warning=True)


def _read_predicates(domain: Domain) -> Iterator[str]:
    """The predicates in conditions, constraints and rules, except those inside aggregates."""
    yield from (
        literal.atom.name
        for condition in _all_conditions(domain)
        for literal in literals_in(condition)
    )


def _aggregated_predicates(domain: Domain) -> Iterator[str]:
    """The predicates inside aggregates."""
    parts = (part for condition in _all_conditions(domain) for part in all_conditions(condition))
    yield from (name for part in parts if isinstance(part, Aggregate) for name, _ in part.uses)


def _all_conditions(domain: Domain) -> Iterator[Condition]:
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


def _changed_predicates(domain: Domain) -> Iterator[str]:
    yield from _added_predicates(domain)
    yield from (effect.atom.name for operator in domain.operators for effect in operator.effects)
    for deductive in domain.deductive_operators:
        yield deductive.trigger.atom.name
        yield from (consequence.atom.name for consequence in deductive.consequences)
    yield from (rule.head.name for rule in domain.rules)


def _added_predicates(domain: Domain) -> Iterator[str]:
    yield from (
        effect.atom.name
        for operator in domain.operators
        for effect in operator.effects
        if effect.adds
    )
    for deductive in domain.deductive_operators:
        yield from (
            consequence.atom.name for consequence in deductive.consequences if consequence.implied
        )
    yield from (default.atom.name for default in domain.defaults)
