"""The statements of an ASP file: what each defines and uses, and whether it is allowed.

Each access to a node of the tree costs microseconds, so frequent kinds of nodes have readers of
their own.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import prod

from clingo import Control, SymbolType, ast

from cellwright.kb.asp import AspError, Messages, find_unsafe_text
from cellwright.kb.asp.bounded_grounding import run_bounded
from cellwright.kb.diagnostics import Source
from cellwright.kb.model.statement import Constant, PredicateUse, Sign, Signature, Statement

MAX_POOL_ALTERNATIVES = 10_000
MAX_RANGE_VALUES = 1_000_000
Strange = tuple[str, str, str]
"""Something that a rule may not contain: message, hint and code."""


class RuleReading:
    """The parts of one rule, in the order of its text."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.variables: list[str] = []
        self.constants: list[Constant] = []
        self.uses: list[PredicateUse] = []
        self.strange: list[Strange] = []
        self.counts = False  # whether arithmetic or a range was found
        self.pools = False
        self._sign = Sign.POSITIVE  # how the atoms at the present place are read

    def read(self, node: ast.AST) -> None:
        """Collects the parts of a node and of all nodes below it."""
        _READERS.get(node.ast_type, RuleReading._other)(self, node)

    def head(self, node: ast.AST) -> None:
        """Collects the parts of a rule's head. A head uses no predicates."""
        self.read(node)
        self.uses.clear()

    def _literal(self, node: ast.AST) -> None:
        outside = self._sign
        if outside is Sign.POSITIVE and node.sign != ast.Sign.NoSign:
            self._sign = Sign.NEGATIVE
        self.read(node.atom)
        self._sign = outside

    def _set(self, node: ast.AST) -> None:
        outside, self._sign = self._sign, Sign.COUNTED
        self._other(node)
        self._sign = outside

    def _atom(self, node: ast.AST) -> None:
        symbol = node.symbol
        if symbol.ast_type == ast.ASTType.Pool:
            self.pools = True
            for argument in symbol.arguments:
                self._predicate(argument)
        else:
            self._predicate(symbol)

    def _predicate(self, symbol: ast.AST) -> None:
        if symbol.ast_type != ast.ASTType.Function:
            self.strange.append(
                ("classical negation is not part of the language", "write `not`", "K202")
            )
            self.read(symbol)
            return
        arguments = list(symbol.arguments)
        predicate = (symbol.name, len(arguments))
        self.uses.append(PredicateUse(predicate, self._sign))
        self.names.append(predicate[0])
        for number, argument in enumerate(arguments):
            if (name := constant_name(argument)) is not None:
                self.names.append(name)
                self.constants.append(Constant(predicate, number, name))
            else:
                self.read(argument)

    def _comparison(self, node: ast.AST) -> None:
        self.read(node.term)
        for guard in node.guards:
            self.read(guard.term)

    def _function(self, node: ast.AST) -> None:
        if node.external:
            self.strange.append(
                ("external functions are not part of the language", "express it as rules", "K202")
            )
        if node.name:
            self.names.append(node.name)
        for argument in node.arguments:
            self.read(argument)

    def _symbol(self, node: ast.AST) -> None:
        if (name := constant_name(node)) is not None:
            self.names.append(name)

    def _variable(self, node: ast.AST) -> None:
        if node.name != "_":
            self.variables.append(node.name)

    def _operation(self, node: ast.AST) -> None:
        self.counts = True
        self._other(node)

    def _interval(self, node: ast.AST) -> None:
        if _range_size(node) > MAX_RANGE_VALUES:
            hint = "count less, or bind the number by a fact"
            self.strange.append((f"a range of more than {MAX_RANGE_VALUES} numbers", hint, "K007"))
        self._operation(node)

    def _pool(self, node: ast.AST) -> None:
        self.pools = True
        self._other(node)

    def _theory(self, node: ast.AST) -> None:
        self.strange.append(("theory atoms are not part of the language", ALLOWED_ALONE, "K202"))
        self._other(node)

    def _other(self, node: ast.AST) -> None:
        for child in child_nodes(node):
            self.read(child)


ALLOWED_ALONE = "facts, rules, constraints and #const alone"
_READERS: dict[ast.ASTType, Callable[[RuleReading, ast.AST], None]] = {
    ast.ASTType.Literal: RuleReading._literal,
    ast.ASTType.BodyAggregate: RuleReading._set,
    ast.ASTType.Aggregate: RuleReading._set,
    ast.ASTType.ConditionalLiteral: RuleReading._set,
    ast.ASTType.SymbolicAtom: RuleReading._atom,
    ast.ASTType.Comparison: RuleReading._comparison,
    ast.ASTType.Function: RuleReading._function,
    ast.ASTType.SymbolicTerm: RuleReading._symbol,
    ast.ASTType.Variable: RuleReading._variable,
    ast.ASTType.UnaryOperation: RuleReading._operation,
    ast.ASTType.BinaryOperation: RuleReading._operation,
    ast.ASTType.Interval: RuleReading._interval,
    ast.ASTType.Pool: RuleReading._pool,
    ast.ASTType.TheoryAtom: RuleReading._theory,
}


