# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False
"""Dynamic controllability in arrays: bounds that bypass uncertain links, found backwards.

The method is RUL (Cairo, Hunsberger & Rizzi 2018; in this order Hunsberger & Posenato 2021). An
edge from X to Y of weight w says that Y comes at most w after X. Each link has three edges: its
end comes at least `least` after its start; it may come as early as that (lower case); it may take
as long as `most` (upper case). The upper-case edge is no edge of the graph. Instead, from the end
of each link paths are followed backwards as long as they are shorter than what the link may vary
by. Where they become longer, the point gets an edge to the start of the link: it bypasses the
link. Such a path must not meet the start of a link whose own bypasses are not known yet: that link
comes first. If it waits for this one itself, the network is not controllable.

Points have potentials: no edge between them is shorter than their difference, so the paths are
found by Dijkstra's method. A new edge lowers potentials; if that comes round to where it began,
there is a negative cycle. The work is O(mn + k²n + kn log n) for n points, m bounds and k links.

At last comes what bypasses do not show: a point that waits for a link whose end it has to precede.

The module is plain Python. Cython compiles it with the types in `bypass_search.pxd`.
"""

from array import array
from collections.abc import Sequence
from typing import TypeAlias

Ints: TypeAlias = "array[int]"  # 32 bits each
Longs: TypeAlias = "array[int]"  # 64 bits each
UNREACHED = 1 << 60
NOTHING = -1
NEW, OPEN, DONE = 0, 1, 2  # how far a link is


def ints(length: int, value: int = 0) -> Ints:
    """An array of one number, 32 bits each."""
    return array("i", [value]) * length


def longs(length: int, value: int = 0) -> Longs:
    """An array of one number, 64 bits each."""
    return array("q", [value]) * length


class PointHeap:
    """Points ordered by key, in a binary heap; each is in it once at most."""

    def __init__(self, points: int) -> None:
        self.size = 0
        self.heap, self.places = ints(points + 1), ints(points, NOTHING)
        self.keys = longs(points)

    def clear(self) -> None:
        """Take everything out."""
        for place in range(self.size):
            self.places[self.heap[place]] = NOTHING
        self.size = 0

    def push(self, point: int, key: int) -> None:
        """Put a point in, or lower its key."""
        place = self.places[point]
        if place == NOTHING:
            place = self.size
            self.size += 1
        self.keys[point] = key
        while place > 0:
            parent = (place - 1) // 2
            if self.keys[self.heap[parent]] <= key:
                break
            self.heap[place] = self.heap[parent]
            self.places[self.heap[place]] = place
            place = parent
        self.heap[place] = point
        self.places[point] = place

    def pop(self) -> int:
        """Take out the point with the least key."""
        first, self.size = self.heap[0], self.size - 1
        self.places[first] = NOTHING
        if self.size:
            last = self.heap[self.size]
            key, place = self.keys[last], 0
            while 2 * place + 1 < self.size:
                child = 2 * place + 1
                if (
                    child + 1 < self.size
                    and self.keys[self.heap[child + 1]] < self.keys[self.heap[child]]
                ):
                    child += 1
                if key <= self.keys[self.heap[child]]:
                    break
                self.heap[place] = self.heap[child]
                self.places[self.heap[place]] = place
                place = child
            self.heap[place] = last
            self.places[last] = place
        return first


