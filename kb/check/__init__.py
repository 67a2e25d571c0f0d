"""Findings about a whole domain that no single expression shows: what is declared and never used, read and never made."""

from collections.abc import Collection, Iterator

from kb.check.conventions import near_misses, read_by_engine
from kb.diagnostics import Diagnostic
from kb.model.conditions import Literal, literals
from kb.model.domain import Domain, Effect, Kind, Operator
from kb.model.problem import Problem
from kb.terms import Atom, is_ground


def check_domain(domain: Domain, problems: Collection[Problem] = ()) -> list[Diagnostic]:
    """Warnings about a domain, seen together with its problems."""
    near = near_misses(domain)
    told = {each.where for each in near}
    unused = (each for each in _unused(domain, problems) if each.where not in told)
    return [*unused, *_never_added(domain, problems), *_not_held(domain), *near]


def unreachable(domain: Domain, reached: Collection[str]) -> list[Diagnostic]:
    """Warnings about operators that no problem can ever apply; those that wait for a workflow stage are not meant."""
    hint = "look at its types, its constraints, and at what adds its preconditions"
    return [
        Diagnostic(each.where, "K304", f"no problem can ever apply {each.header}", hint, warning=True)
        for each in domain.operators
        if each.name not in reached and not any(_is_event(domain, effect) for effect in each.effects)
    ]


def _unused(domain: Domain, problems: Collection[Problem]) -> Iterator[Diagnostic]:
    used = {*_read(domain), *_changed(domain), *read_by_engine(domain)} | {
        f.name for p in problems for f in (*p.statics, *p.initial)
    }
    used |= {literal.atom.name for problem in problems for literal in literals(problem.goal)}
    text = "\n".join([*(part.text for part in domain.asp), *(p.goal + p.stage for p in domain.phrases)])
    for predicate in domain.predicates.values():
        if predicate.name not in used and f"{predicate.name}(" not in text:
            hint = "remove it, or use it"
            yield Diagnostic(predicate.where, "K309", f"nothing uses '{predicate.name}'", hint, warning=True)


def _never_added(domain: Domain, problems: Collection[Problem]) -> Iterator[Diagnostic]:
    made = {*_added(domain)} | {fact.name for problem in problems for fact in problem.initial}
    for name in dict.fromkeys(_read(domain)):
        predicate = domain.predicates.get(name)
        if predicate and predicate.kind is Kind.FLUENT and name not in made:
            hint = "an operator, a deductive operator or a default must add it"
            message = f"'{name}' is a condition, but nothing makes it true"
            yield Diagnostic(predicate.where, "K310", message, hint, warning=True)


def _is_event(domain: Domain, effect: Effect) -> bool:
    return domain.predicates[effect.atom.name].kind is Kind.EVENT


def _not_held(domain: Domain) -> Iterator[Diagnostic]:
    """Operators that read an atom such as `free(gripper)` without holding what all others that read it hold."""
    readers: dict[Atom, list[Operator]] = {}
    for operator in domain.operators:
        for literal in literals(operator.precondition):
            if literal.positive and is_ground(literal.atom):
                readers.setdefault(literal.atom, []).append(operator)
    for atom, operators in readers.items():
        for resource in atom.arguments:
            without = [each for each in operators if resource not in each.resources]
            if len(without) == 1 and len(operators) > 2:
                message = f"{without[0].header} reads {atom} but does not hold {resource}, as all others do that read it"
                hint = f"add `{resource}` to its resources, or two such steps may run at the same moment"
                yield Diagnostic(without[0].where, "K305", message, hint, warning=True)


def _read(domain: Domain) -> Iterator[str]:
    """Predicates that conditions, constraints and rules name."""
    for operator in domain.operators:
        conditions = [
            operator.precondition,
            *(effect.condition for effect in operator.effects),
            *operator.body,
        ]
        yield from (literal.atom.name for condition in conditions for literal in literals(condition))
    bodies = [d.body for d in domain.deductive_operators] + [rule.body for rule in domain.rules]
    bodies += [c.body for d in domain.deductive_operators for c in d.consequences]
    bodies += [default.body for default in domain.defaults]
    yield from (part.atom.name for body in bodies for part in body if isinstance(part, Literal))


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
