# Types with which Cython compiles halton.py. Its meaning is written there.
import cython

@cython.final
cdef class Halton:
    cdef readonly Py_ssize_t count
    cdef readonly long long drawn
    cdef const long long[::1] bases
    cdef const double[::1] shift

cdef double inverse(long long index, long long base) noexcept nogil
cdef double coordinate(Halton h, Py_ssize_t x) noexcept nogil
