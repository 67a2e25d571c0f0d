"""Makes a plan cheaper as long as there is work left.

Each round replaces detours and drops needless steps, until a round finds nothing.
"""

from collections.abc import Callable, Iterator, Sequence
from random import Random

from cellwright.engine.model.replay import early
from cellwright.engine.model.task import Bits, GroundOperator, Task
from cellwright.engine.stages.planning.effort import Effort
from cellwright.engine.stages.planning.elimination import eliminate
from cellwright.engine.stages.planning.improvement.late import grouped
from cellwright.engine.stages.planning.improvement.straighten import Cheaper, by_regression, straighten
from cellwright.engine.stages.planning.regression.space import Regression

Steps = list[GroundOperator]
NARROW = ((6, 500), (12, 1500))  # (steps in a window, nodes that may be generated for it)
WIDE = 12  # steps in the first windows that grow by half in each round
WORK = 1000  # conflicts of a solver, or expansions of a search, for such a window; they grow by half, too
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
            yield from self.settled(kept, passes, effort)

    def settled(self, kept: Steps, passes: Sequence[tuple[int, Cheaper]], effort: Effort) -> Iterator[Steps]:
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


class Growing:
    """Windows that get more work in each round, until even the most work gives nothing more. They are wider each time, and
    narrow again after the whole plan was one.

    `planner` makes what plans windows anew from the work that it may take for each. From the second round on steps that belong
    together stand side by side.
    """

    def __init__(
        self, task: Task, regression: Regression, planner: Callable[[int], Cheaper], seed: int
    ) -> None:
        self._task, self._regression, self._planner, self._chance = task, regression, planner, Random(seed)
        self._width, self._work = WIDE, WORK

    @property
    def ended(self) -> bool:
        """Whether further rounds are not worth their time."""
        return self._work >= MOST

    def round(self, best: Steps, goals: Bits, effort: Effort) -> Iterator[Steps]:
        """Every plan for one alternative of the goals, cheaper than `best`, that the windows of the next round give."""
        improvement = Improvement(self._task, self._regression, goals)
        steps = best if self._work == WORK else grouped(best, self._chance)
        yield from improvement.settled(steps, [(self._width, self._planner(self._work))], effort)
        self._width = WIDE if self._width >= len(best) else self._width + self._width // 2
        self._work += self._work // 2


def cost(steps: Sequence[GroundOperator]) -> tuple[int, int]:
    """The value by which plans are compared: the cost, then the number of steps."""
    return sum(step.cost for step in steps), len(steps)
