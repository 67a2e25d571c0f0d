r"""Arithmetic and order of ground terms, as clingo has them.

The search and the checker both use this definition, because it belongs to the domain language. It
covers the operations of that language (`+ - * / \`); ranges, powers and absolute values occur only
in ASP texts, which clingo evaluates.
"""

from collections.abc import Callable, Iterable

from cellwright.kb.terms import PLAIN, Atom, Function, Number, Operation, Term, Text, term_form

CLINGO_BITS = 32  # bits of clingo's integers; larger values wrap around


def evaluate_term(term: Term, exact: bool = False) -> Term | None:
    """A ground term with all its arithmetic computed; None if it has no value, as with division by
    zero or `bolt + 1`. If it is `exact`, nothing wraps around.
    """
    if isinstance(term, Operation):
        return _calculate_number(
            term.operator, evaluate_term(term.left, exact), evaluate_term(term.right, exact), exact
        )
    return evaluate_atom(term) if isinstance(term, Function) else term


def evaluate_atom(atom: Atom) -> Atom | None:
    """`evaluate` for an atom.

    The result is an atom, too: the same one if there is no arithmetic in it.
    """
    if term_form(atom) == PLAIN:
        return atom
    values = [evaluate_term(argument) for argument in atom.arguments]
    arguments = tuple([value for value in values if value is not None])
    return Function(atom.name, arguments) if len(arguments) == len(values) else None


def wraps_around(term: Term) -> bool:
    """Whether a sum, a difference or a product in a ground term is too large, so that its value
    wraps around.
    """
    if not isinstance(term, Operation):
        return False
    left, right = evaluate_term(term.left), evaluate_term(term.right)
    if isinstance(left, Number) and isinstance(right, Number) and term.operator in _EXACT:
        exact = _EXACT[term.operator](left.value, right.value)
        if exact != _wrap_integer(exact):
            return True
    return wraps_around(term.left) or wraps_around(term.right)


def compare_terms(left: Term, relation: str, right: Term, exact: bool = False) -> bool:
    """Whether a ground comparison is true; false if a side has no value."""
    one, other = evaluate_term(left, exact), evaluate_term(right, exact)
    if one is None or other is None:
        return False
    if relation in ("=", "!="):
        return (one == other) is (relation == "=")
    return _HOLDS[relation](_compare_keys(order_key(one), order_key(other)))


def aggregate_key(function: str, tuples: Iterable[tuple[Term | None, ...]]) -> tuple[object, ...]:
    """The sort key of the value of a set of tuples: #count, #sum, #min or #max, as clingo has it.

    #sum passes over what is no number; the #min of nothing is greater than all terms, the #max of
    nothing less.
    """
    firsts = [row[0] for row in tuples if row and row[0] is not None]
    if function == "count":
        return (0, len(firsts))
    if function == "sum":
        return (0, sum(first.value for first in firsts if isinstance(first, Number)))
    keys = map(order_key, firsts)
    return min(keys, default=(9,)) if function == "min" else max(keys, default=(-1,))


def term_of(key: tuple[object, ...], tuples: Iterable[tuple[Term | None, ...]]) -> Term | None:
    """The term with the sort key of an aggregate's value; None if no term has it."""
    if key[0] == 0 and isinstance(key[1], int):
        return Number(key[1])
    firsts = (row[0] for row in tuples if row)
    return next((first for first in firsts if first is not None and order_key(first) == key), None)


def keys_relate(relation: str, left: tuple[object, ...], right: tuple[object, ...]) -> bool:
    """Whether a comparison holds between the values with two sort keys."""
    if relation in ("=", "!="):
        return (left == right) is (relation == "=")
    return _HOLDS[relation](_compare_keys(left, right))


def order_key(term: Term) -> tuple[object, ...]:
    """A sort key for clingo's order of values: numbers, constants, texts, then compound terms
    by arity, name, arguments.
    """
    match term:
        case Number(value):
            return (0, value)
        case Function(name, ()):
            return (1, name)
        case Text(value):
            return (2, value)
        case Function(name, arguments):
            return (3, len(arguments), name, tuple(map(order_key, arguments)))
        case _:
            raise ValueError(f"{term} is no value")


_HOLDS: dict[str, Callable[[int], bool]] = {
    "<": lambda sign: sign < 0,
    "<=": lambda sign: sign <= 0,
    ">": lambda sign: sign > 0,
    ">=": lambda sign: sign >= 0,
}


def _compare_keys(low: tuple[object, ...], high: tuple[object, ...]) -> int:
    """-1, 0 or 1 if the first comes before the second, equals it, or comes after it."""
    return (low > high) - (low < high)


def _calculate_number(
    operator: str, left: Term | None, right: Term | None, exact: bool
) -> Number | None:
    if not isinstance(left, Number) or not isinstance(right, Number):
        return None
    if operator in ("/", "\\"):
        return _divide_numbers(operator, left.value, right.value)
    value = _EXACT[operator](left.value, right.value)
    return Number(value if exact else _wrap_integer(value))


_EXACT: dict[str, Callable[[int, int], int]] = {
    "+": lambda left, right: left + right,
    "-": lambda left, right: left - right,
    "*": lambda left, right: left * right,
}


def _divide_numbers(operator: str, left: int, right: int) -> Number | None:
    """The quotient, rounded towards zero, or the remainder, which has the sign of the dividend."""
    if right == 0:
        return None
    quotient = abs(left) // abs(right)
    quotient = quotient if (left < 0) == (right < 0) else -quotient
    return Number(_wrap_integer(quotient if operator == "/" else left - quotient * right))


def _wrap_integer(value: int) -> int:
    half = 1 << (CLINGO_BITS - 1)
    return (value + half) % (2 * half) - half
