"""A statement of ASP as a value: what it defines and uses, where it stands, and its text for clingo.

`kb.asp.statements` makes statements from files, once. Whoever asks what a rule says asks the value; nobody looks into
the text, which can deceive: `beside(` holds `ide(`, and a quoted text may hold anything.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

from kb.diagnostics import NOWHERE, Source
from kb.terms import Atom, variables

Signature = tuple[str, int]
"""A predicate's name and how many arguments it has."""


class Sign(Enum):
    """How a body reads a predicate: as true, under `not`, or inside an aggregate or a condition."""

    POSITIVE = "positive"
    NEGATIVE = "negative"
    COUNTED = "counted"


class Use(NamedTuple):
    """A predicate that a body reads; unless the sign is positive, all of it must be known before."""

    predicate: Signature
    sign: Sign


class Constant(NamedTuple):
    """A constant that stands as argument `number` (from 0) of an atom."""

    predicate: Signature
    number: int
    name: str


@dataclass(frozen=True, slots=True)
class Statement:
    """A rule, a fact (nothing in its body), a constraint (nothing defined) or, with `constant`, the value of a constant.

    Equal texts say the same, so that the text alone is compared. All variables are listed as often as they stand, `_`
    never; `names` are those of predicates, functions and constants.
    """

    text: str
    where: Source = field(default=NOWHERE, compare=False)
    defines: Signature | None = field(default=None, compare=False)
    head: str = field(default="", compare=False)
    body: tuple[str, ...] = field(default=(), compare=False)
    uses: tuple[Use, ...] = field(default=(), compare=False)
    constants: tuple[Constant, ...] = field(default=(), compare=False)
    variables: tuple[str, ...] = field(default=(), compare=False)
    names: tuple[str, ...] = field(default=(), compare=False)
    counts: bool = field(default=False, compare=False)  # whether the head holds arithmetic or a range
    constant: str = field(default="", compare=False)

    @property
    def is_constraint(self) -> bool:
        """Whether this forbids what its body says."""
        return self.defines is None and not self.constant

    def under(self, head: str) -> str:
        """The text with another head (or one, for a constraint)."""
        return f"{head} :- {'; '.join(self.body)}." if self.body else f"{head}."


def derivation(head: Atom, body: Sequence[Atom]) -> Statement:
    """The statement `head :- body`, of atoms without texts, arithmetic or negation."""
    uses = tuple(Use((atom.name, len(atom.arguments)), Sign.POSITIVE) for atom in body)
    parts = tuple(map(str, body))
    made = Statement("", head=str(head), body=parts)
    return Statement(
        made.under(made.head),
        defines=(head.name, len(head.arguments)),
        head=made.head,
        body=parts,
        uses=uses,
        variables=tuple(each.name for atom in (head, *body) for each in variables(atom)),
        names=tuple(atom.name for atom in (head, *body)),
    )
