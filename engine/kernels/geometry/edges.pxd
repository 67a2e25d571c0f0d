# Types with which Cython compiles edges.py. Its meaning is written there.
import cython
from libc cimport math
from cellwright.engine.kernels.geometry cimport checks, mechanism, room
from cellwright.engine.kernels.geometry.lanes cimport Lanes, Narrow
from cellwright.engine.kernels.geometry.layout cimport Pairs
from cellwright.engine.kernels.geometry.mechanism cimport Mechanism
from cellwright.engine.kernels.geometry.room cimport Room

cdef int LANES

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
    cdef Lanes lanes
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
@cython.locals(away=double, steps="long long", blocks="long long", stride="long long", b="long long")
cdef bint _swept(
    Edges e, const double[:, ::1] first, Py_ssize_t i, const double[:, ::1] second, Py_ssize_t j
) noexcept nogil
@cython.locals(lanes="unsigned int", share=double, s="long long", n=int, x=Py_ssize_t, g=Py_ssize_t)
cdef bint _block_touches(Edges e, long long steps, long long blocks, long long b) noexcept nogil
@cython.locals(x=Py_ssize_t, g=Py_ssize_t)
cdef bint _touches_in(Edges e, int n) noexcept nogil

@cython.locals(a="const double[:, ::1]", b="const double[:, ::1]", found="unsigned char[::1]", n=Py_ssize_t, free=int)
cpdef void free_edges(Edges e, object first, object second, object out) except *
