# The types with which Cython compiles taken.py. That file says what they mean.
import cython

cdef long long FOREVER
cdef int ROOM
cdef int ROUNDS
cdef long long FREE

@cython.final
cdef class Row:
    cdef int count, used, held, waiting, resources
    cdef bint whole
    cdef long long[::1] durations, uses, holds, waits

@cython.final
cdef class Taken:
    cdef int count
    cdef long long room
    cdef long long[::1] capacities, sizes, times, counts

    @cython.locals(first=int, last=int, place="long long", row="long long")
    cpdef object add(self, int resource, long long begin, long long end, int change)

    @cython.locals(use=int, hold=int, start="long long", end="long long", uses="long long[::1]", holds="long long[::1]")
    cpdef object mark(self, Row row, const long long[::1] starts, int change)

    @cython.locals(wide="long long", resource=int, place=int, times="long long[::1]", counts="long long[::1]")
    cdef void _widen(self) except *

    @cython.locals(low=int, high=int, middle=int, row="long long")
    cdef int _first_from(self, int resource, long long time) noexcept

    @cython.locals(size=int, place=int, other=int, row="long long")
    cdef int _cut(self, int resource, long long time) noexcept

    @cython.locals(size=int, other="long long", row="long long")
    cdef void _join(self, int resource, int place) noexcept

    @cython.locals(size=int, place=int, most="long long", row="long long")
    cpdef long long clash(self, int resource, long long begin, long long end) noexcept

    @cython.locals(last=int, _=int, waited=int, changed=bint, end="long long")
    cpdef bint raised(self, Row row, long long[::1] starts) except -1

    @cython.locals(changed=bint, now="long long", start="long long", until="long long", use=int, act=int, first=int, uses="long long[::1]")
    cdef bint _by_acts(self, Row row, long long[::1] starts) noexcept

    @cython.locals(changed=bint, hold=int, first=int, last=int, least="long long", until="long long", latest="long long", holds="long long[::1]")
    cdef bint _by_holds(self, Row row, long long[::1] starts, long long end) noexcept

    @cython.locals(changed=int, wait=int, act=int, other=int, least="long long", waits="long long[::1]")
    cdef int _by_waits(self, Row row, long long[::1] starts) noexcept
