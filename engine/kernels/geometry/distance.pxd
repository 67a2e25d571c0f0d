# Types with which Cython compiles distance.py. Its meaning is written there.
import cython
from cellwright.engine.kernels.geometry cimport depth, gjk
from cellwright.engine.kernels.geometry.depth cimport Polytope
from cellwright.engine.kernels.geometry.gjk cimport Cores

cdef double INFINITE

@cython.final
cdef class Separations:
    cdef Cores cores
    cdef Polytope polytope
    cdef double[::1] _found
    cdef readonly object found

    cdef double between(
        self, Py_ssize_t a, Py_ssize_t na, double ra, Py_ssize_t b, Py_ssize_t nb, double rb
    ) noexcept nogil
