"""Turns rules of clingo's syntax tree into values of the model, for rules that the planner evaluates."""

from clingo import SymbolType, ast

from cellwright.kb.model.conditions import (
    MIRRORED,
    Body,
    BodyPart,
    Comparison,
    Element,
    Literal,
    StateAggregate,
)
from cellwright.kb.model.conditions import part_variables as variables_of
from cellwright.kb.terms import ANYTHING, Atom, Function, Number, Operation, Term, Text, Variable, variables


class NotCompilable(Exception):
    """The model has no value for a part of a rule. The message is the text of that part."""


def compiled(rule: ast.AST) -> tuple[Atom, Body]:
    """Head and body of a rule without pools whose head is an atom. Raises `NotCompilable`."""
    head = _atom(rule.head.atom)
    plain = [part(node) for node in rule.body if not _is_aggregate(node)]
    outside = {*variables(head), *(v for each in plain for v in variables_of(each))}
    for node in filter(_is_aggregate, rule.body):
        outside.update(v for _, term in _guards(node.atom) for v in variables(term))
    waiting = iter(plain)
    body: list[BodyPart] = [
        _aggregate(node, outside) if _is_aggregate(node) else next(waiting) for node in rule.body
    ]
    return head, tuple(body)


def _is_aggregate(node: ast.AST) -> bool:
    return bool(
        node.ast_type == ast.ASTType.Literal
        and node.atom.ast_type in (ast.ASTType.BodyAggregate, ast.ASTType.Aggregate)
    )


def _aggregate(node: ast.AST, outside: set[Variable]) -> StateAggregate:
    """An aggregate in a rule whose other parts, and whose guards, have the variables `outside`."""
    name = _FUNCTIONS.get(getattr(node.atom, "function", -1))
    if name is None or node.sign == ast.Sign.DoubleNegation:
        raise NotCompilable(str(node))
    elements = tuple(
        Element(tuple(map(value, each.terms)), tuple(map(part, each.condition)))
        for each in node.atom.elements
    )
    used = [v for each in elements for term in each.terms for v in variables(term)]
    used += [v for each in elements for inner in each.body for v in variables_of(inner)]
    guards = _guards(node.atom)
    used += [v for _, term in guards for v in variables(term)]
    outer = tuple(dict.fromkeys(v for v in used if v in outside and v != ANYTHING))
    return StateAggregate(name, elements, guards, outer, node.sign == ast.Sign.NoSign)


def _guards(aggregate: ast.AST) -> tuple[tuple[str, Term], ...]:
    """What the value of an aggregate is compared with, and how; the value stands left."""
    found = []
    if aggregate.left_guard is not None:
        found.append((MIRRORED[relation(aggregate.left_guard.comparison)], value(aggregate.left_guard.term)))
    if aggregate.right_guard is not None:
        found.append((relation(aggregate.right_guard.comparison), value(aggregate.right_guard.term)))
    if not found:
        raise NotCompilable(str(aggregate))
    return tuple(found)


def part(node: ast.AST) -> Literal | Comparison:
    """A literal of a body. Raises `NotCompilable`."""
    if node.ast_type != ast.ASTType.Literal:
        raise NotCompilable(str(node))
    match node.atom.ast_type, node.sign:
        case ast.ASTType.SymbolicAtom, ast.Sign.NoSign | ast.Sign.Negation:
            return Literal(_atom(node.atom), node.sign == ast.Sign.NoSign)
        case ast.ASTType.Comparison, ast.Sign.NoSign if len(node.atom.guards) == 1:
            guard = node.atom.guards[0]
            return Comparison(value(node.atom.term), relation(guard.comparison), value(guard.term))
        case _:
            raise NotCompilable(str(node))


def _atom(node: ast.AST) -> Atom:
    return Function(node.symbol.name, tuple(map(value, node.symbol.arguments)))


def value(node: ast.AST) -> Term:
    """A term. Raises `NotCompilable`."""
    match node.ast_type:
        case ast.ASTType.Variable:
            return Variable(node.name)
        case ast.ASTType.SymbolicTerm:
            return _symbol(node)
        case ast.ASTType.Function if node.name and not node.external:
            return Function(node.name, tuple(map(value, node.arguments)))
        case ast.ASTType.BinaryOperation if node.operator_type in _OPERATORS:
            return Operation(_OPERATORS[node.operator_type], value(node.left), value(node.right))
        case ast.ASTType.UnaryOperation if node.operator_type == ast.UnaryOperator.Minus:
            inside = value(node.argument)
            return Number(-inside.value) if isinstance(inside, Number) else Operation("-", Number(0), inside)
    raise NotCompilable(str(node))


def relation(comparison: int) -> str:
    """The sign of a comparison."""
    return _RELATIONS[ast.ComparisonOperator(comparison)]


def _symbol(node: ast.AST) -> Term:
    symbol = node.symbol
    match symbol.type:
        case SymbolType.Number:
            return Number(symbol.number)
        case SymbolType.String:
            return Text(symbol.string)
        case SymbolType.Function if not symbol.arguments:
            return Function(symbol.name)
    raise NotCompilable(str(node))


_OPERATORS = {
    ast.BinaryOperator.Plus: "+",
    ast.BinaryOperator.Minus: "-",
    ast.BinaryOperator.Multiplication: "*",
    ast.BinaryOperator.Division: "/",
    ast.BinaryOperator.Modulo: "\\",
}
_FUNCTIONS: dict[int, str] = {
    ast.AggregateFunction.Count: "count",
    ast.AggregateFunction.Sum: "sum",
    ast.AggregateFunction.Min: "min",
    ast.AggregateFunction.Max: "max",
}
_RELATIONS = {
    ast.ComparisonOperator.Equal: "=",
    ast.ComparisonOperator.NotEqual: "!=",
    ast.ComparisonOperator.LessThan: "<",
    ast.ComparisonOperator.LessEqual: "<=",
    ast.ComparisonOperator.GreaterThan: ">",
    ast.ComparisonOperator.GreaterEqual: ">=",
}
