"""The limits of one call of the scheduler: deterministic work, seed, workers, interruption."""

from dataclasses import dataclass

from cellwright.engine.kernels.cancellation import Interrupted, never


@dataclass(frozen=True, slots=True)
class ScheduleLimits:
    """`work` is a limit on the solver's deterministic time, which is about seconds of one core.

    If it is the only limit, answers repeat exactly. With more than one of `workers`, they race: the
    answer comes sooner, but is not always the same. `interrupted` is asked now and then whether to
    stop with the best schedule so far.
    """

    work: float = 60.0
    seed: int = 0
    workers: int = 1
    interrupted: Interrupted = never
