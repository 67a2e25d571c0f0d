# The types with which Cython compiles memo.py. That file says what they mean.
import cython

cdef unsigned long long WORD, FIRST, SECOND, THIRD


@cython.final
cdef class Memo:
    cdef readonly long long[::1] possible
    cdef long long[::1] rest
    cdef double[::1] value
    cdef unsigned char[::1] exact
    cdef readonly long long length, budget, entries, expansions
    cdef readonly bint spent, full

    cpdef void resume(self, long long budget) noexcept

    @cython.locals(last="long long", mixed="unsigned long long", at="long long")
    cdef long long slot(self, unsigned long long possible, unsigned long long rest) noexcept

    cdef void enter(self, long long at, long long possible, long long rest, double value, bint exact) noexcept

    @cython.locals(at="long long")
    cdef double conclude(self, long long possible, long long rest, double floor, double limit) noexcept

    cdef void expand(self) noexcept

    @cython.locals(larger=Memo, i="long long", at="long long")
    cpdef Memo grown(self)
