"""The values of ground terms and their order, as in clingo: its arithmetic and its order of terms.

The search and the checker both use this definition, because it belongs to the domain language. It covers the
operations of that language (`+ - * / \\`); ranges, powers and absolute values occur only in ASP texts, which
clingo evaluates.
"""

from collections.abc import Callable, Iterable

from cellwright.kb.terms import PLAIN, Atom, Function, Number, Operation, Term, Text, form_of

BITS = 32  # bits of clingo's integers; larger values wrap around


def evaluate(term: Term, exact: bool = False) -> Term | None:
    """A ground term with all its arithmetic computed; None if it has no value, as with division by zero or
    `bolt + 1`. If it is `exact`, nothing wraps around.
    """
    if isinstance(term, Operation):
        return _calculated(term.operator, evaluate(term.left, exact), evaluate(term.right, exact), exact)
    return evaluate_atom(term) if isinstance(term, Function) else term


def evaluate_atom(atom: Atom) -> Atom | None:
    """`evaluate` for an atom. The result is an atom, too: the same one if there is no arithmetic in it."""
    if form_of(atom) == PLAIN:
        return atom
    values = [evaluate(argument) for argument in atom.arguments]
    found = tuple([value for value in values if value is not None])
    return Function(atom.name, found) if len(found) == len(values) else None


def wraps(term: Term) -> bool:
    """Whether a sum, a difference or a product in a ground term is too large, so that its value wraps around."""
    if not isinstance(term, Operation):
        return False
    left, right = evaluate(term.left), evaluate(term.right)
    if isinstance(left, Number) and isinstance(right, Number) and term.operator in _EXACT:
        exact = _EXACT[term.operator](left.value, right.value)
        if exact != _wrapped(exact):
            return True
    return wraps(term.left) or wraps(term.right)


def compare(left: Term, relation: str, right: Term, exact: bool = False) -> bool:
    """Whether a ground comparison is true; false if a side has no value."""
    one, other = evaluate(left, exact), evaluate(right, exact)
    if one is None or other is None:
        return False
    if relation in ("=", "!="):
        return (one == other) is (relation == "=")
    return _HOLDS[relation](_compared(order_key(one), order_key(other)))


def aggregated(function: str, tuples: Iterable[tuple[Term | None, ...]]) -> tuple[object, ...]:
    """The sort key of the value of a set of tuples: #count, #sum, #min or #max, as clingo has it.

    #sum passes over what is no number; the #min of nothing is greater than all terms, the #max of nothing less.
    """
    firsts = [each[0] for each in tuples if each and each[0] is not None]
    if function == "count":
        return (0, len(firsts))
    if function == "sum":
        return (0, sum(each.value for each in firsts if isinstance(each, Number)))
    keys = map(order_key, firsts)
    return min(keys, default=(9,)) if function == "min" else max(keys, default=(-1,))


def term_of(key: tuple[object, ...], tuples: Iterable[tuple[Term | None, ...]]) -> Term | None:
    """The term with the sort key of an aggregate's value; None if no term has it."""
    if key[0] == 0 and isinstance(key[1], int):
        return Number(key[1])
    firsts = (each[0] for each in tuples if each)
    return next((each for each in firsts if each is not None and order_key(each) == key), None)


def relates(relation: str, left: tuple[object, ...], right: tuple[object, ...]) -> bool:
    """Whether a comparison holds between the values with two sort keys."""
    if relation in ("=", "!="):
        return (left == right) is (relation == "=")
    return _HOLDS[relation](_compared(left, right))


def order_key(term: Term) -> tuple[object, ...]:
    """A sort key for clingo's order of values: numbers, constants, texts, then compound terms by arity, name, arguments."""
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


def _compared(low: tuple[object, ...], high: tuple[object, ...]) -> int:
    """-1, 0 or 1 if the first comes before the second, equals it, or comes after it."""
    return (low > high) - (low < high)


def _calculated(operator: str, left: Term | None, right: Term | None, exact: bool) -> Number | None:
    if not isinstance(left, Number) or not isinstance(right, Number):
        return None
    if operator in ("/", "\\"):
        return _divided(operator, left.value, right.value)
    value = _EXACT[operator](left.value, right.value)
    return Number(value if exact else _wrapped(value))


_EXACT: dict[str, Callable[[int, int], int]] = {
    "+": lambda left, right: left + right,
    "-": lambda left, right: left - right,
    "*": lambda left, right: left * right,
}


def _divided(operator: str, left: int, right: int) -> Number | None:
    """The quotient, rounded towards zero, or the remainder, which has the sign of the dividend."""
    if right == 0:
        return None
    quotient = abs(left) // abs(right)
    quotient = quotient if (left < 0) == (right < 0) else -quotient
    return Number(_wrapped(quotient if operator == "/" else left - quotient * right))


def _wrapped(value: int) -> int:
    half = 1 << (BITS - 1)
    return (value + half) % (2 * half) - half
