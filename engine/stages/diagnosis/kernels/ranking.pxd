# The types with which Cython compiles ranking.py. That file says what they mean.
import cython

@cython.final
cdef class Ranking:
    cdef long long[:, ::1] order
    cdef double[:, ::1] values

    @cython.locals(place=Py_ssize_t)
    cdef Py_ssize_t insert(self, Py_ssize_t level, Py_ssize_t action, double value, Py_ssize_t count) noexcept
