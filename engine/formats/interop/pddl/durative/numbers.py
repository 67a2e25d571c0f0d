"""Reads the arithmetic of a PDDL task with times as exact terms."""

from cellwright.engine.formats.interop.pddl.declared_names import NameMapping
from cellwright.engine.formats.interop.pddl.expressions import Document, Expression, Group, PddlWord
from cellwright.engine.formats.interop.pddl.number_reader import NumberReader, Read
from cellwright.engine.formats.interop.pddl.numeric_functions import (
    ARITHMETIC_SIGNS,
    TaskFunctions,
    Unreadable,
    written_number,
)
from cellwright.kb.model.conditions import ALWAYS_TRUE, Comparison, Condition
from cellwright.kb.model.durative import DURATION, rational
from cellwright.kb.terms import Number, Operation, Term

HINT = "numbers are sums, products and quotients of whole or decimal numbers and functions"


class ExactNumbers(NumberReader):
    """Reads comparisons of numbers as they are written, without units and without polynomials."""

    def __init__(self, document: Document, names: NameMapping) -> None:
        super().__init__(document, names, TaskFunctions())

    def comparison(self, at: Group, relation: str, read: Read) -> Condition:
        """A comparison of two numbers. A wrong one is reported and replaced by true."""
        if len(at.rest) != 2:
            self.document.add(at, "K102", f"'{at.head}' compares two numbers")
            return ALWAYS_TRUE
        left, right = (self.amount(part, read) for part in at.rest)
        return Comparison(left, relation, right, exact=True)

    def amount(self, at: Expression, read: Read) -> Term:
        """A number. A wrong one is reported and replaced by 0."""
        try:
            return _term(at, read)
        except Unreadable as wrong:
            self.document.add(wrong.at, "K802", f"this number is not supported: {wrong.why}", HINT)
            return Number(0)


def _term(at: Expression, read: Read) -> Term:
    if (value := written_number(at)) is not None:
        return rational(value)
    if isinstance(at, PddlWord):
        return _named_term(at, read)
    if at.head not in ARITHMETIC_SIGNS:
        return read(at)
    parts = [_term(part, read) for part in at.rest]
    if not parts or (at.head == "/" and len(parts) != 2):
        raise Unreadable(at, f"'{at.head}' has a wrong number of arguments")
    if at.head == "-" and len(parts) == 1:
        return Operation("-", Number(0), parts[0])
    first, *others = parts
    for part in others:
        first = Operation(at.head, first, part)
    return first


def _named_term(at: PddlWord, read: Read) -> Term:
    if at.text == "?duration":
        return DURATION
    if at.text == "#t":
        raise Unreadable(at, "what changes continuously (#t) is not read")
    return read(Group((at,), at.offset))
