# The types with which Cython compiles temporal_network.py. The docstrings are in that file.
import cython

cdef class TemporalNetwork:
    cdef readonly int changes, nodes, edges
    cdef readonly long long epsilon, makespan
    cdef readonly bint consistent
    cdef int node_room, edge_room
    cdef readonly long long[::1] times
    cdef long long[::1] edge_gap
    cdef int[::1] out, queue, queued, edge_to, edge_next

    cdef void _clear_network(self) noexcept

    @cython.locals(node=int)
    cdef int _add_node(self)

    cdef void _grow_nodes(self)
    cdef void _grow_edges(self)

    @cython.locals(edge=int)
    cdef void _add_edge(self, int before, int after, long long gap)

    @cython.locals(head=int, size=int, room=int, node=int, edge=int, after=int, time="long long", place=int)
    cdef void _propagate(self, int first, int source) noexcept
