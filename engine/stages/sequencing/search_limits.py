"""Limits of a search for a tour: its work decides the answer, a time limit only ends it."""

from collections.abc import Callable
from dataclasses import dataclass

from cellwright.engine.kernels.cancellation import Interrupted, never


def ignore_cost(_cost: int) -> None:
    """Tell nobody."""


@dataclass(frozen=True, slots=True)
class TourLimits:
    """`work` is the greatest number of kicks or moves; 0: a number that suits the number of visits.

    `interrupted` is asked now and then whether to stop. `proof` is the solver's deterministic time
    for an exact search, about seconds. `tell` is called now and then with the cost of the best tour
    so far. Without `sharp` no time goes into a bound that is nearer to the tour that was found: the
    first one is told.
    """

    work: int = 0
    seed: int = 0
    interrupted: Interrupted = never
    proof: float = 60.0
    tell: Callable[[int], None] = ignore_cost
    sharp: bool = True
