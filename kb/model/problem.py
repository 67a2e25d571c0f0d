"""The problem: what one task adds to its domain. `replace` gives the same problem from another initial state."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field

from kb.diagnostics import NOWHERE, Source
from kb.model.conditions import TRUE, Condition
from kb.model.domain import Domain
from kb.terms import Atom, Term


@dataclass(frozen=True, slots=True)
class Chain:
    """The ordered stages of one object (or group of bindings); `after` names chains that must be finished first.

    What the last stage adds must still hold at the end, unless a chain of the same subject comes after this one.
    A fluent stage with `_` is reached by any atom that fits; what must last of it is a goal of its own.
    """

    name: str
    stages: tuple[Atom, ...]
    after: tuple[str, ...] = ()
    subject: Term | None = None
    where: Source = field(default=NOWHERE, compare=False)


@dataclass(frozen=True, slots=True)
class Problem:
    """Objects, statics, initial facts, goals and workflow of one task. `path` is empty for a problem made on the fly."""

    name: str
    domain: Domain
    objects: Mapping[str, str] = field(default_factory=dict)
    statics: tuple[Atom, ...] = ()
    initial: tuple[Atom, ...] = ()
    goal: Condition = TRUE
    chains: tuple[Chain, ...] = ()
    complete: bool = False  # `initial` is a whole state: neither closed nor completed by defaults
    path: str = ""
    where: Source = field(default=NOWHERE, compare=False)

    def replace(self, initial: tuple[Atom, ...]) -> "Problem":
        """The same problem from an observed state, taken as it is."""
        return dataclasses.replace(self, initial=initial, complete=True)
