"""Window optimisation: stretches of a plan are replaced by cheaper ones between the same points (in the spirit of
block deordering and window optimisation, Siddiqui & Haslum 2015).

A window is planned anew by regression in the space of what is near its first state. Between rounds the sequence is
arranged anew from its partial order, so that steps that serve each other come to stand in one window.
"""

from collections.abc import Sequence

from engine.model.task import Bits, GroundOperator, progress
from engine.planning.backward import Backward, Regression
from engine.planning.effort import Effort
from engine.planning.regression import BestFirst

WIDTHS = ((6, 500), (12, 1500))  # steps in a window, and the nodes that may be generated for it
SHARE = 32  # operators that cost as much as one node when a window's relaxed plans are made


def straighten(
    regression: Regression, initial: Bits, steps: Sequence[GroundOperator], goals: Bits, effort: Effort
) -> list[GroundOperator]:
    """The steps after a pass of a narrow window over them, then of a wide one, with every cheaper stretch put in."""
    kept = list(steps)
    for width, nodes in WIDTHS:
        kept = _pass(regression, initial, kept, goals, effort, width, nodes)
    return kept


def _pass(
    regression: Regression,
    initial: Bits,
    steps: Sequence[GroundOperator],
    goals: Bits,
    effort: Effort,
    width: int,
    nodes: int,
) -> list[GroundOperator]:
    kept = list(steps)
    start = 0
    while start < len(kept) and not effort.spent():
        states, needed = _states(initial, kept), _needed(kept, goals)
        end = min(start + width, len(kept))
        cheaper = _cheaper(regression, states[start], needed[end], kept[start:end], effort, nodes)
        if cheaper is not None:
            kept[start:end] = cheaper
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


def _cheaper(
    regression: Regression,
    state: Bits,
    goals: Bits,
    window: Sequence[GroundOperator],
    effort: Effort,
    nodes: int,
) -> list[GroundOperator] | None:
    """A cheaper way than `window` from a state to its goals, if one is found soon."""
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
    saved = sum(operator.cost for operator in window) - sum(operator.cost for operator in answer.steps)
    return answer.steps if saved > 0 else None
