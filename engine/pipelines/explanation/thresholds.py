"""Which numbers a fact could have so that a comparison turns out differently: rules that compute them, in ASP.

A rule or an operator that compares a number of a fact with something else changes its answer where the two
are equal. So the other side is solved for the number, and evaluated with all other facts as they are.
"""

from collections.abc import Iterable, Iterator, Mapping

from cellwright.kb.asp.bodies import ReadBody, read_body
from cellwright.kb.model.conditions import Literal
from cellwright.kb.model.statement import Signature
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Function,
    Operation,
    Term,
    Variable,
    substitute,
    substitute_atom,
    variables,
)

THRESHOLD = "_threshold"
Renamed = Mapping[str, str]
"""For each predicate that changes, the predicate that holds what is reachable of it."""


def threshold_rules(texts: Iterable[str], opened: Iterable[Signature], renamed: Renamed) -> Iterator[str]:
    """Rules for `_threshold(p, i, N)`: N may matter as argument i of predicate p, which is one of `opened`."""
    wanted = set(opened)
    seen: set[str] = set()
    for body in map(read_body, texts):
        for literal in body.literals:
            if (literal.atom.name, len(literal.atom.arguments)) not in wanted:
                continue
            for place, argument in enumerate(literal.atom.arguments):
                if isinstance(argument, Variable) and argument != ANYTHING:
                    for line in _for_argument(body, literal, place, argument, renamed):
                        if line not in seen:
                            seen.add(line)
                            yield line


def _for_argument(
    body: ReadBody, literal: Literal, place: int, argument: Variable, renamed: Renamed
) -> Iterator[str]:
    rest = [_text(each.atom, renamed) for each in _others(body, argument)]
    own = _text(substitute_atom(literal.atom, {argument: ANYTHING}), renamed)
    bound = {v for each in _others(body, argument) for v in variables(each.atom)}
    beside = {v for v in variables(literal.atom)} - {argument}
    rest += [text for variable, text in body.counted]
    bound |= {variable for variable, _ in body.counted}
    for value in _solutions(body, argument):
        needed = set(variables(value))
        if not needed <= bound | beside:
            continue
        parts = rest if needed <= bound else [*rest, own]
        head = f"{THRESHOLD}({literal.atom.name}, {place}, {value}+__D)"
        yield f"{head} :- {', '.join([*parts, '__D = -1..1'])}."


def _others(body: ReadBody, argument: Variable) -> Iterator[Literal]:
    """The literals that hold whatever the number is."""
    return (each for each in body.literals if each.positive and argument not in variables(each.atom))


def _text(atom: Atom, renamed: Renamed) -> str:
    return str(Function(renamed.get(atom.name, atom.name), atom.arguments))


def _solutions(body: ReadBody, argument: Variable) -> Iterator[Term]:
    """What the variable is compared with, once every comparison that has it on one side is solved for it."""
    for each in body.comparisons:
        for bindings in ({}, _definitions(body, argument)):
            left, right = substitute(each.left, bindings), substitute(each.right, bindings)
            if list((*variables(left), *variables(right))).count(argument) == 1:
                inside, other = (left, right) if argument in variables(left) else (right, left)
                if (found := solved(inside, other, argument)) is not None:
                    yield found


def _definitions(body: ReadBody, argument: Variable) -> dict[Variable, Term]:
    """The variables that an equation defines, without `argument`."""
    defined: dict[Variable, Term] = {}
    for each in body.comparisons:
        for left, right in ((each.left, each.right), (each.right, each.left)):
            if each.relation == "=" and isinstance(left, Variable) and not isinstance(right, Variable):
                defined.setdefault(left, right)
    defined.pop(argument, None)
    return defined


def solved(inside: Term, other: Term, wanted: Variable) -> Term | None:
    """The value of `wanted`, which occurs once in `inside`, for which `inside` equals `other`, up to rounding.

    None where it cannot be computed.
    """
    while isinstance(inside, Operation):
        left = wanted in variables(inside.left)
        rest = inside.right if left else inside.left
        if (sign := _INVERSE.get((inside.operator, left))) is None:
            return None
        operator, swapped = sign
        other = Operation(operator, rest, other) if swapped else Operation(operator, other, rest)
        inside = inside.left if left else inside.right
    return other if inside == wanted else None


_INVERSE = {  # (operator, wanted is on its left): operator of the solution, and whether the rest comes first
    ("+", True): ("-", False),
    ("+", False): ("-", False),
    ("-", True): ("+", False),
    ("-", False): ("-", True),
    ("*", True): ("/", False),
    ("*", False): ("/", False),
    ("/", True): ("*", False),
    ("/", False): ("/", True),
}
