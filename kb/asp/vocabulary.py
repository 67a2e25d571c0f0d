"""The static part of a problem as an ASP program: types, objects, compound terms, static facts and rules."""

from collections.abc import Collection, Iterable, Iterator

from cellwright.kb.model.conditions import Parameter
from cellwright.kb.model.domain import BUILT_IN_TYPES, NUMERIC_TYPES, OBJECT, Domain
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Function, Variable

VIOLATED = "_violated"


def static_program(problem: Problem, about: Collection[str] | None = None) -> str:
    """ASP text with exactly one model, which holds every static fact.

    Constraint n of the domain derives `_violated(n)`. With `about`, the model holds what is true of the predicates that are
    named there: nothing is said about others, except for those that they rest on.
    """
    domain = problem.domain
    needed = None if about is None else resting(domain, about)

    def wanted(name: str) -> bool:
        return needed is None or name in needed

    lines = [line for name, line in _types(domain) if wanted(name)]
    objects = {**domain.objects, **problem.objects}
    lines += [f"{type_}({name})." for name, type_ in objects.items() if wanted(type_)]
    lines += [f"{fact}." for fact in problem.statics if wanted(fact.name)]
    for number, each in enumerate(domain.asp):
        if each.is_constraint and wanted(VIOLATED):
            lines.append(each.under(f"{VIOLATED}({number})"))
        elif each.constant or (each.defines and wanted(each.defines[0])):
            lines.append(each.text)
    return "\n".join(lines)


def resting(domain: Domain, about: Collection[str]) -> set[str]:
    """Some predicates and all that they rest on, by rules, types and compound terms."""
    used: dict[str, set[str]] = {}
    for type_ in domain.types.values():
        used.setdefault(type_.parent, set()).add(type_.name)
    for function in domain.functions.values():
        used.setdefault(function.result, set()).update(function.arguments)
    for each in domain.asp:
        name = each.defines[0] if each.defines else VIOLATED
        used.setdefault(name, set()).update(use.predicate[0] for use in each.uses)
    found, waiting = set(about), list(about)
    while waiting:
        fresh = used.get(waiting.pop(), set()) - found
        found |= fresh
        waiting += fresh
    return found


def _types(domain: Domain) -> Iterator[tuple[str, str]]:
    """The rules of types and compound terms, each with the type about which it speaks."""
    for type_ in domain.types.values():
        yield type_.parent, f"{type_.parent}(X) :- {type_.name}(X)."
    for function in domain.functions.values():
        if any(argument in NUMERIC_TYPES for argument in function.arguments):
            continue
        arguments = tuple(Variable(f"X{index}") for index, _ in enumerate(function.arguments))
        guards = guard(Parameter(v, t) for v, t in zip(arguments, function.arguments, strict=True))
        body = f" :- {', '.join(guards)}" if guards else ""
        yield function.result, f"{function.result}({Function(function.name, arguments)}){body}."


def guard(parameters: Iterable[Parameter]) -> list[str]:
    """Body literals that bind each parameter to the values of its type.

    Numbers and texts cannot be listed, so they get none.
    """
    unbound = {name for name in BUILT_IN_TYPES if name != OBJECT}
    return [
        f"{parameter.type}({parameter.variable})" for parameter in parameters if parameter.type not in unbound
    ]
