"""Values of arms that share space: where they can meet, and who goes first. Metres, radians, the domain's unit of time."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from cellwright.kb.model.plan import StepId

Pair = tuple[StepId, StepId]


@dataclass(frozen=True, slots=True)
class Meetings:
    """Which steps of different arms can meet.

    `tracks` are the steps of each arm in their order; a step of several arms is on several tracks. `steps` are pairs that can
    meet on their ways. `rests` are an arm, the step after which it rests (None: at the start), and a step of another arm that
    meets it there. `orders` are pairs of which the first must come first, because it clears the way of the second, or because
    the second would block it. `looked` pairs of steps were compared, `near` of them by their paths.
    """

    tracks: Mapping[str, tuple[StepId, ...]]
    steps: frozenset[Pair] = frozenset()
    rests: frozenset[tuple[str, StepId | None, StepId]] = frozenset()
    orders: frozenset[Pair] = frozenset()
    looked: int = 0
    near: int = 0


@dataclass(frozen=True, slots=True)
class Zone:
    """Space that two arms share: a box (m, in the world), and the steps of each arm that go through it.

    One arm at a time may be in it: it is a resource that geometry has found.
    """

    name: str
    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    steps: Mapping[str, tuple[StepId, ...]]


@dataclass(frozen=True, slots=True)
class Passed:
    """Who goes first: the start of each step, and pairs of steps of which the first ends before the second begins.

    No order of the arms in their zones is done before `lower_bound`. `proved` says that none is better.
    """

    starts: Mapping[StepId, int]
    makespan: int
    lower_bound: int
    orders: frozenset[Pair] = frozenset()
    proved: bool = False


@dataclass(frozen=True, slots=True)
class Sharing:
    """How the arms of a plan share space: `zones`, how many pairs of steps never meet whatever their times (`apart`), and how many are
    kept apart by their order (`ordered`). `held` are the orders that were added for that.
    """

    zones: tuple[Zone, ...] = ()
    apart: int = 0
    ordered: int = 0
    held: frozenset[Pair] = field(default_factory=frozenset)
    lower_bound: int = 0
    proved: bool = False
