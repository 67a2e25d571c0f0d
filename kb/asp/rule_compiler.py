"""Rules and bodies of clingo's syntax tree as conditions of the model, for the planner."""

from dataclasses import dataclass

from clingo import SymbolType, ast

from cellwright.kb.model.conditions import (
    MIRRORED_RELATIONS,
    Body,
    BodyPart,
    Comparison,
    Element,
    Literal,
    StateAggregate,
)
from cellwright.kb.model.conditions import part_variables as variables_of
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Function,
    Number,
    Operation,
    Term,
    Text,
    Variable,
    term_variables,
)


class NotCompilable(Exception):
    """The model has no value for a part of a rule. The message is the text of that part."""


def compile_rule(rule: ast.AST) -> tuple[Atom, Body]:
    """Head and body of a rule without pools whose head is an atom. Raises `NotCompilable`."""
    head = _compile_atom(rule.head.atom)
    plain = [compile_literal(node) for node in rule.body if not _is_aggregate(node)]
    outside = {*term_variables(head), *(v for literal in plain for v in variables_of(literal))}
    for node in filter(_is_aggregate, rule.body):
        outside.update(v for _, term in _aggregate_guards(node.atom) for v in term_variables(term))
    waiting = iter(plain)
    body: list[BodyPart] = [
        _compile_aggregate(node, outside) if _is_aggregate(node) else next(waiting)
        for node in rule.body
    ]
    return head, tuple(body)


def _is_aggregate(node: ast.AST) -> bool:
    return bool(
        node.ast_type == ast.ASTType.Literal
        and node.atom.ast_type in (ast.ASTType.BodyAggregate, ast.ASTType.Aggregate)
    )


def _compile_aggregate(node: ast.AST, outside: set[Variable]) -> StateAggregate:
    """An aggregate in a rule whose other parts, and whose guards, have the variables `outside`."""
    name = _FUNCTIONS.get(getattr(node.atom, "function", -1))
    if name is None or node.sign == ast.Sign.DoubleNegation:
        raise NotCompilable(str(node))
    elements = tuple(
        Element(
            tuple(map(compile_term, element.terms)), tuple(map(compile_literal, element.condition))
        )
        for element in node.atom.elements
    )
    used = [v for element in elements for term in element.terms for v in term_variables(term)]
    used += [v for element in elements for inner in element.body for v in variables_of(inner)]
    guards = _aggregate_guards(node.atom)
    used += [v for _, term in guards for v in term_variables(term)]
    outer = tuple(dict.fromkeys(v for v in used if v in outside and v != ANYTHING))
    return StateAggregate(name, elements, guards, outer, node.sign == ast.Sign.NoSign)


def _aggregate_guards(aggregate: ast.AST) -> tuple[tuple[str, Term], ...]:
    """What the value of an aggregate is compared with, and how; the value stands left."""
    guards = []
    if aggregate.left_guard is not None:
        guards.append(
            (
                MIRRORED_RELATIONS[relation_sign(aggregate.left_guard.comparison)],
                compile_term(aggregate.left_guard.term),
            )
        )
    if aggregate.right_guard is not None:
        guards.append(
            (
                relation_sign(aggregate.right_guard.comparison),
                compile_term(aggregate.right_guard.term),
            )
        )
    if not guards:
        raise NotCompilable(str(aggregate))
    return tuple(guards)


def compile_literal(node: ast.AST) -> Literal | Comparison:
    """A literal of a body. Raises `NotCompilable`."""
    if node.ast_type != ast.ASTType.Literal:
        raise NotCompilable(str(node))
    match node.atom.ast_type, node.sign:
        case ast.ASTType.SymbolicAtom, ast.Sign.NoSign | ast.Sign.Negation:
            return Literal(_compile_atom(node.atom), node.sign == ast.Sign.NoSign)
        case ast.ASTType.Comparison, ast.Sign.NoSign if len(node.atom.guards) == 1:
            guard = node.atom.guards[0]
            return Comparison(
                compile_term(node.atom.term),
                relation_sign(guard.comparison),
                compile_term(guard.term),
            )
        case _:
            raise NotCompilable(str(node))


def _compile_atom(node: ast.AST) -> Atom:
    return Function(node.symbol.name, tuple(map(compile_term, node.symbol.arguments)))


def compile_term(node: ast.AST) -> Term:
    """A term. Raises `NotCompilable`."""
    match node.ast_type:
        case ast.ASTType.Variable:
            return Variable(node.name)
        case ast.ASTType.SymbolicTerm:
            return _compile_symbol(node)
        case ast.ASTType.Function if node.name and not node.external:
            return Function(node.name, tuple(map(compile_term, node.arguments)))
        case ast.ASTType.BinaryOperation if node.operator_type in _OPERATORS:
            return Operation(
                _OPERATORS[node.operator_type], compile_term(node.left), compile_term(node.right)
            )
        case ast.ASTType.UnaryOperation if node.operator_type == ast.UnaryOperator.Minus:
            inside = compile_term(node.argument)
            return (
                Number(-inside.value)
                if isinstance(inside, Number)
                else Operation("-", Number(0), inside)
            )
    raise NotCompilable(str(node))


def relation_sign(comparison: int) -> str:
    """The sign of a comparison."""
    return _RELATION_SIGNS[ast.ComparisonOperator(comparison)]


def _compile_symbol(node: ast.AST) -> Term:
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
_RELATION_SIGNS = {
    ast.ComparisonOperator.Equal: "=",
    ast.ComparisonOperator.NotEqual: "!=",
    ast.ComparisonOperator.LessThan: "<",
    ast.ComparisonOperator.LessEqual: "<=",
    ast.ComparisonOperator.GreaterThan: ">",
    ast.ComparisonOperator.GreaterEqual: ">=",
}


@dataclass(frozen=True, slots=True)
class ReadBody:
    """The literals and comparisons of a body.

    `counted` are texts that bind the variables of aggregates.
    """

    literals: tuple[Literal, ...] = ()
    comparisons: tuple[Comparison, ...] = ()
    counted: tuple[tuple[Variable, str], ...] = ()


def read_body(text: str) -> ReadBody:
    """What can be read of a body given as ASP text; parts that the model has no value for are
    left out.
    """
    nodes: list[ast.AST] = []
    ast.parse_string(f":- {text}.", nodes.append)
    literals: list[Literal] = []
    comparisons: list[Comparison] = []
    counted: list[tuple[Variable, str]] = []
    for node in (
        body_node for rule in nodes if rule.ast_type == ast.ASTType.Rule for body_node in rule.body
    ):
        if node.ast_type == ast.ASTType.Literal and node.atom.ast_type == ast.ASTType.BodyAggregate:
            variable = Variable(f"__A{len(counted)}")
            counted.append(
                (variable, f"{variable} = {node.atom.update(left_guard=None, right_guard=None)}")
            )
            comparisons += _guard_comparisons(node.atom, variable)
            continue
        try:
            body_part = compile_literal(node)
        except NotCompilable:
            continue
        if isinstance(body_part, Literal):
            literals.append(body_part)
        else:
            comparisons.append(body_part)
    return ReadBody(tuple(literals), tuple(comparisons), tuple(counted))


def _guard_comparisons(aggregate: ast.AST, variable: Variable) -> list[Comparison]:
    guards = []
    for guard in (aggregate.left_guard, aggregate.right_guard):
        try:
            if guard is not None:
                guards.append(
                    Comparison(compile_term(guard.term), relation_sign(guard.comparison), variable)
                )
        except NotCompilable:
            continue
    return guards
