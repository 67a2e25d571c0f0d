# Types with which Cython compiles volumes.py. Its meaning is written there.
import cython
from libc cimport math
from cellwright.engine.kernels.geometry cimport layout
from cellwright.engine.kernels.geometry.room cimport Room

cpdef enum:
    APART = 0
    TOUCHING = 1
    UNDECIDED = 2

cdef int verdict(Room room, Py_ssize_t i, Py_ssize_t j, double by) noexcept nogil
@cython.locals(total=double, beyond=double)
cdef double _block_gap(Room room, Py_ssize_t j, double x, double y, double z) noexcept nogil
cdef bint _off_block(
    Room room, Py_ssize_t i, Py_ssize_t j, double x, double y, double z, double by
) noexcept nogil
