# The types with which Cython compiles belief.py. That file says what they mean.
import cython
from cellwright.engine.kernels.cancellation cimport Poll
from cellwright.engine.stages.diagnosis.kernels.memo cimport Keys, Memo
from cellwright.engine.stages.diagnosis.kernels.ranking cimport Ranking

cdef double inf

@cython.final
cdef class Beliefs:
    cdef readonly object likelihoods, ends, repairs, shown, costs, following, losses, known, shifts, widths, before
    cdef readonly double slack
    cdef readonly long long situations
    cdef readonly Py_ssize_t causes, actions, outcomes, sets, words
    cdef Py_ssize_t conclusions, changes
    cdef const double[:, :, ::1] _likelihoods
    cdef const long long[:, ::1] _shown, _following
    cdef const unsigned char[:, ::1] _ends
    cdef const unsigned char[::1] _repairs
    cdef const double[:, ::1] _costs, _losses, _cures
    cdef const double[::1] _known, _least
    cdef const long long[::1] _shifts, _widths, _before

@cython.final
cdef class Trail:
    cdef readonly Keys keys
    cdef readonly Poll poll
    cdef double[:, ::1] weights
    cdef long long[:, ::1] members
    cdef readonly long long[::1] counts
    cdef Ranking ranking

    @cython.locals(count="long long", word=Py_ssize_t, cause=Py_ssize_t)
    cdef void enter(self, const double[::1] weights) noexcept

    @cython.locals(bit="unsigned long long")
    cdef unsigned long long _bit(self, long long cause) noexcept

    @cython.locals(total=double, place=Py_ssize_t)
    cdef double mass(self, Py_ssize_t level) noexcept

    @cython.locals(count="long long", place=Py_ssize_t, cause=Py_ssize_t, likelihood=double)
    cpdef long long follow(self, Beliefs problem, Py_ssize_t level, Py_ssize_t action, Py_ssize_t outcome) noexcept

    @cython.locals(word=Py_ssize_t, place=Py_ssize_t, cause=Py_ssize_t, situation="long long")
    cdef void _name(self, Beliefs problem, Py_ssize_t level, Py_ssize_t action, Py_ssize_t outcome) noexcept

    @cython.locals(earlier="long long", seen="long long")
    cdef void _note(self, Beliefs problem, Py_ssize_t level, long long action, long long digit) noexcept

    @cython.locals(shift="long long", word=Py_ssize_t, mask="unsigned long long")
    cdef void _put(self, Beliefs problem, Py_ssize_t level, long long action, long long digit) noexcept

@cython.locals(best=double, most=double, barred=double, loss=double, conclusion=Py_ssize_t, place=Py_ssize_t, cause=Py_ssize_t)
cpdef double stop(Beliefs problem, Trail trail, Py_ssize_t level) noexcept

@cython.locals(total=double, place=Py_ssize_t, cause=Py_ssize_t)
cpdef double floor_of(Beliefs problem, Trail trail, Py_ssize_t level) noexcept

@cython.locals(width="long long", shift="long long", word="unsigned long long", one="unsigned long long")
cpdef long long digit_of(Beliefs problem, Trail trail, Py_ssize_t level, Py_ssize_t action) noexcept

@cython.locals(earlier="long long")
cpdef bint is_done(Beliefs problem, Trail trail, Py_ssize_t level, Py_ssize_t action) noexcept

@cython.locals(saved=double, likelihood=double, outcome=Py_ssize_t, place=Py_ssize_t, cause=Py_ssize_t)
cdef double _ended(Beliefs problem, Trail trail, Py_ssize_t level, Py_ssize_t action) noexcept

@cython.locals(first=double, value=double, ends=bint, outcome=Py_ssize_t, place=Py_ssize_t)
cpdef bint tells(Beliefs problem, Trail trail, Py_ssize_t level, Py_ssize_t action) noexcept

cpdef long long situation_of(Beliefs problem, Trail trail, Py_ssize_t level) noexcept

@cython.locals(
    at="long long", stopping=double, base=double, least=double, total=double, situation="long long",
    action=Py_ssize_t, value=double
)
cdef double lower(Beliefs problem, Memo table, Trail trail, Py_ssize_t level) noexcept

@cython.locals(value=double, outcome=Py_ssize_t)
cpdef double estimate(Beliefs problem, Memo table, Trail trail, Py_ssize_t level, Py_ssize_t action) noexcept

@cython.locals(count=Py_ssize_t, action=Py_ssize_t, value=double)
cdef Py_ssize_t ranked(Beliefs problem, Memo table, Trail trail, Py_ssize_t level) noexcept

@cython.locals(value=double, outcome=Py_ssize_t, going=bint, guess=double)
cdef double begun(
    Beliefs problem, Memo table, Trail trail, Py_ssize_t level, Py_ssize_t action, double best
) noexcept

@cython.locals(known=double, count=Py_ssize_t, best=double, floor=double, rank=Py_ssize_t, value=double)
cpdef double solve(Beliefs problem, Memo table, Trail trail, Py_ssize_t level, double limit) noexcept
