# The types with which Cython compiles memo.py. That file says what they mean.
import cython

cdef unsigned long long WORD, FIRST, THIRD


@cython.final
cdef class Keys:
    cdef readonly Py_ssize_t width
    cdef unsigned long long[:, ::1] words

    @cython.locals(word=Py_ssize_t)
    cpdef object number(self, Py_ssize_t row, Py_ssize_t first, Py_ssize_t last)

    @cython.locals(word=Py_ssize_t)
    cpdef write(self, Py_ssize_t row, Py_ssize_t first, Py_ssize_t last, object number)


@cython.final
cdef class Memo:
    cdef readonly Keys keys
    cdef double[::1] value
    cdef unsigned char[::1] used, exact
    cdef readonly long long length, budget, entries, expansions
    cdef readonly Py_ssize_t width
    cdef readonly bint spent, full

    cpdef void resume(self, long long budget) noexcept

    cpdef void halt(self) noexcept

    @cython.locals(last="long long", mixed="unsigned long long", at="long long", word=Py_ssize_t)
    cdef long long slot(self, Keys keys, Py_ssize_t row) noexcept

    @cython.locals(word=Py_ssize_t)
    cdef bint _holds(self, long long at, Keys keys, Py_ssize_t row) noexcept

    @cython.locals(word=Py_ssize_t)
    cdef void enter(self, long long at, Keys keys, Py_ssize_t row, double value, bint exact) noexcept

    @cython.locals(at="long long")
    cdef double conclude(self, Keys keys, Py_ssize_t row, double floor, double limit) noexcept

    cdef void expand(self) noexcept

    @cython.locals(larger=Memo, i="long long", at="long long")
    cpdef Memo grown(self)
