"""Comparisons of quantities in the relaxed task: they can hold with values from the start, with those that steps assign, or
once a step has added or taken something.

A step that breaks a comparison among the goals is of no use if nothing moves the quantity the other way again.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from cellwright.engine.stages.grounding.numeric import Quantities, Setting, Test
from cellwright.engine.stages.grounding.program import Schema, Vocabulary, is_conditional, reachable, rule
from cellwright.kb.asp.vocabulary import guard
from cellwright.kb.model.conditions import Body, Comparison, Literal
from cellwright.kb.model.domain import UNLISTED
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Function,
    Number,
    Operation,
    Term,
    Variable,
    is_ground,
    match,
    substitute,
    substitute_atom,
    variables,
)

CHANGED, VALUE, RAISED, LOWERED = "_changed", "_value", "_raised", "_lowered"
AUXILIARY = (
    CHANGED,
    VALUE,
    RAISED,
    LOWERED,
    "_but_",
    "_met_",
)  # how the names begin that only these rules use

Ways = list[list[str]]
"""Bodies of which one is enough."""


def measured(
    name: str, head: Atom, body: Iterable[str], needed: Sequence[Ways], own: Body = ()
) -> Iterator[str]:
    """The rules for a head with a body and all that is `needed`, too. `name` is theirs alone.

    The body binds the variables of the head and of the literals in `own`.
    """
    if not needed:
        yield rule(str(head), body)
        return
    atoms = (head, *(each.atom for each in own if isinstance(each, Literal)))
    known = (each for atom in atoms for each in variables(atom) if each != ANYTHING)
    arguments = tuple(dict.fromkeys(known))
    rest = Function(f"_but_{name}", arguments)
    met = [Function(f"_met_{name}_{number}", arguments) for number, _ in enumerate(needed)]
    yield rule(str(rest), body)
    yield rule(str(head), map(str, met))
    for each, ways in zip(met, needed, strict=True):
        yield from (rule(str(each), [str(rest), *way]) for way in ways)


def changes(head: Atom, settings: Iterable[Setting]) -> Iterator[str]:
    """What an instance of an operator does to quantities: a value that it assigns, or any value."""
    for each in settings:
        known = not _reads(each.value, each)
        what = f"{VALUE}({each.quantity}, {each.value})" if known else f"{CHANGED}({each.quantity})"
        yield rule(what, [str(head)])


def moves(schema: Schema, settings: Iterable[Setting], vocabulary: Vocabulary) -> Iterator[str]:
    """Whether an operator can raise or lower a quantity, within reach or not: what it needs may come by what it undoes."""
    operator = schema.operator
    plain = [e.atom for e in operator.effects if e.atom.name in vocabulary.events and not is_conditional(e)]
    events = [Function(f"_v_{each.name}", each.arguments) for each in plain]
    given = [each.atom for each in schema.static if isinstance(each, Literal) and each.positive]
    body = [*guard(operator.parameters), *map(str, (*events, *given))]
    bound = {p.variable for p in operator.parameters if p.type not in UNLISTED}
    bound |= {variable for atom in (*events, *given) for variable in variables(atom)}
    for each in settings:
        step = _step(each)
        sure = step is not None and set(variables(step)) <= bound
        yield rule(f"{RAISED}({each.quantity})", [*body, *([f"{step} < 0"] if sure else [])])
        yield rule(f"{LOWERED}({each.quantity})", [*body, *([f"{step} > 0"] if sure else [])])


def starts(taken: Quantities) -> Iterator[str]:
    """The values at the start, which edits may add to."""
    yield f"#defined {CHANGED}/1. #defined {VALUE}/2. #defined {RAISED}/1. #defined {LOWERED}/1."
    for name, arity in sorted({(each.name, len(each.arguments)) for each in taken.initial}):
        arguments, value = tuple(Variable(f"X{place}") for place in range(arity)), Variable("Value")
        given = reachable(Function(name, (*arguments, value)))
        yield f"#defined _r_{name}/{arity + 1}. {VALUE}({Function(name, arguments)}, {value}) :- {given}."


def tests_in(body: Body, taken: Quantities) -> list[Literal]:
    """The literals of a body that stand for comparisons."""
    return taken.literals_of([each for each in body if isinstance(each, Literal)])


def possible(literal: Literal, taken: Quantities) -> Ways:
    """How a comparison can be as a literal wants it."""
    test = next(each for each in taken.tests if each.head.name == literal.atom.name)
    comparison, quantities = _comparing(test, literal)
    values = [f"{VALUE}({each}, {variable})" for variable, each in quantities.items()]
    start = [*values, str(comparison) if literal.positive else f"not {comparison}"]
    return [start, *([f"{CHANGED}({each})"] for each in quantities.values())]


class Kept(NamedTuple):
    """A goal: a quantity compared with a number."""

    quantity: Function
    relation: str
    number: Term


def kept(goals: Iterable[Body], taken: Quantities) -> Iterator[Kept]:
    """The comparisons of one quantity with a number among goals without alternatives."""
    for literal in (each for body in goals for each in tests_in(body, taken) if each.positive):
        test = next(each for each in taken.tests if each.head.name == literal.atom.name)
        comparison, quantities = _comparing(test, literal)
        if len(quantities) == 1 and comparison.left in quantities and is_ground(comparison.right):
            yield Kept(next(iter(quantities.values())), comparison.relation, comparison.right)


def keeping(settings: Iterable[Setting], goals: Sequence[Kept]) -> Iterator[Ways]:
    """What an instance of an operator needs so that it does not break a goal for good."""
    for each in settings:
        if (step := _step(each)) is not None:
            for goal in (goal for goal in goals if goal.quantity.name == each.quantity.name):
                other = [[f"{each.quantity} != {goal.quantity}"]] if each.quantity != goal.quantity else []
                for harmless, relation, back in _HALVES.get(goal.relation, ()):
                    left = [f"{VALUE}({goal.quantity}, _Left)", f"_Left - {step} {relation} {goal.number}"]
                    yield [*other, [f"{step} {harmless} 0"], left, [f"{back}({goal.quantity})"]]


_HALVES = {  # which steps do no harm, what has to hold after the others, and what may put it right again
    ">=": [("<=", ">=", RAISED)],
    ">": [("<=", ">", RAISED)],
    "<=": [(">=", "<=", LOWERED)],
    "<": [(">=", "<", LOWERED)],
    "=": [("<=", ">=", RAISED), (">=", "<=", LOWERED)],
}


def _comparing(test: Test, literal: Literal) -> tuple[Comparison, dict[Variable, Function]]:
    """The comparison that a literal stands for, and the quantities whose values its variables are."""
    bound = match(test.head, literal.atom, {}) or {}
    left, right = (substitute(each, bound) for each in (test.comparison.left, test.comparison.right))
    quantities = {variable: substitute_atom(each, bound) for variable, each in test.values.items()}
    return Comparison(left, test.comparison.relation, right), quantities


def _step(setting: Setting) -> Term | None:
    """By how much a setting lowers its own quantity; None if it does something else."""
    match setting.value:
        case Operation("+" | "-" as sign, Variable() as own, by) if (
            setting.values.get(own) == setting.quantity
        ):
            if not _reads(by, setting):
                return by if sign == "-" else Operation("-", Number(0), by)
    return None


def _reads(term: Term, setting: Setting) -> bool:
    """Whether a term depends on values of quantities."""
    return any(variable in setting.values for variable in variables(term))
