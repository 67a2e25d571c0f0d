"""Finds arithmetic of clingo that does not fit into its 32 bits; clingo wraps it silently.

For each operation in a rule there are rules for the values with which it does so. They have the
body of the rule, without the part that has the operation, unless that part binds a variable. What
they derive is computed again here, exactly. A `#sum` is added up in two halves of 16 bits.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

from clingo import ast

from cellwright.kb.asp import Grounder
from cellwright.kb.asp.statements import child_nodes
from cellwright.kb.diagnostics import Diagnostic, Source
from cellwright.kb.terms import Number

OVERFLOWN = "_overflown"
MOST = 2**31 - 1
LEAST = -MOST - 1
HALF = 2**16
LARGEST_POWER = 64  # a greater exponent is too large for any base but -1, 0 and 1
_NEEDS_LOOK = re.compile(r"(?<!:)-|[+*]|#sum")  # not the sign of a rule, `:-`
_NAMES = {"+": "sum", "-": "difference", "*": "product", "**": "power"}


@dataclass(frozen=True, slots=True)
class WatchedRule:
    """A rule as clingo gets it, where it stands, and how a person knows it."""

    text: str
    where: Source
    said: str


class _Watch(NamedTuple):
    """What is computed (an operation, or `#sum`), and rules for `_overflown(KEY, value, value)`
    that tell when it is too large.
    """

    sign: str
    rules: tuple[str, ...]


def rules_that_watch(rules: Sequence[WatchedRule]) -> str:
    """Rules that tell which operations in `rules` do not fit into 32 bits.

    `overflows` reads what they derive.
    """
    lines = [
        line.replace("KEY", f"{number},{place}")
        for number, rule in enumerate(rules)
        for place, watch in enumerate(_watches(rule.text))
        for line in watch.rules
    ]
    return "\n".join(lines)


def overflows(rules: Sequence[WatchedRule], grounder: Grounder) -> Iterator[Diagnostic]:
    """One diagnostic for each of `rules` in which something does not fit into 32 bits.

    Their rules of `rules_that_watch` are grounded.
    """
    told: set[int] = set()
    for key, place, left, right in grounder.atoms(OVERFLOWN, 4):
        if not all(isinstance(each, Number) for each in (key, place, left, right)):
            continue
        number, index, one, other = (
            each.value for each in (key, place, left, right) if isinstance(each, Number)
        )
        message = _message(_watches(rules[number].text)[index].sign, one, other)
        if message and number not in told:
            told.add(number)
            hint = f"numbers are at most {MOST}: count in a larger unit"
            yield Diagnostic(rules[number].where, "K113", f"{message}: {rules[number].said}", hint)


def _message(sign: str, left: int, right: int) -> str:
    """That the value of an operation, or of a sum in two halves, is too large; empty if it is
    not.
    """
    if sign == "#sum":
        total, said = left * HALF + right, "a #sum is"
    else:
        total, said = _exact(sign, left, right), f"the {_NAMES[sign]} {left} {sign} {right} is"
    return "" if LEAST <= total <= MOST else f"{said} {total}, which does not fit into 32 bits"


def _exact(sign: str, left: int, right: int) -> int:
    if sign == "**":
        return int(left ** min(max(right, 0), LARGEST_POWER))
    return left + right if sign == "+" else left - right if sign == "-" else left * right


@lru_cache(maxsize=20_000)
def _watches(text: str) -> tuple[_Watch, ...]:
    """The operations in a rule, each with the rules that watch it."""
    if not _NEEDS_LOOK.search(text):
        return ()
    nodes: list[ast.AST] = []
    ast.parse_string(text, nodes.append)
    return tuple(
        watch for node in nodes if node.ast_type == ast.ASTType.Rule for watch in _of_rule(node)
    )


def _of_rule(rule: ast.AST) -> Iterator[_Watch]:
    yield from _of_operations([rule.head], [str(each) for each in rule.body])
    for place, part in enumerate(rule.body):
        before = [
            str(each) for number, each in enumerate(rule.body) if number != place or _binds(each)
        ]
        aggregate = part.atom if part.ast_type == ast.ASTType.Literal else part
        if aggregate.ast_type == ast.ASTType.BodyAggregate:
            yield from _of_aggregate(aggregate, before)
        elif part.ast_type == ast.ASTType.ConditionalLiteral:
            yield from _of_operations(child_nodes(part), [*before, *map(str, part.condition)])
        else:
            yield from _of_operations([part], before)


def _binds(part: ast.AST) -> bool:
    """Whether a part of a body may bind variables: an atom that is true, an equation, or an
    aggregate that is equal to something.
    """
    if part.ast_type != ast.ASTType.Literal or part.sign != ast.Sign.NoSign:
        return False
    equal = ast.ComparisonOperator.Equal
    match part.atom.ast_type:
        case ast.ASTType.SymbolicAtom:
            return True
        case ast.ASTType.Comparison:
            return any(guard.comparison == equal for guard in part.atom.guards)
        case ast.ASTType.BodyAggregate | ast.ASTType.Aggregate:
            guards = (part.atom.left_guard, part.atom.right_guard)
            return any(guard is not None and guard.comparison == equal for guard in guards)
        case _:
            return False


def _of_aggregate(aggregate: ast.AST, body: Sequence[str]) -> Iterator[_Watch]:
    for element in aggregate.elements:
        yield from _of_operations(child_nodes(element), [*body, *map(str, element.condition)])
    guards = [each for each in (aggregate.left_guard, aggregate.right_guard) if each is not None]
    yield from _of_operations(guards, body)
    if aggregate.function not in (ast.AggregateFunction.Sum, ast.AggregateFunction.SumPlus):
        return
    name = "#sum" if aggregate.function == ast.AggregateFunction.Sum else "#sum+"
    high, low = (_halves(aggregate, sign) for sign in ("/", "\\"))
    both = [
        f"High__ = {name} {{ {high} }}",
        f"Low__ = {name} {{ {low} }}",
        f"Top__ = High__ + Low__ / {HALF}",
    ]
    limits = (f"Top__ >= {HALF // 2 - 1}", f"Top__ <= {1 - HALF // 2}")
    yield _Watch("#sum", tuple(_rule("High__", "Low__", [*body, *both, limit]) for limit in limits))


def _halves(aggregate: ast.AST, sign: str) -> str:
    """The elements of a sum with a half of each weight."""
    elements = []
    for element in aggregate.elements:
        terms = ", ".join([f"({element.terms[0]}) {sign} {HALF}", *map(str, element.terms)])
        elements.append(f"{terms} : {', '.join(map(str, element.condition))}")
    return "; ".join(elements)


def _of_operations(nodes: Iterable[ast.AST], body: Sequence[str]) -> Iterator[_Watch]:
    """The operations in some nodes, watched where a body holds."""
    for node in nodes:
        yield from _of_operations(child_nodes(node), body)
        if node.ast_type == ast.ASTType.BinaryOperation and node.operator_type in _WHEN:
            sign, conditions = _WHEN[node.operator_type]
            left, right = f"({node.left})", f"({node.right})"
            rules = (_rule(left, right, [*body, *when]) for when in conditions(left, right))
            yield _Watch(sign, tuple(rules))


def _rule(left: str, right: str, body: Sequence[str]) -> str:
    return f"{OVERFLOWN}(KEY,{left},{right}) :- {'; '.join(body)}."


# What two numbers are like whose sum, difference, product or power may be too large. Nothing in it
# wraps itself. What is added to 0 is a number: a name would be greater than all numbers. A product
# of -1 and the least number is left out, as no number is so small.
def _sums(left: str, right: str) -> list[list[str]]:
    return [
        [f"{right} + 0 > 0", f"{left} + 0 > {MOST} - {right}"],
        [f"{right} + 0 < 0", f"{left} + 0 < -{MOST} - {right}"],
    ]


def _differences(left: str, right: str) -> list[list[str]]:
    return [
        [f"{right} + 0 > 0", f"{left} + 0 < -{MOST} + {right}"],
        [f"{right} + 0 < 0", f"{left} + 0 > {MOST} + {right}"],
    ]


def _products(left: str, right: str) -> list[list[str]]:
    up, down = f"{MOST} / ({left})", f"{MOST} / (0 - {left})"
    return [
        [f"{left} + 0 > 0", f"{right} + 0 > {up}"],
        [f"{left} + 0 > 0", f"{right} + 0 < 0 - {up}"],
        [f"{left} + 0 < 0", f"{right} + 0 > {down}"],
        [f"{left} + 0 < 0", f"{right} + 0 < 0 - {down}"],
    ]


def _powers(left: str, right: str) -> list[list[str]]:
    return [[f"{left} + 0 != 0", f"{right} + 0 > 1"]]


_WHEN: dict[int, tuple[str, Callable[[str, str], list[list[str]]]]] = {
    ast.BinaryOperator.Plus: ("+", _sums),
    ast.BinaryOperator.Minus: ("-", _differences),
    ast.BinaryOperator.Multiplication: ("*", _products),
    ast.BinaryOperator.Power: ("**", _powers),
}
