# Types with which Cython compiles room.py. Its meaning is written there.
import cython
from cellwright.engine.kernels.geometry cimport layout
from cellwright.engine.kernels.geometry.gjk cimport Cores
from cellwright.engine.kernels.geometry.layout cimport Pieces

@cython.final
cdef class Room:
    cdef readonly Py_ssize_t count, batch, most, first
    cdef const double[:, :, :, ::1] poses
    cdef const double[:, ::1] vertices, own
    cdef long long[:, ::1] stretch
    cdef double[::1] radius
    cdef const long long[::1] carrier
    cdef double[:, ::1] world, bounds
    cdef Py_ssize_t[::1] placed, moved
    cdef Cores cores
    cdef Pieces pieces

cdef void move_bounds(Room room, Py_ssize_t n) noexcept nogil
cdef void bounds_once(Room room, Py_ssize_t i, Py_ssize_t n) noexcept nogil
cdef void _place_bounds(Room room, Py_ssize_t n, Py_ssize_t i) noexcept nogil
cdef void _turn(Room room, Py_ssize_t n, Py_ssize_t k, Py_ssize_t i, Py_ssize_t at) noexcept nogil
cdef void place(Room room, Py_ssize_t n, Py_ssize_t i) noexcept nogil
cdef void move_vertices(Room room, Py_ssize_t n) noexcept nogil
cdef void forget(Room room) noexcept nogil
cdef void place_once(Room room, Py_ssize_t i, Py_ssize_t n) noexcept nogil
cdef void bring_bounds(Room room, Pieces visitors, Py_ssize_t r) noexcept nogil
cdef void bring(Room room, Pieces visitors, Py_ssize_t r) noexcept nogil
