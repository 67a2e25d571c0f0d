# The types with which Cython compiles graphs.py. That file says what they mean.
import cython

cdef double GRAIN
cdef int DIGIT

@cython.final
cdef class Graph:
    cdef int n, edges
    cdef const int[::1] first, second
    cdef const double[::1] cost
    cdef double[::1] weight
    cdef long long[::1] key
    cdef int[::1] order, spare, root, places

    @cython.locals(city=int, total=double)
    cpdef double weigh(self, const double[::1] penalty, int[::1] degree, double floor) except? -1

    @cython.locals(count=int, city=int, place=int, edge=int, a=int, b=int)
    cpdef int span(self, const double[::1] penalty, int cities, int[::1] found) except -1

    @cython.locals(city=int, place=int, at=int)
    cpdef int clusters(self, const int[::1] joining, int[::1] cluster) except -1

    @cython.locals(least=double, greatest=double, weight=double, edge=int)
    cdef long long _weights(self, const double[::1] penalty) noexcept

    @cython.locals(edge=int, shift=int)
    cdef void _sort(self, long long greatest) noexcept

    @cython.locals(digits=int, digit=int, edge=int, place=int)
    cdef void _sort_by(self, int shift) noexcept

    @cython.locals(taken=int, own=int, wanted=int, lacking=int, total=double, city=int, place=int, edge=int, a=int, b=int)
    cdef double _tree(self, int[::1] degree, double floor) noexcept

    cdef bint _joined(self, int a, int b) noexcept
