"""Reads an ASP file statement by statement: what each one defines and uses, and whether it is allowed."""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from clingo import Control, ast

from cellwright.kb.asp import AspError, Messages
from cellwright.kb.asp.bounded import run_bounded
from cellwright.kb.asp.suspicion import suspicion
from cellwright.kb.asp.tree import ALONE, Reading, signature, strange
from cellwright.kb.diagnostics import Source
from cellwright.kb.model.statement import Constant, Statement

MAX_LENGTH = 2**19  # characters in one file
Place = Callable[[int, int], Source]
"""Where a line and a column of a text are, both counted from 1."""


@dataclass(frozen=True, slots=True)
class ParsedStatement:
    """A statement, with its tree from clingo's parser, for `cellwright.kb.asp.compiled`."""

    statement: Statement
    tree: ast.AST


@dataclass(frozen=True, slots=True)
class RefusedStatement:
    """A statement that domain files may not contain, and why."""

    where: Source
    message: str
    hint: str = ""
    code: str = "K202"


def statements(text: str, place: Place, pools: bool = False) -> Iterator[ParsedStatement | RefusedStatement]:
    """The statements of an ASP file, in order. Raises `AspError` for what is not ASP.

    Rules with pools become several rules; with `pools` they are kept as they are.
    """
    if (found := suspicion(text, MAX_LENGTH)) is not None:
        line = text.count("\n", 0, found.offset) + 1
        column = found.offset - text.rfind("\n", 0, found.offset)
        yield RefusedStatement(place(line, column), found.message, found.hint, found.code)
        return
    messages, nodes = Messages(), list[ast.AST]()
    try:
        ast.parse_string(text, nodes.append, logger=messages)
    except (RuntimeError, UnicodeEncodeError) as error:  # half of a pair of surrogates is no character
        raise AspError(messages.heard or [(0, 0, str(error))]) from None
    for node in nodes:
        if node.ast_type not in _SILENT and str(node) != "#program base.":
            begin = node.location.begin
            yield from _statement(node, place(begin.line, begin.column), pools)


def printed(text: str) -> list[str]:
    """The statements of an ASP text as clingo prints them, comments left out. Raises `AspError`."""
    messages, nodes = Messages(), list[ast.AST]()
    if (found := suspicion(text, MAX_LENGTH)) is not None:
        raise AspError([(text.count("\n", 0, found.offset) + 1, 0, found.message)])
    try:
        ast.parse_string(text, nodes.append, logger=messages)
    except (RuntimeError, UnicodeEncodeError) as error:
        raise AspError(messages.heard or [(0, 0, str(error))]) from None
    return [str(node) for node in nodes if node.ast_type not in _SILENT]


_SILENT = {ast.ASTType.Comment} if hasattr(ast.ASTType, "Comment") else set()
_REFUSED = {
    ast.ASTType.External: ("#external is not part of the language", "declare a fluent"),
    ast.ASTType.Minimize: ("optimisation is not part of the language", "use costs on operators"),
    ast.ASTType.ShowSignature: ("#show is not part of the language", "remove it: nothing is printed"),
    ast.ASTType.ShowTerm: ("#show is not part of the language", "remove it: nothing is printed"),
    ast.ASTType.Program: ("#program is not part of the language", "remove it: all rules belong together"),
    ast.ASTType.Defined: ("#defined is not part of the language", "declare the predicate in domain.yaml"),
}


def _statement(node: ast.AST, where: Source, pools: bool) -> Iterator[ParsedStatement | RefusedStatement]:
    if node.ast_type == ast.ASTType.Definition:
        yield ParsedStatement(Statement(str(node), where, constant=node.name), node)
    elif node.ast_type != ast.ASTType.Rule:
        other = f"{node.ast_type.name} statements are not part of the language", ALONE
        yield RefusedStatement(where, *_REFUSED.get(node.ast_type, other))
    elif (fact := plain_fact(str(node), where)) is not None:
        yield ParsedStatement(fact, node)
    else:
        yield from _rules(node, where, pools)


def _rules(node: ast.AST, where: Source, pools: bool) -> Iterator[ParsedStatement | RefusedStatement]:
    """The rules of a statement: one, or several if it has pools."""
    reading = Reading()
    made = rule(node, where, reading)
    if why := strange(node, reading):
        yield RefusedStatement(where, *why)
    elif reading.pools and not pools:
        yield from (rule(each, where, Reading()) for each in node.unpool())
    else:
        yield made


def rule(node: ast.AST, where: Source, reading: Reading) -> ParsedStatement | RefusedStatement:
    """The value of a rule without pools. `reading` collects its parts."""
    head, body = node.head, list(node.body)
    reading.head(head)
    counts = reading.counts
    for part in body:
        reading.read(part)
    defines, said = None, ""
    kind = head.atom.ast_type if head.ast_type == ast.ASTType.Literal and not head.sign else None
    if kind == ast.ASTType.SymbolicAtom and head.atom.symbol.ast_type == ast.ASTType.Function:
        defines, said = signature(head.atom), str(head)
    elif kind != ast.ASTType.BooleanConstant or head.atom.value:
        return RefusedStatement(
            where, "a rule's head must be one atom", "choices and disjunctions have no single answer"
        )
    made = Statement(
        str(node),
        where,
        defines,
        said,
        tuple(map(str, body)),
        tuple(reading.uses),
        tuple(reading.constants),
        tuple(reading.variables),
        tuple(reading.names),
        counts,
    )
    return ParsedStatement(made, node)


def plain_fact(text: str, where: Source) -> Statement | None:
    """The fact that clingo prints as `text` if its arguments are constants and natural numbers, else None.

    This is a faster way for files with hundreds of facts: reading their trees takes several times as long.
    """
    if (fact := _FACT.fullmatch(text)) is None:
        return None
    arguments = fact[2].split(",") if fact[2] else []
    defines = (fact[1], len(arguments))
    constants = [(number, each) for number, each in enumerate(arguments) if not each[0].isdigit()]
    return Statement(
        text,
        where,
        defines,
        text[:-1],
        constants=tuple(Constant(defines, number, each) for number, each in constants),
        names=(fact[1], *(each for _, each in constants)),
    )


_FACT = re.compile(r"([a-z][A-Za-z0-9_]*)(?:\(([a-z0-9][A-Za-z0-9_]*(?:,[a-z0-9][A-Za-z0-9_]*)*)\))?\.")


def unsafe(rules: Sequence[Statement]) -> Iterator[tuple[Statement, str]]:
    """The rules that have unsafe variables, each with these variables. Nothing is grounded.

    Each body gets an extra atom that is never true. So clingo checks the rules but finds no instance of them.
    """
    heard: list[str] = []
    control = Control(["--warn=none"], logger=lambda _, text: heard.append(text), message_limit=1000)
    try:
        control.add(
            "base", [], "\n".join(f"{each.head} :- {'; '.join((*each.body, NEVER))}." for each in rules)
        )
        run_bounded(lambda: control.ground([("base", [])]))
    except RuntimeError:
        pass  # the collected messages say why
    for message in heard:
        found = re.match(r"<?[\w-]*>?:([0-9]+):", message)
        if found and "error" in message and int(found[1]) <= len(rules):
            variables = dict.fromkeys(re.findall(r"'([^']+)' is unsafe", message))
            yield rules[int(found[1]) - 1], ", ".join(variables)


NEVER = "_never"
