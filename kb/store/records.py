"""What a library is told of MACROPs, and what it tells of them."""

from collections.abc import Mapping
from dataclasses import dataclass

from cellwright.kb.model.macro import Macrop
from cellwright.kb.store.notation import Requirement


class Saving:
    """What the uses of a MACROP of a library have brought."""

    __slots__ = ()
    uses: int
    planning_s: float
    lookup_s: float

    @property
    def saved_s(self) -> float:
        """The planning time that it has saved in seconds, minus the time for looking it up."""
        return self.uses * self.planning_s - self.lookup_s


@dataclass(frozen=True, slots=True)
class Record:
    """A MACROP to be stored under the signature of its goals. `planning_s` is the planning time when it was learned.

    `requirements` are the conditions of the index on a query; if missing, they are computed at the first lookup.
    """

    macrop: Macrop
    signature: str
    planning_s: float = 0.0
    requirements: tuple[Requirement, ...] | None = None


@dataclass(frozen=True, slots=True)
class Stored(Saving):
    """A MACROP of a library with its number and its uses."""

    id: int
    macrop: Macrop
    signature: str
    uses: int = 0
    planning_s: float = 0.0
    lookup_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Use:
    """How often a MACROP was used, and the total time for looking it up in seconds."""

    times: int
    lookup_s: float


@dataclass(frozen=True, slots=True)
class Figures:
    """The figures of a library. `domains` counts MACROPs by domain."""

    macrops: int
    shapes: int
    uses: int
    saved_s: float
    domains: Mapping[str, int]
    schema: int
