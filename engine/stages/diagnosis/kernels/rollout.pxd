# The types with which Cython compiles rollout.py. That file says what they mean.
import cython
cimport libc.math as math
from cellwright.engine.stages.diagnosis.kernels.belief cimport Beliefs, Trail, is_done, situation_of, stop, tells
from cellwright.engine.stages.diagnosis.kernels.memo cimport Memo

cdef double inf
cdef int GAIN, PAIRS, CURES, MILD

@cython.final
cdef class Groups:
    cdef const long long[::1] group
    cdef const unsigned char[::1] alone
    cdef const double[::1] dearest
    cdef double[::1] mass, own, parts, sums
    cdef readonly double worst, least
    cdef readonly Py_ssize_t width
    cdef bint together

    cpdef void limit(self, Py_ssize_t width, double least) noexcept

cdef double _spread(double part, double total, int rule) noexcept

@cython.locals(total=double, found=double, weight=double, place=Py_ssize_t, cause=Py_ssize_t, group=Py_ssize_t)
cdef double uncertainty(
    Beliefs problem, Trail trail, Py_ssize_t level, Groups groups, int rule, Py_ssize_t action, Py_ssize_t outcome
) noexcept

@cython.locals(place=Py_ssize_t, cause=Py_ssize_t, weight=double)
cdef double prepare(Beliefs problem, Trail trail, Py_ssize_t level, Groups groups, int rule) noexcept

@cython.locals(left=double, outcome=Py_ssize_t)
cdef double _left(
    Beliefs problem, Groups groups, Py_ssize_t action, Trail trail, Py_ssize_t level, int rule
) noexcept

@cython.locals(left=double, part=double, outcome=Py_ssize_t, place=Py_ssize_t, cause=Py_ssize_t)
cdef double _left_surely(
    Beliefs problem, Groups groups, Py_ssize_t action, Trail trail, Py_ssize_t level, int rule
) noexcept

@cython.locals(ended=double, outcome=Py_ssize_t, place=Py_ssize_t, cause=Py_ssize_t)
cdef double _ending(Beliefs problem, Trail trail, Py_ssize_t level, Py_ssize_t action) noexcept

@cython.locals(cost=double, situation=Py_ssize_t)
cdef double _price(Beliefs problem, Trail trail, Py_ssize_t level, Py_ssize_t action, int rule) noexcept

@cython.locals(gain=double)
cdef double index(
    Beliefs problem, Groups groups, Py_ssize_t action, Trail trail, Py_ssize_t level, int rule, double before
) noexcept

@cython.locals(best=Py_ssize_t, value=double, before=double, action=Py_ssize_t, this=double)
cdef (Py_ssize_t, double) _preferred(
    Beliefs problem, Groups groups, Trail trail, Py_ssize_t level, int rule
) noexcept

@cython.locals(best=Py_ssize_t, value=double)
cpdef Py_ssize_t greedy(Beliefs problem, Groups groups, Trail trail, Py_ssize_t level, int rule) noexcept

@cython.locals(cost=double, action=Py_ssize_t)
cpdef double at_most(Beliefs problem, Groups groups, Trail trail, Py_ssize_t level) noexcept

@cython.locals(at="long long", value=double, action=Py_ssize_t)
cpdef double follow(
    Beliefs problem, Groups groups, Memo table, Trail trail, Py_ssize_t level, int rule
) noexcept

@cython.locals(going=double, outcome=Py_ssize_t)
cdef double followed(
    Beliefs problem, Groups groups, Memo table, Trail trail, Py_ssize_t level, int rule, Py_ssize_t action
) noexcept

@cython.locals(least=double)
cdef double base_cost(Beliefs problem, Groups groups, tuple bases, Trail trail, Py_ssize_t level) noexcept

@cython.locals(count=Py_ssize_t, several=bint, before=double, action=Py_ssize_t, worth=double)
cdef Py_ssize_t candidates(Beliefs problem, Groups groups, Trail trail, Py_ssize_t level) noexcept

@cython.locals(best=Py_ssize_t, value=double, count=Py_ssize_t, rank=Py_ssize_t, action=Py_ssize_t, going=double)
cpdef (Py_ssize_t, double) look_ahead(
    Beliefs problem, Groups groups, tuple bases, Trail trail, Py_ssize_t level, int steps, double limit
) noexcept

@cython.locals(going=double, outcome=Py_ssize_t, going_on=bint)
cdef double _looked(
    Beliefs problem, Groups groups, tuple bases, Trail trail, Py_ssize_t level, int steps, Py_ssize_t action,
    double limit
) noexcept
