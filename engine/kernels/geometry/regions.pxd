# Types with which Cython compiles regions.py. Its meaning is written there.
import cython
from engine.kernels.geometry cimport checks, room, volumes
from engine.kernels.geometry.distance cimport Separations
from engine.kernels.geometry.layout cimport Pieces, Tree
from engine.kernels.geometry.room cimport Room

@cython.final
cdef class Walk:
    cdef Py_ssize_t[::1] stack, seen
    cdef Py_ssize_t size
    cdef Tree tree

cdef void _begin(Walk w) noexcept nogil
cdef Py_ssize_t _next_solid(Walk w, Room here, Py_ssize_t asking, double by, Py_ssize_t number) noexcept nogil

@cython.locals(here=Room, w=Walk, told="unsigned char[:, ::1]", n=Py_ssize_t, r=Py_ssize_t, regions=Py_ssize_t)
cpdef void near_solids(Pieces p, Tree tree, double within, object near) except *

@cython.locals(
    here=Room, w=Walk, told="unsigned char[::1]", may="const unsigned char[:, ::1]", both="const long long[:, ::1]",
    n=Py_ssize_t, asking=Py_ssize_t
)
cpdef void first_hits(object poses, Pieces p, Tree tree, object pairs, object skip, object out) except *

cdef int _refuse_unless_fitting(
    Room here, Walk w, const long long[:, ::1] pairs, const unsigned char[:, ::1] skip, Py_ssize_t results
) except -1

cdef bint _pairs_touch(Room here, const long long[:, ::1] pairs) noexcept nogil
cdef bint _hits(
    Room here, Walk w, const unsigned char[:, ::1] skip, Py_ssize_t asking, Py_ssize_t number
) noexcept nogil

@cython.locals(
    here=Room, w=Walk, s=Separations, least="double[::1]", may="const unsigned char[:, ::1]",
    both="const long long[:, ::1]", n=Py_ssize_t, asking=Py_ssize_t, best=double
)
cpdef void nearest_hits(
    object poses, Pieces p, Tree tree, object pairs, object skip, double beyond, object distance
) except *

cdef double _nearest_of_pairs(
    Room here, Separations s, const long long[:, ::1] pairs, double best
) noexcept nogil
cdef double _nearest(
    Room here, Separations s, Walk w, const unsigned char[:, ::1] skip, Py_ssize_t asking, Py_ssize_t number, double best
) noexcept nogil
