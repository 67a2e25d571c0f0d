"""Reads the body of a rule as far as the model has values for it; aggregates become variables.

For questions about rules that clingo evaluates, such as which numbers they compare. Nothing is planned with
the result.
"""

from dataclasses import dataclass

from clingo import ast

from cellwright.kb.asp.compiled import NotCompilable, part, relation, value
from cellwright.kb.model.conditions import Comparison, Literal
from cellwright.kb.terms import Variable


@dataclass(frozen=True, slots=True)
class ReadBody:
    """The literals and comparisons of a body. `counted` are texts that bind the variables of aggregates."""

    literals: tuple[Literal, ...] = ()
    comparisons: tuple[Comparison, ...] = ()
    counted: tuple[tuple[Variable, str], ...] = ()


def read_body(text: str) -> ReadBody:
    """What can be read of a body given as ASP text; parts that the model has no value for are left out."""
    nodes: list[ast.AST] = []
    ast.parse_string(f":- {text}.", nodes.append)
    literals: list[Literal] = []
    comparisons: list[Comparison] = []
    counted: list[tuple[Variable, str]] = []
    for node in (each for rule in nodes if rule.ast_type == ast.ASTType.Rule for each in rule.body):
        if node.ast_type == ast.ASTType.Literal and node.atom.ast_type == ast.ASTType.BodyAggregate:
            variable = Variable(f"__A{len(counted)}")
            counted.append((variable, f"{variable} = {node.atom.update(left_guard=None, right_guard=None)}"))
            comparisons += _guards(node.atom, variable)
            continue
        try:
            found = part(node)
        except NotCompilable:
            continue
        if isinstance(found, Literal):
            literals.append(found)
        else:
            comparisons.append(found)
    return ReadBody(tuple(literals), tuple(comparisons), tuple(counted))


def _guards(aggregate: ast.AST, variable: Variable) -> list[Comparison]:
    found = []
    for guard in (aggregate.left_guard, aggregate.right_guard):
        try:
            if guard is not None:
                found.append(Comparison(value(guard.term), relation(guard.comparison), variable))
        except NotCompilable:
            continue
    return found
