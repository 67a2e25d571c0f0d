# Types with which Cython compiles regions.py. Its meaning is written there.
import cython
from cellwright.engine.kernels.geometry cimport checks, hierarchy, layout, room, volumes
from cellwright.engine.kernels.geometry.distance cimport Separations
from cellwright.engine.kernels.geometry.hierarchy cimport Hierarchy
from cellwright.engine.kernels.geometry.layout cimport Pieces
from cellwright.engine.kernels.geometry.room cimport Room

@cython.final
cdef class Walk:
    cdef Pieces standing
    cdef Hierarchy tree
    cdef long long[::1] open
    cdef double[::1] gaps, box
    cdef Py_ssize_t size

cdef void begin(Walk w, Room here, Py_ssize_t asking, double by) noexcept nogil
@cython.locals(x=Py_ssize_t, axis=Py_ssize_t, reach=double)
cdef void _surround(Walk w, Room here, Py_ssize_t asking) noexcept nogil
cdef void _open(Walk w, Py_ssize_t node, double square) noexcept nogil
@cython.locals(x=Py_ssize_t, total=double, above=double, below=double, beyond=double)
cdef double _gap(Walk w, Py_ssize_t node, double square) noexcept nogil
cdef Py_ssize_t next_within(Walk w, double by) noexcept nogil
cdef int _compared(Walk w, Room here, Py_ssize_t asking, Py_ssize_t r, double by) noexcept nogil
cdef bint meets(Walk w, Room here, Py_ssize_t asking, Py_ssize_t r, double by, Py_ssize_t n) noexcept nogil

@cython.locals(here=Room, w=Walk, told="long long[:, ::1]", n=Py_ssize_t, r=Py_ssize_t, count=Py_ssize_t)
cpdef Py_ssize_t near_pieces(
    Pieces asking, Pieces standing, Hierarchy tree, double within, object found
) except -1

@cython.locals(
    here=Room, w=Walk, told="unsigned char[::1]", may="const unsigned char[:, ::1]", both="const long long[:, ::1]",
    again="long long[:, ::1]", n=Py_ssize_t
)
cpdef void first_hits(
    object poses, Pieces asking, Pieces standing, Hierarchy tree, object pairs, object skip, object likely,
    object out
) except *

cdef int refuse_unless_fitting(
    Room here, Walk w, const long long[:, ::1] pairs, const unsigned char[:, ::1] skip, Py_ssize_t results
) except -1

cdef bint _pairs_touch(Room here, const long long[:, ::1] pairs, Py_ssize_t n) noexcept nogil
cdef bint both_touch(Room here, Py_ssize_t i, Py_ssize_t j, Py_ssize_t n) noexcept nogil
cdef bint _hit(Room here, Walk w, Py_ssize_t n, Py_ssize_t asking, Py_ssize_t other) noexcept nogil
@cython.locals(k=Py_ssize_t, side=Py_ssize_t, kept=Py_ssize_t)
cdef bint _hits_again(Room here, Walk w, Py_ssize_t n, long long[:, ::1] hit) noexcept nogil
@cython.locals(asking=Py_ssize_t, r=Py_ssize_t)
cdef bint _hits_one(
    Room here, Walk w, const unsigned char[:, ::1] skip, Py_ssize_t n, long long[:, ::1] hit
) noexcept nogil
@cython.locals(k=Py_ssize_t, last=Py_ssize_t)
cdef void _keep(long long[:, ::1] hit, Py_ssize_t asking, Py_ssize_t r) noexcept nogil

@cython.locals(
    here=Room, w=Walk, s=Separations, least="double[::1]", may="const unsigned char[:, ::1]",
    both="const long long[:, ::1]", n=Py_ssize_t, i=Py_ssize_t, best=double
)
cpdef void nearest_hits(
    object poses, Pieces asking, Pieces standing, Hierarchy tree, object pairs, object skip, double beyond,
    object distance
) except *

cdef double _nearest_of_pairs(
    Room here, Separations s, const long long[:, ::1] pairs, double best
) noexcept nogil
cdef double _nearest(
    Room here, Separations s, Walk w, const unsigned char[:, ::1] skip, Py_ssize_t asking, double best
) noexcept nogil
