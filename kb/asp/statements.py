"""Reads an ASP file statement by statement: what each defines and uses, and what domain files may not contain."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import prod

from clingo import Control, SymbolType, ast

from kb.asp import AspError, Messages
from kb.asp.suspicion import suspicion

Signature = tuple[str, int]
MAX_LENGTH = 2**19  # characters of one file
MAX_ALTERNATIVES = 10_000
MAX_RANGE = 1_000_000


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
    constants: tuple[
        tuple[Signature, int, str], ...
    ] = ()  # predicate, argument number, constant standing there
    defines: str = ""  # the constant that `#const` gives a value


@dataclass(frozen=True, slots=True)
class Refused:
    """A statement that domain files may not contain, and why."""

    line: int
    column: int
    message: str
    hint: str = ""
    code: str = "K202"


def statements(text: str) -> Iterator[Statement | Refused]:
    """The statements of an ASP file in order. Raises `AspError` for what is not ASP."""
    if (found := suspicion(text, MAX_LENGTH)) is not None:
        line = text.count("\n", 0, found.offset) + 1
        column = found.offset - text.rfind("\n", 0, found.offset)
        yield Refused(line, column, found.message, found.hint, found.code)
        return
    messages, nodes = Messages(), list[ast.AST]()
    try:
        ast.parse_string(text, nodes.append, logger=messages)
    except RuntimeError as error:
        raise AspError(messages.heard or [(0, 0, str(error))]) from None
    for node in nodes:
        yield from _statement(node)


_SILENT = {ast.ASTType.Comment} if hasattr(ast.ASTType, "Comment") else set()
_REFUSED = {
    ast.ASTType.External: ("#external is not part of the language", "declare a fluent"),
    ast.ASTType.Minimize: ("optimisation is not part of the language", "use costs on operators"),
    ast.ASTType.ShowSignature: ("#show is not part of the language", "remove it: nothing is printed"),
    ast.ASTType.ShowTerm: ("#show is not part of the language", "remove it: nothing is printed"),
    ast.ASTType.Program: ("#program is not part of the language", "remove it: all rules belong together"),
    ast.ASTType.Defined: ("#defined is not part of the language", "declare the predicate in domain.yaml"),
}
_ALONE = "facts, rules, constraints and #const alone"


def _statement(node: ast.AST) -> Iterator[Statement | Refused]:
    begin = node.location.begin
    if node.ast_type in _SILENT or str(node) == "#program base.":
        return
    if node.ast_type == ast.ASTType.Definition:
        yield Statement(str(node), None, None, (), (), begin.line, begin.column, defines=node.name)
    elif node.ast_type != ast.ASTType.Rule:
        message, hint = _REFUSED.get(
            node.ast_type, (f"{node.ast_type.name} statements are not part of the language", _ALONE)
        )
        yield Refused(begin.line, begin.column, message, hint)
    else:
        yield from _rules(node, str(node), begin.line, begin.column)


def _rules(node: ast.AST, text: str, line: int, column: int) -> Iterator[Statement | Refused]:
    """The rules of a statement. The syntax tree is slow to walk, so that the text says whether there is need to."""
    if fact := _FACT.fullmatch(text):
        signature = (fact[1], len(fact[2].split(",")) if fact[2] else 0)
        yield Statement(text, text[:-1], signature, (), (), line, column, constants=tuple(_constants(text)))
    elif not _has_pool(text) and not _WORTH_A_LOOK.search(text):
        yield _rule(node)
    elif strange := _strange(node):
        yield Refused(line, column, *strange)
    else:
        yield from (_rule(rule) for rule in node.unpool())


_FACT = re.compile(r"([a-z][A-Za-z0-9_]*)(?:\(([a-z0-9][A-Za-z0-9_]*(?:,[a-z0-9][A-Za-z0-9_]*)*)\))?\.")
_WORTH_A_LOOK = re.compile(r'[@&"-]|\.\.')


def _has_pool(text: str) -> bool:
    """Whether a `;` stands within brackets."""
    if ";" not in text:
        return False
    while (shorter := re.sub(r"\([^();]*\)", "", text)) != text:
        text = shorter
    return "(" in text


def _strange(rule: ast.AST) -> tuple[str, str, str] | None:
    """What a rule may not contain, wherever in it: runaway pools and ranges, external functions, classical negation."""
    if _alternatives(rule) > MAX_ALTERNATIVES:
        return f"pools make more than {MAX_ALTERNATIVES} rules of this one", "use variables", "K007"
    for part in _parts(rule):
        if part.ast_type == ast.ASTType.Function and part.external:
            return "external functions are not part of the language", "express it as rules", "K202"
        if part.ast_type == ast.ASTType.SymbolicAtom and part.symbol.ast_type == ast.ASTType.UnaryOperation:
            return "classical negation is not part of the language", "write `not`", "K202"
        if part.ast_type == ast.ASTType.TheoryAtom:
            return "theory atoms are not part of the language", _ALONE, "K202"
        if part.ast_type == ast.ASTType.Interval and _span(part) > MAX_RANGE:
            return (
                f"a range of more than {MAX_RANGE} numbers",
                "count less, or bind the number by a fact",
                "K007",
            )
    return None


def _span(interval: ast.AST) -> int:
    """How many numbers a range has; 0 when its ends are not plain numbers."""
    ends = []
    for end in (interval.left, interval.right):
        if end.ast_type != ast.ASTType.SymbolicTerm or end.symbol.type != SymbolType.Number:
            return 0
        ends.append(end.symbol.number)
    return int(ends[1] - ends[0] + 1)


def _alternatives(node: ast.AST) -> int:
    """An upper bound on the rules that pools make of one."""
    inside = [_alternatives(child) for child in _children(node)]
    return sum(inside) if node.ast_type == ast.ASTType.Pool else prod(inside)


def _parts(node: ast.AST) -> Iterator[ast.AST]:
    yield node
    for child in _children(node):
        yield from _parts(child)


def _children(node: ast.AST) -> Iterator[ast.AST]:
    for key in node.child_keys:
        child = getattr(node, key)
        for part in child if isinstance(child, (ast.ASTSequence, list)) else [child]:
            if isinstance(part, ast.AST):
                yield part


def _rule(rule: ast.AST) -> Statement | Refused:
    begin, head = rule.location.begin, rule.head
    uses = tuple(use for part in rule.body for use in _uses(part, False))
    body = tuple(map(str, rule.body))
    plain = head.ast_type == ast.ASTType.Literal and head.sign == ast.Sign.NoSign
    if plain and head.atom.ast_type == ast.ASTType.SymbolicAtom:
        return Statement(
            str(rule),
            str(head),
            _signature(head.atom.symbol),
            body,
            uses,
            begin.line,
            begin.column,
            constants=tuple(_constants(str(rule))),
        )
    if plain and head.atom.ast_type == ast.ASTType.BooleanConstant and not head.atom.value:
        return Statement(str(rule), None, None, body, uses, begin.line, begin.column, constraint=True)
    return Refused(
        begin.line,
        begin.column,
        "a rule's head must be one atom",
        "choices and disjunctions have no single answer",
    )


def _constants(text: str) -> Iterator[tuple[Signature, int, str]]:
    """Which constant stands where as an argument of which predicate or function without compound arguments."""
    for found in _FLAT.finditer(text) if '"' not in text else ():
        arguments = [argument.strip() for argument in found[2].split(",")]
        for number, argument in enumerate(arguments):
            if _CONSTANT.fullmatch(argument):
                yield (found[1], len(arguments)), number, argument


_FLAT = re.compile(r"([a-z][A-Za-z0-9_]*)\(([^()]+)\)")
_CONSTANT = re.compile(r"[a-z][A-Za-z0-9_]*")


def _signature(symbol: ast.AST) -> Signature:
    if symbol.ast_type == ast.ASTType.Function:
        return (symbol.name, len(symbol.arguments))
    return (str(symbol), 0)


def _uses(node: ast.AST, negated: bool) -> Iterator[tuple[Signature, bool]]:
    """Predicates read by a part of a body; everything inside an aggregate counts as negated (it needs a lower stratum)."""
    if node.ast_type == ast.ASTType.SymbolicAtom:
        yield _signature(node.symbol), negated
        return
    if node.ast_type == ast.ASTType.Comparison:
        return
    if node.ast_type == ast.ASTType.Literal:
        yield from _uses(node.atom, negated or node.sign != ast.Sign.NoSign)
        return
    inside = negated or node.ast_type in (
        ast.ASTType.BodyAggregate,
        ast.ASTType.Aggregate,
        ast.ASTType.ConditionalLiteral,
    )
    for child in _children(node):
        yield from _uses(child, inside)


def unsafe(rules: Sequence[Statement]) -> Iterator[tuple[Statement, str]]:
    """The rules that have unsafe variables, with these variables; nothing is grounded.

    An atom that nothing makes true joins each body, so clingo checks the rules and finds no instance of them.
    """
    heard: list[str] = []
    control = Control(["--warn=none"], logger=lambda _, text: heard.append(text), message_limit=1000)
    try:
        control.add(
            "base", [], "\n".join(f"{_headless(each)}{', '.join((*each.body, NEVER))}." for each in rules)
        )
        control.ground([("base", [])])
    except RuntimeError:
        pass  # what was heard says why
    for message in heard:
        found = re.match(r"<?[\w-]*>?:([0-9]+):", message)
        if found and "error" in message and int(found[1]) <= len(rules):
            variables = dict.fromkeys(re.findall(r"'([^']+)' is unsafe", message))
            yield rules[int(found[1]) - 1], ", ".join(variables)


NEVER = "_never"


def _headless(statement: Statement) -> str:
    return f"{statement.head or ''} :- "
