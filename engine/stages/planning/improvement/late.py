"""The order of a plan in which steps that are dear or done again come as late as they can."""

from collections import Counter
from collections.abc import Sequence
from heapq import heapify, heappop, heappush

from engine.model.task import Bits, GroundOperator, Task, indices
from engine.stages.planning.variants import plainly


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
