"""Measures how much MACROPs help a search.

A task is solved with and without them, and the generated nodes are counted. Each pattern is first tried
alone. Then the patterns that pay are tried again, the best first, together with those that were kept before.
So if two patterns save the same work, only one of them gets the credit (the utility problem: Minton 1988;
filtering by solving the training tasks: Botea et al. 2005).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from cellwright.engine.kernels.cancellation import Interrupted, never
from cellwright.engine.model.task import Task
from cellwright.engine.stages.planning.composites import Pattern
from cellwright.engine.stages.planning.effort import Effort, OutOfRange
from cellwright.engine.stages.planning.regression.searches import BestFirst
from cellwright.engine.stages.planning.regression.space import Backward
from cellwright.engine.stages.planning.setting import COMPOSITES, GREED, Setting

SEEDS = (0, 1, 2, 3, 4)  # one run for each seed, where a search breaks ties by chance
MOST = 20_000  # a task that takes more nodes is not used for training
TOGETHER = 4  # the largest number of patterns for one search
PAYS = 0.85  # a pattern pays if the work with it is below this part of the work without it

Work = Callable[[Sequence[Pattern], int], int]
"""Takes patterns and a limit. Returns the nodes that are generated to solve the task, at most the limit."""


@dataclass(frozen=True, slots=True)
class Trial:
    """The nodes generated until a plan was found, without a pattern (`without`) and with it (`beside`).

    Patterns that were kept before are used in both cases.
    """

    without: int
    beside: int

    @property
    def paid(self) -> bool:
        """Whether the pattern saved enough work to be kept."""
        return self.beside < PAYS * self.without


def measured(
    task: Task, search: str, patterns: Sequence[Pattern], interrupted: Interrupted = never
) -> dict[Pattern, Trial]:
    """The trial of every pattern in one kind of search, `backward` or `forward`.

    There are no trials if the task is too hard for this search, or if the measurement was interrupted: its
    numbers would not show the real work.
    """
    setting = Setting(task)
    if search == "backward" and setting.regression is None:
        return {}
    work: Work = _backward(setting, interrupted) if search == "backward" else _forward(task, interrupted)
    base = work((), MOST)
    if base >= MOST or not base:
        return {}
    found = _in_turn(base, patterns, work)
    return {} if interrupted() else found


def _in_turn(base: int, patterns: Sequence[Pattern], work: Work) -> dict[Pattern, Trial]:
    """The trials: each pattern alone, then those that pay together with those that were kept."""
    found = {pattern: Trial(base, work([pattern], 2 * base)) for pattern in patterns}
    paying = sorted((each for each in found if found[each].paid), key=lambda each: found[each].beside)
    kept, least = paying[:1], found[paying[0]].beside if paying else base
    for pattern in paying[1:]:
        if len(kept) == TOGETHER:
            break
        found[pattern] = Trial(least, work([*kept, pattern], 2 * least))
        if found[pattern].paid:
            kept.append(pattern)
            least = found[pattern].beside
    return found


def _backward(setting: Setting, interrupted: Interrupted) -> Work:
    """The work of best-first regression."""
    assert setting.regression is not None
    plain = Backward(setting.regression, setting.task.initial)
    roots = [root for goal in setting.task.goals if (root := plain.root(goal)) is not None]

    def work(patterns: Sequence[Pattern], most: int) -> int:
        effort = Effort(most, interrupted, most=most)
        answer = BestFirst(plain.offered(patterns, COMPOSITES), roots, GREED).run(effort)
        return most if answer is None else min(effort.generated, most)

    return work


def _forward(task: Task, interrupted: Interrupted) -> Work:
    """The work of lazy greedy search, summed over all `SEEDS`."""
    from cellwright.engine.stages.planning.forward.search import forward

    def work(patterns: Sequence[Pattern], most: int) -> int:
        total = 0
        for seed in SEEDS:
            effort = Effort(most, interrupted, most=most - total)
            try:
                answer = forward(task, seed, patterns=patterns).run(effort)
            except OutOfRange:
                return most
            total += effort.generated
            if answer is None or total >= most:
                return most
        return total

    return work
