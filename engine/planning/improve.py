"""Makes a sequence of steps cheaper without losing its goals: steps nobody needs, and detours inside short windows."""

from collections.abc import Sequence

from engine.model.task import Bits, GroundOperator, progress
from engine.planning.backward import Backward, Effort
from engine.planning.regression import BestFirst


def eliminate(initial: Bits, steps: Sequence[GroundOperator], goals: Bits) -> list[GroundOperator]:
    """Action elimination (Nakhost & Müller 2010): drop a step, with all that then cannot run, if the goals still hold."""
    kept = list(steps)
    position = 0
    while position < len(kept):
        state, trial = initial, []
        for index, operator in enumerate(kept):
            if index != position and operator.preconditions & ~state == 0:
                trial.append(operator)
                state = progress(state, operator)
        if goals & ~state == 0:
            kept = trial
        else:
            position += 1
    return kept


def straighten(
    space: Backward, steps: Sequence[GroundOperator], goals: Bits, effort: Effort, width: int = 12
) -> list[GroundOperator]:
    """Replace windows of the plan by cheaper sequences between the same points, until none is found."""
    kept = list(steps)
    start = 0
    while start < len(kept) and not effort.spent():
        states = _states(space.initial, kept)
        needed = _needed(kept, goals)
        end = min(start + width, len(kept))
        window = kept[start:end]
        shorter = _cheaper(space, states[start], needed[end], window, effort)
        if shorter is not None:
            kept[start:end] = shorter
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
    space: Backward, state: Bits, goals: Bits, window: Sequence[GroundOperator], effort: Effort
) -> list[GroundOperator] | None:
    cost = sum(operator.cost for operator in window)
    local = Backward(space.operators, state, space.weights, space.excluded)
    root = local.root(goals)
    if root is None:
        return None
    slice_ = Effort(min(effort.expanded + 300, effort.limit), effort.interrupted, effort.expanded)
    answer = BestFirst(local, [root], 1).run(slice_)
    effort.expanded = slice_.expanded
    if answer is None or answer.steps is None:
        return None
    found = [space.operators[number] for number in answer.steps]
    return found if sum(operator.cost for operator in found) < cost else None
