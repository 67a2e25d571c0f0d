"""Quantities as fluents whose last argument is the value: comparisons and changes.

A comparison means that the fluents have some values for which it holds. A change is an effect that
ends the old value and one that adds the new value, so what reads domains needs to know fluents
only.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping

from cellwright.kb.model.conditions import And, Comparison, Condition, Exists, Literal, Parameter
from cellwright.kb.model.domain_model import Effect, Quantity
from cellwright.kb.terms import Atom, Function, Number, Operation, Term, Variable

Fresh = Iterator[int]
Values = Mapping[Function, Variable]


def replace_quantities(
    term: Term, known: Collection[str], values: dict[Function, Variable], fresh: Fresh
) -> Term:
    """A term with a variable in the place of each quantity in `known`; `values` are these
    variables.
    """
    match term:
        case Operation(sign, left, right):
            return Operation(
                sign,
                replace_quantities(left, known, values, fresh),
                replace_quantities(right, known, values, fresh),
            )
        case Function(name) if name in known:
            return values.setdefault(term, Variable(f"_Value{next(fresh)}"))
        case _:
            return term


def compare_quantities(comparison: Comparison, known: Collection[str], fresh: Fresh) -> Condition:
    """A comparison in which quantities may stand, as a condition on fluents."""
    values: dict[Function, Variable] = {}
    left, right = (
        replace_quantities(side, known, values, fresh)
        for side in (comparison.left, comparison.right)
    )
    return (
        some_values(values, [Comparison(left, comparison.relation, right, exact=True)])
        if values
        else comparison
    )


def some_values(values: Values, tests: Iterable[Comparison]) -> Condition:
    """The quantities have some values for which the comparisons hold."""
    parameters = tuple(Parameter(variable, "int") for variable in values.values())
    return Exists(parameters, And((*value_fluents(values), *tests)))


def value_fluents(values: Values) -> Iterator[Literal]:
    """The fluents that give the quantities their values."""
    for quantity, variable in values.items():
        yield Literal(value_atom(quantity, variable))


def value_atom(quantity: Function, value: Term) -> Atom:
    """The fluent that says that a quantity has a value."""
    return Function(quantity.name, (*quantity.arguments, value))


def range_comparisons(value: Term, bounds: Quantity) -> list[Comparison]:
    """That a value is in the range of its quantity; nothing where the range is open."""
    comparisons = []
    if bounds.low is not None:
        comparisons.append(Comparison(value, ">=", Number(bounds.low), exact=True))
    if bounds.high is not None:
        comparisons.append(Comparison(value, "<=", Number(bounds.high), exact=True))
    return comparisons


def value_error(
    fact: Atom, bounds: Quantity, known: Mapping[Function, int]
) -> tuple[str, str, str] | None:
    """What is wrong with the value that a fact gives a quantity, as code, message and hint; None if
    it is right. `known` are the values of other facts."""
    *arguments, value = fact.arguments
    quantity = Function(fact.name, tuple(arguments))
    if not isinstance(value, Number):
        return None
    if known.get(quantity, value.value) != value.value:
        message = f"{quantity} has two values, {known[quantity]} and {value}"
        return "K115", message, "leave one of the facts out"
    low, high = bounds.low, bounds.high
    if (low is None or low <= value.value) and (high is None or value.value <= high):
        return None
    ends = ("" if end is None else str(end) for end in (low, high))
    return (
        "K113",
        f"{quantity} is {value}, which is not within {'..'.join(ends)}",
        "change the fact, or the range",
    )


def value_change(
    quantity: Function, new: Term, values: Values, bounds: Quantity, fresh: Fresh
) -> tuple[Effect, Effect]:
    """The end of the old value, and the new one.

    In `new`, quantities are the variables in `values`; one of them is `quantity`.
    """
    held = tuple(value_fluents(values))
    parameters = tuple(Parameter(variable, "int") for variable in values.values())
    after = Variable(f"_Value{next(fresh)}")
    condition = And(
        (*held, Comparison(after, "=", new, exact=True), *range_comparisons(after, bounds))
    )
    ends = Effect(value_atom(quantity, values[quantity]), False, parameters, And(held))
    return ends, Effect(
        value_atom(quantity, after), True, (*parameters, Parameter(after, "int")), condition
    )


def distinct_quantities(changed: Iterable[tuple[Function, Function]]) -> list[Comparison]:
    """What keeps the two quantities of each pair from being the same one."""
    return [
        compare_arguments(first, "!=", second)
        for first, second in changed
        if first.name == second.name
    ]


def compare_arguments(one: Function, relation: str, other: Function) -> Comparison:
    """That two quantities of one name are the same one (`=`), or not (`!=`)."""
    return Comparison(_as_tuple(one), relation, _as_tuple(other))


def _as_tuple(quantity: Function) -> Term:
    return (
        quantity.arguments[0]
        if len(quantity.arguments) == 1
        else Function("_of", quantity.arguments)
    )
