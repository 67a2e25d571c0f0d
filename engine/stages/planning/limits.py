"""What a call of the planner may cost, and what it is asked to report."""

from collections.abc import Callable
from dataclasses import dataclass, field

from engine.stages.planning.effort import Effort, Interrupted
from engine.stages.planning.improvement.exact import ROOM, Room
from kb.model.plan import Plan

RESTARTS = 4


def _deaf(_: Plan) -> None:
    """Nobody wants to hear of better plans."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Work allowed: `expansions` while searching, `improvement` nodes generated once a plan is known.

    In the `room` given the states of a small task are all looked at, for a cheapest plan; where it is too small,
    `restarts` of hill climbing give other plans to choose from.

    `thorough` improves on until interrupted, in ever wider windows. `strategy` is one of `STRATEGIES`, or `RACE`; `seed` breaks ties where a search breaks them by chance. `interrupted` is asked
    now and then whether to stop, with the best plan so far; `improved` is called with the first plan and every better one.
    """

    expansions: int = 1_000_000
    improvement: int = 1_500
    room: Room | None = ROOM
    restarts: int = RESTARTS
    interrupted: Interrupted = field(default=lambda: False)
    thorough: bool = False
    strategy: str = "auto"
    seed: int = 0
    improved: Callable[[Plan], None] = _deaf

    def searching(self) -> Effort:
        """The effort that a search may take."""
        return Effort(self.expansions, self.interrupted)

    def improving(self) -> Effort:
        """The effort that improvement may take."""
        return Effort(1 << 60, self.interrupted, most=1 << 60 if self.thorough else self.improvement)
