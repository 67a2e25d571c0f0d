"""Makes a plan cheaper while there is work left: steps nobody needs, then detours, then the same in another order."""

from collections.abc import Iterator, Sequence

from engine.model.task import Bits, GroundOperator, Task
from engine.planning.backward import Regression
from engine.planning.deorder import arranged
from engine.planning.effort import Effort
from engine.planning.elimination import eliminate
from engine.planning.windows import straighten


def improvements(
    task: Task, regression: Regression | None, steps: Sequence[GroundOperator], goals: Bits, effort: Effort
) -> Iterator[list[GroundOperator]]:
    """The plan without needless steps, then every cheaper one found. Without `regression` there are no windows."""
    kept = eliminate(task.initial, steps, goals)
    yield kept
    if regression is None:
        return
    idle = 0
    while idle < 2 and not effort.spent():
        found = straighten(regression, task.initial, kept, goals, effort)
        found = eliminate(task.initial, found, goals)
        cheaper = cost(found) < cost(kept)
        idle = 0 if cheaper else idle + 1
        if cheaper:
            yield found
        kept = arranged(task, found, goals)


def cost(steps: Sequence[GroundOperator]) -> tuple[int, int]:
    """What a plan is compared by: its cost, then its length."""
    return sum(step.cost for step in steps), len(steps)
