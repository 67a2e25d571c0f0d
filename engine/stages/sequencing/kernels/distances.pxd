# The types with which Cython compiles distances.py. That file says what they mean.
import cython
cimport libc.math as math

cdef int NARROW, WIDE, ROUNDED, RAISED, MANHATTAN, LARGEST, PSEUDO, MICROMETRES
cdef double LARGER

@cython.final
cdef class Distances:
    cdef readonly int n
    cdef int kind, dummy
    cdef bint grouped
    cdef const int[:, ::1] narrow
    cdef const long long[:, ::1] wide, extra
    cdef const double[:, ::1] points
    cdef const int[::1] group
    cdef const long long[::1] ends

    cpdef long long between(self, int a, int b) noexcept

    @cython.locals(x=double, y=double, z=double, exact=double, near="long long")
    cdef long long _length(self, int a, int b) noexcept

    @cython.locals(low="long long", rest=double)
    cdef long long _even(self, double value) noexcept
