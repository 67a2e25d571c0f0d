"""Limits on the work of the planner, and functions that it calls while it works."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from cellwright.engine.kernels.cancellation import Interrupted, never
from cellwright.engine.stages.planning.effort import Effort
from cellwright.kb.model.plan import Plan

STATES = 500_000
CHECKS = 40_000_000  # questions whether an operator can be done in a state
RESTARTS = 6


class Batching(NamedTuple):
    """Expansions and generated nodes of the searches for fewer batches, for each node of `Limits.improvement`."""

    expansions: int
    generated: int


BATCHING = Batching(2, 40)


@dataclass(frozen=True, slots=True)
class Room:
    """How many states may be met, and how often it may be asked whether an operator can be done in one."""

    states: int = STATES
    checks: int = CHECKS


ROOM = Room()
LITTLE = Room(states=8_000, checks=500_000)  # a few milliseconds


def _deaf(_: Plan) -> None:
    """Ignores a better plan. This is the default."""


@dataclass(frozen=True, slots=True)
class Limits:
    """The work that a call of the planner may do.

    A search may expand `expansions` nodes. If all states of the task fit into `room`, the plan is a cheapest one.
    If not, improvement may generate `improvement` nodes for each plan that is found: for the first one, and for
    those of other searches, among them `restarts` of hill climbing. If `thorough` is set, improvement continues in
    ever wider windows until it is interrupted. `strategy` is one of `STRATEGIES`, or `RACE`. With a `seed` other than
    0, searches break ties by chance, with this seed. The planner calls `interrupted` from time to time and, if it returns True,
    stops with the best plan so far. It calls `improved` with the first plan and with every better one. Where a plan is
    `doubtful`, it first tries to prove that there is none.
    """

    expansions: int = 1_000_000
    improvement: int = 1_500
    room: Room | None = ROOM
    restarts: int = RESTARTS
    interrupted: Interrupted = never
    thorough: bool = False
    strategy: str = "auto"
    seed: int = 0
    improved: Callable[[Plan], None] = _deaf
    doubtful: bool = False

    def searching(self) -> Effort:
        """The effort for the search."""
        return Effort(self.expansions, self.interrupted)

    def improving(self) -> Effort:
        """The effort for the improvement of a plan."""
        return Effort(1 << 60, self.interrupted, most=1 << 60 if self.thorough else self.improvement)

    def batching(self) -> Effort:
        """The effort for fewer repeated steps in a plan, for tasks that only forward searches can plan."""
        most = self.improvement
        return Effort(BATCHING.expansions * most, self.interrupted, most=BATCHING.generated * most)
