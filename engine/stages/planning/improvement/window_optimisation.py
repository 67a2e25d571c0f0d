"""Window optimisation: stretches of a plan are replaced by cheaper ones, in rounds of more work."""

from collections.abc import Callable, Iterator, Sequence
from random import Random
from typing import TYPE_CHECKING

from cellwright.engine.kernels.bits import Bits
from cellwright.engine.model.ground_task import GroundOperator, GroundTask, progress_state
from cellwright.engine.model.workflow_replay import reach_stages_early
from cellwright.engine.stages.planning.action_elimination import eliminate_actions
from cellwright.engine.stages.planning.improvement.plan_reordering import group_steps
from cellwright.engine.stages.planning.regression.backward_search import (
    BackwardSpace,
    BestFirstRegression,
    Regression,
)
from cellwright.engine.stages.planning.search_control import Effort

if TYPE_CHECKING:
    from cellwright.engine.stages.planning.forward.weighted_search import WeightedSearch

OPERATORS_PER_NODE = 32  # a window's relaxed plans cost one node for this many operators

Cheaper = Callable[[Bits, Bits, Sequence[GroundOperator], Effort], list[GroundOperator] | None]
"""Takes a state, goals, a window and an effort.

Returns cheaper steps to the goals; None if it finds none.
"""


def optimise_windows(
    initial: Bits,
    steps: Sequence[GroundOperator],
    goals: Bits,
    width: int,
    cheaper: Cheaper,
    effort: Effort,
) -> list[GroundOperator]:
    """The steps after a window of `width` steps has moved over the whole plan.

    Every stretch for which `cheaper` finds a better one is replaced.
    """
    best_steps = list(steps)
    start = 0
    while start < len(best_steps) and not effort.over():
        states, needed = _states_along(initial, best_steps), _needed_atoms(best_steps, goals)
        end = min(start + width, len(best_steps))
        cheaper_steps = cheaper(states[start], needed[end], best_steps[start:end], effort)
        if cheaper_steps is not None:
            best_steps[start:end] = cheaper_steps
            start = max(0, start - width)
        elif end == len(best_steps):
            break
        else:
            start += max(1, width // 3)
    return best_steps


def _states_along(initial: Bits, steps: Sequence[GroundOperator]) -> list[Bits]:
    states = [initial]
    for operator in steps:
        states.append(progress_state(states[-1], operator))
    return states


def _needed_atoms(steps: Sequence[GroundOperator], goals: Bits) -> list[Bits]:
    needed = [goals]
    for operator in reversed(steps):
        needed.append((needed[-1] & ~operator.adds) | operator.preconditions)
    return needed[::-1]


def by_regression(regression: Regression, nodes: int) -> Cheaper:
    """Plans windows anew by regression, with at most `nodes` generated nodes each.

    The space contains only what is near the first state of the window.
    """

    def cheaper(
        state: Bits, goals: Bits, window: Sequence[GroundOperator], effort: Effort
    ) -> list[GroundOperator] | None:
        effort.generated += len(regression.operators) // OPERATORS_PER_NODE
        bound = sum(map(regression.relaxation.charge, window))
        local = BackwardSpace(regression, state, bound)
        root = local.root(goals)
        if root is None:
            return None
        part = effort.part(most=nodes)
        answer = BestFirstRegression(local, [root], 1, bound).run(part)
        effort.add(part)
        if answer is None or answer.steps is None:
            return None
        return answer.steps if _steps_price(answer.steps) < _steps_price(window) else None

    return cheaper


def by_search(search: "WeightedSearch", expansions: int) -> Cheaper:
    """Plans windows anew by a forward search with at most so many expansions each."""

    def cheaper(
        state: Bits, goals: Bits, window: Sequence[GroundOperator], effort: Effort
    ) -> list[GroundOperator] | None:
        part = effort.part(expansions)
        answer = search.between(state, goals, _steps_price(window)).run(part)
        effort.add(part)
        return answer.steps if answer is not None else None

    return cheaper


def _steps_price(steps: Sequence[GroundOperator]) -> int:
    return sum(step.cost for step in steps)


Steps = list[GroundOperator]
NARROW_WINDOWS = ((6, 500), (12, 1500))  # (steps in a window, nodes that may be generated for it)
FIRST_WINDOW_STEPS = 12  # steps in the first windows that grow by half in each round
# conflicts of a solver, or expansions of a search, for such a window; they grow by half, too
FIRST_WINDOW_WORK = 1000
MAX_WINDOW_WORK = 1_000_000


class PlanImprovement:
    """Cheaper plans for one alternative of a task's goals.

    Without regression only needless steps are dropped.
    """

    def __init__(self, task: GroundTask, regression: Regression | None, goals: Bits) -> None:
        self.task, self.regression, self.goals = task, regression, goals

    def near(self, steps: Sequence[GroundOperator], effort: Effort) -> Iterator[Steps]:
        """The plan without needless steps, then every cheaper one found in narrow windows."""
        needed = eliminate_actions(
            self.task.initial, reach_stages_early(self.task, steps), self.goals
        )
        yield needed
        if self.regression is not None:
            passes = [
                (width, by_regression(self.regression, nodes)) for width, nodes in NARROW_WINDOWS
            ]
            yield from self.settled(needed, passes, effort)

    def settled(
        self, kept: Steps, passes: Sequence[tuple[int, Cheaper]], effort: Effort
    ) -> Iterator[Steps]:
        """Every cheaper plan that the passes find, until a round finds nothing."""
        while not effort.over():
            best_steps = kept
            for width, cheaper in passes:
                best_steps = optimise_windows(
                    self.task.initial, best_steps, self.goals, width, cheaper, effort
                )
            best_steps = eliminate_actions(
                self.task.initial, reach_stages_early(self.task, best_steps), self.goals
            )
            if steps_cost(best_steps) >= steps_cost(kept):
                return
            yield best_steps
            kept = best_steps


class GrowingWindows:
    """Windows that get more work in each round, until even the most work gives nothing more. They
    are wider each time, and narrow again after the whole plan was one.

    `planner` makes what plans windows anew from the work that it may take for each. From the second
    round on steps that belong together stand side by side.
    """

    def __init__(
        self, task: GroundTask, regression: Regression, planner: Callable[[int], Cheaper], seed: int
    ) -> None:
        self._task, self._regression, self._planner, self._chance = (
            task,
            regression,
            planner,
            Random(seed),
        )
        self._width, self._work = FIRST_WINDOW_STEPS, FIRST_WINDOW_WORK

    @property
    def ended(self) -> bool:
        """Whether further rounds are not worth their time."""
        return self._work >= MAX_WINDOW_WORK

    def round(self, best: Steps, goals: Bits, effort: Effort) -> Iterator[Steps]:
        """Every plan for one alternative of the goals, cheaper than `best`, that the windows of
        the next round give.
        """
        improvement = PlanImprovement(self._task, self._regression, goals)
        steps = best if self._work == FIRST_WINDOW_WORK else group_steps(best, self._chance)
        yield from improvement.settled(steps, [(self._width, self._planner(self._work))], effort)
        self._width = (
            FIRST_WINDOW_STEPS if self._width >= len(best) else self._width + self._width // 2
        )
        self._work += self._work // 2


def steps_cost(steps: Sequence[GroundOperator]) -> tuple[int, int]:
    """The value by which plans are compared: the cost, then the number of steps."""
    return sum(step.cost for step in steps), len(steps)
