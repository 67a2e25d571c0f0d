"""A statement of ASP as a value: predicates that it defines and uses, its place, its text.

`cellwright.kb.asp.statements` makes statements from files, once. All questions about a rule are
answered by the value, never by a look into the text. The text can mislead: `beside(` contains
`ide(`, and a quoted text may contain anything.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

from cellwright.kb.diagnostics import NOWHERE, Source
from cellwright.kb.terms import Atom, term_variables

Signature = tuple[str, int]
"""A predicate's name and how many arguments it has."""


class Sign(Enum):
    """How a body reads a predicate: as true, under `not`, or inside an aggregate or a condition."""

    POSITIVE = "positive"
    NEGATIVE = "negative"
    COUNTED = "counted"


class PredicateUse(NamedTuple):
    """A predicate that a body reads.

    If the sign is not positive, all atoms of the predicate must be known before.
    """

    predicate: Signature
    sign: Sign


class Constant(NamedTuple):
    """A constant that is argument `number` (from 0) of an atom."""

    predicate: Signature
    number: int
    name: str


@dataclass(frozen=True, slots=True)
class Statement:
    """A rule, a fact (its body is empty), a constraint (it defines nothing) or, with `constant`,
    the value of a constant.

    Equal texts mean the same, so only the text is compared. `variables` lists variables as often as
    they occur, without `_`. `names` are those of predicates, functions and constants.
    """

    text: str
    where: Source = field(default=NOWHERE, compare=False)
    defines: Signature | None = field(default=None, compare=False)
    head: str = field(default="", compare=False)
    body: tuple[str, ...] = field(default=(), compare=False)
    uses: tuple[PredicateUse, ...] = field(default=(), compare=False)
    constants: tuple[Constant, ...] = field(default=(), compare=False)
    variables: tuple[str, ...] = field(default=(), compare=False)
    names: tuple[str, ...] = field(default=(), compare=False)
    # whether the head contains arithmetic or a range
    counts: bool = field(default=False, compare=False)
    constant: str = field(default="", compare=False)

    @property
    def is_constraint(self) -> bool:
        """Whether this is a constraint: its body must not hold."""
        return self.defines is None and not self.constant

    def under(self, head: str) -> str:
        """The text with another head. A constraint gets a head in this way."""
        return f"{head} :- {'; '.join(self.body)}." if self.body else f"{head}."


def derivation_statement(head: Atom, body: Sequence[Atom]) -> Statement:
    """The statement `head :- body`.

    Its atoms have no texts and no arithmetic, and none is negated.
    """
    uses = tuple(PredicateUse((atom.name, len(atom.arguments)), Sign.POSITIVE) for atom in body)
    parts = tuple(map(str, body))
    made = Statement("", head=str(head), body=parts)
    return Statement(
        made.under(made.head),
        defines=(head.name, len(head.arguments)),
        head=made.head,
        body=parts,
        uses=uses,
        variables=tuple(
            variable.name for atom in (head, *body) for variable in term_variables(atom)
        ),
        names=tuple(atom.name for atom in (head, *body)),
    )
