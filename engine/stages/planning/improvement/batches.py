"""Fewer batches: the stretch around a step that is done twice is planned anew, as doing it once may serve all.

A step that serves many at once, such as a spin of all tubes that are inside, is worth waiting for. A search that looks for any
plan does it as soon as it can. Only forward searches plan these stretches, so that quantities and derived atoms are no obstacle.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product

from cellwright.engine.model.replay import early, reached_goals
from cellwright.engine.model.task import Bits, GroundOperator, Task
from cellwright.engine.stages.planning.effort import Effort, OutOfRange
from cellwright.engine.stages.planning.elimination import eliminate, reached
from cellwright.engine.stages.planning.improvement.late import late
from cellwright.engine.stages.planning.improvement.needless import without_needless
from cellwright.engine.stages.planning.improvement.rounds import Steps, cost
from cellwright.engine.stages.planning.improvement.stretches import Stretch, stretches
from cellwright.engine.stages.planning.variants import plainly

TRIES = 4  # searches for a stretch, which break ties differently
FIRST = 150  # expansions of such a search at first
MOST = 20_000  # expansions of such a search at most
PASS = 50  # generated nodes that take as long as looking at one step of a plan for order and need

Tried = set[tuple[Bits, Bits, int]]


def fewer(
    task: Task, steps: Sequence[GroundOperator], effort: Effort, growing: bool = False
) -> Iterator[Steps]:
    """The needed steps of a plan, then every cheaper plan that is found.

    There is none if the plan is too long for the effort. With `growing` the searches get ever longer, as long as there is
    effort.
    """
    if not _affords(effort, steps):
        return
    best, expansions = needed(task, steps, effort), FIRST
    yield best
    while not effort.over() and expansions <= MOST:
        tried: Tried = set()
        while (better := _better(task, best, effort, expansions, tried)) is not None:
            best = better
            yield best
        if not growing:
            return
        expansions *= 2


def needed(task: Task, steps: Sequence[GroundOperator], effort: Effort) -> Steps:
    """The steps of a plan that it needs, with every stage reached as early as possible if that bars none of them."""
    settled = early(task, steps)
    plain = [replace(each) for each in plainly(task, settled)]  # no two of them are the same object
    kept = {id(each) for each in eliminate(task.initial, plain, reached(task, settled))}
    left = [step for step, each in zip(settled, plain, strict=True) if id(each) in kept]
    left = left if _reaches(task, left) else settled
    if task.axioms is None:
        return left
    fewest = without_needless(task, left, effort)
    return fewest if _reaches(task, fewest) else left


def _better(task: Task, best: Steps, effort: Effort, expansions: int, tried: Tried) -> Steps | None:
    """A cheaper plan with one stretch planned anew; None if none is found.

    Every stretch is tried once before one is tried again.
    """
    if not _affords(effort, best):
        return None
    ordered = late(task, best)
    for seed, stretch in product(range(TRIES), stretches(task, ordered)):
        state = _after(task, ordered[: stretch.first])
        if effort.over():
            return None
        if state is None or (state, stretch.goals, seed) in tried:
            continue
        tried.add((state, stretch.goals, seed))
        part = effort.part(expansions)
        trial = _replaced(task, ordered, stretch, state, seed, part)
        effort.add(part)
        if trial and _affords(effort, trial) and cost(kept := needed(task, trial, effort)) < cost(best):
            return kept
    return None


def _replaced(
    task: Task, steps: Steps, stretch: Stretch, state: Bits, seed: int, effort: Effort
) -> Steps | None:
    """The plan with other steps in the place of a stretch, which begins in a state; None if none are found."""
    bound = sum(max(step.cost, 1) for step in steps[stretch.first : stretch.end])
    found = _anew(task, state, stretch, seed, bound, effort)
    if found is None:
        return None
    trial = [*steps[: stretch.first], *found, *steps[stretch.end :]]
    return trial if _reaches(task, trial) else None


def _affords(effort: Effort, steps: Sequence[GroundOperator]) -> bool:
    """Whether there is effort left after that of looking at each step, which is spent."""
    effort.generated += PASS * len(steps)
    return not effort.over()


def _anew(task: Task, state: Bits, stretch: Stretch, seed: int, bound: int, effort: Effort) -> Steps | None:
    """Steps from a state to what a stretch hands over, if they seem to cost less than `bound`; None if none are found."""
    from cellwright.engine.stages.planning.forward.search import Forward  # loads compiled kernels

    own, size, goals = task.operators, len(task.atoms), stretch.goals
    effort.generated += len(own)  # which the search packs first
    if effort.over():
        return None
    search = Forward(own, state, goals, size, seed, joint=True, bound=bound, axioms=task.axioms)
    try:
        answer = search.run(effort)
    except OutOfRange:
        return None
    return answer.steps if answer is not None else None


def _reaches(task: Task, steps: Sequence[GroundOperator]) -> bool:
    """Whether the steps can be done one after another, and lead to the goals."""
    state = _after(task, steps)
    return state is not None and reached_goals(task, state) is not None


def _after(task: Task, steps: Sequence[GroundOperator]) -> Bits | None:
    """The state after steps; None if one of them cannot be done."""
    state = task.initial
    for step in steps:
        if step.preconditions & ~state:
            return None
        state = task.after(state, step)
    return state
