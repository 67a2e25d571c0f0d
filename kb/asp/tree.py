"""Finds the parts of a rule in clingo's syntax tree in one walk: names, variables, uses, forbidden things.

Each access to a node of the tree costs microseconds, so frequent kinds of nodes have readers of their own.
"""

from collections.abc import Callable, Iterator
from math import prod

from clingo import SymbolType, ast

from cellwright.kb.model.statement import Constant, PredicateUse, Sign, Signature

MAX_ALTERNATIVES = 10_000
MAX_RANGE = 1_000_000
Strange = tuple[str, str, str]
"""Something that a rule may not contain: message, hint and code."""


class Reading:
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
        _READERS.get(node.ast_type, Reading._other)(self, node)

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
            for each in symbol.arguments:
                self._predicate(each)
        else:
            self._predicate(symbol)

    def _predicate(self, symbol: ast.AST) -> None:
        if symbol.ast_type != ast.ASTType.Function:
            self.strange.append(("classical negation is not part of the language", "write `not`", "K202"))
            self.read(symbol)
            return
        arguments = list(symbol.arguments)
        predicate = (symbol.name, len(arguments))
        self.uses.append(PredicateUse(predicate, self._sign))
        self.names.append(predicate[0])
        for number, argument in enumerate(arguments):
            if (name := constant(argument)) is not None:
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
        if (name := constant(node)) is not None:
            self.names.append(name)

    def _variable(self, node: ast.AST) -> None:
        if node.name != "_":
            self.variables.append(node.name)

    def _operation(self, node: ast.AST) -> None:
        self.counts = True
        self._other(node)

    def _interval(self, node: ast.AST) -> None:
        if _span(node) > MAX_RANGE:
            hint = "count less, or bind the number by a fact"
            self.strange.append((f"a range of more than {MAX_RANGE} numbers", hint, "K007"))
        self._operation(node)

    def _pool(self, node: ast.AST) -> None:
        self.pools = True
        self._other(node)

    def _theory(self, node: ast.AST) -> None:
        self.strange.append(("theory atoms are not part of the language", ALONE, "K202"))
        self._other(node)

    def _other(self, node: ast.AST) -> None:
        for child in children(node):
            self.read(child)


ALONE = "facts, rules, constraints and #const alone"
_READERS: dict[ast.ASTType, Callable[[Reading, ast.AST], None]] = {
    ast.ASTType.Literal: Reading._literal,
    ast.ASTType.BodyAggregate: Reading._set,
    ast.ASTType.Aggregate: Reading._set,
    ast.ASTType.ConditionalLiteral: Reading._set,
    ast.ASTType.SymbolicAtom: Reading._atom,
    ast.ASTType.Comparison: Reading._comparison,
    ast.ASTType.Function: Reading._function,
    ast.ASTType.SymbolicTerm: Reading._symbol,
    ast.ASTType.Variable: Reading._variable,
    ast.ASTType.UnaryOperation: Reading._operation,
    ast.ASTType.BinaryOperation: Reading._operation,
    ast.ASTType.Interval: Reading._interval,
    ast.ASTType.Pool: Reading._pool,
    ast.ASTType.TheoryAtom: Reading._theory,
}


def constant(node: ast.AST) -> str | None:
    """The name of the constant, if a term is one, else None."""
    if node.ast_type == ast.ASTType.SymbolicTerm:
        symbol = node.symbol
        return symbol.name if symbol.type == SymbolType.Function else None
    if node.ast_type == ast.ASTType.Function and not node.arguments and not node.external:
        return node.name or None
    return None


def signature(atom: ast.AST) -> Signature:
    """The predicate of a symbolic atom without pools."""
    return (atom.symbol.name, len(atom.symbol.arguments))


def strange(rule: ast.AST, reading: Reading) -> Strange | None:
    """The first thing in a rule that is not allowed, such as too large pools and ranges, external functions,
    classical negation.
    """
    if reading.pools and _alternatives(rule) > MAX_ALTERNATIVES:
        return f"pools make more than {MAX_ALTERNATIVES} rules of this one", "use variables", "K007"
    return reading.strange[0] if reading.strange else None


def _span(interval: ast.AST) -> int:
    """How many numbers a range has; 0 if its ends are not plain numbers."""
    ends = []
    for end in (interval.left, interval.right):
        if end.ast_type != ast.ASTType.SymbolicTerm or end.symbol.type != SymbolType.Number:
            return 0
        ends.append(end.symbol.number)
    return int(ends[1] - ends[0] + 1)


def _alternatives(node: ast.AST) -> int:
    """An upper bound on the number of rules that pools make of one rule."""
    inside = [_alternatives(child) for child in children(node)]
    return sum(inside) if node.ast_type == ast.ASTType.Pool else prod(inside)


def children(node: ast.AST) -> Iterator[ast.AST]:
    """The nodes directly below a node, in order."""
    for key in node.child_keys:
        child = getattr(node, key)
        for part in child if isinstance(child, (ast.ASTSequence, list)) else [child]:
            if isinstance(part, ast.AST):
                yield part
