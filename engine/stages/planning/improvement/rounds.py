"""Makes a plan cheaper as long as there is work left.

Each round replaces detours and drops needless steps, until a round finds nothing.
"""

from collections.abc import Iterator, Sequence

from engine.model.replay import early
from engine.model.task import Bits, GroundOperator, Task
from engine.stages.planning.effort import Effort
from engine.stages.planning.elimination import eliminate
from engine.stages.planning.improvement.straighten import Cheaper, by_regression, straighten
from engine.stages.planning.regression.space import Regression

Steps = list[GroundOperator]
NARROW = ((6, 500), (12, 1500))  # (steps in a window, nodes that may be generated for it)
WIDE = 12  # steps in the first windows for stable models; they grow by half in each pass
CONFLICTS = 1000  # conflicts for such a window; they grow by half, too
MOST = 1_000_000


class Improvement:
    """Cheaper plans for one alternative of a task's goals.

    Without regression only needless steps are dropped.
    """

    def __init__(self, task: Task, regression: Regression | None, goals: Bits) -> None:
        self.task, self.regression, self.goals = task, regression, goals

    def near(self, steps: Sequence[GroundOperator], effort: Effort) -> Iterator[Steps]:
        """The plan without needless steps, then every cheaper one found in narrow windows."""
        kept = eliminate(self.task.initial, early(self.task, steps), self.goals)
        yield kept
        if self.regression is not None:
            passes = [(width, by_regression(self.regression, nodes)) for width, nodes in NARROW]
            yield from self._settled(kept, passes, effort)

    def wide(self, best: Steps, effort: Effort) -> Iterator[Steps]:
        """Every cheaper plan found in ever wider windows, until even the widest windows give nothing more."""
        from engine.stages.planning.stable_models.windows import Windows

        if self.regression is None:
            return
        width, conflicts, size = WIDE, CONFLICTS, len(self.regression.excluded)
        while not effort.over() and conflicts < MOST:
            cheaper = Windows(self.regression.operators, self.task.mutex_groups, size, conflicts)
            for better in self._settled(best, [(width, cheaper)], effort):
                best = better
                yield best
            width, conflicts = min(width + width // 2, max(len(best), WIDE)), conflicts + conflicts // 2

    def _settled(self, kept: Steps, passes: Sequence[tuple[int, Cheaper]], effort: Effort) -> Iterator[Steps]:
        """Every cheaper plan that the passes find, until a round finds nothing."""
        while not effort.over():
            found = kept
            for width, cheaper in passes:
                found = straighten(self.task.initial, found, self.goals, width, cheaper, effort)
            found = eliminate(self.task.initial, early(self.task, found), self.goals)
            if cost(found) >= cost(kept):
                return
            yield found
            kept = found


def cost(steps: Sequence[GroundOperator]) -> tuple[int, int]:
    """The value by which plans are compared: the cost, then the number of steps."""
    return sum(step.cost for step in steps), len(steps)
