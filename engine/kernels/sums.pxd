# The types with which Cython compiles sums.py. That file says what they mean.
import cython

@cython.final
cdef class Comparisons:
    cdef int count, width
    cdef int[::1] starts, places, relations, atoms, others
    cdef long long[::1] factors, constants, totals

    @cython.locals(index=int, atom=int, found="unsigned char[::1]")
    cpdef bytes true(self, const long long[::1] values)

    @cython.locals(index=int)
    cpdef void add(self, const long long[::1] values) noexcept

    @cython.locals(held=bint)
    cpdef void look(self, int index, const long long[::1] values, unsigned char[::1] atoms) noexcept

    @cython.locals(place=int, total="long long")
    cdef long long _total(self, int index, const long long[::1] values) noexcept

cdef void _put(unsigned char[::1] atoms, int atom, bint held) noexcept

cdef bint _holds(long long total, int relation) noexcept

@cython.final
cdef class Repetitions:
    cdef Comparisons comparisons
    cdef int count
    cdef int[::1] tests, relations
    cdef long long[::1] gains, costs
    cdef object found

    @cython.locals(index=int, times="long long", found="long long[::1]")
    cpdef object needed(self, const long long[::1] values)

cdef long long _times(long long total, int relation, long long gain) noexcept
