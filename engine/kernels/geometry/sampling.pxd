# Types with which Cython compiles sampling.py. Its meaning is written there.
import cython
from cellwright.engine.kernels.geometry cimport regions, room
from cellwright.engine.kernels.geometry.hierarchy cimport Hierarchy
from cellwright.engine.kernels.geometry.layout cimport Pieces
from cellwright.engine.kernels.geometry.regions cimport Walk
from cellwright.engine.kernels.geometry.room cimport Room

@cython.locals(
    here=Room, w=Walk, told="long long[:, ::1]", may="const unsigned char[:, ::1]", both="const long long[:, ::1]",
    n=Py_ssize_t, i=Py_ssize_t, r=Py_ssize_t, m=Py_ssize_t, count=Py_ssize_t
)
cpdef Py_ssize_t all_hits(
    object poses, Pieces asking, Pieces standing, Hierarchy tree, object pairs, object skip, object found
) except -1

cdef Py_ssize_t _tell(
    long long[:, ::1] told, Py_ssize_t count, Py_ssize_t n, Py_ssize_t i, Py_ssize_t other
) noexcept nogil
