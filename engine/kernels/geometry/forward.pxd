# Types with which Cython compiles forward.py. Its meaning is written there.
from cellwright.engine.kernels.geometry cimport angles

cdef void stand(double[:, :, :, ::1] out, Py_ssize_t n) noexcept nogil
cdef void place_joint(
    const double[:, :, ::1] origin, const double[:, ::1] axis, bint prismatic, Py_ssize_t parent, Py_ssize_t j,
    double value, Py_ssize_t n, double[:, :, :, ::1] out
) noexcept nogil
