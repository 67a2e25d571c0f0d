# The types with which Cython compiles cancellation.py. That file says what they mean.
import cython

@cython.final
cdef class Poll:
    cdef readonly object interrupted, error
    cdef long long every, left
    cdef readonly bint stopped

    cpdef bint due(self, long long work) noexcept

    cdef void _ask(self) noexcept
