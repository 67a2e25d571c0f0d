# Types with which Cython compiles layout.py. Its meaning is written there.
import cython

cpdef enum:
    CENTRE = 0
    BALL = 3
    AXES = 4
    HALF = 13
    RADIUS = 16
    KIND = 17

cpdef enum:
    BALL_ITSELF = 0
    BLOCK_ITSELF = 1
    NEITHER = 2

@cython.final
cdef class Pieces:
    cdef readonly object vertices, stretch, radius, carrier, bounds
    cdef readonly Py_ssize_t count, carriers, most
    cdef const double[:, ::1] _vertices, _bounds
    cdef const long long[:, ::1] _stretch
    cdef const double[::1] _radius
    cdef const long long[::1] _carrier

@cython.locals(i=Py_ssize_t)
cdef bint _within(Pieces p) noexcept

@cython.final
cdef class Pairs:
    cdef readonly object pairs, groups, after, order
    cdef readonly Py_ssize_t numbers
    cdef const long long[:, ::1] _pairs, _groups
    cdef const long long[::1] _after, _order
