# Types with which Cython compiles edges.py. Its meaning is written there.
import cython
from libc cimport math
from engine.kernels.geometry cimport checks, forward, room
from engine.kernels.geometry.layout cimport Pairs, Pieces
from engine.kernels.geometry.room cimport Room

cdef double INFINITE

@cython.final
cdef class Mechanism:
    cdef readonly Py_ssize_t count
    cdef const long long[::1] parent
    cdef const double[:, :, ::1] origin
    cdef const double[:, ::1] axis
    cdef const unsigned char[::1] slides

cdef void place_carriers(Mechanism m, const double[::1] at, Py_ssize_t n, double[:, :, :, ::1] poses) noexcept nogil

@cython.final
cdef class Edges:
    cdef readonly Py_ssize_t count
    cdef readonly long long looked
    cdef readonly double step, margin
    cdef public object ask
    cdef bint foreign
    cdef Mechanism mechanism
    cdef Pairs pairs
    cdef Room room
    cdef double[:, :, :, ::1] poses
    cdef double[::1] at
    cdef Py_ssize_t latest

    cdef int free(
        self, const double[:, ::1] first, Py_ssize_t i, const double[:, ::1] second, Py_ssize_t j
    ) except -1 nogil

cdef int _asked(
    Edges e, const double[:, ::1] first, Py_ssize_t i, const double[:, ::1] second, Py_ssize_t j
) except -1 with gil
@cython.locals(total=double, away=double, x=Py_ssize_t)
cdef double length(
    const double[:, ::1] first, Py_ssize_t i, const double[:, ::1] second, Py_ssize_t j, Py_ssize_t count
) noexcept nogil
@cython.locals(away=double, steps="long long", stride="long long", s="long long", share=double)
cdef bint _swept(
    Edges e, const double[:, ::1] first, Py_ssize_t i, const double[:, ::1] second, Py_ssize_t j
) noexcept nogil
cdef bint _touches_at(
    Edges e, const double[:, ::1] first, Py_ssize_t i, const double[:, ::1] second, Py_ssize_t j, double t
) noexcept nogil
@cython.locals(g=Py_ssize_t, latest=Py_ssize_t)
cdef bint touches(Edges e) noexcept nogil

@cython.locals(a="const double[:, ::1]", b="const double[:, ::1]", found="unsigned char[::1]", n=Py_ssize_t, free=int)
cpdef void free_edges(Edges e, object first, object second, object out) except *
