# Types with which Cython compiles rays.py. Its meaning is written there.
import cython
from libc cimport math

cdef double NEAR
cdef long long NONE

@cython.final
cdef class Range:
    cdef readonly object depth, owner
    cdef double[:, ::1] _depth, plane
    cdef long long[:, ::1] _owner
    cdef Py_ssize_t height, width
    cdef double focal, cx, cy

@cython.locals(triangles="const double[:, :, ::1]", numbers="const long long[::1]", t=Py_ssize_t, count=Py_ssize_t)
cpdef draw(Range r, corners, owners)
@cython.locals(
    u0=double, u1=double, v0=double, v1=double, across=double, down=double, low=double, high=double, i=int,
    left=Py_ssize_t, right=Py_ssize_t, top=Py_ssize_t, bottom=Py_ssize_t, u=Py_ssize_t, v=Py_ssize_t,
    first=Py_ssize_t, last=Py_ssize_t, y=double, offset=double
)
cdef void _draw(Range r, const double[:, :, ::1] corners, Py_ssize_t t, long long owner) noexcept nogil
@cython.locals(low=double, high=double, rise=double, height=double, first=double, last=double, i=int)
cdef (Py_ssize_t, Py_ssize_t) _span(Range r, double y, double side, Py_ssize_t left, Py_ssize_t right) noexcept nogil
@cython.locals(x=double, a=double, b=double, c=double, slope=double, z=double)
cdef void _look(Range r, long long owner, Py_ssize_t u, Py_ssize_t v, double y, double offset) noexcept nogil
cdef Py_ssize_t _least(double pixel, Py_ssize_t low) noexcept nogil
cdef Py_ssize_t _most(double pixel, Py_ssize_t high) noexcept nogil
@cython.locals(i=int, j=int, x=int, y=int, z=int)
cdef double _planes(Range r, const double[:, :, ::1] corners, Py_ssize_t t) noexcept nogil
