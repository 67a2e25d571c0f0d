"""Window optimisation: stretches of a plan are replaced by cheaper ones with the same result (in the spirit
of block deordering and window optimisation, Siddiqui & Haslum 2015).
"""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from cellwright.engine.model.task import Bits, GroundOperator, progress
from cellwright.engine.stages.planning.effort import Effort
from cellwright.engine.stages.planning.regression.searches import BestFirst
from cellwright.engine.stages.planning.regression.space import Backward, Regression

if TYPE_CHECKING:
    from cellwright.engine.stages.planning.forward.weighted import Weighted

SHARE = 32  # a window's relaxed plans cost one node for this many operators

Cheaper = Callable[[Bits, Bits, Sequence[GroundOperator], Effort], list[GroundOperator] | None]
"""Takes a state, goals, a window and an effort. Returns cheaper steps to the goals; None if it finds none."""


def straighten(
    initial: Bits, steps: Sequence[GroundOperator], goals: Bits, width: int, cheaper: Cheaper, effort: Effort
) -> list[GroundOperator]:
    """The steps after a window of `width` steps has moved over the whole plan.

    Every stretch for which `cheaper` finds a better one is replaced.
    """
    kept = list(steps)
    start = 0
    while start < len(kept) and not effort.over():
        states, needed = _states(initial, kept), _needed(kept, goals)
        end = min(start + width, len(kept))
        found = cheaper(states[start], needed[end], kept[start:end], effort)
        if found is not None:
            kept[start:end] = found
            start = max(0, start - width)
        elif end == len(kept):
            break
        else:
            start += max(1, width // 3)
    return kept


def _states(initial: Bits, steps: Sequence[GroundOperator]) -> list[Bits]:
    states = [initial]
    for operator in steps:
        states.append(progress(states[-1], operator))
    return states


def _needed(steps: Sequence[GroundOperator], goals: Bits) -> list[Bits]:
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
        effort.generated += len(regression.operators) // SHARE
        bound = sum(map(regression.relaxation.charge, window))
        local = Backward(regression, state, bound)
        root = local.root(goals)
        if root is None:
            return None
        part = effort.part(most=nodes)
        answer = BestFirst(local, [root], 1, bound).run(part)
        effort.add(part)
        if answer is None or answer.steps is None:
            return None
        return answer.steps if _price(answer.steps) < _price(window) else None

    return cheaper


def by_search(search: "Weighted", expansions: int) -> Cheaper:
    """Plans windows anew by a forward search with at most so many expansions each."""

    def cheaper(
        state: Bits, goals: Bits, window: Sequence[GroundOperator], effort: Effort
    ) -> list[GroundOperator] | None:
        part = effort.part(expansions)
        answer = search.between(state, goals, _price(window)).run(part)
        effort.add(part)
        return answer.steps if answer is not None else None

    return cheaper


def _price(steps: Sequence[GroundOperator]) -> int:
    return sum(step.cost for step in steps)
