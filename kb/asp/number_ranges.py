"""Which numbers the arguments of static predicates can have, and how many values a range has.

Numbers come from facts and are passed on by rules. Whatever computes a number, or gives it in
another way than by a plain term, leaves its argument without bounds.
"""

import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from functools import cached_property
from math import inf

from cellwright.kb.asp import AspError, ground_term
from cellwright.kb.model.statement import Sign, Signature, Statement
from cellwright.kb.plain_terms import plain_terms
from cellwright.kb.terms import Atom, Function, Number, Term, Variable

Interval = tuple[float, float]  # the least and the greatest number
Argument = tuple[Signature, int]  # an argument of a predicate, from 0

NO_NUMBER: Interval = (inf, -inf)
ANY_NUMBER: Interval = (-inf, inf)
NUMBER_ROUNDS = 20  # rules that pass numbers on, in a row
# a bound is a term in brackets, or one without any
ASP_RANGE = re.compile(r"(\([^()]*\)|[^\s(),;:{]+)\s*\.\.\s*(\([^()]*\)|[^\s(),;.}]+)")
# What may stand before and behind a range. Next to anything else, a bound is part of a longer term.
BEFORE_RANGE, BEHIND_RANGE = frozenset("(,;:{=<>"), frozenset("),;:.}=<>!")
SHIFTED_VARIABLE = re.compile(r"([A-Z]\w*)(?:([+-])(\d{1,9}))?", re.ASCII)


class StaticNumbers:
    """Bounds on the numbers among the arguments of static predicates."""

    def __init__(
        self, facts: Iterable[Atom], rules: Sequence[Statement], types: Collection[str]
    ) -> None:
        self._facts, self._rules, self._types = facts, rules, types

    def count_range_values(self, rule: Statement) -> float:
        """An upper bound on the values that the ranges of a rule have together; infinite if a bound
        of one may be any number.
        """
        product = 1.0
        for match in ASP_RANGE.finditer(rule.text):
            before, behind = rule.text[: match.start()].rstrip(), rule.text[match.end() :].lstrip()
            if before[-1:] not in BEFORE_RANGE or behind[:1] not in BEHIND_RANGE:
                return inf
            least = self._bounds(match[1], rule)[0]
            greatest = self._bounds(match[2], rule)[1]
            product *= greatest - least + 1 if greatest > least else 1.0
        return product

    def _bounds(self, text: str, rule: Statement) -> Interval:
        """The numbers that a bound of a range can be, in some instance of the rule."""
        if shifted := SHIFTED_VARIABLE.fullmatch(text.strip("()")):
            name, sign, digits = shifted.groups()
            if self._numbers is None:
                return ANY_NUMBER
            least, greatest = self._variable_numbers(Variable(name), rule, self._numbers)
            shift = int(f"{sign}{digits}") if sign else 0
            return least + shift, greatest + shift
        try:
            term = ground_term(text)
        except AspError:
            return ANY_NUMBER
        return (term.value, term.value) if isinstance(term, Number) else ANY_NUMBER

    @cached_property
    def _numbers(self) -> dict[Argument, Interval] | None:
        """The numbers of each argument, no entry where it has none; None if nothing is known."""
        if any(rule.constant for rule in self._rules):  # a name in a fact may stand for a number
            return None
        numbers = dict[Argument, Interval]()
        for fact in self._facts:
            _include(numbers, fact, [_own_numbers(term) for term in fact.arguments])
        for _ in range(NUMBER_ROUNDS):
            before = dict(numbers)
            for rule in self._rules:
                self._pass_on(rule, numbers)
            if numbers == before:
                return numbers
        return None

    def _pass_on(self, rule: Statement, numbers: dict[Argument, Interval]) -> None:
        """Add the numbers that a rule gives to its head."""
        if rule.defines is None:
            return
        head = _only_atom(rule.head)
        if head is None:
            for place in range(rule.defines[1]):
                numbers[rule.defines, place] = ANY_NUMBER
            return
        _include(
            numbers,
            head,
            [
                self._variable_numbers(term, rule, numbers)
                if isinstance(term, Variable)
                else _own_numbers(term)
                for term in head.arguments
            ],
        )

    def _variable_numbers(
        self, variable: Variable, rule: Statement, numbers: dict[Argument, Interval]
    ) -> Interval:
        """The numbers of a variable of a rule: those that all its places in the body allow.

        Types can have numbers of which no fact and no rule speaks.
        """
        least, greatest = ANY_NUMBER
        for predicate, place in _variable_places(variable, rule):
            if predicate[0] not in self._types:
                low, high = numbers.get((predicate, place), NO_NUMBER)
                least, greatest = max(least, low), min(greatest, high)
        return least, greatest


def _variable_places(variable: Variable, rule: Statement) -> Iterator[Argument]:
    """Where a body binds a variable: the arguments of its plain atoms that are the variable."""
    positive = {use.predicate for use in rule.uses if use.sign is Sign.POSITIVE}
    for part in rule.body:
        atom = _only_atom(part)
        if atom is None or (predicate := (atom.name, len(atom.arguments))) not in positive:
            continue
        for place, term in enumerate(atom.arguments):
            if term == variable:
                yield predicate, place


def _include(numbers: dict[Argument, Interval], atom: Atom, intervals: Iterable[Interval]) -> None:
    predicate = (atom.name, len(atom.arguments))
    for place, (low, high) in enumerate(intervals):
        least, greatest = numbers.get((predicate, place), NO_NUMBER)
        if low < least or high > greatest:
            numbers[predicate, place] = min(least, low), max(greatest, high)


def _own_numbers(term: Term) -> Interval:
    return (term.value, term.value) if isinstance(term, Number) else NO_NUMBER


def _only_atom(text: str) -> Function | None:
    """The atom that a text is; None if it is anything else."""
    terms = plain_terms(text)
    if terms is None or len(terms) != 1 or not isinstance(terms[0], Function):
        return None
    return terms[0]
