"""Simple temporal networks with uncertainty: what must be apart in time, and what nobody decides.

Points of time are numbered. Point 0 is the origin: nothing comes before it. Times are whole numbers
of one unit.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

ORIGIN = 0  # the point at which everything begins
NO_TIMES: Mapping[int, int] = {}


@dataclass(frozen=True, slots=True)
class DifferenceBound:
    """Point `later` comes at most `most` after point `earlier`; a negative `most` sets the order.

    `says` is what it stands for, in words. Only bounds that are `relaxable` may give way.
    """

    earlier: int
    later: int
    most: int
    says: str = field(default="", compare=False)
    relaxable: bool = False


@dataclass(frozen=True, slots=True)
class UncertainLink:
    """Point `end` comes by itself, at least `least` and at most `most` after point `start`."""

    start: int
    end: int
    least: int
    most: int
    says: str = field(default="", compare=False)

    @property
    def slack(self) -> int:
        """By how much its length varies."""
        return self.most - self.least


@dataclass(frozen=True, slots=True)
class UncertainNetwork:
    """Points of time, bounds between them, and links whose lengths nobody decides.

    No two links end in the same point.
    """

    points: tuple[str, ...]
    bounds: tuple[DifferenceBound, ...]
    links: tuple[UncertainLink, ...] = ()


class EdgeKind(StrEnum):
    """What an edge of a negative cycle says.

    - `bound`: a bound of the network
    - `shortest`: a link ends as soon as it can (the lower-case edge of the literature)
    - `at least`: a link takes at least so long
    - `derived`: a bound that follows for each dynamic policy
    """

    BOUND = "bound"
    SHORTEST = "shortest"
    AT_LEAST = "at least"
    DERIVED = "derived"


@dataclass(frozen=True, slots=True)
class CycleEdge:
    """An edge of a cycle: the number of a bound, a link, or a derived bound."""

    kind: EdgeKind
    number: int


@dataclass(frozen=True, slots=True)
class DerivedBound:
    """What follows if a link takes as long as it can: `path` leads from a point to its end.

    The point has to wait until the link has ended, or so long after the start of the link as
    its longest time exceeds the length of the path.
    """

    link: int
    path: tuple[CycleEdge, ...]


@dataclass(frozen=True, slots=True)
class NegativeCycle:
    """Why no policy exists: what contradicts itself.

    `derived` are the bounds that follow; each uses only those before it. Either `edges` are a
    closed path of negative length, or `waits` are closed: the point where each begins is the
    start of the link of the next, so that each waits for another.
    """

    derived: tuple[DerivedBound, ...] = ()
    edges: tuple[CycleEdge, ...] = ()
    waits: tuple[DerivedBound, ...] = ()


@dataclass(frozen=True, slots=True)
class Controllable:
    """Some policy keeps all bounds, however long the links take."""


@dataclass(frozen=True, slots=True)
class WaitBound:
    """Point `waiting` comes before neither the end of a link nor `time` after its start."""

    waiting: int
    link: int
    time: int


@dataclass(frozen=True, slots=True)
class DispatchableNetwork:
    """All that a policy has to look at (Morris 2014).

    `bounds` say how long after points each other point comes at least; `order` lists the points so
    that each bound leads forward. Who lets each point happen as soon as these bounds and the waits
    allow keeps all bounds of the network.
    """

    order: tuple[int, ...]
    bounds: tuple[DifferenceBound, ...]
    waits: tuple[WaitBound, ...]


@dataclass(frozen=True, slots=True)
class Relaxation:
    """What would have to change so that a policy exists.

    `bounds` says by how much bounds have to be wider, `earliest` by how much links have to take
    longer at least, `latest` by how much less they may take at most. No smaller sum of changes is
    enough if it is `least_proved`.
    """

    bounds: Mapping[int, int] = field(default_factory=dict)
    earliest: Mapping[int, int] = field(default_factory=dict)
    latest: Mapping[int, int] = field(default_factory=dict)
    least_proved: bool = True

    @property
    def amount(self) -> int:
        """The sum of all changes."""
        return sum((*self.bounds.values(), *self.earliest.values(), *self.latest.values()))
