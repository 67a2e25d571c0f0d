"""A lower bound on the cost of all plans: the LM-cut heuristic of the initial state.

After Helmert & Domshlak, "Landmarks, critical paths and abstractions: what's the difference
anyway?" (ICAPS 2009). Deletes are ignored. A cut is a set of operators of which every plan has one.
It counts for the cheapest of them, all become cheaper by that, and the next cut is sought, until
the goal costs nothing.
"""

import heapq
from dataclasses import dataclass, field

from cellwright.engine.kernels.bits import Bits, indices
from cellwright.engine.model.ground_task import GroundOperator, GroundTask

FAR = 1 << 60
# conditions and effects that may be looked at; a bound that took so much is good enough
MAX_WORK = 500_000


def lower_bound(task: GroundTask, enough: int, most: int = MAX_WORK) -> int:
    """A cost that no plan of a task stays below. The search for a better bound ends at `enough`, or
    after so much work.

    Conditional effects count as if they always happened. With axioms or changes of quantities it is
    0.
    """
    if task.axioms is not None or any(each.changes for each in task.operators):
        return 0
    return min((_bound(task, goal, enough, most) for goal in task.goals), default=0)


def _bound(task: GroundTask, goal: Bits, enough: int, most: int) -> int:
    """The bound for one alternative of the goals."""
    cuts = _Relaxed.of(task, goal)
    total = 0
    while total < enough and cuts.work < most:
        cuts.evaluate()
        if cuts.values[cuts.goal] >= FAR:
            return FAR
        if cuts.values[cuts.goal] == 0:
            break
        total += cuts.cut()
    return total


@dataclass
class _Relaxed:
    """Operators without deletes. The last atom is true, the one before it the goal, which the last
    operator reaches.
    """

    needs: list[tuple[int, ...]]
    adds: list[tuple[int, ...]]
    costs: list[int]
    users: list[list[int]]
    adders: list[list[int]]
    initial: list[int]
    values: list[int] = field(default_factory=list)
    critical: list[int] = field(default_factory=list)
    work: int = 0

    @classmethod
    def of(cls, task: GroundTask, goal: Bits) -> "_Relaxed":
        """The relaxed task of one alternative of the goals."""
        true, reached = len(task.atoms) + 1, len(task.atoms)
        needs = [tuple(indices(each.preconditions)) or (true,) for each in task.operators]
        adds = [tuple(indices(_added_atoms(each))) for each in task.operators]
        needs.append(tuple(indices(goal)) or (true,))
        adds.append((reached,))
        costs = [*(each.cost for each in task.operators), 0]
        users: list[list[int]] = [[] for _ in range(true + 1)]
        adders: list[list[int]] = [[] for _ in range(true + 1)]
        for atoms, kept in ((needs, users), (adds, adders)):
            for number, own in enumerate(atoms):
                for atom in own:
                    kept[atom].append(number)
        return cls(needs, adds, costs, users, adders, [*indices(task.initial), true])

    @property
    def goal(self) -> int:
        """The atom that stands for the goal."""
        return len(self.users) - 2

    def evaluate(self) -> None:
        """The least cost of each atom, and for each operator the condition that is reached last
        (h^max).
        """
        self.values = [FAR] * len(self.users)
        self.critical = [-1] * len(self.needs)
        missing = list(map(len, self.needs))
        queue = [(0, atom) for atom in self.initial]
        for atom in self.initial:
            self.values[atom] = 0
        while queue:
            value, atom = heapq.heappop(queue)
            if value > self.values[atom]:
                continue
            self.work += len(self.users[atom])
            for number in self.users[atom]:
                missing[number] -= 1
                if missing[number]:
                    continue
                self.critical[number] = atom  # atoms come by their cost: the last one costs most
                reached = value + self.costs[number]
                for added in self.adds[number]:
                    if reached < self.values[added]:
                        self.values[added] = reached
                        heapq.heappush(queue, (reached, added))

    def cut(self) -> int:
        """The cost of the cheapest operator of a cut, by which all operators of the cut become
        cheaper.
        """
        near = self._goal_zone()
        own = self._crossing(near)
        least = min(self.costs[number] for number in own)
        for number in own:
            self.costs[number] -= least
        return least

    def _goal_zone(self) -> set[int]:
        """The atoms from which the goal is reached at no cost, by critical conditions."""
        zone, waiting = {self.goal}, [self.goal]
        while waiting:
            atom = waiting.pop()
            self.work += len(self.adders[atom])
            for number in self.adders[atom]:
                source = self.critical[number]
                if self.costs[number] == 0 and source >= 0 and source not in zone:
                    zone.add(source)
                    waiting.append(source)
        return zone

    def _crossing(self, zone: set[int]) -> set[int]:
        """The operators that lead into the goal zone from what is reached from the start outside
        it.
        """
        seen, waiting, own = set(self.initial), list(self.initial), set[int]()
        while waiting:
            atom = waiting.pop()
            self.work += len(self.users[atom])
            for number in self.users[atom]:
                if self.critical[number] != atom:
                    continue
                if not zone.isdisjoint(self.adds[number]):
                    own.add(number)
                    continue
                fresh = [added for added in self.adds[number] if added not in seen]
                seen.update(fresh)
                waiting.extend(fresh)
        return own


def _added_atoms(operator: GroundOperator) -> Bits:
    adds = operator.adds
    for effect in operator.conditional:
        adds |= effect.adds
    return adds
