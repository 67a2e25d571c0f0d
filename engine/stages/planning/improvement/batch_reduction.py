"""Fewer batches: the stretch around a step that is done twice is planned anew to do it once."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise, product
from typing import NamedTuple

from cellwright.engine.kernels.bits import Bits
from cellwright.engine.model.ground_task import GroundOperator, GroundTask
from cellwright.engine.model.workflow_replay import reach_stages_early, reached_goals
from cellwright.engine.stages.planning.action_elimination import (
    achieved_goal,
    eliminate_actions,
    without_needless,
)
from cellwright.engine.stages.planning.effect_variants import plain_steps
from cellwright.engine.stages.planning.improvement.plan_reordering import (
    delay_dear_steps,
    is_internal,
)
from cellwright.engine.stages.planning.improvement.window_optimisation import Steps, steps_cost
from cellwright.engine.stages.planning.search_control import Effort, OutOfRange
from cellwright.kb.terms import Function


class RepeatStretch(NamedTuple):
    """The steps from `first` to before `end`; `goals` are the fluents that later steps and the
    goals need of them.
    """

    first: int
    end: int
    goals: Bits


def repeat_stretches(task: GroundTask, steps: Sequence[GroundOperator]) -> list[RepeatStretch]:
    """Around each two times that a step is done, the dearest steps first.

    What serves both is within as many steps before and after them as are between them. A stretch
    begins and ends there where least is handed over: before a batch is begun, and after it is put
    away.
    """
    goals, final_goals = _needed_fluents(task, steps)
    size = [(goal & ~final_goals).bit_count() for goal in goals]
    candidates = []
    for before, first_time, two, after in _repeated_pairs(steps):
        near = two - first_time
        first = min(range(max(before + 1, first_time - near), first_time + 1), key=size.__getitem__)
        end = min(range(two + 1, min(after, two + near) + 1), key=size.__getitem__)
        candidates.append((-steps[first_time].cost, RepeatStretch(first, end, goals[end])))
    return list(dict.fromkeys(stretch for _, stretch in sorted(candidates)))


def _needed_fluents(task: GroundTask, steps: Sequence[GroundOperator]) -> tuple[list[Bits], Bits]:
    """The fluents that are needed before each step and at the end, and the last ones. Values of
    quantities are left out: later steps do not need just these."""
    fluents = -1 if task.axioms is None else (1 << task.axioms.size) - 1
    last = achieved_goal(task, steps) & fluents
    needs = [last]
    for step in reversed(plain_steps(task, steps)):
        needs.append((needs[-1] & ~step.adds | step.preconditions) & fluents)
    return needs[::-1], last


def _repeated_pairs(steps: Sequence[GroundOperator]) -> Iterator[tuple[int, int, int, int]]:
    """The places of each two times that a step is done, between those of the time before and the
    time after.

    Steps that serve many at once count as the same if they have the same operator.
    """
    places: dict[Function | str, list[int]] = {}
    for place, step in enumerate(steps):
        if not is_internal(step.instance):
            places.setdefault(step.instance.name if step.conditional else step.instance, []).append(
                place
            )
    for own in places.values():
        around = [-1, *own, len(steps)]
        for number, (one, two) in enumerate(pairwise(own)):
            yield around[number], one, two, around[number + 3]


STRETCH_TRIES = 4  # searches for a stretch, which break ties differently
FIRST_STRETCH_EXPANSIONS = 150  # expansions of such a search at first
MAX_STRETCH_EXPANSIONS = 20_000  # expansions of such a search at most
PASS_NODES_PER_STEP = (
    50  # generated nodes that take as long as looking at one step of a plan for order and need
)

Tried = set[tuple[Bits, Bits, int]]


def reduce_batches(
    task: GroundTask, steps: Sequence[GroundOperator], effort: Effort, growing: bool = False
) -> Iterator[Steps]:
    """The needed steps of a plan, then every cheaper plan that is found.

    There is none if the plan is too long for the effort. With `growing` the searches get ever
    longer, as long as there is effort.
    """
    if not _affords_look(effort, steps):
        return
    best, expansions = needed_steps(task, steps, effort), FIRST_STRETCH_EXPANSIONS
    yield best
    while not effort.over() and expansions <= MAX_STRETCH_EXPANSIONS:
        tried: Tried = set()
        while (better := _better_steps(task, best, effort, expansions, tried)) is not None:
            best = better
            yield best
        if not growing:
            return
        expansions *= 2


def needed_steps(task: GroundTask, steps: Sequence[GroundOperator], effort: Effort) -> Steps:
    """The steps of a plan that it needs, with every stage reached as early as possible if that
    bars none of them.
    """
    settled = reach_stages_early(task, steps)
    # no two of them are the same object
    plain = [replace(step) for step in plain_steps(task, settled)]
    kept_ids = {
        id(step) for step in eliminate_actions(task.initial, plain, achieved_goal(task, settled))
    }
    remaining = [
        step for step, plain_step in zip(settled, plain, strict=True) if id(plain_step) in kept_ids
    ]
    remaining = remaining if _reaches_goals(task, remaining) else settled
    if task.axioms is None:
        return remaining
    fewest = without_needless(task, remaining, effort)
    return fewest if _reaches_goals(task, fewest) else remaining


def _better_steps(
    task: GroundTask, best: Steps, effort: Effort, expansions: int, tried: Tried
) -> Steps | None:
    """A cheaper plan with one stretch planned anew; None if none is found.

    Every stretch is tried once before one is tried again.
    """
    if not _affords_look(effort, best):
        return None
    ordered = delay_dear_steps(task, best)
    for seed, stretch in product(range(STRETCH_TRIES), repeat_stretches(task, ordered)):
        state = _state_after(task, ordered[: stretch.first])
        if effort.over():
            return None
        if state is None or (state, stretch.goals, seed) in tried:
            continue
        tried.add((state, stretch.goals, seed))
        part = effort.part(expansions)
        trial = _replace_stretch(task, ordered, stretch, state, seed, part)
        effort.add(part)
        if (
            trial
            and _affords_look(effort, trial)
            and steps_cost(candidate := needed_steps(task, trial, effort)) < steps_cost(best)
        ):
            return candidate
    return None


def _replace_stretch(
    task: GroundTask, steps: Steps, stretch: RepeatStretch, state: Bits, seed: int, effort: Effort
) -> Steps | None:
    """The plan with other steps in the place of a stretch, which begins in a state; None if
    none are found.
    """
    bound = sum(max(step.cost, 1) for step in steps[stretch.first : stretch.end])
    replacement = _plan_stretch(task, state, stretch, seed, bound, effort)
    if replacement is None:
        return None
    trial = [*steps[: stretch.first], *replacement, *steps[stretch.end :]]
    return trial if _reaches_goals(task, trial) else None


def _affords_look(effort: Effort, steps: Sequence[GroundOperator]) -> bool:
    """Whether there is effort left after that of looking at each step, which is spent."""
    effort.generated += PASS_NODES_PER_STEP * len(steps)
    return not effort.over()


def _plan_stretch(
    task: GroundTask, state: Bits, stretch: RepeatStretch, seed: int, bound: int, effort: Effort
) -> Steps | None:
    """Steps from a state to what a stretch hands over, if they seem to cost less than `bound`;
    None if none are found.
    """
    from cellwright.engine.stages.planning.forward.forward_search import (
        ForwardSearch,  # loads compiled kernels
    )

    own, size, goals = task.operators, len(task.atoms), stretch.goals
    effort.generated += len(own)  # which the search packs first
    if effort.over():
        return None
    search = ForwardSearch(
        own, state, goals, size, seed, joint=True, bound=bound, axioms=task.axioms
    )
    try:
        answer = search.run(effort)
    except OutOfRange:
        return None
    return answer.steps if answer is not None else None


def _reaches_goals(task: GroundTask, steps: Sequence[GroundOperator]) -> bool:
    """Whether the steps can be done one after another, and lead to the goals."""
    state = _state_after(task, steps)
    return state is not None and reached_goals(task, state) is not None


def _state_after(task: GroundTask, steps: Sequence[GroundOperator]) -> Bits | None:
    """The state after steps; None if one of them cannot be done."""
    state = task.initial
    for step in steps:
        if step.preconditions & ~state:
            return None
        state = task.after(state, step)
    return state
