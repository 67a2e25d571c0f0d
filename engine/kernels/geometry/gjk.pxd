# Types with which Cython compiles gjk.py. Its meaning is written there.
import cython
from libc cimport math
from cellwright.engine.kernels.geometry cimport vectors
from cellwright.engine.kernels.geometry.vectors cimport Triple

cdef int ROUNDS
cdef double INFINITE

@cython.final
cdef class Cores:
    cdef double[:, ::1] rows, corners
    cdef int size

cdef Triple row(Cores c, Py_ssize_t index) noexcept nogil
cdef Triple corner(Cores c, Py_ssize_t index) noexcept nogil
cdef Py_ssize_t farthest(Cores c, Py_ssize_t start, Py_ssize_t count, Triple direction) noexcept nogil
cdef Triple support(
    Cores c, Py_ssize_t a, Py_ssize_t na, Py_ssize_t b, Py_ssize_t nb, Triple direction, Py_ssize_t at
) noexcept nogil
@cython.locals(size=int, vv=double, reach=double)
cdef double core_distance(
    Cores c, Py_ssize_t a, Py_ssize_t na, Py_ssize_t b, Py_ssize_t nb, double limit
) noexcept nogil
cdef bint _repeated(Cores c, int size) noexcept nogil
@cython.locals(x=double, y=double, z=double)
cdef Triple _nearest(Cores c, int size) noexcept nogil
cdef int _reduce(Cores c, int size) noexcept nogil
cdef int _compressed(Cores c, int size) noexcept nogil
@cython.locals(outside=bint, left_out=int, opposite=int)
cdef bint _tetrahedron(Cores c) noexcept nogil
cdef bint _separates(Triple a, Triple b, Triple c, Triple d) noexcept nogil
cdef Triple triangle_weights(Triple a, Triple b, Triple c) noexcept nogil
cdef Triple _inner_weights(
    double d1, double d2, double d3, double d4, double d5, double d6, double vc
) noexcept nogil
cdef void nearest_points(Cores c, double[::1] out) noexcept nogil
