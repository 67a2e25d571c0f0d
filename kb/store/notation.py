"""Terms and literals of stored MACROPs, read from the text that `str` made of them.

Libraries contain hundreds of thousands of short texts, but few different ones. So this is a small hand-written reader with
a cache. Texts written by people are read by `cellwright.kb.syntax`.
"""

import functools
import re

from cellwright.kb.model.conditions import BodyPart, Comparison, Literal
from cellwright.kb.numbers import NumberError, whole
from cellwright.kb.terms import Atom, Function, Number, Operation, Term, Text, Variable

_TOKEN = re.compile(
    r"""\s*(?:(?P<number>-?[0-9]+)|(?P<text>"(?:[^"\\]|\\.)*")|(?P<name>[A-Za-z_][A-Za-z0-9_@']*)"""
    r"""|(?P<sign>!=|<=|>=|.))""",
    re.DOTALL,
)
_RELATIONS = frozenset({"=", "!=", "<", "<=", ">", ">="})
_OPERATORS = frozenset("+-*/\\")
END = ""
DEEPEST = 200  # brackets within brackets

Requirement = tuple[str, int]
"""A condition of the index, written as a text, and how many facts must at least meet it."""


class NotationError(ValueError):
    """The text is not a term or literal."""


class _Tokens:
    def __init__(self, text: str) -> None:
        self.text = text
        found = list(_TOKEN.finditer(text.rstrip()))
        self.found = [each[each.lastgroup or 0] for each in found]
        self.kinds = [each.lastgroup for each in found]
        self.place = self.depth = 0

    def look(self) -> str:
        """The next token."""
        return self.found[self.place] if self.place < len(self.found) else END

    def kind(self) -> str | None:
        """The kind of the next token: number, text, name or sign; None at the end."""
        return self.kinds[self.place] if self.place < len(self.kinds) else None

    def take(self, wanted: str = "") -> str:
        """The next token. If `wanted` is given, the token must be equal to it."""
        token = self.look()
        if token == END or (wanted and token != wanted):
            raise NotationError(f"'{self.text}': {wanted or 'more'} is missing")
        self.place += 1
        return token


@functools.lru_cache(maxsize=65_536)
def read_term(text: str) -> Term:
    """The term in a text. Raises `NotationError`."""
    tokens = _Tokens(text)
    found = _term(tokens)
    _finish(tokens)
    return found


def read_atom(text: str) -> Atom:
    """The atom in a text. Raises `NotationError`."""
    found = read_term(text)
    if not isinstance(found, Function):
        raise NotationError(f"'{text}' is not an atom")
    return found


def read_literal(text: str) -> Literal:
    """The literal in a text. Raises `NotationError`."""
    negative = text.startswith("not ")
    return Literal(read_atom(text[4:] if negative else text), not negative)


@functools.lru_cache(maxsize=65_536)
def read_part(text: str) -> BodyPart:
    """The literal or comparison in a text. Raises `NotationError`."""
    if text.startswith("not "):
        return read_literal(text)
    tokens = _Tokens(text)
    left = _term(tokens)
    if tokens.look() in _RELATIONS:
        relation = tokens.take()
        right = _term(tokens)
        _finish(tokens)
        return Comparison(left, relation, right)
    _finish(tokens)
    return read_literal(text)


def _finish(tokens: _Tokens) -> None:
    if tokens.look() != END:
        raise NotationError(f"'{tokens.text}': '{tokens.look()}' is too much")


def _term(tokens: _Tokens) -> Term:
    tokens.depth += 1
    if tokens.depth > DEEPEST:
        raise NotationError(f"'{tokens.text[:60]}': nested deeper than {DEEPEST} brackets")
    found = _one(tokens)
    tokens.depth -= 1
    return found


def _one(tokens: _Tokens) -> Term:
    kind, token = tokens.kind(), tokens.take()
    if token == "(":
        return _bracket(tokens)
    if kind == "text":
        return Text(re.sub(r"\\(.)", lambda found: "\n" if found[1] == "n" else found[1], token[1:-1]))
    if kind == "number":
        return Number(_number(tokens, token))
    if kind != "name":
        raise NotationError(f"'{tokens.text}': '{token}' begins no term")
    if _is_variable(token):
        return Variable(token)
    return Function(token, _arguments(tokens) if tokens.look() == "(" else ())


def _number(tokens: _Tokens, token: str) -> int:
    try:
        return whole(token)
    except NumberError as error:
        raise NotationError(f"'{tokens.text[:60]}': a number {error}") from None


def _is_variable(name: str) -> bool:
    bare = name.lstrip("_")
    return not bare or bare[0].isupper()


def _arguments(tokens: _Tokens) -> tuple[Term, ...]:
    tokens.take("(")
    found = [_term(tokens)]
    while tokens.look() == ",":
        tokens.take()
        found.append(_term(tokens))
    tokens.take(")")
    return tuple(found)


def _bracket(tokens: _Tokens) -> Term:
    """An operation or a tuple in brackets."""
    first = _term(tokens)
    if tokens.look()[:1] in _OPERATORS:
        return _operation(first, tokens)
    found = [first]
    while tokens.look() == ",":
        tokens.take()
        found.append(_term(tokens))
    tokens.take(")")
    return Function("", tuple(found))


def _operation(left: Term, tokens: _Tokens) -> Term:
    """The operation that begins with `left`. A sign and digits in one token are a subtraction."""
    if tokens.kind() == "number":
        token = tokens.take()
        right: Term = Number(int(token[1:]))
        operator = "-"
    else:
        operator = tokens.take()
        right = _term(tokens)
    tokens.take(")")
    return Operation(operator, left, right)
