# The types with which Cython compiles instant_search.py. The docstrings are in that file.
import cython

from cellwright.engine.kernels.cancellation cimport Poll
from cellwright.engine.stages.temporal.key_heap cimport KeyHeap
from cellwright.engine.stages.temporal.timed_relaxation cimport TimedRelaxation
from cellwright.engine.stages.temporal.timeline cimport Timeline

cdef long long NO_GOAL, INFINITE_COST

@cython.final
cdef class SearchTree:
    cdef readonly int size, room
    cdef int[::1] parents, codes, depths

    @cython.locals(node=int, more=int)
    cdef int add(self, int parent, int code, int depth)

@cython.final
cdef class ReachedStates:
    cdef long long size, room
    cdef long long[::1] keys, least

    @cython.locals(key="long long", place="long long")
    cdef bint better(self, long long digest, long long makespan)

    @cython.locals(old="long long", place="long long", room="long long", keys="long long[::1]", least="long long[::1]")
    cdef void _grow(self)

@cython.final
cdef class InstantSearch:
    cdef Timeline line
    cdef TimedRelaxation guide
    cdef Poll poll
    cdef SearchTree nodes
    cdef KeyHeap every, preferred
    cdef ReachedStates seen
    cdef readonly long long expanded, best, bound
    cdef public long long tie
    cdef public double weight
    cdef public int greedy, cut, newest_first
    cdef long long pushed
    cdef long long boost_every, boost_preferred
    cdef int at, first
    cdef int[::1] path

    @cython.locals(queue=KeyHeap, node=int)
    cdef int _next(self)

    @cython.locals(depth=int, ancestor=int, place=int)
    cdef bint _replay(self, int node)

    cdef int path_room(self)

    @cython.locals(cost="long long", key="long long", depth=int, line=Timeline)
    cdef int _expand(self, int node)

    cdef long long _key(self, long long key) noexcept

    @cython.locals(place=int, operator=int, guide=TimedRelaxation, line=Timeline, shift=int, step=int)
    cdef void _push_helpful(self, int node, int depth, long long key)

    @cython.locals(place=int, operator=int, guide=TimedRelaxation, line=Timeline)
    cdef void _push_all(self, int node, int depth, long long key)

    @cython.locals(place=int, action=int, change=int, line=Timeline)
    cdef void _push_ends(self, KeyHeap queue, int node, int depth, long long key)

    @cython.locals(change=int, place=int, fact=int, guide=TimedRelaxation, line=Timeline)
    cdef bint _is_goal(self)
