# Types with which Cython compiles depth.py. Its meaning is written there.
import cython
from libc cimport math
from cellwright.engine.kernels.geometry cimport gjk, vectors
from cellwright.engine.kernels.geometry.gjk cimport Cores
from cellwright.engine.kernels.geometry.vectors cimport Triple

cdef int MAX_POINTS, MAX_FACES
cdef double INFINITE

@cython.final
cdef class Polytope:
    cdef Cores apart
    cdef double[:, ::1] planes
    cdef long long[:, ::1] faces, edges

cdef double core_depth(
    Cores c, Polytope p, Py_ssize_t a, Py_ssize_t na, Py_ssize_t b, Py_ssize_t nb, double[::1] out
) noexcept nogil
cdef bint _first_tetrahedron(
    Cores c, Py_ssize_t a, Py_ssize_t na, Py_ssize_t b, Py_ssize_t nb, double[::1] out
) noexcept nogil
cdef bint _third_and_fourth(
    Cores c, Py_ssize_t a, Py_ssize_t na, Py_ssize_t b, Py_ssize_t nb, double[::1] out, Triple line
) noexcept nogil
cdef void _copy(Cores c, Py_ssize_t start, Py_ssize_t end) noexcept nogil
cdef void _set_normal(double[::1] out, Triple normal) noexcept nogil
cdef Triple _aside(Triple axis) noexcept nogil
cdef Triple _normal(Polytope p, Py_ssize_t face) noexcept nogil
cdef void _first_faces(Cores c, Polytope p) noexcept nogil
cdef void _set_face(Cores c, Polytope p, Py_ssize_t f, Py_ssize_t i, Py_ssize_t j, Py_ssize_t k) noexcept nogil
cdef Py_ssize_t _nearest_face(Polytope p, Py_ssize_t count) noexcept nogil
cdef Py_ssize_t _grow(Cores c, Polytope p, Py_ssize_t new, Py_ssize_t count) noexcept nogil
cdef void _move_face(Polytope p, Py_ssize_t start, Py_ssize_t end) noexcept nogil
cdef Py_ssize_t _toggle(Polytope p, Py_ssize_t count, long long start, long long end) noexcept nogil
cdef void _deepest_points(
    Cores c, Polytope p, Py_ssize_t a, Py_ssize_t na, Py_ssize_t b, Py_ssize_t nb, Triple normal, double depth, double[::1] out
) noexcept nogil
