# The types with which Cython compiles belief.py. That file says what they mean.
import cython
from engine.stages.diagnosis.kernels.memo cimport Memo
from engine.stages.diagnosis.kernels.ranking cimport Ranking

cdef double inf

@cython.final
cdef class Beliefs:
    cdef readonly object likelihoods, masks, ends, repairs, costs, following, losses, known, shifts, widths
    cdef readonly long long situations
    cdef readonly Py_ssize_t causes, actions, outcomes
    cdef Py_ssize_t conclusions, changes
    cdef const double[:, :, ::1] _likelihoods
    cdef const long long[:, ::1] _masks, _following
    cdef const unsigned char[:, ::1] _ends
    cdef const unsigned char[::1] _repairs
    cdef const double[:, ::1] _costs, _losses
    cdef const double[::1] _known
    cdef const long long[::1] _shifts, _widths

@cython.final
cdef class Trail:
    cdef Py_ssize_t causes
    cdef double[:, ::1] weights
    cdef Ranking ranking

    @cython.locals(total=double, cause=Py_ssize_t)
    cdef double mass(self, Py_ssize_t level) noexcept

    @cython.locals(found="unsigned long long", bit="unsigned long long", cause=Py_ssize_t)
    cpdef long long possible(self, Py_ssize_t level) noexcept

    @cython.locals(cause=Py_ssize_t, likelihood=double)
    cdef void follow(self, Beliefs problem, Py_ssize_t level, Py_ssize_t action, Py_ssize_t outcome) noexcept

@cython.locals(best=double, loss=double, weight=double, conclusion=Py_ssize_t, cause=Py_ssize_t)
cpdef double stop(Beliefs problem, Trail trail, Py_ssize_t level) noexcept

@cython.locals(total=double, cause=Py_ssize_t)
cdef double floor_of(Beliefs problem, Trail trail, Py_ssize_t level) noexcept

cdef bint is_done(Beliefs problem, Py_ssize_t action, long long rest) noexcept

@cython.locals(saved=double, likelihood=double, outcome=Py_ssize_t, cause=Py_ssize_t)
cdef double _ended(Beliefs problem, Trail trail, Py_ssize_t level, Py_ssize_t action) noexcept

@cython.locals(first=double, value=double, ends=bint, outcome=Py_ssize_t, cause=Py_ssize_t)
cpdef bint tells(Beliefs problem, Trail trail, Py_ssize_t level, Py_ssize_t action, long long rest) noexcept

cpdef long long situation_of(Beliefs problem, long long rest) noexcept

@cython.locals(situation="long long", after="long long")
cpdef long long rest_after(Beliefs problem, Py_ssize_t action, long long outcome, long long rest) noexcept

@cython.locals(
    causes="long long", at="long long", stopping=double, base=double, least=double, total=double, situation="long long",
    action=Py_ssize_t, value=double
)
cdef double lower(Beliefs problem, Memo table, Trail trail, Py_ssize_t level, long long rest) noexcept

@cython.locals(value=double, outcome=Py_ssize_t)
cpdef double estimate(
    Beliefs problem, Memo table, Trail trail, Py_ssize_t level, Py_ssize_t action, long long causes, long long rest
) noexcept

@cython.locals(count=Py_ssize_t, action=Py_ssize_t, value=double)
cdef Py_ssize_t ranked(
    Beliefs problem, Memo table, Trail trail, Py_ssize_t level, long long causes, long long rest
) noexcept

@cython.locals(
    known=double, causes="long long", count=Py_ssize_t, floor=double, best=double, rank=Py_ssize_t, action=Py_ssize_t,
    value=double, outcome=Py_ssize_t, seen="long long", then="long long", guess=double
)
cpdef double solve(
    Beliefs problem, Memo table, Trail trail, Py_ssize_t level, long long rest, double limit
) noexcept
