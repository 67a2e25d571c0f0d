"""The work of a search, counted in nodes instead of seconds, and the answer of a search."""

from dataclasses import dataclass

from cellwright.engine.kernels.cancellation import Interrupted, never
from cellwright.engine.model.outcome import NO_OFFER, Offer
from cellwright.engine.model.task import GroundOperator


class OutOfRange(Exception):
    """A search met values that are larger than it can count."""


@dataclass
class Effort:
    """The work done so far, and its limits.

    A search stops after `limit` expansions, after `most` generated nodes, or when `interrupted` returns True.
    `most` matters where expansions have very many successors.
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
        """A part of this effort: at most `expansions` more expansions and `most` generated nodes."""
        limit = self.limit if expansions is None else min(self.expanded + expansions, self.limit)
        left = self.most - self.generated
        return Effort(limit, self.interrupted, self.expanded, most=left if most is None else min(most, left))

    def add(self, part: "Effort") -> None:
        """Adds the work of a part."""
        self.expanded, self.generated = part.expanded, self.generated + part.generated


@dataclass(frozen=True, slots=True)
class SearchResult:
    """The steps of a plan; `steps` is None if the whole space was searched and there is no plan.

    MACROPs are replaced by their steps.
    """

    steps: list[GroundOperator] | None
    offer: Offer = NO_OFFER


NO_PLAN = SearchResult(None)
