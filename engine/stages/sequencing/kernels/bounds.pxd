# The types with which Cython compiles bounds.py. That file says what they mean.
import cython
from cellwright.engine.stages.sequencing.kernels.chain cimport Cost

cdef double GRAIN, WHOLE, INFINITE

@cython.final
cdef class Ascent:
    cdef double[::1] penalty, kept, last, near
    cdef int[::1] degree, parent, outside
    cdef double upper, size, best
    cdef int patience, vain
    cdef bint ended

@cython.locals(n=int, made=int, share=int, state=Ascent)
cpdef tuple ascend(const Cost[:, ::1] cost, penalty, double upper, int steps, double size, interrupted=*)

@cython.locals(n=int, step=int, city=int, bound=double, square=double, length=double, turn=double, way=double)
cdef int _climb(const Cost[:, ::1] cost, Ascent state, int steps) noexcept

@cython.locals(city=int)
cdef void _copy(const double[::1] source, double[::1] target) noexcept

cdef double _rounded(double value) noexcept

@cython.locals(n=int, near="double[::1]", outside="int[::1]")
cpdef double one_tree(const Cost[:, ::1] cost, const double[::1] penalty, int[::1] degree, int[::1] parent) except? -1

@cython.locals(n=int, city=int, rank=int, end=int, size=int, chosen=int, place=int, total=double, penalties=double)
cdef double _grow(const Cost[:, ::1] cost, const double[::1] penalty, int[::1] degree, int[::1] parent, double[::1] near, int[::1] outside) noexcept

@cython.locals(own=double, chosen=int, least=double, place=int, other=int, weight=double)
cdef int _nearest(const Cost[:, ::1] cost, const double[::1] penalty, int city, double[::1] near, int[::1] parent, int[::1] outside, int size) noexcept

@cython.locals(first=int, second=int, other=int, weight=double)
cdef int _cheapest(const Cost[:, ::1] cost, const double[::1] penalty, int rank) noexcept

@cython.locals(n=int, city=int, other=int, second=int, least=double, instead=double, weight=double, degree="int[::1]", parent="int[::1]", order="int[::1]", heaviest="double[::1]", weights="double[::1]", found="double[:, ::1]")
cpdef object excess(const Cost[:, ::1] cost, const double[::1] penalty)

@cython.locals(n=int, size=int, city=int, depth=int, at=int, level=int, placed="unsigned char[::1]")
cdef int _from_the_root(const int[::1] parent, int[::1] order, int[::1] trail) except -1

@cython.locals(at=int, index=int, value=double)
cdef void _heaviest(int start, const int[::1] parent, const int[::1] order, const double[::1] weights, double[::1] heaviest, int[::1] seen) noexcept
