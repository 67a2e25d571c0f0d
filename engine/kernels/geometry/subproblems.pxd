# Types with which Cython compiles subproblems.py. Its meaning is written there.
import cython
from libc cimport math
from cellwright.engine.kernels.geometry cimport angles, vectors
from cellwright.engine.kernels.geometry.vectors cimport Triple

cdef double SLACK, ALONG

cdef double angle_onto(Triple axis, Triple start, Triple end) noexcept nogil
cdef Triple angles_to_plane(Triple normal, Triple axis, Triple start, double offset) noexcept nogil
cdef Triple angles_to_angle(Triple normal, Triple axis, Triple start, Triple target) noexcept nogil
cdef double _between(Triple a, Triple b) noexcept nogil
