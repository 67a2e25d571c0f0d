# Types with which Cython compiles regions.py. Its meaning is written there.
import cython
from libc cimport math

cdef double DOUBT

@cython.final
cdef class Grower:
    cdef const double[:, ::1] inverse
    cdef long long[:, ::1] label
    cdef long long[::1] queue
    cdef double[::1] sums
    cdef public double[::1] plane
    cdef readonly Py_ssize_t size
    cdef Py_ssize_t height, width, u0, v0
    cdef double w0

@cython.locals(n=double, uu=double, uv=double, vv=double, uw=double, vw=double, determinant=double, a=double, b=double)
cdef bint fit(Grower g) noexcept nogil
@cython.locals(i=int)
cdef void _begin(Grower g, Py_ssize_t u, Py_ssize_t v) noexcept nogil
@cython.locals(x=double, y=double, w=double)
cdef void _add(Grower g, Py_ssize_t u, Py_ssize_t v) noexcept nogil
cdef bint _free(Grower g, Py_ssize_t u, Py_ssize_t v) noexcept nogil
@cython.locals(x=Py_ssize_t, y=Py_ssize_t)
cpdef double block(Grower g, Py_ssize_t u, Py_ssize_t v, Py_ssize_t side) noexcept nogil
@cython.locals(x=Py_ssize_t, y=Py_ssize_t, square=double, apart=double)
cdef double _square(Grower g, Py_ssize_t u, Py_ssize_t v, Py_ssize_t side) noexcept nogil
@cython.locals(row=Py_ssize_t, column=Py_ssize_t, rows=Py_ssize_t, columns=Py_ssize_t, out="double[:, ::1]")
cpdef blocks(Grower g, Py_ssize_t side, Py_ssize_t stride)
cpdef Py_ssize_t grow(Grower g, long long number, double tolerance_m)
@cython.locals(
    first=Py_ssize_t, last=Py_ssize_t, due=Py_ssize_t, u=Py_ssize_t, v=Py_ssize_t, x=Py_ssize_t, y=Py_ssize_t, side=int, w=double
)
cdef Py_ssize_t _grow(Grower g, long long number, double tolerance_m) noexcept nogil
@cython.locals(i=Py_ssize_t)
cpdef void release(Grower g, long long number) noexcept nogil
