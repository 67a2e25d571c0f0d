# Types with which Cython compiles raster.py. Its meaning is written there.
import cython
from libc cimport math

ctypedef (Py_ssize_t, Py_ssize_t) Range

cdef double FLAT

@cython.locals(n=Py_ssize_t)
cdef void _draw(const double[:, :, ::1] corners, double[:, ::1] depth, long long[:, ::1] number) noexcept
@cython.locals(
    ax=double, ay=double, az=double, bx=double, by=double, bz=double, cx=double, cy=double, cz=double, area=double,
    x=double, y=double, z=double, u=double, v=double, row=Py_ssize_t, column=Py_ssize_t, left=Py_ssize_t,
    right=Py_ssize_t, top=Py_ssize_t, bottom=Py_ssize_t
)
cdef void _fill(
    const double[:, :, ::1] corners, Py_ssize_t n, double[:, ::1] depth, long long[:, ::1] number
) noexcept nogil
cdef Range _pixels(double low, double high, Py_ssize_t count) noexcept nogil
