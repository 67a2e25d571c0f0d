"""Reads an ASP file statement by statement: what each defines and uses, and what domain files may not contain."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from clingo import ast

from kb.asp import AspError, Messages

Signature = tuple[str, int]


@dataclass(frozen=True, slots=True)
class Statement:
    """A rule, constraint or constant. `head` is None for the last two; `body` are texts; `uses` are what the body reads."""

    text: str
    head: str | None
    signature: Signature | None
    body: tuple[str, ...]
    uses: tuple[
        tuple[Signature, bool], ...
    ]  # predicate, and whether it stands under negation or in an aggregate
    line: int
    column: int
    constraint: bool = False


@dataclass(frozen=True, slots=True)
class Refused:
    """A statement that domain files may not contain, and why."""

    line: int
    column: int
    message: str
    hint: str = ""


def statements(text: str) -> Iterator[Statement | Refused]:
    """The statements of an ASP file in order. Raises `AspError` for what is not ASP."""
    inclusion = _inclusion(text)
    if inclusion is not None:
        yield inclusion
        return
    messages, nodes = Messages(), list[ast.AST]()
    try:
        ast.parse_string(text, nodes.append, logger=messages)
    except RuntimeError as error:
        raise AspError(messages.heard or [(0, 0, str(error))]) from None
    for node in nodes:
        yield from _statement(node)


def _inclusion(text: str) -> Refused | None:
    """clingo would follow `#include` while parsing, so it is found before."""
    bare = re.sub(
        r'%\*.*?\*%|%[^\n]*|"(?:\\.|[^"\\\n])*"',
        lambda found: re.sub(r"[^\n]", " ", found[0]),
        text,
        flags=re.DOTALL,
    )
    found = re.search(r"#\s*include\b", bare)
    if not found:
        return None
    line = bare.count("\n", 0, found.start()) + 1
    column = found.start() - (bare.rfind("\n", 0, found.start()) + 1) + 1
    return Refused(
        line, column, "#include is not part of the language", "list the file under `include:` in domain.yaml"
    )


_SILENT = (
    {ast.ASTType.Program, ast.ASTType.Comment} if hasattr(ast.ASTType, "Comment") else {ast.ASTType.Program}
)
_REFUSED = {
    ast.ASTType.Script: ("#script is not allowed: domain files are data", "express it as rules"),
    ast.ASTType.External: ("#external is not part of the language", "declare a fluent"),
    ast.ASTType.Minimize: ("optimisation is not part of the language", "use costs on operators"),
}


def _statement(node: ast.AST) -> Iterator[Statement | Refused]:
    begin = node.location.begin
    if node.ast_type in _SILENT:
        return
    if node.ast_type == ast.ASTType.Definition:
        yield Statement(str(node), None, None, (), (), begin.line, begin.column)
    elif node.ast_type != ast.ASTType.Rule:
        message, hint = _REFUSED.get(
            node.ast_type, (f"{node.ast_type.name} statements are not part of the language", "")
        )
        yield Refused(begin.line, begin.column, message, hint)
    else:
        yield from (_rule(rule) for rule in node.unpool())


def _rule(rule: ast.AST) -> Statement | Refused:
    begin, head = rule.location.begin, rule.head
    uses = tuple(use for part in rule.body for use in _uses(part, False))
    body = tuple(map(str, rule.body))
    plain = head.ast_type == ast.ASTType.Literal and head.sign == ast.Sign.NoSign
    if plain and head.atom.ast_type == ast.ASTType.SymbolicAtom:
        return Statement(
            str(rule), str(head), _signature(head.atom.symbol), body, uses, begin.line, begin.column
        )
    if plain and head.atom.ast_type == ast.ASTType.BooleanConstant and not head.atom.value:
        return Statement(str(rule), None, None, body, uses, begin.line, begin.column, constraint=True)
    return Refused(
        begin.line,
        begin.column,
        "a rule's head must be one atom",
        "choices and disjunctions have no single answer",
    )


def _signature(symbol: ast.AST) -> Signature:
    if symbol.ast_type == ast.ASTType.Function:
        return (symbol.name, len(symbol.arguments))
    return (str(symbol), 0)


def _uses(node: Any, negated: bool) -> Iterator[tuple[Signature, bool]]:
    """Predicates read by a part of a body; everything inside an aggregate counts as negated (it needs a lower stratum)."""
    if not isinstance(node, ast.AST):
        return
    if node.ast_type == ast.ASTType.SymbolicAtom:
        yield _signature(node.symbol), negated
        return
    inside = negated or node.ast_type in (
        ast.ASTType.BodyAggregate,
        ast.ASTType.Aggregate,
        ast.ASTType.ConditionalLiteral,
    )
    inside = inside or (node.ast_type == ast.ASTType.Literal and node.sign != ast.Sign.NoSign)
    for key in node.child_keys:
        child = getattr(node, key)
        for part in child if isinstance(child, (ast.ASTSequence, list)) else [child]:
            yield from _uses(part, inside)
