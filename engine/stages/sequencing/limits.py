"""How long a sequence is searched for. Work decides the answer; seconds only end it."""

from collections.abc import Callable
from dataclasses import dataclass


def never() -> bool:
    """Go on."""
    return False


@dataclass(frozen=True, slots=True)
class Limits:
    """`work` kicks or moves at most, 0: as many as suit the number of visits; `interrupted` is asked now and then.

    `proof` allows an exact search for as much deterministic time of the solver, about seconds.
    """

    work: int = 0
    seed: int = 0
    interrupted: Callable[[], bool] = never
    proof: float = 60.0
