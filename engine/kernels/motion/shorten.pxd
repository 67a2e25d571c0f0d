# Types with which Cython compiles shorten.py. Its meaning is written there.
import cython
from libc cimport math
from cellwright.engine.kernels.geometry cimport edges
from cellwright.engine.kernels.geometry.edges cimport Edges
from cellwright.engine.kernels.motion cimport halton
from cellwright.engine.kernels.motion.halton cimport Halton

@cython.final
cdef class Route:
    cdef readonly object rows
    cdef readonly Py_ssize_t count
    cdef readonly Py_ssize_t size
    cdef double[:, ::1] _rows, ends
    cdef double[::1] along
    cdef Halton halton

cpdef void shorten(Route r, Edges e, Py_ssize_t tries, long long budget) except *
@cython.locals(i=Py_ssize_t, j=Py_ssize_t, free=int)
cdef int _skip_corners(Route r, Edges e, long long budget) except -1 nogil
@cython.locals(i=Py_ssize_t, close=bint, free=int)
cdef int _drop_close(Route r, Edges e) except -1 nogil
cdef void _cut(Route r, Py_ssize_t i, Py_ssize_t j, Py_ssize_t middle) noexcept nogil
cdef void _measure(Route r) noexcept nogil
@cython.locals(one=double, other=double, kept=double, i=Py_ssize_t, j=Py_ssize_t, free=int)
cdef int _bridge(Route r, Edges e, double window) except -1 nogil
@cython.locals(n=Py_ssize_t, length=double, t=double)
cdef Py_ssize_t _locate(Route r, double way, Py_ssize_t row) noexcept nogil
