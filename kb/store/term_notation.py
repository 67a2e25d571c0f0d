"""Reads terms and literals of stored MACROPs from their texts.

Libraries contain hundreds of thousands of short texts, but few different ones. So this is a small
hand-written reader with a cache. Texts written by people are read by `cellwright.kb.syntax`.
"""

import functools
import re

from cellwright.kb.model.conditions import BodyPart, Comparison, Literal
from cellwright.kb.numbers import NumberError, read_whole
from cellwright.kb.terms import Atom, Function, Number, Operation, Term, Text, Variable

_TERM_TOKEN = re.compile(
    r"""\s*(?:(?P<number>-?[0-9]+)|(?P<text>"(?:[^"\\]|\\.)*")|(?P<name>[A-Za-z_][A-Za-z0-9_@']*)"""
    r"""|(?P<sign>!=|<=|>=|.))""",
    re.DOTALL,
)
_COMPARISON_TOKENS = frozenset({"=", "!=", "<", "<=", ">", ">="})
_OPERATOR_TOKENS = frozenset("+-*/\\")
TEXT_END = ""
MAX_BRACKET_DEPTH = 200  # brackets within brackets

Requirement = tuple[str, int]
"""A condition of the index, written as a text, and how many facts must at least meet it."""


class NotationError(ValueError):
    """The text is not a term or literal."""


class _Tokens:
    def __init__(self, text: str) -> None:
        self.text = text
        matches = list(_TERM_TOKEN.finditer(text.rstrip()))
        self.found = [match[match.lastgroup or 0] for match in matches]
        self.kinds = [match.lastgroup for match in matches]
        self.place = self.depth = 0

    def look(self) -> str:
        """The next token."""
        return self.found[self.place] if self.place < len(self.found) else TEXT_END

    def kind(self) -> str | None:
        """The kind of the next token: number, text, name or sign; None at the end."""
        return self.kinds[self.place] if self.place < len(self.kinds) else None

    def take(self, wanted: str = "") -> str:
        """The next token. If `wanted` is given, the token must be equal to it."""
        token = self.look()
        if token == TEXT_END or (wanted and token != wanted):
            raise NotationError(f"'{self.text}': {wanted or 'more'} is missing")
        self.place += 1
        return token


@functools.lru_cache(maxsize=65_536)
def read_term(text: str) -> Term:
    """The term in a text. Raises `NotationError`."""
    tokens = _Tokens(text)
    term = _read_term(tokens)
    _finish_text(tokens)
    return term


def read_stored_atom(text: str) -> Atom:
    """The atom in a text. Raises `NotationError`."""
    atom_term = read_term(text)
    if not isinstance(atom_term, Function):
        raise NotationError(f"'{text}' is not an atom")
    return atom_term


def read_literal(text: str) -> Literal:
    """The literal in a text. Raises `NotationError`."""
    negative = text.startswith("not ")
    return Literal(read_stored_atom(text[4:] if negative else text), not negative)


@functools.lru_cache(maxsize=65_536)
def read_part(text: str) -> BodyPart:
    """The literal or comparison in a text. Raises `NotationError`."""
    if text.startswith("not "):
        return read_literal(text)
    tokens = _Tokens(text)
    left = _read_term(tokens)
    if tokens.look() in _COMPARISON_TOKENS:
        relation = tokens.take()
        right = _read_term(tokens)
        _finish_text(tokens)
        return Comparison(left, relation, right)
    _finish_text(tokens)
    return read_literal(text)


def _finish_text(tokens: _Tokens) -> None:
    if tokens.look() != TEXT_END:
        raise NotationError(f"'{tokens.text}': '{tokens.look()}' is too much")


def _read_term(tokens: _Tokens) -> Term:
    tokens.depth += 1
    if tokens.depth > MAX_BRACKET_DEPTH:
        raise NotationError(
            f"'{tokens.text[:60]}': nested deeper than {MAX_BRACKET_DEPTH} brackets"
        )
    term = _read_operand(tokens)
    tokens.depth -= 1
    return term


def _read_operand(tokens: _Tokens) -> Term:
    kind, token = tokens.kind(), tokens.take()
    if token == "(":
        return _read_bracket(tokens)
    if kind == "text":
        return Text(
            re.sub(r"\\(.)", lambda escape: "\n" if escape[1] == "n" else escape[1], token[1:-1])
        )
    if kind == "number":
        return Number(_read_number(tokens, token))
    if kind != "name":
        raise NotationError(f"'{tokens.text}': '{token}' begins no term")
    if _is_variable(token):
        return Variable(token)
    return Function(token, _read_arguments(tokens) if tokens.look() == "(" else ())


def _read_number(tokens: _Tokens, token: str) -> int:
    try:
        return read_whole(token)
    except NumberError as error:
        raise NotationError(f"'{tokens.text[:60]}': a number {error}") from None


def _is_variable(name: str) -> bool:
    bare = name.lstrip("_")
    return not bare or bare[0].isupper()


def _read_arguments(tokens: _Tokens) -> tuple[Term, ...]:
    tokens.take("(")
    arguments = [_read_term(tokens)]
    while tokens.look() == ",":
        tokens.take()
        arguments.append(_read_term(tokens))
    tokens.take(")")
    return tuple(arguments)


def _read_bracket(tokens: _Tokens) -> Term:
    """An operation or a tuple in brackets."""
    first = _read_term(tokens)
    if tokens.look()[:1] in _OPERATOR_TOKENS:
        return _read_operation(first, tokens)
    terms = [first]
    while tokens.look() == ",":
        tokens.take()
        terms.append(_read_term(tokens))
    tokens.take(")")
    return Function("", tuple(terms))


def _read_operation(left: Term, tokens: _Tokens) -> Term:
    """The operation that begins with `left`. A sign and digits in one token are a subtraction."""
    if tokens.kind() == "number":
        token = tokens.take()
        right: Term = Number(int(token[1:]))
        operator = "-"
    else:
        operator = tokens.take()
        right = _read_term(tokens)
    tokens.take(")")
    return Operation(operator, left, right)
