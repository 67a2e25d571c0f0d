# The types with which Cython compiles dense.py. That file says what they mean.
import cython
from cellwright.engine.kernels.cancellation cimport Poll
from cellwright.engine.stages.diagnosis.kernels.belief cimport Beliefs, Trail, stop

@cython.final
cdef class States:
    cdef Beliefs problem
    cdef Trail trail
    cdef Py_ssize_t count
    cdef object found
    cdef const double[::1] prior
    cdef const long long[::1] radix, place
    cdef long long[::1] digits
    cdef double[::1] weights
    cdef double[:, ::1] values

    @cython.locals(problem=Beliefs, action=Py_ssize_t, cause=Py_ssize_t, digit="long long")
    cdef void _enter(self, long long number) noexcept

    @cython.locals(problem=Beliefs, after="long long", outcome="long long")
    cdef double _going(self, long long situation, long long number, Py_ssize_t action, double going) noexcept

    @cython.locals(
        problem=Beliefs, number="long long", total=double, stopping=double, situation=Py_ssize_t, best=double,
        action=Py_ssize_t, going=double
    )
    cdef void fill(self) noexcept

@cython.locals(states=States)
cpdef object values(Beliefs problem, object prior, object radix, Poll poll)
