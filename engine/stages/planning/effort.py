"""Work, counted rather than timed, and what a search answers."""

from collections.abc import Callable
from dataclasses import dataclass

from engine.model.outcome import NO_OFFER, Offer
from engine.model.task import GroundOperator

Interrupted = Callable[[], bool]


@dataclass
class Effort:
    """Work so far: a search stops after `limit` expansions, or when `interrupted` says so.

    `most` bounds the nodes generated, where expansions may have very many successors.
    """

    limit: int
    interrupted: Interrupted = lambda: False
    expanded: int = 0
    generated: int = 0
    most: int = 1 << 60
    asked: int = 0

    def spent(self) -> bool:
        """Whether to stop; after something quick, as not every call asks whether it is interrupted."""
        self.asked += 1
        return self._used_up() or (self.asked % 64 == 1 and self.interrupted())

    def over(self) -> bool:
        """Whether to stop, after something slow."""
        return self._used_up() or self.interrupted()

    def _used_up(self) -> bool:
        return self.expanded >= self.limit or self.generated >= self.most

    def part(self, expansions: int | None = None, most: int | None = None) -> "Effort":
        """A slice of this effort: so many more expansions, or nodes generated."""
        limit = self.limit if expansions is None else min(self.expanded + expansions, self.limit)
        left = self.most - self.generated
        return Effort(limit, self.interrupted, self.expanded, most=left if most is None else min(most, left))

    def add(self, part: "Effort") -> None:
        """Count the work of a slice."""
        self.expanded, self.generated = part.expanded, self.generated + part.generated


@dataclass(frozen=True, slots=True)
class Answer:
    """The steps of a plan; None if the whole space was searched and there is none. MACROPs are in it by their steps."""

    steps: list[GroundOperator] | None
    offer: Offer = NO_OFFER


NO_PLAN = Answer(None)
