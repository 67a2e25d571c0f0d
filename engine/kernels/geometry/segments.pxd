# Types with which Cython compiles segments.py. Its meaning is written there.
import cython
from libc cimport math
from cellwright.engine.kernels.geometry cimport layout, vectors
from cellwright.engine.kernels.geometry.room cimport Room
from cellwright.engine.kernels.geometry.vectors cimport Triple

cpdef double segment_gap(Room room, Py_ssize_t i, Py_ssize_t j) noexcept nogil
cpdef double segment_block_gap(Room room, Py_ssize_t i, Py_ssize_t j) noexcept nogil
cdef Triple _end(Room room, Py_ssize_t i, bint last) noexcept nogil
cdef Triple _in_block(Room room, Triple point, Py_ssize_t j) noexcept nogil
cdef Triple _entries(Room room, Py_ssize_t j, Py_ssize_t at) noexcept nogil
cdef double _axis(Triple v, int axis) noexcept nogil
cdef double _beyond(double x, double half) noexcept nogil
cdef double _slope(Triple start, Triple step, Triple half, double t) noexcept nogil
cdef double _square(Triple start, Triple step, Triple half, double t) noexcept nogil
cdef double _clamped(double above, double below) noexcept nogil
