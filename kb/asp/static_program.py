"""The static part of a problem as an ASP program: types, objects, terms, facts and rules."""

from collections.abc import Collection, Iterable, Iterator

from cellwright.kb.model.conditions import Parameter
from cellwright.kb.model.domain_model import BUILT_IN_TYPES, NUMERIC_TYPES, OBJECT_TYPE, Domain
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function, Variable

VIOLATED = "_violated"


def static_program(problem: Problem, about: Collection[str] | None = None) -> str:
    """ASP text with exactly one model, which holds every static fact.

    Constraint n of the domain derives `_violated(n)`. With `about`, the model holds what is true of
    the predicates that are named there: nothing is said about others, except for those that they
    rest on.
    """
    domain = problem.domain
    needed = None if about is None else dependency_closure(domain, about)

    def is_wanted(name: str) -> bool:
        return needed is None or name in needed

    lines = [line for name, line in _type_rules(domain) if is_wanted(name)]
    objects = {**domain.objects, **problem.objects}
    lines += [f"{type_}({name})." for name, type_ in objects.items() if is_wanted(type_)]
    lines += [f"{fact}." for fact in problem.statics if is_wanted(fact.name)]
    for number, statement in enumerate(domain.asp):
        if statement.is_constraint and is_wanted(VIOLATED):
            lines.append(statement.under(f"{VIOLATED}({number})"))
        elif statement.constant or (statement.defines and is_wanted(statement.defines[0])):
            lines.append(statement.text)
    return "\n".join(lines)


def dependency_closure(domain: Domain, about: Collection[str]) -> set[str]:
    """Some predicates and all that they rest on, by rules, types and compound terms."""
    used: dict[str, set[str]] = {}
    for type_ in domain.types.values():
        for parent in domain.parents(type_.name):
            used.setdefault(parent, set()).add(type_.name)
    for function in domain.functions.values():
        used.setdefault(function.result, set()).update(function.arguments)
    for statement in domain.asp:
        name = statement.defines[0] if statement.defines else VIOLATED
        used.setdefault(name, set()).update(use.predicate[0] for use in statement.uses)
    reached, waiting = set(about), list(about)
    while waiting:
        fresh = used.get(waiting.pop(), set()) - reached
        reached |= fresh
        waiting += fresh
    return reached


def _type_rules(domain: Domain) -> Iterator[tuple[str, str]]:
    """The rules of types and compound terms, each with the type about which it speaks."""
    for type_ in domain.types.values():
        for parent in domain.parents(type_.name):
            yield parent, f"{parent}(X) :- {type_.name}(X)."
    for function in domain.functions.values():
        if any(argument in NUMERIC_TYPES for argument in function.arguments):
            continue
        arguments = tuple(Variable(f"X{index}") for index, _ in enumerate(function.arguments))
        guards = type_guard(
            Parameter(v, t) for v, t in zip(arguments, function.arguments, strict=True)
        )
        body = f" :- {', '.join(guards)}" if guards else ""
        yield function.result, f"{function.result}({Function(function.name, arguments)}){body}."


def type_guard(parameters: Iterable[Parameter]) -> list[str]:
    """Body literals that bind each parameter to the values of its type.

    Numbers and texts cannot be listed, so they get none.
    """
    unbound = {name for name in BUILT_IN_TYPES if name != OBJECT_TYPE}
    return [
        f"{parameter.type}({parameter.variable})"
        for parameter in parameters
        if parameter.type not in unbound
    ]
