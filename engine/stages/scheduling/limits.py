"""What a call of the scheduler may cost."""

from collections.abc import Callable
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class ScheduleLimits:
    """`work` is deterministic time of the solver, about seconds of one core; with it alone answers repeat exactly.

    `workers` above 1 race each other: sooner an answer, not always the same. `interrupted` is asked now and then
    whether to stop, with the best schedule so far.
    """

    work: float = 60.0
    seed: int = 0
    workers: int = 1
    interrupted: Callable[[], bool] = field(default=lambda: False)
