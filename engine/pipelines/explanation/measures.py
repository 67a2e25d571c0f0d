"""Comparisons of quantities in the relaxed task: they can hold with values from the start, with those that steps assign, or
once a step has added or taken something.

What has to hold is asked apart from everything else, so that its variables have their values then.
"""

from collections.abc import Iterable, Iterator, Sequence

from engine.stages.grounding.numeric import Quantities, Setting
from engine.stages.grounding.program import reachable, rule
from kb.model.conditions import Body, Comparison, Literal
from kb.terms import ANYTHING, Atom, Function, Variable, match, substitute, substitute_atom, variables

CHANGED, VALUE = "_changed", "_value"
AUXILIARY = (CHANGED, VALUE, "_but_", "_met_")  # how the names begin that only these rules use


def measured(
    name: str, head: Atom, body: Iterable[str], tests: Sequence[Literal], taken: Quantities
) -> Iterator[str]:
    """The rules for a head, whose variables the body binds, where comparisons have to be true, too. `name` is theirs alone."""
    if not tests:
        yield rule(str(head), body)
        return
    known = (v for atom in (head, *(each.atom for each in tests)) for v in variables(atom) if v != ANYTHING)
    arguments = tuple(dict.fromkeys(known))
    rest = Function(f"_but_{name}", arguments)
    met = [Function(f"_met_{name}_{number}", arguments) for number, _ in enumerate(tests)]
    yield rule(str(rest), body)
    yield rule(str(head), map(str, met))
    for each, literal in zip(met, tests, strict=True):
        yield from (rule(str(each), [str(rest), *way]) for way in _ways(literal, taken))


def tests_in(body: Body, taken: Quantities) -> list[Literal]:
    """The literals of a body that stand for comparisons."""
    return taken.literals_of([each for each in body if isinstance(each, Literal)])


def changes(head: Atom, settings: Iterable[Setting]) -> Iterator[str]:
    """What an instance of an operator does to quantities: a value that it assigns, or any value."""
    for each in settings:
        known = not any(variable in each.values for variable in variables(each.value))
        what = f"{VALUE}({each.quantity}, {each.value})" if known else f"{CHANGED}({each.quantity})"
        yield rule(what, [str(head)])


def starts(taken: Quantities) -> Iterator[str]:
    """The values at the start, which edits may add to."""
    yield f"#defined {CHANGED}/1. #defined {VALUE}/2."
    for name, arity in sorted({(each.name, len(each.arguments)) for each in taken.initial}):
        arguments, value = tuple(Variable(f"X{place}") for place in range(arity)), Variable("Value")
        given = reachable(Function(name, (*arguments, value)))
        yield f"#defined _r_{name}/{arity + 1}. {VALUE}({Function(name, arguments)}, {value}) :- {given}."


def _ways(literal: Literal, taken: Quantities) -> Iterator[list[str]]:
    """The bodies under which a comparison can be as a literal wants it."""
    test = next(each for each in taken.tests if each.head.name == literal.atom.name)
    bound = match(test.head, literal.atom, {}) or {}
    quantities = {variable: substitute_atom(each, bound) for variable, each in test.values.items()}
    left, right = (substitute(each, bound) for each in (test.comparison.left, test.comparison.right))
    comparison = Comparison(left, test.comparison.relation, right)
    values = [f"{VALUE}({each}, {variable})" for variable, each in quantities.items()]
    yield [*values, str(comparison) if literal.positive else f"not {comparison}"]
    yield from ([f"{CHANGED}({each})"] for each in quantities.values())
