# Types with which Cython compiles inverse.py. Its meaning is written there.
import cython
from libc cimport math
from cellwright.engine.kernels.geometry cimport angles, subproblems, vectors
from cellwright.engine.kernels.geometry.vectors cimport Triple

cdef double INFINITE

@cython.final
cdef class Batch:
    cdef readonly Py_ssize_t count
    cdef double x, y, z
    cdef const double[:, ::1] h, o
    cdef const double[:, :, ::1] poses
    cdef double[:, :, ::1] q
    cdef double[:, ::1] valid

@cython.locals(arm=bint, poses=bint, q=bint)
cdef bint _fits(Batch e) noexcept

cdef Triple axis(Batch e, int joint) noexcept nogil
cdef Triple point(Batch e, int joint) noexcept nogil
cdef Triple centre_of(Batch e) noexcept nogil
cdef Triple rotate(Batch e, Py_ssize_t n, Triple v) noexcept nogil
cdef Triple rotate_back(Batch e, Py_ssize_t n, Triple v) noexcept nogil
cdef Triple moved(Batch e, Py_ssize_t n, Triple v) noexcept nogil
cpdef void spherical_wrist(Batch e) except *
cdef void _spherical_wrist(Batch e, Py_ssize_t n) noexcept nogil
cpdef void intersecting_axes(Batch e) except *
cdef void _intersecting_axes(Batch e, Py_ssize_t n) noexcept nogil
cdef double _wrist(Batch e, Py_ssize_t n, Py_ssize_t b) noexcept nogil
cdef Triple _back(Batch e, Py_ssize_t n, Py_ssize_t b, Triple v) noexcept nogil
cdef Triple _across(Triple axis) noexcept nogil
cpdef void parallel_axes(Batch e) except *
cdef void _parallel_axes(Batch e, Py_ssize_t n) noexcept nogil
cdef double _elbow(Batch e, Py_ssize_t n, Py_ssize_t b, Triple wrist) noexcept nogil
cdef (double, double) _hand(Batch e, Py_ssize_t n, Py_ssize_t b, Triple whole, Triple palm) noexcept nogil

@cython.locals(missed="double[:, ::1]", n=Py_ssize_t, b=Py_ssize_t)
cpdef void residuals(Batch e, object out) except *

cdef double _residual(Batch e, Py_ssize_t n, Py_ssize_t b) noexcept nogil
cdef double _largest(double worst, Triple v) noexcept nogil
