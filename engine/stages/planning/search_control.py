"""Control of searches: work counted in nodes, limits on it, answers, and how ties are broken."""

from collections.abc import Callable
from dataclasses import dataclass
from random import Random
from typing import NamedTuple

from cellwright.engine.kernels.cancellation import Interrupted, never
from cellwright.engine.model.ground_task import GroundOperator
from cellwright.engine.model.outcome import NO_OFFER, MacroOffer
from cellwright.kb.model.plan_model import Plan


class OutOfRange(Exception):
    """A search met values that are larger than it can count."""


@dataclass
class Effort:
    """The work done so far, and its limits.

    A search stops after `limit` expansions, after `most` generated nodes, or when `interrupted`
    returns True. `most` matters where expansions have very many successors.
    """

    limit: int
    interrupted: Interrupted = never
    expanded: int = 0
    generated: int = 0
    most: int = 1 << 60
    asked: int = 0

    def spent(self) -> bool:
        """Whether the search has to stop. A search calls this after each quick piece of work.

        Only one call in 64 asks whether the search is interrupted.
        """
        self.asked += 1
        return self._used_up() or (self.asked % 64 == 1 and self.interrupted())

    def over(self) -> bool:
        """Whether the search has to stop. A search calls this after each slow piece of work."""
        return self._used_up() or self.interrupted()

    def _used_up(self) -> bool:
        return self.expanded >= self.limit or self.generated >= self.most

    def part(self, expansions: int | None = None, most: int | None = None) -> "Effort":
        """A part of this effort: at most `expansions` more expansions and `most` generated
        nodes.
        """
        limit = self.limit if expansions is None else min(self.expanded + expansions, self.limit)
        remaining = self.most - self.generated
        return Effort(
            limit,
            self.interrupted,
            self.expanded,
            most=remaining if most is None else min(most, remaining),
        )

    def add(self, part: "Effort") -> None:
        """Adds the work of a part."""
        self.expanded, self.generated = part.expanded, self.generated + part.generated


@dataclass(frozen=True, slots=True)
class SearchResult:
    """The steps of a plan; `steps` is None if the whole space was searched and there is no plan.

    MACROPs are replaced by their steps.
    """

    steps: list[GroundOperator] | None
    offer: MacroOffer = NO_OFFER


NO_PLAN = SearchResult(None)


MAX_STATES_MET = 500_000
MAX_STATE_CHECKS = 40_000_000  # questions whether an operator can be done in a state
RESTARTS = 6
MAX_EXPANSIONS = 1_000_000  # where neither expansions nor seconds are limited
UNLIMITED = 1 << 60


class BatchEffort(NamedTuple):
    """Expansions and generated nodes of the searches for fewer batches, for each node of
    `Limits.improvement`.
    """

    expansions: int
    generated: int


BATCH_EFFORT = BatchEffort(2, 40)


@dataclass(frozen=True, slots=True)
class StateRoom:
    """How many states may be met, and how often it may be asked whether an operator can be done
    in one.
    """

    states: int = MAX_STATES_MET
    checks: int = MAX_STATE_CHECKS


def expansions_within(expansions: int | None, seconds: float | None) -> int:
    """The expansions of a search: as many as are given.

    Without a number, a limit of seconds governs alone.
    """
    if expansions is not None:
        return expansions
    return MAX_EXPANSIONS if seconds is None else UNLIMITED


STATE_ROOM = StateRoom()
SMALL_STATE_ROOM = StateRoom(states=8_000, checks=500_000)  # a few milliseconds


def ignore_plan(_: Plan) -> None:
    """Ignores a better plan. This is the default."""


@dataclass(frozen=True, slots=True)
class SearchLimits:
    """The work that a call of the planner may do.

    A search may expand `expansions` nodes. If all states of the task fit into `room`, the plan is a
    cheapest one. If not, improvement may generate `improvement` nodes for each plan that is found:
    for the first one, and for those of other searches, among them `restarts` of hill climbing. If
    `thorough` is set, improvement continues in ever wider windows until it is interrupted.
    `strategy` is one of `STRATEGIES`, or `RACE`. With a `seed` other than 0, searches break ties by
    chance, with this seed. The planner calls `interrupted` from time to time and, if it returns
    True, stops with the best plan so far. It calls `improved` with the first plan and with every
    better one. Where a plan is `doubtful`, it first tries to prove that there is none.
    """

    expansions: int = MAX_EXPANSIONS
    improvement: int = 1_500
    room: StateRoom | None = STATE_ROOM
    restarts: int = RESTARTS
    interrupted: Interrupted = never
    thorough: bool = False
    strategy: str = "auto"
    seed: int = 0
    improved: Callable[[Plan], None] = ignore_plan
    doubtful: bool = False

    def searching(self) -> Effort:
        """The effort for the search."""
        return Effort(self.expansions, self.interrupted)

    def improving(self) -> Effort:
        """The effort for the improvement of a plan."""
        return Effort(
            1 << 60, self.interrupted, most=1 << 60 if self.thorough else self.improvement
        )

    def batching(self) -> Effort:
        """The effort for fewer repeated steps in a plan, for tasks that only forward searches
        can plan.
        """
        most = self.improvement
        return Effort(
            BATCH_EFFORT.expansions * most, self.interrupted, most=BATCH_EFFORT.generated * most
        )


def random_source(seed: int) -> "Random | None":
    """A source of chance; None for the seed 0, with which the order is kept."""
    if not seed:
        return None
    return Random(seed)