class BypassSearch:
    """The edges of a network, and the search for bypasses.

    Edges 0 to m-1 are bounds. Link i has edge m + 2i from its end to its start (it takes at least
    so long) and m + 2i + 1 from its start to its end (it may be as short as that). Bypasses come
    behind.
    """

    def __init__(
        self,
        points: int,
        bounds: Sequence[tuple[int, int, int]],
        links: Sequence[tuple[int, int, int, int]],
    ) -> None:
        """Bounds are (from, to, weight), links (start, end, least, most)."""
        self.points, self.first_link, self.links = points, len(bounds), len(links)
        self.first_bypass = self.first_link + 2 * self.links
        self.edges, self.room = 0, max(16, 4 * (self.first_bypass + points))
        self.tails, self.heads, self.following = ints(self.room), ints(self.room), ints(self.room)
        self.weights, self.origins = longs(self.room), ints(self.room)
        self.first_in, self.first_out = ints(points, NOTHING), ints(points, NOTHING)
        self.following_out = ints(self.room)
        for tail, head, weight in bounds:
            self.add_edge(tail, head, weight, NOTHING)
        self.starts, self.ends = ints(self.links + 1), ints(self.links + 1)
        self.most, self.slacks = longs(self.links + 1), longs(self.links + 1)
        self.started, self.next_started = ints(points, NOTHING), ints(self.links + 1)
        for link, (start, end, least, most) in enumerate(links):
            self.add_edge(end, start, -least, link)
            self.add_edge(start, end, least, link)
            self.starts[link], self.ends[link] = start, end
            self.most[link], self.slacks[link] = most, most - least
            self.next_started[link], self.started[start] = self.started[start], link
        self.state, self.stack = ints(self.links + 1), ints(self.links + 1)
        self.depth = 0
        self.potentials, self.distances = longs(points), longs(points)
        self.lowered, self.parents = longs(points), ints(points, NOTHING)
        self.trees = ints(max(1, self.links * points), NOTHING)
        self.waiting = ints(max(1, self.links * points))
        self.settled, self.settled_count = ints(points), 0
        self.is_settled, self.touched = ints(points), ints(points)
        self.queue = PointHeap(points)
        self.cycle_edge, self.cycle_point, self.closing_link = NOTHING, NOTHING, NOTHING
        self.early_point, self.late_link = NOTHING, NOTHING

    def add_edge(self, tail: int, head: int, weight: int, origin: int) -> None:
        """Add an edge."""
        if self.edges == self.room:
            self._grow()
        edge = self.edges
        self.edges += 1
        self.tails[edge], self.heads[edge], self.weights[edge] = tail, head, weight
        self.origins[edge] = origin
        self.following[edge], self.first_in[head] = self.first_in[head], edge
        self.following_out[edge], self.first_out[tail] = self.first_out[tail], edge

    def _grow(self) -> None:
        more, wide = ints(self.room), longs(self.room)
        self.tails, self.heads = array("i", self.tails) + more, array("i", self.heads) + more
        self.following = array("i", self.following) + more
        self.following_out = array("i", self.following_out) + more
        self.origins = array("i", self.origins) + more
        self.weights = array("q", self.weights) + wide
        self.room *= 2

    def run(self) -> bool:
        """Whether the network is controllable. If not, `cycle_point`, `cycle_edge`, `closing_link`
        or `late_link` is set.
        """
        if not self._find_potentials():
            return False
        for link in range(self.links):
            if self.state[link] == NEW and not self._process(link):
                return False
        for link in range(self.links):
            if self.slacks[link] > 0 and self._waits_too_long(link):
                return False
        return True

    def _find_potentials(self) -> bool:
        """Lower potentials until all edges fit (Bellman & Ford, by rounds).

        False if there is a negative cycle: `cycle_point` is in it, `parents` lead around.
        """
        for round_number in range(self.points + 1):
            changed = NOTHING
            for edge in range(self.edges):
                tail, head = self.tails[edge], self.heads[edge]
                least = self.weights[edge] + self.potentials[head]
                if least < self.potentials[tail]:
                    self.potentials[tail] = least
                    self.parents[tail] = edge
                    changed = tail
            if changed == NOTHING:
                return True
            if (round_number & 15 == 15 or round_number == self.points) and self._has_loop():
                return False
        return True

    def _has_loop(self) -> bool:
        """Whether parents come round to themselves; `cycle_point` is then on the loop."""
        for point in range(self.points):
            self.touched[point] = 0
        for first in range(self.points):
            point = first
            while point != NOTHING and self.touched[point] == 0:
                self.touched[point] = first + 1
                edge = self.parents[point]
                point = self.heads[edge] if edge != NOTHING else NOTHING
            if point != NOTHING and self.touched[point] == first + 1:
                self.cycle_point = point
                return True
        return False

    def _process(self, first: int) -> bool:
        """Find the bypasses of a link, and before of all links on which they depend."""
        self.depth = 1
        self.stack[0], self.state[first] = first, OPEN
        while self.depth:
            link = self.stack[self.depth - 1]
            needed = self._explore(link)
            if needed == NOTHING:
                if not self._bypass(link):
                    return False
                self.state[link] = DONE
                self.depth -= 1
            elif self.state[needed] == OPEN:
                self.closing_link = needed
                return False
            else:
                self.stack[self.depth], self.state[needed] = needed, OPEN
                self.depth += 1
        return True

    def _explore(self, link: int) -> int:
        """Distances of points to the end of a link, as far as they are less than its slack.

        NOTHING when all are known; else a link whose bypasses have to be known before.
        """
        end, slack, queue = self.ends[link], self.slacks[link], self.queue
        row = link * self.points
        for point in range(self.points):
            self.distances[point], self.is_settled[point] = UNREACHED, 0
            self.trees[row + point], self.waiting[row + point] = NOTHING, 0
        self.settled_count = 0
        queue.clear()
        self.distances[end] = 0
        queue.push(end, -self.potentials[end])
        while queue.size:
            point = queue.pop()
            self.is_settled[point] = 1
            self.settled[self.settled_count] = point
            self.settled_count += 1
            if self.distances[point] >= slack:
                continue
            self.waiting[row + point] = 1
            needed = self._needed(point)
            if needed != NOTHING:
                return needed
            edge = self.first_in[point]
            while edge != NOTHING:
                tail = self.tails[edge]
                distance = self.distances[point] + self.weights[edge]
                own = edge == self.first_link + 2 * link + 1
                if not own and not self.is_settled[tail] and distance < self.distances[tail]:
                    self.distances[tail] = distance
                    self.trees[row + tail] = edge
                    queue.push(tail, distance - self.potentials[tail])
                edge = self.following[edge]
        return NOTHING

    def _needed(self, point: int) -> int:
        """A link that begins in a point and is not done; one that is open if there is such."""
        needed, link = NOTHING, self.started[point]
        while link != NOTHING:
            if self.state[link] == OPEN:
                return link
            if self.state[link] == NEW:
                needed = link
            link = self.next_started[link]
        return needed

    def _bypass(self, link: int) -> bool:
        """Add the bypasses of a link that was explored, and lower potentials.

        False if there is a negative cycle: it closes with `cycle_edge`, `parents` lead on from its
        end to the start of the link.
        """
        start, slack = self.starts[link], self.slacks[link]
        self.queue.clear()
        for point in range(self.points):
            self.touched[point] = 0
        for place in range(self.settled_count):
            point = self.settled[place]
            if self.distances[point] < slack:
                continue
            weight = self.distances[point] - self.most[link]
            if point == start and weight >= 0:
                continue
            self.add_edge(point, start, weight, link)
            if not self._lower(point, weight + self.potentials[start], self.edges - 1, start):
                return False
        return self._spread(start)

    def _lower(self, point: int, potential: int, edge: int, start: int) -> bool:
        """Note that a potential has to be lower; False if that is the one of the start."""
        known = self.lowered[point] if self.touched[point] else self.potentials[point]
        if potential >= known:
            return True
        if point == start:
            self.cycle_edge = edge
            return False
        self.parents[point], self.lowered[point], self.touched[point] = edge, potential, 1
        self.queue.push(point, potential - self.potentials[point])
        return True

    def _spread(self, start: int) -> bool:
        """Lower the potentials of all points that an edge leads from to lowered ones."""
        while self.queue.size:
            point = self.queue.pop()
            self.potentials[point] = self.lowered[point]
            edge = self.first_in[point]
            while edge != NOTHING:
                least = self.weights[edge] + self.potentials[point]
                if not self._lower(self.tails[edge], least, edge, start):
                    return False
                edge = self.following[edge]
        return True

    def _waits_too_long(self, link: int) -> bool:
        """Whether a point waits for a link and has to come before its end: `early_point`.

        `parents` then lead from it back to the end of the link, along the shortest path.
        """
        end, row, queue = self.ends[link], link * self.points, self.queue
        for point in range(self.points):
            self.distances[point], self.is_settled[point] = UNREACHED, 0
        queue.clear()
        self.distances[end] = 0
        queue.push(end, self.potentials[end])
        while queue.size:
            point = queue.pop()
            self.is_settled[point] = 1
            if self.distances[point] < 0 and self.waiting[row + point]:
                self.early_point, self.late_link = point, link
                return True
            edge = self.first_out[point]
            while edge != NOTHING:
                head = self.heads[edge]
                distance = self.distances[point] + self.weights[edge]
                if not self.is_settled[head] and distance < self.distances[head]:
                    self.distances[head], self.parents[head] = distance, edge
                    queue.push(head, distance + self.potentials[head])
                edge = self.following_out[edge]
        return False
