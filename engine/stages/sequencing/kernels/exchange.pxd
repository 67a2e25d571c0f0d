# The types with which Cython compiles exchange.py. That file says what they mean.
import cython
from cellwright.engine.stages.sequencing.kernels.distances cimport Distances

cdef int ROOM, JOURNAL, TWO, TWO_TWICE, SWAPPED, TURNED

@cython.final
cdef class Ring:
    cdef int n, count, rows, written, head, size, kind, t2, t3, t4, t5, t6
    cdef Distances distances
    cdef bint noting
    cdef int[::1] tour, position, queue, waiting
    cdef int[:, ::1] journal, beside
    cdef long long[:, ::1] ways
    cdef const int[::1] mate
    cdef const int[:, ::1] near
    cdef const long long[:, ::1] toll

    @cython.locals(index=int)
    cdef void _begin(self) noexcept

    cdef long long edge(self, int a, int b) noexcept

    cdef long long link(self, int a, int b) noexcept

    cdef long long _closed(self, long long gain, long long best, int last, int first) noexcept

    cdef bint fixed(self, int a, int b) noexcept

    cdef void wake(self, int city) noexcept

    @cython.locals(n=int, length=int, a=int, b=int)
    cdef void reverse(self, int first, int last) noexcept

    cdef void note(self, int first, int last) noexcept

    @cython.locals(row=int)
    cdef void back(self) noexcept

    @cython.locals(row=int)
    cdef void forth(self) noexcept

    @cython.locals(gain="long long", city=int)
    cdef long long settle(self) noexcept

    @cython.locals(gain="long long", won="long long", idle=int, forward=bint)
    cdef long long _improve(self, int city) noexcept

    cdef void _wake_ends(self) noexcept

    @cython.locals(at=int)
    cdef int _step(self, bint forward, int city) noexcept

    @cython.locals(a=int, b=int, c=int)
    cdef bint _within(self, bint forward, int first, int city, int last) noexcept

    @cython.locals(t2=int, beyond=int, rank=int, t3=int, t4=int, best="long long", removed="long long", left="long long", gain="long long", closed="long long")
    cdef long long _best_exchange(self, int t1, bint forward) noexcept

    cdef void _keep(self, int kind, int t2, int t3, int t4, int t5, int t6) noexcept

    @cython.locals(follower=int, rank=int, t5=int, t6=int, left="long long", closed="long long")
    cdef long long _second_turn(self, bint forward, long long gain, long long best, int t1, int t2, int t3, int t4) noexcept

    @cython.locals(rank=int, side=int, t5=int, t6=int, left="long long", closed="long long")
    cdef long long _opened_cycle(self, bint forward, long long gain, long long best, int t1, int t2, int t3, int t4) noexcept

    @cython.locals(start=int, end=int, length=int)
    cdef bint _turn(self, bint forward, int first, int last) noexcept

    cdef void _apply(self, bint forward) noexcept
