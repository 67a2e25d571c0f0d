# Types with which Cython compiles mechanism.py. Its meaning is written there.
import cython
from cellwright.engine.kernels.geometry cimport forward

@cython.final
cdef class Mechanism:
    cdef readonly Py_ssize_t count
    cdef readonly object parents, origins, axes, sliding, travels
    cdef const long long[::1] parent
    cdef const double[:, :, ::1] origin
    cdef const double[:, ::1] axis
    cdef const unsigned char[::1] slides
    cdef const double[::1] travel

cdef void place_carriers(Mechanism m, const double[::1] at, Py_ssize_t n, double[:, :, :, ::1] poses) noexcept nogil

@cython.locals(values="const double[:, ::1]", poses="double[:, :, :, ::1]", n=Py_ssize_t, j=Py_ssize_t)
cpdef void place_batch(Mechanism m, object q, object out) except *
