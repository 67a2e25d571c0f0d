"""The problem: what one task adds to its domain."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field

from cellwright.kb.diagnostics import NOWHERE, Source
from cellwright.kb.model.conditions import TRUE, Condition
from cellwright.kb.model.domain import Domain
from cellwright.kb.terms import Atom, Function, Term


@dataclass(frozen=True, slots=True)
class Chain:
    """The ordered stages of one object (or of one group of bindings).

    `after` names chains that must be finished first. The last stage must still hold at the end, unless a
    chain of the same subject comes after this one. Any atom that fits reaches a fluent stage with `_`. Such a
    stage need not last, unless a goal says so. A stage of several fluents that are reached together is one term, `&` of
    them (`cellwright.kb.terms.together`). A chain that is not `wanted` says which events may occur, in their order; none of them has to.
    """

    name: str
    stages: tuple[Atom, ...]
    after: tuple[str, ...] = ()
    subject: Term | None = None
    where: Source = field(default=NOWHERE, compare=False)
    wanted: bool = True


@dataclass(frozen=True, slots=True)
class Problem:
    """Objects, statics, initial facts, goals and workflow of one task.

    `path` is empty for a problem that is not from a file. `durations` says how long some steps last, in the domain's unit of
    time, in place of what their operators say.
    """

    name: str
    domain: Domain
    objects: Mapping[str, str] = field(default_factory=dict)
    statics: tuple[Atom, ...] = ()
    initial: tuple[Atom, ...] = ()
    goal: Condition = TRUE
    chains: tuple[Chain, ...] = ()
    complete: bool = (
        False  # `initial` is a complete state: no deductive operators or defaults are applied to it
    )
    path: str = ""
    where: Source = field(default=NOWHERE, compare=False)
    durations: Mapping[Function, int] = field(default_factory=dict)

    def replace(self, initial: tuple[Atom, ...]) -> "Problem":
        """The same problem from an observed state, which is taken as complete."""
        return dataclasses.replace(self, initial=initial, complete=True)
