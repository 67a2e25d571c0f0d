"""Other orders of a plan: steps that are dear or done again as late as they can be, or what belongs together side by side."""

from collections import Counter
from collections.abc import Sequence
from heapq import heapify, heappop, heappush
from random import Random

from cellwright.engine.model.task import Bits, GroundOperator, Task, indices
from cellwright.engine.stages.planning.variants import plainly


def late(task: Task, steps: Sequence[GroundOperator]) -> list[GroundOperator]:
    """The same steps in an order with the same effect: cheap steps that are done once come as early as they can.

    Then nothing that can be done before a batch stands between two batches.
    """
    done = Counter(step.instance for step in steps)
    rank = [(done[step.instance] > 1, step.cost, place) for place, step in enumerate(steps)]
    before = [indices(each) for each in _before(plainly(task, steps))]
    after: list[list[int]] = [[] for _ in steps]
    for place, earlier in enumerate(before):
        for each in earlier:
            after[each].append(place)
    missing = [len(each) for each in before]
    ready = [rank[place] for place in range(len(steps)) if not missing[place]]
    heapify(ready)
    order = []
    while ready:
        place = heappop(ready)[-1]
        order.append(steps[place])
        for each in after[place]:
            missing[each] -= 1
            if not missing[each]:
                heappush(ready, rank[each])
    return order


def grouped(steps: Sequence[GroundOperator], chance: Random) -> list[GroundOperator]:
    """The same unconditional steps in an order with the same effect: before a step comes what it needs, if that is not done yet.

    So the steps of one errand stand side by side, which the plan may have mixed with others. Chance decides which errand is first.
    """
    before = [indices(each) for each in _before(steps)]
    needed = {place for own in before for place in own}
    last = [place for place in range(len(steps)) if place not in needed]
    order, seen = list[int](), set[int]()
    waiting = [(place, False) for place in chance.sample(last, len(last))]
    while waiting:
        place, ready = waiting.pop()
        if ready:
            order.append(place)
        elif place not in seen:
            seen.add(place)
            waiting += [(place, True), *((earlier, False) for earlier in before[place])]
    return [steps[place] for place in order]


def _before(steps: Sequence[GroundOperator]) -> list[Bits]:
    """For each unconditional step the earlier ones with which it must not change places."""
    adding: dict[int, Bits] = {}
    denying: dict[int, Bits] = {}
    touching: dict[int, Bits] = {}
    found = []
    for place, step in enumerate(steps):
        denied, touched, earlier = step.deletes & ~step.adds, step.adds | step.preconditions, 0
        for seen, atoms in ((touching, denied), (denying, touched), (adding, step.preconditions)):
            for atom in indices(atoms):
                earlier |= seen.get(atom, 0)
        for seen, atoms in ((touching, touched), (denying, denied), (adding, step.adds)):
            for atom in indices(atoms):
                seen[atom] = seen.get(atom, 0) | 1 << place
        found.append(earlier)
    return found
