"""What MACROPs are worth to a search, measured: the same task solved with and without them, work counted in nodes generated.

A pattern is tried alone first; then, the best first, beside those that already pay, so that of two which do the same only one
is credited (the utility problem: Minton 1988; filtering by solving the training tasks: Botea et al. 2005).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from engine.model.task import Task
from engine.stages.planning.composites import Pattern
from engine.stages.planning.effort import Effort, Interrupted
from engine.stages.planning.portfolio import COMPOSITES, GREED, Setting
from engine.stages.planning.regression.searches import BestFirst
from engine.stages.planning.regression.space import Backward

SEEDS = (0, 1, 2, 3, 4)  # ties broken in so many ways, where a search breaks ties by chance
MOST = 20_000  # nodes that a task may take; what takes more is no task to train on
TOGETHER = 4  # patterns that are kept for one search
PAYS = 0.85  # of the work without a pattern, that with it may be

Work = Callable[[Sequence[Pattern], int], int]
"""The nodes that solving takes with some patterns, at most so many."""


@dataclass(frozen=True, slots=True)
class Trial:
    """Nodes generated until a plan was found, without a pattern and with it; beside others that pay, if there are some."""

    without: int
    beside: int

    @property
    def paid(self) -> bool:
        """Whether it spared work worth speaking of."""
        return self.beside < PAYS * self.without


def measured(
    task: Task, search: str, patterns: Sequence[Pattern], interrupted: Interrupted = lambda: False
) -> dict[Pattern, Trial]:
    """A trial of every pattern in one kind of search, `backward` or `forward`; none if the task is too hard for that.

    None, too, once interrupted: what was measured then would not be the work.
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
    """Each alone; then those that pay, the best first, beside the others that do."""
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
    """Best-first regression."""
    assert setting.regression is not None
    plain = Backward(setting.regression, setting.task.initial)
    roots = [root for goal in setting.task.goals if (root := plain.root(goal)) is not None]

    def work(patterns: Sequence[Pattern], most: int) -> int:
        effort = Effort(most, interrupted, most=most)
        answer = BestFirst(plain.offered(patterns, COMPOSITES), roots, GREED).run(effort)
        return most if answer is None else min(effort.generated, most)

    return work


def _forward(task: Task, interrupted: Interrupted) -> Work:
    """Lazy greedy search, summed over ways to break ties."""
    from engine.stages.planning.forward.search import forward

    def work(patterns: Sequence[Pattern], most: int) -> int:
        total = 0
        for seed in SEEDS:
            effort = Effort(most, interrupted, most=most - total)
            answer = forward(task, seed, patterns=patterns).run(effort)
            total += effort.generated
            if answer is None or total >= most:
                return most
        return total

    return work