def constant_name(node: ast.AST) -> str | None:
    """The name of the constant, if a term is one, else None."""
    if node.ast_type == ast.ASTType.SymbolicTerm:
        symbol = node.symbol
        return symbol.name if symbol.type == SymbolType.Function else None
    if node.ast_type == ast.ASTType.Function and not node.arguments and not node.external:
        return node.name or None
    return None


def atom_signature(atom: ast.AST) -> Signature:
    """The predicate of a symbolic atom without pools."""
    return (atom.symbol.name, len(atom.symbol.arguments))


def find_forbidden(rule: ast.AST, reading: RuleReading) -> Strange | None:
    """The first thing in a rule that is not allowed, such as too large pools and ranges, external
    functions, classical negation.
    """
    if reading.pools and _count_alternatives(rule) > MAX_POOL_ALTERNATIVES:
        return (
            f"pools make more than {MAX_POOL_ALTERNATIVES} rules of this one",
            "use variables",
            "K007",
        )
    return reading.strange[0] if reading.strange else None


def _range_size(interval: ast.AST) -> int:
    """How many numbers a range has; 0 if its ends are not plain numbers."""
    ends = []
    for end in (interval.left, interval.right):
        if end.ast_type != ast.ASTType.SymbolicTerm or end.symbol.type != SymbolType.Number:
            return 0
        ends.append(end.symbol.number)
    return int(ends[1] - ends[0] + 1)


def _count_alternatives(node: ast.AST) -> int:
    """An upper bound on the number of rules that pools make of one rule."""
    inside = [_count_alternatives(child) for child in child_nodes(node)]
    return sum(inside) if node.ast_type == ast.ASTType.Pool else prod(inside)


def child_nodes(node: ast.AST) -> Iterator[ast.AST]:
    """The nodes directly below a node, in order."""
    for key in node.child_keys:
        child = getattr(node, key)
        for part in child if isinstance(child, (ast.ASTSequence, list)) else [child]:
            if isinstance(part, ast.AST):
                yield part


MAX_ASP_FILE_LENGTH = 2**19  # characters in one file
Place = Callable[[int, int], Source]
"""Where a line and a column of a text are, both counted from 1."""


@dataclass(frozen=True, slots=True)
class ParsedStatement:
    """A statement, with its tree from clingo's parser, for `cellwright.kb.asp.rule_compiler`."""

    statement: Statement
    tree: ast.AST


@dataclass(frozen=True, slots=True)
class RefusedStatement:
    """A statement that domain files may not contain, and why."""

    where: Source
    message: str
    hint: str = ""
    code: str = "K202"


def read_statements(
    text: str, place: Place, pools: bool = False
) -> Iterator[ParsedStatement | RefusedStatement]:
    """The statements of an ASP file, in order. Raises `AspError` for what is not ASP.

    Rules with pools become several rules; with `pools` they are kept as they are.
    """
    if (reason := find_unsafe_text(text, MAX_ASP_FILE_LENGTH)) is not None:
        line = text.count("\n", 0, reason.offset) + 1
        column = reason.offset - text.rfind("\n", 0, reason.offset)
        yield RefusedStatement(place(line, column), reason.message, reason.hint, reason.code)
        return
    messages, nodes = Messages(), list[ast.AST]()
    try:
        ast.parse_string(text, nodes.append, logger=messages)
    # half of a pair of surrogates is no character
    except (RuntimeError, UnicodeEncodeError) as error:
        raise AspError(messages.heard or [(0, 0, str(error))]) from None
    for node in nodes:
        if node.ast_type not in _SILENT and str(node) != "#program base.":
            begin = node.location.begin
            yield from _read_statement(node, place(begin.line, begin.column), pools)


def statement_texts(text: str) -> list[str]:
    """The statements of an ASP text as clingo prints them, comments left out. Raises `AspError`."""
    messages, nodes = Messages(), list[ast.AST]()
    if (reason := find_unsafe_text(text, MAX_ASP_FILE_LENGTH)) is not None:
        raise AspError([(text.count("\n", 0, reason.offset) + 1, 0, reason.message)])
    try:
        ast.parse_string(text, nodes.append, logger=messages)
    except (RuntimeError, UnicodeEncodeError) as error:
        raise AspError(messages.heard or [(0, 0, str(error))]) from None
    return [str(node) for node in nodes if node.ast_type not in _SILENT]


