"""The static part of a problem as an ASP program: types, objects, compound terms, static facts and rules."""

from collections.abc import Iterable, Iterator

from kb.model.conditions import Parameter
from kb.model.domain import BUILT_IN_TYPES, NUMERIC_TYPES, OBJECT, Domain
from kb.model.problem import Problem
from kb.terms import Function, Variable

VIOLATED = "_violated"


def static_program(problem: Problem) -> str:
    """ASP text with exactly one model, which holds every static fact.

    Constraint n of the domain derives `_violated(n)`.
    """
    domain = problem.domain
    lines = list(_types(domain))
    lines += [f"{type_}({name})." for name, type_ in {**domain.objects, **problem.objects}.items()]
    lines += [f"{fact}." for fact in problem.statics]
    for number, each in enumerate(domain.asp):
        lines.append(each.under(f"{VIOLATED}({number})") if each.is_constraint else each.text)
    return "\n".join(lines)


def _types(domain: Domain) -> Iterator[str]:
    for type_ in domain.types.values():
        yield f"{type_.parent}(X) :- {type_.name}(X)."
    for function in domain.functions.values():
        if any(argument in NUMERIC_TYPES for argument in function.arguments):
            continue
        arguments = tuple(Variable(f"X{index}") for index, _ in enumerate(function.arguments))
        guards = guard(Parameter(v, t) for v, t in zip(arguments, function.arguments, strict=True))
        body = f" :- {', '.join(guards)}" if guards else ""
        yield f"{function.result}({Function(function.name, arguments)}){body}."


def guard(parameters: Iterable[Parameter]) -> list[str]:
    """Body literals that bind each parameter to the values of its type.

    Numbers and texts cannot be listed, so they get none.
    """
    unbound = {name for name in BUILT_IN_TYPES if name != OBJECT}
    return [
        f"{parameter.type}({parameter.variable})" for parameter in parameters if parameter.type not in unbound
    ]
