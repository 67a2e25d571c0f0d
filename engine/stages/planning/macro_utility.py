"""Utility of MACROPs: measures how much each of them helps a search.

A task is solved with and without them, and the generated nodes are counted. Each pattern is first
tried alone. Then the patterns that pay are tried again, the best first, together with those that
were kept before. So if two patterns save the same work, only one of them gets the credit (the
utility problem: Minton 1988; filtering by solving the training tasks: Botea et al. 2005).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from cellwright.engine.kernels.cancellation import Interrupted, never
from cellwright.engine.model.ground_task import GroundTask
from cellwright.engine.stages.planning.composites import Pattern
from cellwright.engine.stages.planning.portfolio import (
    MAX_COMPOSITES,
    REGRESSION_GREED,
    SearchSetting,
)
from cellwright.engine.stages.planning.regression.backward_search import (
    BackwardSpace,
    BestFirstRegression,
)
from cellwright.engine.stages.planning.search_control import Effort, OutOfRange

TRIAL_SEEDS = (0, 1, 2, 3, 4)  # one run for each seed, where a search breaks ties by chance
MAX_TRAINING_NODES = 20_000  # a task that takes more nodes is not used for training
MAX_PATTERNS_TOGETHER = 4  # the largest number of patterns for one search
PAYING_RATIO = 0.85  # a pattern pays if the work with it is below this part of the work without it

Work = Callable[[Sequence[Pattern], int], int]
"""Takes patterns and a limit.

Returns the nodes that are generated to solve the task, at most the limit.
"""


@dataclass(frozen=True, slots=True)
class PatternTrial:
    """The nodes generated until a plan was found, without a pattern (`without`) and with it
    (`beside`).

    Patterns that were kept before are used in both cases.
    """

    without: int
    beside: int

    @property
    def paid(self) -> bool:
        """Whether the pattern saved enough work to be kept."""
        return self.beside < PAYING_RATIO * self.without


def measure_utility(
    task: GroundTask, search: str, patterns: Sequence[Pattern], interrupted: Interrupted = never
) -> dict[Pattern, PatternTrial]:
    """The trial of every pattern in one kind of search, `backward` or `forward`.

    There are no trials if the task is too hard for this search, or if the measurement was
    interrupted: its numbers would not show the real work.
    """
    setting = SearchSetting(task)
    if search == "backward" and setting.regression is None:
        return {}
    work: Work = (
        _backward_work(setting, interrupted)
        if search == "backward"
        else _forward_work(task, interrupted)
    )
    base = work((), MAX_TRAINING_NODES)
    if base >= MAX_TRAINING_NODES or not base:
        return {}
    trials = _in_turn(base, patterns, work)
    return {} if interrupted() else trials


def _in_turn(base: int, patterns: Sequence[Pattern], work: Work) -> dict[Pattern, PatternTrial]:
    """The trials: each pattern alone, then those that pay together with those that were kept."""
    trials = {pattern: PatternTrial(base, work([pattern], 2 * base)) for pattern in patterns}
    paying = sorted(
        (pattern for pattern in trials if trials[pattern].paid),
        key=lambda pattern_entry: trials[pattern_entry].beside,
    )
    chosen, least = paying[:1], trials[paying[0]].beside if paying else base
    for pattern in paying[1:]:
        if len(chosen) == MAX_PATTERNS_TOGETHER:
            break
        trials[pattern] = PatternTrial(least, work([*chosen, pattern], 2 * least))
        if trials[pattern].paid:
            chosen.append(pattern)
            least = trials[pattern].beside
    return trials


def _backward_work(setting: SearchSetting, interrupted: Interrupted) -> Work:
    """The work of best-first regression."""
    assert setting.regression is not None
    plain = BackwardSpace(setting.regression, setting.task.initial)
    roots = [root for goal in setting.task.goals if (root := plain.root(goal)) is not None]

    def work(patterns: Sequence[Pattern], most: int) -> int:
        effort = Effort(most, interrupted, most=most)
        answer = BestFirstRegression(
            plain.offered(patterns, MAX_COMPOSITES), roots, REGRESSION_GREED
        ).run(effort)
        return most if answer is None else min(effort.generated, most)

    return work


def _forward_work(task: GroundTask, interrupted: Interrupted) -> Work:
    """The work of lazy greedy search, summed over all `SEEDS`."""
    from cellwright.engine.stages.planning.forward.forward_search import start_forward_search

    def work(patterns: Sequence[Pattern], most: int) -> int:
        total = 0
        for seed in TRIAL_SEEDS:
            effort = Effort(most, interrupted, most=most - total)
            try:
                answer = start_forward_search(task, seed, patterns=patterns).run(effort)
            except OutOfRange:
                return most
            total += effort.generated
            if answer is None or total >= most:
                return most
        return total

    return work
