# Types with which Cython compiles samples.py. Its meaning is written there.
import cython
from libc cimport math

@cython.final
cdef class Samples:
    cdef const double[:, ::1] depth, points, normals
    cdef const double[::1] optics
    cdef double facing

@cython.locals(count=Py_ssize_t)
cpdef seen(Samples s, poses, double tolerance_m)
@cython.locals(
    h=Py_ssize_t, n=Py_ssize_t, x=double, y=double, z=double, nx=double, ny=double, nz=double, u=double, v=double, depth=double,
    row=Py_ssize_t, column=Py_ssize_t
)
cdef void _seen(
    Samples s, const double[:, :, ::1] poses, double tolerance_m, double[::1] agree, double[::1] through
) noexcept nogil
@cython.locals(a=double, b=double, c=double)
cdef (double, double) _row(
    const double[:, ::1] points, const double[:, ::1] normals, const double[:, :, ::1] poses, Py_ssize_t h, Py_ssize_t n,
    Py_ssize_t i
) noexcept nogil
