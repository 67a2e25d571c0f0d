"""Reads plain terms without a grammar: names, whole numbers, variables and compounds of them.

What is read here is read alike by the grammar of the language and by clingo. Everything else is
left to them: operators, times, texts, very long or deep terms, and errors, so that only they say
what is wrong.
"""

import functools
import re

from cellwright.kb.terms import Function, Number, Term, Variable

MAX_PLAIN_CHARACTERS = 2_000  # characters; a longer text is left to others
MAX_PLAIN_DEPTH = 20  # brackets in brackets
PLAIN_END = ""

_PLAIN_TOKEN = re.compile(
    r"[a-z][A-Za-z0-9_']*|_(?![A-Za-z0-9_'])|[A-Z][A-Za-z0-9_']*|-?[0-9]+|[(),]|[^ \t]+", re.ASCII
)
_NUMBER = re.compile(r"-?(?:0|[1-9][0-9]{0,8})", re.ASCII)
_NAME = re.compile(r"[a-z][A-Za-z0-9_']*", re.ASCII)
_VARIABLE = re.compile(r"_|[A-Z][A-Za-z0-9_']*", re.ASCII)


def plain_terms(text: str) -> tuple[Term, ...] | None:
    """The terms of a list with commas; None if anything in it is not plain."""
    if len(text) > MAX_PLAIN_CHARACTERS:
        return None
    tokens = [*_PLAIN_TOKEN.findall(text), PLAIN_END, PLAIN_END]
    opened: list[tuple[str, list[Term]]] = []
    items: list[Term] = []
    at = 0
    while (simple := _simple_term(token := tokens[at])) is not None:
        at += 1
        if tokens[at] == "(":
            if not isinstance(simple, Function) or len(opened) == MAX_PLAIN_DEPTH:
                return None
            opened.append((token, items))
            items, at = [], at + 1
            continue
        items.append(simple)
        while tokens[at] == ")" and opened:
            name, outer = opened.pop()
            outer.append(Function(name, tuple(items)))
            items, at = outer, at + 1
        if tokens[at] == PLAIN_END:
            return None if opened else tuple(items)
        if tokens[at] != ",":
            return None
        at += 1
    return None


@functools.lru_cache(maxsize=1 << 16)
def _simple_term(token: str) -> Term | None:
    """A constant, a number or a variable; None for another token."""
    if _NAME.fullmatch(token):
        return Function(token) if token != "not" else None
    if _NUMBER.fullmatch(token):
        return Number(int(token))
    return Variable(token) if _VARIABLE.fullmatch(token) else None
