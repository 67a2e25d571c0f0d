# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""A simple temporal network that holds the earliest time of each instant.

What must be apart in time is an edge (Dechter, Meiri & Pearl 1991); each new edge is propagated at
once. All times are whole numbers of one unit.

The module is plain Python. Cython compiles it with the types in `temporal_network.pxd`; without a
compiler it runs slowly.
"""

from array import array

from cellwright.engine.kernels.packed_rows import zero_ints, zero_longs


class TemporalNetwork:
    """Instants as nodes, least distances as edges, and the earliest times that follow.

    Node 0 is the start, and nodes 1 to `changes` are changes that happen by themselves: they do not
    count for the makespan.
    """

    def __init__(self, changes: int, epsilon: int) -> None:
        self.changes, self.epsilon = changes, epsilon
        self.node_room, self.edge_room = 1024, 8192
        self.times, self.out = zero_longs(self.node_room), zero_ints(self.node_room)
        self.queue, self.queued = zero_ints(self.node_room), zero_ints(self.node_room)
        self.edge_to, self.edge_next = zero_ints(self.edge_room), zero_ints(self.edge_room)
        self.edge_gap = zero_longs(self.edge_room)
        self._clear_network()

    def _clear_network(self) -> None:
        """Takes all nodes and edges out."""
        self.nodes = self.edges = 0
        self.makespan, self.consistent = 0, True

    def _add_node(self) -> int:
        if self.nodes == self.node_room:
            self._grow_nodes()
        node = self.nodes
        self.nodes += 1
        self.times[node], self.out[node], self.queued[node] = 0, -1, 0
        return node

    def _grow_nodes(self) -> None:
        more = self.node_room
        self.times = array("q", self.times) + zero_longs(more)
        self.out = array("i", self.out) + zero_ints(more)
        self.queue = array("i", self.queue) + zero_ints(more)
        self.queued = array("i", self.queued) + zero_ints(more)
        self.node_room = 2 * more

    def _grow_edges(self) -> None:
        more = self.edge_room
        self.edge_to = array("i", self.edge_to) + zero_ints(more)
        self.edge_next = array("i", self.edge_next) + zero_ints(more)
        self.edge_gap = array("q", self.edge_gap) + zero_longs(more)
        self.edge_room = 2 * more

    def _add_edge(self, before: int, after: int, gap: int) -> None:
        """`after` is at least `gap` after `before`.

        An edge that closes a cycle makes the timeline inconsistent.
        """
        if before == after:
            if gap > 0:
                self.consistent = False
            return
        if self.edges == self.edge_room:
            self._grow_edges()
        edge = self.edges
        self.edges += 1
        self.edge_to[edge], self.edge_gap[edge], self.edge_next[edge] = after, gap, self.out[before]
        self.out[before] = edge
        if self.times[before] + gap > self.times[after] and self.consistent:
            self.times[after] = self.times[before] + gap
            if after > self.changes and self.times[after] > self.makespan:
                self.makespan = self.times[after]
            self._propagate(after, before)

    def _propagate(self, first: int, source: int) -> None:
        """Moves what follows `first` to its earliest time.

        `source` may not move: then there is a cycle.
        """
        head, size = 0, 1
        room = self.node_room
        self.queue[0], self.queued[first] = first, 1
        while size > 0:
            node = self.queue[head]
            head = head + 1 if head + 1 < room else 0
            size -= 1
            self.queued[node] = 0
            edge = self.out[node]
            while edge >= 0:
                after = self.edge_to[edge]
                time = self.times[node] + self.edge_gap[edge]
                if time > self.times[after]:
                    if after == source or after == 0:
                        self.consistent = False
                        return
                    self.times[after] = time
                    if time > self.makespan and after > self.changes:
                        self.makespan = time
                    if self.queued[after] == 0:
                        self.queued[after] = 1
                        place = head + size
                        self.queue[place if place < room else place - room] = after
                        size += 1
                edge = self.edge_next[edge]
