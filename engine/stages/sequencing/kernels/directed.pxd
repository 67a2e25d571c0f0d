# The types with which Cython compiles directed.py. That file says what they mean.
import cython
from cellwright.engine.stages.sequencing.kernels.twister cimport Stream

cdef int LONGEST

@cython.final
cdef class Orders:
    cdef int n, count, start, end
    cdef bint closed
    cdef long long late, wrong
    cdef int[::1] order, moved, rank
    cdef const long long[:, ::1] arcs, times, pairs

    @cython.locals(total="long long", late="long long", wrong="long long", clock="long long", step="long long", before=int, index=int, city=int, pair=int, first=int)
    cpdef long long price(self) noexcept

    @cython.locals(length=int, at=int, index=int, step=int)
    cdef void move(self, int first, int last, int behind, bint turned) noexcept

    @cython.locals(n=int, head=int, tail=int, before=int, beyond=int, left=int, right=int, change="long long")
    cdef long long difference(self, int first, int last, int behind) noexcept

    cdef int _city(self, int position) noexcept

@cython.final
cdef class Annealing:
    cdef Orders orders
    cdef Stream stream
    cdef int breadth, low, high, first, last, behind
    cdef readonly long long best
    cdef readonly int[::1] kept
    cdef int[::1] place
    cdef const int[:, ::1] near

    @cython.locals(now="long long", after="long long", turned=bint)
    cpdef double run(self, long long moves, double warmth, double cooling)

    @cython.locals(width=int, first=int, last=int, behind=int, city=int)
    cdef bint _propose(self) noexcept

    cdef long long _price_after(self, long long now, bint turned) noexcept

    @cython.locals(index=int, city=int)
    cdef void _take(self) noexcept

    @cython.locals(index=int)
    cdef void _keep(self) noexcept
