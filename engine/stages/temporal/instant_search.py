# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""Best-first search over sequences of starts and ends of actions: its tree, the states it has
reached, and the search.

The module is plain Python. Cython compiles it with the types in `instant_search.pxd`; without a
compiler it runs slowly.
"""

from array import array
from collections.abc import Sequence
from typing import Any

from cellwright.engine.kernels.packed_rows import zero_ints, zero_longs
from cellwright.engine.stages.temporal.key_heap import KeyHeap
from cellwright.engine.stages.temporal.timed_relaxation import TimedRelaxation
from cellwright.engine.stages.temporal.timeline import Timeline

INFINITE_COST = 1 << 60  # before the first evaluation
NO_GOAL = -2  # instead of a node, whose number is -1 for the first one


class SearchTree:
    """The tree of a search: the parent of each node, and the instant that leads to it."""

    def __init__(self, room: int) -> None:
        self.size, self.room = 0, room
        self.parents, self.codes, self.depths = zero_ints(room), zero_ints(room), zero_ints(room)

    def add(self, parent: int, code: int, depth: int) -> int:
        """A new node."""
        if self.size == self.room:
            more = self.room
            self.parents = array("i", self.parents) + zero_ints(more)
            self.codes = array("i", self.codes) + zero_ints(more)
            self.depths = array("i", self.depths) + zero_ints(more)
            self.room = 2 * more
        node = self.size
        self.size += 1
        self.parents[node], self.codes[node], self.depths[node] = parent, code, depth
        return node


class ReachedStates:
    """The least makespan with which each state was reached, in a table with open addressing."""

    def __init__(self, room: int) -> None:
        self.size, self.room = 0, room
        self.keys, self.least = zero_longs(room), zero_longs(room)

    def better(self, digest: int, makespan: int) -> bool:
        """Whether a state is new, or reached sooner than before; then it is noted."""
        if 2 * self.size >= self.room:
            self._grow()
        key = digest | 1
        place = key % self.room
        while self.keys[place] != 0:
            if self.keys[place] == key:
                if self.least[place] <= makespan:
                    return False
                self.least[place] = makespan
                return True
            place = place + 1 if place + 1 < self.room else 0
        self.keys[place], self.least[place] = key, makespan
        self.size += 1
        return True

    def _grow(self) -> None:
        keys, least, room = self.keys, self.least, self.room
        self.room = 2 * room
        self.keys, self.least = zero_longs(self.room), zero_longs(self.room)
        for old in range(room):
            if keys[old] != 0:
                place = keys[old] % self.room
                while self.keys[place] != 0:
                    place = place + 1 if place + 1 < self.room else 0
                self.keys[place], self.least[place] = keys[old], least[old]


class InstantSearch:
    """Best-first search over sequences of instants, with deferred evaluation and preferred
    instants (Richter & Helmert 2009).
    """

    def __init__(self, line: "Timeline", guide: "TimedRelaxation", poll: Any) -> None:
        self.line, self.guide, self.poll = line, guide, poll
        self.nodes = SearchTree(4096)
        self.every, self.preferred = KeyHeap(4096), KeyHeap(4096)
        self.expanded = self.best = 0
        self.tie = 1
        self.weight = 1.0
        self.greedy = self.cut = self.newest_first = 0
        self.pushed = 0
        self.path = zero_ints(4096)

    def run(
        self, prefix: Sequence[int], bound: int, most: int, most_nodes: int
    ) -> list[int] | None:
        """A sequence of codes that reaches the goal before `bound`; None if none was found
        within `most` expansions.
        """
        self.nodes = SearchTree(4096)
        self.every, self.preferred = KeyHeap(4096), KeyHeap(4096)
        self.seen = ReachedStates(1 << 13)
        self.expanded, self.best, self.bound = 0, INFINITE_COST, bound
        self.boost_every, self.boost_preferred = 0, 0
        self.at = -1
        node = -1
        for depth, code in enumerate(prefix):
            node = self.nodes.add(node, code, depth + 1)
        self.first = node
        goal = self._expand(node)
        while goal == NO_GOAL and self.expanded < most and self.nodes.size < most_nodes:
            if self.every.size + self.preferred.size == 0:
                break
            if self.poll.due(4000 + 10 * self.line.facts):
                break
            goal = self._expand(self._next())
        if goal == NO_GOAL:
            return None
        return self._sequence(goal)

    def _next(self) -> int:
        """The node that is looked at next, from the two queues in turn."""
        queue = self.every
        if self.every.size == 0 or (
            self.preferred.size > 0 and self.boost_preferred <= self.boost_every
        ):
            queue = self.preferred
            self.boost_preferred += 1
        else:
            self.boost_every += 1
        node = queue.heap[0]
        queue.pop()
        return node

    def _sequence(self, node: int) -> list[int]:
        codes = []
        while node >= 0:
            codes.append(self.nodes.codes[node])
            node = self.nodes.parents[node]
        codes.reverse()
        return codes

    def _replay(self, node: int) -> bool:
        """Brings the timeline to a node; False if that is not possible."""
        if node < 0:
            self.line.reset()
            return True
        if (
            self.at >= -1
            and self.at == self.nodes.parents[node]
            and (self.at >= 0 or self.line.nodes <= self.line.changes + 1)
        ):
            self.at = -2
            return self.line.apply(self.nodes.codes[node])
        self.at = -2
        depth = self.nodes.depths[node]
        if depth > self.path_room():
            self.path = zero_ints(2 * depth)
        ancestor = node
        for place in range(depth - 1, -1, -1):
            self.path[place] = self.nodes.codes[ancestor]
            ancestor = self.nodes.parents[ancestor]
        self.line.reset()
        for place in range(depth):  # noqa: SIM110 - a loop compiles to less than a generator
            if not self.line.apply(self.path[place]):
                return False
        return True

    def path_room(self) -> int:
        """How long a path may be."""
        return len(self.path)

    def _expand(self, node: int) -> int:
        """Looks at a node: the node if it is a goal (-1: the first), `NO_GOAL` if not."""
        if not self._replay(node):
            return NO_GOAL
        line = self.line
        self.at = node
        if line.makespan >= self.bound or not self.seen.better(line.digest(), 0):
            return NO_GOAL
        self.expanded += 1
        cost = self.guide.evaluate(line)
        if not self.guide.reachable or (self.cut and self.guide.estimate >= self.bound):
            return NO_GOAL
        if self.guide.length == 0 and line.opened == 0 and self._is_goal():
            return node
        if cost < self.best:
            self.best = cost
            self.boost_preferred -= 1000
        key = cost + int(self.weight * self.guide.estimate)
        depth = self.nodes.depths[node] + 1 if node >= 0 else 1
        self._push_helpful(node, depth, key)
        if not self.greedy:
            self._push_all(node, depth, key)
        return NO_GOAL

    def _key(self, key: int) -> int:
        """A key whose ties are broken in favour of the newest, or at random."""
        if self.newest_first:
            self.pushed = (self.pushed + 1) & 0xFFFFFF
            return key * 0x1000000 + 0xFFFFFF - self.pushed
        self.tie = (self.tie * 1103515245 + 12345) & 0x7FFFFFFF
        return key * 0x1000000 + (self.tie >> 7)

    def _push_helpful(self, node: int, depth: int, key: int) -> None:
        """The instants that relaxed plans begin with.

        Ends come a little later than starts: they can wait.
        """
        guide, line = self.guide, self.line
        self.tie = (self.tie * 1103515245 + 12345) & 0x7FFFFFFF
        shift = (self.tie >> 8) % guide.helping if guide.helping > 0 else 0
        for step in range(guide.helping):
            place = step + shift if step + shift < guide.helping else step + shift - guide.helping
            operator = guide.helpful[place]
            if operator < guide.actions and line.applicable(operator):
                self.preferred.push(self.nodes.add(node, operator, depth), self._key(key))
        self._push_ends(self.preferred, node, depth, key + 1)

    def _push_all(self, node: int, depth: int, key: int) -> None:
        """All instants that may come next."""
        guide, line = self.guide, self.line
        for place in range(guide.fitting):
            operator = guide.fits[place]
            if operator < guide.actions and line.applicable(operator):
                self.every.push(self.nodes.add(node, operator, depth), self._key(key))
        self._push_ends(self.every, node, depth, key + 1)

    def _push_ends(self, queue: "KeyHeap", node: int, depth: int, key: int) -> None:
        """The ends of open actions, and the next timed change."""
        line = self.line
        for place in range(line.opened):
            action = line.open_list[place]
            if line.can_end(action):
                queue.push(self.nodes.add(node, line.actions + action, depth), self._key(key))
        if line.passed < line.changes:
            change = 2 * line.actions + line.passed
            queue.push(self.nodes.add(node, change, depth), self._key(key))

    def _is_goal(self) -> bool:
        """Whether the goal holds after all that happens by itself."""
        line, guide = self.line, self.guide
        self.at = -2
        for change in range(line.passed, line.changes):
            if not line.apply(2 * line.actions + change):
                return False
        for place in range(guide.goals.starts[0], guide.goals.starts[1]):
            fact = guide.goals.items[place]
            if fact < line.facts:
                if line.state[fact] == 0:
                    return False
            elif not line.holds_test(guide.tests[fact - guide.first_test]):
                return False
        return True