_SILENT = {ast.ASTType.Comment} if hasattr(ast.ASTType, "Comment") else set()
_REFUSED_STATEMENTS = {
    ast.ASTType.External: ("#external is not part of the language", "declare a fluent"),
    ast.ASTType.Minimize: ("optimisation is not part of the language", "use costs on operators"),
    ast.ASTType.ShowSignature: (
        "#show is not part of the language",
        "remove it: nothing is printed",
    ),
    ast.ASTType.ShowTerm: ("#show is not part of the language", "remove it: nothing is printed"),
    ast.ASTType.Program: (
        "#program is not part of the language",
        "remove it: all rules belong together",
    ),
    ast.ASTType.Defined: (
        "#defined is not part of the language",
        "declare the predicate in domain.yaml",
    ),
}


def _read_statement(
    node: ast.AST, where: Source, pools: bool
) -> Iterator[ParsedStatement | RefusedStatement]:
    if node.ast_type == ast.ASTType.Definition:
        yield ParsedStatement(Statement(str(node), where, constant=node.name), node)
    elif node.ast_type != ast.ASTType.Rule:
        not_allowed = f"{node.ast_type.name} statements are not part of the language", ALLOWED_ALONE
        yield RefusedStatement(where, *_REFUSED_STATEMENTS.get(node.ast_type, not_allowed))
    elif (fact := plain_fact(str(node), where)) is not None:
        yield ParsedStatement(fact, node)
    else:
        yield from _read_rules(node, where, pools)


def _read_rules(
    node: ast.AST, where: Source, pools: bool
) -> Iterator[ParsedStatement | RefusedStatement]:
    """The rules of a statement: one, or several if it has pools."""
    reading = RuleReading()
    parsed = read_rule(node, where, reading)
    if why := find_forbidden(node, reading):
        yield RefusedStatement(where, *why)
    elif reading.pools and not pools:
        yield from (read_rule(unpooled, where, RuleReading()) for unpooled in node.unpool())
    else:
        yield parsed


def read_rule(
    node: ast.AST, where: Source, reading: RuleReading
) -> ParsedStatement | RefusedStatement:
    """The value of a rule without pools. `reading` collects its parts."""
    head, body = node.head, list(node.body)
    reading.head(head)
    counts = reading.counts
    for part in body:
        reading.read(part)
    defines, head_text = None, ""
    kind = head.atom.ast_type if head.ast_type == ast.ASTType.Literal and not head.sign else None
    if kind == ast.ASTType.SymbolicAtom and head.atom.symbol.ast_type == ast.ASTType.Function:
        defines, head_text = atom_signature(head.atom), str(head)
    elif kind != ast.ASTType.BooleanConstant or head.atom.value:
        return RefusedStatement(
            where,
            "a rule's head must be one atom",
            "choices and disjunctions have no single answer",
        )
    statement = Statement(
        str(node),
        where,
        defines,
        head_text,
        tuple(map(str, body)),
        tuple(reading.uses),
        tuple(reading.constants),
        tuple(reading.variables),
        tuple(reading.names),
        counts,
    )
    return ParsedStatement(statement, node)


def plain_fact(text: str, where: Source) -> Statement | None:
    """The fact that clingo prints as `text` if its arguments are constants and natural numbers,
    else None.

    This is a faster way for files with hundreds of facts: reading their trees takes several times
    as long.
    """
    if (fact := _PLAIN_FACT.fullmatch(text)) is None:
        return None
    arguments = fact[2].split(",") if fact[2] else []
    defines = (fact[1], len(arguments))
    constants = [
        (number, argument) for number, argument in enumerate(arguments) if not argument[0].isdigit()
    ]
    return Statement(
        text,
        where,
        defines,
        text[:-1],
        constants=tuple(Constant(defines, number, constant) for number, constant in constants),
        names=(fact[1], *(constant for _, constant in constants)),
    )


_PLAIN_FACT = re.compile(
    r"([a-z][A-Za-z0-9_]*)(?:\(([a-z0-9][A-Za-z0-9_]*(?:,[a-z0-9][A-Za-z0-9_]*)*)\))?\."
)


def unsafe_rules(rules: Sequence[Statement]) -> Iterator[tuple[Statement, str]]:
    """The rules that have unsafe variables, each with these variables. Nothing is grounded.

    Each body gets an extra atom that is never true. So clingo checks the rules but finds no
    instance of them.
    """
    heard: list[str] = []
    control = Control(
        ["--warn=none"], logger=lambda _, text: heard.append(text), message_limit=1000
    )
    try:
        control.add(
            "base",
            [],
            "\n".join(f"{rule.head} :- {'; '.join((*rule.body, NEVER_TRUE))}." for rule in rules),
        )
        run_bounded(lambda: control.ground([("base", [])]))
    except RuntimeError:
        pass  # the collected messages say why
    for message in heard:
        place_match = re.match(r"<?[\w-]*>?:([0-9]+):", message)
        if place_match and "error" in message and int(place_match[1]) <= len(rules):
            variables = dict.fromkeys(re.findall(r"'([^']+)' is unsafe", message))
            yield rules[int(place_match[1]) - 1], ", ".join(variables)


NEVER_TRUE = "_never"
