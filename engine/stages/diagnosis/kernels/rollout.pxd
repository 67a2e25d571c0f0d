# The types with which Cython compiles rollout.py. That file says what they mean.
import cython
cimport libc.math as math
from engine.stages.diagnosis.kernels.belief cimport Beliefs, Trail, rest_after, situation_of, stop, tells
from engine.stages.diagnosis.kernels.memo cimport Memo

cdef double inf
cdef int GAIN, PAIRS, CURES, MILD

@cython.final
cdef class Groups:
    cdef Py_ssize_t count
    cdef const long long[::1] group
    cdef double[::1] mass

@cython.locals(total=double, found=double, group=Py_ssize_t, cause=Py_ssize_t, part=double)
cdef double uncertainty(Trail trail, Py_ssize_t level, Groups groups, int rule) noexcept

@cython.locals(cost=double, situation=Py_ssize_t)
cdef double _price(Beliefs problem, Py_ssize_t action, long long rest, int rule) noexcept

@cython.locals(left=double, ended=double, outcome=Py_ssize_t, gain=double)
cdef double index(
    Beliefs problem, Groups groups, Py_ssize_t action, Trail trail, Py_ssize_t level, long long rest, int rule
) noexcept

@cython.locals(best=Py_ssize_t, value=double, action=Py_ssize_t, this=double)
cdef (Py_ssize_t, double) _preferred(
    Beliefs problem, Groups groups, Trail trail, Py_ssize_t level, long long rest, int rule
) noexcept

@cython.locals(best=Py_ssize_t, value=double)
cpdef Py_ssize_t greedy(
    Beliefs problem, Groups groups, Trail trail, Py_ssize_t level, long long rest, int rule
) noexcept

@cython.locals(
    causes="long long", at="long long", value=double, action=Py_ssize_t, going=double, outcome=Py_ssize_t,
    then="long long"
)
cpdef double follow(
    Beliefs problem, Groups groups, Memo table, Trail trail, Py_ssize_t level, long long rest, int rule
) noexcept

@cython.locals(least=double)
cdef double base_cost(
    Beliefs problem, Groups groups, tuple bases, Trail trail, Py_ssize_t level, long long rest
) noexcept

@cython.locals(
    best=Py_ssize_t, value=double, causes="long long", total=double, action=Py_ssize_t, going=double,
    outcome=Py_ssize_t, seen="long long", then="long long", left=double
)
cpdef (Py_ssize_t, double) look_ahead(
    Beliefs problem, Groups groups, tuple bases, Trail trail, Py_ssize_t level, long long rest, int steps, double limit
) noexcept
