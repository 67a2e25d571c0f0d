# Types with which Cython compiles angles.py. Its meaning is written there.
import cython
from libc cimport math

ctypedef (double, double) Pair

cdef double LARGE, SHIFT, HALF_TURN, HALF_TURN_REST, FIRST, SECOND, THIRD

@cython.locals(n=double, r=double, z=double, s=double, c=double, half=double, whole=double, odd=bint, back=bint)
cpdef Pair sine_cosine(double x) noexcept nogil

@cython.locals(
    wide=double, high=double, endless=double, t=double, angle=double, rest=double, z=double, w=double, even=double, odd=double
)
cpdef double angle_of(double y, double x) noexcept nogil
cpdef double arc_cosine(double x) noexcept nogil
@cython.locals(n=Py_ssize_t, pair=Pair)
cdef void _fill(const double[::1] x, double[::1] s, double[::1] c) noexcept nogil
@cython.locals(n=Py_ssize_t)
cdef void _fill_angles(const double[::1] y, const double[::1] x, double[::1] found) noexcept nogil
