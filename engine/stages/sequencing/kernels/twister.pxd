# The types with which Cython compiles twister.py. That file says what they mean.
import cython
cimport libc.math as math

cdef int SIZE, SHIFT
cdef unsigned int WORD, HIGH, LOW, TWIST, TEMPER, TEMPER_HIGH

@cython.final
cdef class Stream:
    cdef unsigned int[::1] words
    cdef int place

    @cython.locals(high="unsigned int", low="unsigned int")
    cpdef double random(self) noexcept

    @cython.locals(mask="unsigned int", found="unsigned int")
    cpdef int below(self, int count) noexcept

    cdef bint accepts(self, double exponent) noexcept

    @cython.locals(place=int)
    cdef void _begin(self, unsigned int word) noexcept

    @cython.locals(word="unsigned int")
    cdef unsigned int _word(self) noexcept

    @cython.locals(place=int, following=int, far=int, word="unsigned int")
    cdef void _turn(self) noexcept
