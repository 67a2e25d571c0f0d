"""Turns rules of clingo's syntax tree into values of the model, for rules that the planner evaluates."""

from clingo import SymbolType, ast

from kb.model.conditions import Body, Comparison, Literal
from kb.terms import Atom, Function, Number, Operation, Term, Text, Variable


class NotCompilable(Exception):
    """The model has no value for a part of a rule. The message is the text of that part."""


def compiled(rule: ast.AST) -> tuple[Atom, Body]:
    """Head and body of a rule without pools whose head is an atom. Raises `NotCompilable`."""
    return _atom(rule.head.atom), tuple(map(part, rule.body))


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
            if isinstance(inside, Number):
                return Number(-inside.value)
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
_RELATIONS = {
    ast.ComparisonOperator.Equal: "=",
    ast.ComparisonOperator.NotEqual: "!=",
    ast.ComparisonOperator.LessThan: "<",
    ast.ComparisonOperator.LessEqual: "<=",
    ast.ComparisonOperator.GreaterThan: ">",
    ast.ComparisonOperator.GreaterEqual: ">=",
}
