# The types with which Cython compiles bypass_search.py. The docstrings are in that file.
import cython

cdef long long UNREACHED
cdef int NOTHING, NEW, OPEN, DONE

@cython.final
cdef class PointHeap:
    cdef readonly int size
    cdef int[::1] heap, places
    cdef long long[::1] keys

    @cython.locals(place=int)
    cdef void clear(self) noexcept

    @cython.locals(place=int, parent=int)
    cdef void push(self, int point, long long key) noexcept

    @cython.locals(first=int, last=int, key="long long", place=int, child=int)
    cdef int pop(self) noexcept

@cython.final
cdef class BypassSearch:
    cdef readonly int points, first_link, links, first_bypass, edges, room, depth
    cdef readonly int cycle_edge, cycle_point, closing_link, early_point, late_link
    cdef readonly int[::1] tails, heads, origins, parents, trees, starts, ends, stack
    cdef readonly long long[::1] weights, distances, most
    cdef int[::1] following, first_in, following_out, first_out, waiting, started, next_started, state, settled, is_settled, touched
    cdef long long[::1] slacks, potentials, lowered
    cdef int settled_count
    cdef PointHeap queue

    @cython.locals(edge=int)
    cdef void add_edge(self, int tail, int head, long long weight, int origin)

    cdef void _grow(self)

    @cython.locals(link=int)
    cpdef bint run(self)

    @cython.locals(round_number=int, changed=int, edge=int, tail=int, head=int, least="long long")
    cdef bint _find_potentials(self) noexcept

    @cython.locals(first=int, point=int, edge=int)
    cdef bint _has_loop(self) noexcept

    @cython.locals(link=int, needed=int)
    cdef bint _process(self, int first)

    @cython.locals(end=int, slack="long long", queue=PointHeap, row="long long", point=int, needed=int, edge=int, tail=int, distance="long long", own=bint)
    cdef int _explore(self, int link) noexcept

    @cython.locals(needed=int, link=int)
    cdef int _needed(self, int point) noexcept

    @cython.locals(start=int, slack="long long", point=int, place=int, weight="long long")
    cdef bint _bypass(self, int link)

    @cython.locals(known="long long")
    cdef bint _lower(self, int point, long long potential, int edge, int start) noexcept

    @cython.locals(point=int, edge=int, least="long long")
    cdef bint _spread(self, int start) noexcept

    @cython.locals(end=int, row="long long", queue=PointHeap, point=int, edge=int, head=int, distance="long long")
    cdef bint _waits_too_long(self, int link) noexcept
