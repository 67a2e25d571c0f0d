# Types with which Cython compiles checks.py. Its meaning is written there.
import cython
from libc cimport math
from cellwright.engine.kernels.geometry cimport gjk, layout, room, segments, volumes
from cellwright.engine.kernels.geometry.distance cimport Separations
from cellwright.engine.kernels.geometry.layout cimport Pairs, Pieces
from cellwright.engine.kernels.geometry.room cimport Room

cdef double INFINITE

cdef bint touches(Room here, Py_ssize_t i, Py_ssize_t j, double by) noexcept nogil
cdef double separation(Room here, Separations s, Py_ssize_t i, Py_ssize_t j) noexcept nogil

@cython.locals(here=Room, found="long long[::1]", n=Py_ssize_t)
cpdef void first_contacts(object poses, Pieces p, Pairs q, object out) except *

cdef long long first_contact(Room here, Pairs q, Py_ssize_t n, double by) noexcept nogil
cdef long long first_of_group(Room here, Pairs q, Py_ssize_t g, Py_ssize_t n, double by) noexcept nogil
cdef bint _decided(Room here, Py_ssize_t i, Py_ssize_t j, Py_ssize_t n, double by) noexcept nogil

@cython.locals(here=Room, count="long long[::1]", n=Py_ssize_t, g=Py_ssize_t)
cpdef void count_hits(object poses, Pieces p, Pairs q, object hits) except *

@cython.locals(
    here=Room, s=Separations, least="double[::1]", number="long long[::1]", points="double[:, ::1]", n=Py_ssize_t
)
cpdef void nearest_pairs(
    object poses, Pieces p, Pairs q, double beyond, object distance, object pair, object witness
) except *

cdef bint fit(Room here, const long long[:, ::1] pairs) noexcept nogil

cdef void _nearest_pair(
    Room here, Separations s, Pairs q, Py_ssize_t n, double[::1] least, long long[::1] number, double[:, ::1] points
) noexcept nogil

@cython.locals(
    here=Room, s=Separations, asked="const long long[:, ::1]", each="double[::1]", points="double[:, ::1]",
    m=Py_ssize_t, i=Py_ssize_t, j=Py_ssize_t, x=Py_ssize_t
)
cpdef void near_pairs(
    object poses, Pieces p, object pairs, double within, object distance, object witness
) except *
