# Types with which Cython compiles forward.py. Its meaning is written there.
import cython
from engine.kernels.geometry cimport angles

cdef void stand(double[:, :, :, ::1] out, Py_ssize_t n) noexcept nogil
cdef void place_joint(
    const double[:, :, ::1] origin, const double[:, ::1] axis, bint prismatic, Py_ssize_t parent, Py_ssize_t j,
    double value, Py_ssize_t n, double[:, :, :, ::1] out
) noexcept nogil

@cython.locals(
    up="const long long[::1]", fixed="const double[:, :, ::1]", along="const double[:, ::1]",
    slides="const unsigned char[::1]", values="const double[:, ::1]", poses="double[:, :, :, ::1]",
    n=Py_ssize_t, j=Py_ssize_t
)
cpdef void carriers(object parent, object origin, object axis, object prismatic, object q, object out) except *
