# The types with which Cython compiles kicks.py. That file says what they mean.
import cython
from cellwright.engine.stages.sequencing.kernels.exchange cimport Ring
from cellwright.engine.stages.sequencing.kernels.twister cimport Stream

cdef int SEGMENT, WALK, SPAN, TRIES
cdef double SPATIAL

@cython.final
cdef class Kicker:
    cdef Ring ring
    cdef Stream stream
    cdef int n, breadth
    cdef int[::1] cuts, kept
    cdef bint stale
    cdef readonly long long gain, best_gain

    @cython.locals(index=int, won="long long")
    cpdef long long settle(self, int first, int last)

    cpdef void begin(self) noexcept

    cpdef object best(self)

    @cython.locals(change="long long")
    cpdef double anneal(self, long long kicks, double warmth, double cooling)

    cdef void _accept(self, long long change) noexcept

    @cython.locals(index=int)
    cdef void _remember(self) noexcept

    @cython.locals(loss="long long", place=int, last=int, first=int)
    cdef long long _kick(self) noexcept

    @cython.locals(place=int)
    cdef bint _cuts_fixed(self) noexcept

    cdef int _beside(self, int place, int side) noexcept

    cdef long long _new_edge(self, int place, int other) noexcept

    @cython.locals(city=int, place=int, longest=int, turn=int, path=int, first=int)
    cdef bint _near_cuts(self) noexcept

    @cython.locals(place=int, cut=int, at=int)
    cdef void _sort(self) noexcept

    @cython.locals(limit=int, place=int)
    cdef void _short_cuts(self) noexcept
